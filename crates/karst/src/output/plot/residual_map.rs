//! Where in the picture corners were, and how far they are from where the calibrated camera expects them.

use super::*;
use serde::{Deserialize, Serialize};

/// A corner with its residual.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CornerResidual {
    /// Position, px.
    pub pixel: [f64; 2],
    /// Found minus expected, px.
    pub residual_px: [f64; 2],
    /// Whether it is an outlier.
    pub outlier: bool,
}

/// Residual map of one camera: corners as dots in its picture, residuals as lines from them, enlarged.
pub fn residual_map(title: &str, camera: &Camera, corners: &[CornerResidual]) -> Result<String, OutputError> {
    let [width, height] = camera.image_size_px.map(f64::from);
    let inside: Vec<&CornerResidual> = corners.iter().filter(|corner| !corner.outlier).collect();
    let square: f64 = inside.iter().map(|corner| corner.residual_px[0].hypot(corner.residual_px[1]).powi(2)).sum();
    let rms = (square / inside.len().max(1) as f64).sqrt();
    // A residual of the usual size as long as a thirtieth of the picture, in round numbers.
    let enlarged = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0]
        .into_iter()
        .take_while(|factor| factor * rms <= width / 30.0)
        .last()
        .unwrap_or(1.0);

    let mut legend = Legend::new(title);
    legend.add(Symbol::Dot(BLUE), "corner");
    legend.add(Symbol::Line(BLUE), &format!("residual, enlarged {enlarged} times"));
    if inside.len() < corners.len() {
        legend.add(Symbol::Cross(VERMILION), "outlier, not enlarged");
    }
    legend.add(Symbol::Line(GREY), "mirror and inner radius");
    legend.text(&format!("{} corners, {} of them inliers", corners.len(), inside.len()));
    legend.text(&format!("rms of the inliers {rms:.3} px"));

    const WIDTH: i32 = 1100;
    let plot_height = (f64::from(WIDTH) * height / width) as i32;
    svg(WIDTH + 130 + COLUMN, plot_height + 120, |root| {
        let (plot, column) = root.split_horizontally(WIDTH + 130);
        legend.draw(&column)?;
        // As in the picture, rows run down.
        let mut chart = chart(&plot, 0.0..width, height..0.0, ["x (px)", "y (px)"])?;
        if let Some(model) = camera.air.as_ref().or(camera.water.as_ref()) {
            for radius in [camera.mirror_radius_px, camera.inner_radius_px] {
                draw(&mut chart, [PathElement::new(circle(model.centre_px.into(), radius), GREY.stroke_width(2))])?;
            }
        }
        for corner in corners {
            let [x, y] = corner.pixel;
            let factor = if corner.outlier { 1.0 } else { enlarged };
            let colour = if corner.outlier { VERMILION } else { BLUE };
            let end = [0, 1].map(|axis| corner.pixel[axis] + factor * corner.residual_px[axis]);
            // A wild outlier would be drawn over the edge of the chart.
            if (0.0..width).contains(&end[0]) && (0.0..height).contains(&end[1]) {
                draw(&mut chart, [PathElement::new([(x, y), end.into()], colour.mix(0.8).stroke_width(2))])?;
            }
            if corner.outlier {
                draw(&mut chart, [Cross::new((x, y), 7, VERMILION.stroke_width(3))])?;
            } else {
                draw(&mut chart, [Circle::new((x, y), 3, BLUE.filled())])?;
            }
        }
        Ok(())
    })
}
