//! Plots as SVG: cross-section, error over range, and the rig.
//!
//! Colours are those of Okabe and Ito, which the colour-blind tell apart. The backend places everything on whole
//! units, so the canvas is about twice as large as the plot is meant to be shown: scale it down through its view box.

use super::summary::{Summary, range_error_mm};
use super::{OutputError, viridis};
use crate::result::{LaserResult, Section};
use karst_rig::{Camera, CameraModel, Rig, Tube, Water};
use nalgebra::{Point3, Vector2};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::element::{Drawable, PointCollection};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::fmt::Display;
use std::ops::Range;

mod budget;
mod residual_map;

pub use budget::budget_plot;
pub use residual_map::{CornerResidual, residual_map};

const INK: RGBColor = RGBColor(45, 45, 45);
const GREY: RGBColor = RGBColor(120, 120, 120);
const RULE: RGBColor = RGBColor(214, 214, 214);
const WATER: RGBColor = RGBColor(233, 243, 250);
const BLUE: RGBColor = RGBColor(0, 114, 178);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const ORANGE: RGBColor = RGBColor(230, 159, 0);
const VERMILION: RGBColor = RGBColor(213, 94, 0);
const CAMERAS: [RGBColor; 2] = [BLUE, ORANGE];

/// Font sizes, canvas units.
const TITLE: i32 = 36;
const TEXT: i32 = 28;
const SMALL: i32 = 25;
/// Width of the column with the legend, canvas units.
const COLUMN: i32 = 560;
/// Height of a line in the legend, canvas units.
const LINE: i32 = 44;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Place = (f64, f64);

fn failed(error: impl Display) -> OutputError {
    OutputError::Plot(error.to_string())
}

/// Largest coordinate that is drawn, m: what is farther, or not a number, is a mistake that would ruin the scale.
const FARTHEST_M: f64 = 1000.0;

fn drawable(value: f64) -> bool {
    value.abs() <= FARTHEST_M
}

/// Place of a position in the cross-section, m. None: not drawable.
fn in_metres(x_mm: f64, y_mm: f64) -> Option<Place> {
    let (x, y) = (x_mm / 1000.0, y_mm / 1000.0);
    (drawable(x) && drawable(y)).then_some((x, y))
}

/// Cross-section of the cave as one frame measured it, seen along the axis: points with their standard deviations, the
/// truth where it is known, and range rings. `outline_mm` is the true wall in the belt plane as a closed line (x, y);
/// empty: unknown.
pub fn section_plot(section: &Section, outline_mm: &[[f64; 2]]) -> Result<String, OutputError> {
    let outline: Vec<Place> = outline_mm.iter().filter_map(|&[x, y]| in_metres(x, y)).collect();
    let measured = measured(section);
    let truth: Vec<(usize, Place, bool)> = section
        .lasers
        .iter()
        .filter_map(|laser| {
            let [x, y, _] = laser.truth.as_ref()?.position_mm?;
            Some((laser.laser, in_metres(x, y)?, laser.point.is_some()))
        })
        .collect();
    let radius = measured
        .iter()
        .map(|m| m.at)
        .chain(truth.iter().map(|t| t.1))
        .chain(outline.iter().copied())
        .map(|(x, y)| x.hypot(y))
        .fold(0.0, f64::max);
    let extent = 1.16 * radius.max(0.1);
    // Standard deviations are millimetres in metres of cave: enlarge them until the largest can be seen.
    let largest = measured.iter().filter_map(|m| m.sigma).fold(0.0, f64::max);
    let enlarged = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0]
        .into_iter()
        .take_while(|factor| factor * largest <= 0.09 * extent)
        .last()
        .unwrap_or(1.0);

    let summary = Summary::new(&[section]);
    let mut legend = Legend::new("Cross-section");
    legend.text(&section.frame);
    legend.add(Symbol::Dot(BLUE), "measured point, laser number");
    if largest > 0.0 {
        legend.add(Symbol::Bar(BLUE), &format!("±1 σ along the beam, enlarged {enlarged} times"));
    }
    legend.add(Symbol::Line(BLUE), "polygon through the points, dashed over gaps");
    if !outline.is_empty() {
        legend.add(Symbol::Patch(WATER.to_rgba()), "true cross-section");
    }
    if !truth.is_empty() {
        legend.add(Symbol::Ring(INK), "true point on the beam");
    }
    if truth.iter().any(|&(_, _, found)| !found) {
        legend.add(Symbol::Cross(VERMILION), "true point, not measured");
    }
    legend.text(&format!("{} of {} lasers gave a point", summary.points, summary.lasers));
    legend.figure("mean σ", summary.mean_sigma_mm, "mm");
    legend.figure("rms range error", summary.rms_error_mm, "mm");
    legend.figure("mean |error|", summary.mean_error_percent, "% of range");
    legend.figure("mean χ² per degree of freedom", summary.mean_chi2_per_dof, "");
    legend.text(&format!("method: {} ({})", section.method, section.arithmetic));
    legend.text("view along the axis, from camera 2");

    const SIZE: i32 = 1100;
    svg(SIZE + 130 + COLUMN, SIZE + 120, |root| {
        let (plot, column) = root.split_horizontally(SIZE + 130);
        legend.draw(&column)?;
        let mut chart = chart(&plot, -extent..extent, -extent..extent, ["x (m)", "y (m)"])?;
        draw(&mut chart, [Polygon::new(outline.clone(), WATER.filled())])?;
        range_rings(&mut chart, extent)?;
        for at in measured.iter().map(|m| m.at).chain(truth.iter().map(|t| t.1)) {
            draw(&mut chart, [PathElement::new([(0.0, 0.0), at], GREEN.mix(0.35).stroke_width(2))])?;
        }
        draw(&mut chart, [PathElement::new(closed(&outline), GREY.stroke_width(2))])?;
        for side in sides(&measured, section.lasers.len()) {
            if side.whole {
                draw(&mut chart, [PathElement::new(side.ends, BLUE.mix(0.8).stroke_width(3))])?;
            } else {
                dashes(&mut chart, side.ends, BLUE.mix(0.6))?;
            }
        }
        for &(_, at, found) in &truth {
            if found {
                draw(&mut chart, [Circle::new(at, 11, INK.stroke_width(2))])?;
            } else {
                draw(&mut chart, [Cross::new(at, 11, VERMILION.stroke_width(4))])?;
            }
        }
        for point in &measured {
            if let Some(sigma) = point.sigma {
                error_bar(&mut chart, point.at, unit(point.at), enlarged * sigma, 0.008 * extent, BLUE)?;
            }
            draw(&mut chart, [Circle::new(point.at, 7, BLUE.filled())])?;
        }
        let labels = measured
            .iter()
            .map(|m| (m.laser, m.at, enlarged * m.sigma.unwrap_or(0.0), BLUE))
            .chain(truth.iter().filter(|t| !t.2).map(|&(laser, at, _)| (laser, at, 0.0, VERMILION)));
        for (laser, (x, y), bar, colour) in labels {
            let outwards = unit((x, y));
            let distance = bar + 0.05 * extent;
            let at = (x + distance * outwards.0, y + distance * outwards.1);
            label(&mut chart, laser.to_string(), at, SMALL + 2, colour, HPos::Center)?;
        }
        draw(&mut chart, [Cross::new((0.0, 0.0), 8, INK.stroke_width(2))])
    })
}

/// A point in the cross-section, m.
struct Measured {
    laser: usize,
    at: Place,
    sigma: Option<f64>,
}

fn measured(section: &Section) -> Vec<Measured> {
    let point = |laser: &LaserResult| {
        let point = laser.point.as_ref()?;
        let sigma = point.sigma_mm.map(|s| s / 1000.0).filter(|s| drawable(*s));
        Some(Measured { laser: laser.laser, at: in_metres(point.position_mm[0], point.position_mm[1])?, sigma })
    };
    section.lasers.iter().filter_map(point).collect()
}

/// The cross-sections of all frames over one another, dark for the first frame to bright for the last.
pub fn sequence_plot(sections: &[&Section]) -> Result<String, OutputError> {
    let frames: Vec<Vec<Measured>> = sections.iter().map(|section| measured(section)).collect();
    let radius = frames.iter().flatten().map(|m| m.at.0.hypot(m.at.1)).fold(0.0, f64::max);
    let extent = 1.16 * radius.max(0.1);
    let colour = |frame: usize| {
        // Without the brightest fifth: yellow on white is hard to see.
        let [red, green, blue] = viridis(0.8 * frame as f64 / frames.len().saturating_sub(1).max(1) as f64);
        RGBColor(red, green, blue)
    };

    let summary = Summary::new(sections);
    let mut legend = Legend::new("All cross-sections");
    // Five frames tell the scale.
    let mut shown: Vec<usize> = (0..5).map(|i| i * sections.len().saturating_sub(1) / 4).collect();
    shown.dedup();
    for (frame, section) in shown.into_iter().filter_map(|frame| Some((frame, sections.get(frame)?))) {
        legend.add(Symbol::Line(colour(frame)), &section.frame);
    }
    legend.text(&format!("{} frames, {} points", summary.frames, summary.points));
    legend.text("in the rig frame: the instrument's own");
    legend.text("motion is not known");
    legend.text("view along the axis, from camera 2");

    const SIZE: i32 = 1100;
    svg(SIZE + 130 + COLUMN, SIZE + 120, |root| {
        let (plot, column) = root.split_horizontally(SIZE + 130);
        legend.draw(&column)?;
        let mut chart = chart(&plot, -extent..extent, -extent..extent, ["x (m)", "y (m)"])?;
        range_rings(&mut chart, extent)?;
        for (frame, points) in frames.iter().enumerate() {
            let colour = colour(frame);
            let sides = sides(points, sections[frame].lasers.len()).filter(|side| side.whole);
            draw(&mut chart, sides.map(|side| PathElement::new(side.ends, colour.mix(0.7).stroke_width(2))))?;
            draw(&mut chart, points.iter().map(|point| Circle::new(point.at, 4, colour.filled())))?;
        }
        draw(&mut chart, [Cross::new((0.0, 0.0), 8, INK.stroke_width(2))])
    })
}

/// A side of the polygon through the points.
struct Side {
    ends: [Place; 2],
    /// Between neighbouring lasers. A line over a laser without a point would claim a wall that nobody measured.
    whole: bool,
}

fn sides(points: &[Measured], lasers: usize) -> impl Iterator<Item = Side> {
    points
        .iter()
        .zip(points.iter().cycle().skip(1))
        .map(move |(from, to)| Side { ends: [from.at, to.at], whole: (from.laser + 1) % lasers == to.laser })
}

/// Range error over true range with the standard deviation of every point. None: the truth of no point is known.
pub fn error_plot(sections: &[&Section]) -> Result<Option<String>, OutputError> {
    let points: Vec<(f64, f64, Option<f64>)> = sections
        .iter()
        .flat_map(|section| &section.lasers)
        .filter_map(|laser| {
            let range = laser.truth.as_ref()?.range_mm? / 1000.0;
            let sigma = laser.point.as_ref()?.sigma_mm.filter(|s| drawable(s / 1000.0));
            Some((range, range_error_mm(laser)?, sigma))
        })
        .filter(|&(range, error, _)| drawable(range) && drawable(error / 1000.0))
        .collect();
    if points.is_empty() {
        return Ok(None);
    }
    let farthest = points.iter().map(|p| p.0).fold(0.0, f64::max);
    let reach = |p: &(f64, f64, Option<f64>)| p.1.abs() + p.2.unwrap_or(0.0);
    let height = 1.15 * points.iter().map(reach).fold(0.1, f64::max);
    let width = 1.08 * farthest.max(0.1);
    let with_sigma = points.iter().any(|p| p.2.is_some());

    let summary = Summary::new(sections);
    let mut legend = Legend::new("Range error");
    legend.add(Symbol::Dot(BLUE), "measured - true range");
    if with_sigma {
        legend.add(Symbol::Bar(BLUE), "±1 σ as reported");
        let inside = points.iter().filter(|p| p.2.is_some_and(|s| p.1.abs() <= s)).count();
        let all = points.iter().filter(|p| p.2.is_some()).count();
        legend.text(&format!("{inside} of {all} errors within 1 σ (68 % expected)"));
    }
    legend.figure("bias", summary.bias_mm, "mm");
    legend.figure("rms", summary.rms_error_mm, "mm");
    legend.figure("largest", summary.worst_error_mm, "mm");
    legend.figure("mean |error|", summary.mean_error_percent, "% of range");
    const SIZE: [i32; 2] = [1230, 620];
    svg(SIZE[0] + COLUMN, SIZE[1], |root| {
        let (plot, column) = root.split_horizontally(SIZE[0]);
        legend.draw(&column)?;
        let mut chart = chart(&plot, 0.0..width, -height..height, ["true range (m)", "range error (mm)"])?;
        draw(&mut chart, [PathElement::new([(0.0, 0.0), (width, 0.0)], GREY.stroke_width(2))])?;
        for &(range, error, sigma) in &points {
            if let Some(sigma) = sigma {
                error_bar(&mut chart, (range, error), (0.0, 1.0), sigma, 0.004 * width, BLUE.mix(0.6))?;
            }
            draw(&mut chart, [Circle::new((range, error), 7, BLUE.filled())])?;
        }
        Ok(())
    })
    .map(Some)
}

/// The instrument: side view with tube, viewpoints, fields of view and belt, and the belt seen along the axis.
pub fn rig_plot(rig: &Rig) -> Result<String, OutputError> {
    let viewpoints: [Viewpoint; 2] = rig.cameras.each_ref().map(|camera| {
        let model = camera.water.as_ref().or(camera.air.as_ref())?;
        let position = Point3::from(model.pose.position_mm);
        position.iter().all(|v| drawable(v / 1000.0)).then_some((position, model))
    });
    let reach = viewpoints.iter().flatten().map(|(position, _)| position.z.abs()).fold(150.0, f64::max);
    let extent = 1.55 * reach;
    let [near, far] = rig.reconstruction.range_mm;

    let mut legend = Legend::new("Rig");
    legend.text(&rig.name);
    for (i, viewpoint) in viewpoints.iter().enumerate() {
        let name = if viewpoint.is_some() { "viewpoint and field of view" } else { "not known" };
        legend.add(Symbol::Patch(CAMERAS[i].mix(0.3)), &format!("camera {}: {name}", i + 1));
    }
    legend.add(Symbol::Line(GREEN), &format!("{} laser beams", rig.lasers.len()));
    legend.add(Symbol::Patch(RULE.to_rgba()), "transparent tube");
    legend.add(Symbol::Dashes(GREEN), "start of the working range");
    legend.text(&format!("working range {} to {} m", near / 1000.0, far / 1000.0));
    if let [Some((first, _)), Some((second, _))] = viewpoints {
        legend.text(&format!("baseline B = {:.1} mm", (second - first).norm()));
    }
    for (i, camera) in rig.cameras.iter().enumerate() {
        let [width, height] = camera.image_size_px;
        let radius = camera.mirror_radius_px;
        legend.text(&format!("camera {}: {width} x {height} px, mirror radius {radius} px", i + 1));
    }
    if let Some(Tube { inner_radius_mm, wall_mm, index, .. }) = rig.tube {
        legend.text(&format!("tube: radius {inner_radius_mm} mm, wall {wall_mm} mm, index {index}"));
    }
    let Water { temperature_c, salinity, wavelength_nm } = rig.water;
    let index = rig.water.index();
    legend.text(&format!("water: {temperature_c} °C, salinity {salinity}, index {index:.4} at {wavelength_nm} nm"));

    const SIZE: i32 = 900;
    svg(2 * (SIZE + 110) + COLUMN, SIZE + 160, |root| {
        let (views, column) = root.split_horizontally(2 * (SIZE + 110));
        legend.draw(&column)?;
        let (side, belt) = views.split_horizontally(SIZE + 110);
        side_view(&titled(&side, "Side view")?, rig, viewpoints, extent)?;
        belt_view(&titled(&belt, "Belt, seen along the axis from camera 2")?, rig, extent)
    })
}

/// Where a camera sees from, and its model.
type Viewpoint<'a> = Option<(Point3<f64>, &'a CameraModel)>;

fn side_view(area: &Area, rig: &Rig, viewpoints: [Viewpoint; 2], extent: f64) -> Result<(), OutputError> {
    let mut chart = chart(area, -extent..extent, -extent..extent, ["z (mm)", "x (mm)"])?;
    for (i, camera) in rig.cameras.iter().enumerate() {
        let Some((viewpoint, model)) = viewpoints[i] else { continue };
        let colour = CAMERAS[i];
        for side in [-1.0, 1.0] {
            let edge = |radius: f64| {
                let ray = model.ray(Vector2::from(model.centre_px) + Vector2::new(side * radius, 0.0));
                let end = ray.origin + 20.0 * extent * ray.direction;
                [(ray.origin.z, ray.origin.x), (end.z, end.x)]
            };
            let edges = [camera.inner_radius_px, camera.mirror_radius_px].map(edge);
            let [[a, b], [c, d]] = edges;
            draw(&mut chart, [Polygon::new(clipped(vec![a, b, d, c], extent), colour.mix(0.16).filled())])?;
            let lines = edges.map(|edge| clipped(edge.to_vec(), extent));
            draw(&mut chart, lines.map(|line| PathElement::new(line, colour.mix(0.7).stroke_width(2))))?;
        }
        draw(&mut chart, [Circle::new((viewpoint.z, viewpoint.x), 11, colour.filled())])?;
        // Beside the point, away from the belt: nothing else is there.
        let outwards = viewpoint.z.signum();
        let align = if outwards < 0.0 { HPos::Right } else { HPos::Left };
        let at = (viewpoint.z + 0.04 * extent * outwards, viewpoint.x);
        label(&mut chart, format!("camera {}", i + 1), at, SMALL, INK, align)?;
    }
    if let Some(Tube { inner_radius_mm, wall_mm, .. }) = rig.tube.filter(|tube| fits(tube, extent)) {
        for low in [inner_radius_mm, -inner_radius_mm - wall_mm] {
            let wall = [(-extent, low), (extent, low + wall_mm)];
            draw(&mut chart, [Rectangle::new(wall, RULE.filled()), Rectangle::new(wall, GREY.stroke_width(1))])?;
        }
    }
    for laser in &rig.lasers {
        let (origin, direction) = (Point3::from(laser.origin_mm), laser.direction());
        // A beam towards the viewer is a dot in this view.
        if direction.x.abs() > 0.1 {
            beam(&mut chart, [origin.z, origin.x], [direction.z, direction.x], extent)?;
        }
    }
    let near = rig.reconstruction.range_mm[0];
    if near < extent {
        for x in [-near, near] {
            dashes(&mut chart, [(-0.3 * extent, x), (0.3 * extent, x)], GREEN)?;
        }
    }
    if let [Some((first, _)), Some((second, _))] = viewpoints {
        let height = -0.8 * extent;
        dimension(&mut chart, [(first.z, height), (second.z, height)], extent, "B".into())?;
    }
    label(&mut chart, "belt".into(), (0.03 * extent, 0.93 * extent), SMALL, GREEN, HPos::Left)
}

/// Whether a tube is inside the view.
fn fits(tube: &Tube, extent: f64) -> bool {
    let [x, y, _] = tube.pose.position_mm;
    x.hypot(y) + tube.inner_radius_mm + tube.wall_mm < extent
}

fn belt_view(area: &Area, rig: &Rig, extent: f64) -> Result<(), OutputError> {
    let mut chart = chart(area, -extent..extent, -extent..extent, ["x (mm)", "y (mm)"])?;
    if let Some(tube) = rig.tube.filter(|tube| fits(tube, extent)) {
        let [x, y, _] = tube.pose.position_mm;
        let outer = circle((x, y), tube.inner_radius_mm + tube.wall_mm);
        let inner = circle((x, y), tube.inner_radius_mm);
        draw(
            &mut chart,
            [(&outer, RULE), (&inner, WHITE)].map(|(ring, fill)| Polygon::new(ring.clone(), fill.filled())),
        )?;
        draw(&mut chart, [outer, inner].map(|ring| PathElement::new(ring, GREY.stroke_width(1))))?;
    }
    let near = rig.reconstruction.range_mm[0];
    if near < extent {
        let ring = circle((0.0, 0.0), near);
        draw(
            &mut chart,
            ring.windows(2).step_by(2).map(|dash| PathElement::new(dash.to_vec(), GREEN.stroke_width(2))),
        )?;
    }
    // As many numbers as are legible.
    let every = rig.lasers.len().div_ceil(36).max(1);
    for (index, laser) in rig.lasers.iter().enumerate() {
        let (origin, direction) = (Point3::from(laser.origin_mm), laser.direction());
        beam(&mut chart, [origin.x, origin.y], [direction.x, direction.y], extent)?;
        let at = origin + 0.85 * extent * direction;
        if index % every == 0 && at.x.abs() < extent && at.y.abs() < extent {
            let circle = || Circle::new((at.x, at.y), 19, WHITE.filled());
            draw(&mut chart, [circle(), Circle::new((at.x, at.y), 19, GREEN.stroke_width(2))])?;
            label(&mut chart, index.to_string(), (at.x, at.y), SMALL, INK, HPos::Center)?;
        }
    }
    Ok(())
}

/// Draws into a new SVG document with a light background.
fn svg(width: i32, height: i32, draw: impl FnOnce(&Area) -> Result<(), OutputError>) -> Result<String, OutputError> {
    let mut text = String::new();
    let root = SVGBackend::with_string(&mut text, (width as u32, height as u32)).into_drawing_area();
    root.fill(&WHITE).map_err(failed)?;
    draw(&root.margin(14, 14, 14, 14))?;
    root.present().map_err(failed)?;
    drop(root);
    Ok(text)
}

fn chart<'a>(
    area: &Area<'a>,
    x: Range<f64>,
    y: Range<f64>,
    [x_name, y_name]: [&str; 2],
) -> Result<Chart<'a>, OutputError> {
    let mut chart = ChartBuilder::on(area)
        .margin(20)
        .set_label_area_size(LabelAreaPosition::Left, 90)
        .set_label_area_size(LabelAreaPosition::Bottom, 80)
        .build_cartesian_2d(x, y)
        .map_err(failed)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .axis_style(GREY)
        .label_style(("sans-serif", SMALL).into_font().color(&INK))
        .axis_desc_style(("sans-serif", TEXT).into_font().color(&INK))
        .x_desc(x_name)
        .y_desc(y_name)
        .x_labels(9)
        .y_labels(9)
        .x_label_formatter(&tick)
        .y_label_formatter(&tick)
        .draw()
        .map_err(failed)?;
    Ok(chart)
}

/// A tick label without rounding noise; adding zero turns -0 into 0.
fn tick(value: &f64) -> String {
    format!("{}", (value * 1e6).round() / 1e6 + 0.0)
}

/// Puts a title over an area and gives what is left.
fn titled<'a>(area: &Area<'a>, title: &str) -> Result<Area<'a>, OutputError> {
    area.titled(title, ("sans-serif", TITLE - 4).into_font().color(&INK)).map_err(failed)
}

/// Draws elements at places of the chart.
fn draw<'a, E>(chart: &mut Chart<'a>, elements: impl IntoIterator<Item = E>) -> Result<(), OutputError>
where
    for<'b> &'b E: PointCollection<'b, Place>,
    E: Drawable<SVGBackend<'a>>,
{
    chart.draw_series(elements).map_err(failed)?;
    Ok(())
}

fn label(
    chart: &mut Chart,
    text: String,
    (x, y): Place,
    size: i32,
    colour: RGBColor,
    horizontal: HPos,
) -> Result<(), OutputError> {
    let style = ("sans-serif", size).into_font().color(&colour).pos(Pos::new(horizontal, VPos::Center));
    draw(chart, [Text::new(text, (x, y), style)])
}

/// A bar of `sigma` to both sides of a point along a unit vector, with end caps; all in chart units.
fn error_bar(
    chart: &mut Chart,
    (x, y): Place,
    (dx, dy): Place,
    sigma: f64,
    cap: f64,
    colour: impl Color,
) -> Result<(), OutputError> {
    let ends = [-sigma, sigma].map(|s| (x + s * dx, y + s * dy));
    let caps = ends.map(|(x, y)| [(x - cap * dy, y + cap * dx), (x + cap * dy, y - cap * dx)]);
    draw(chart, [ends, caps[0], caps[1]].map(|line| PathElement::new(line, colour.stroke_width(3))))
}

/// Circles of equal distance at round numbers, labelled in metres.
fn range_rings(chart: &mut Chart, extent: f64) -> Result<(), OutputError> {
    let step = [0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0]
        .into_iter()
        .find(|step| extent / step <= 6.0)
        .unwrap_or(extent / 4.0);
    let rings = (1..).map(|i| f64::from(i) * step).take_while(|radius| *radius < extent);
    for radius in rings {
        draw(chart, [PathElement::new(circle((0.0, 0.0), radius), GREY.mix(0.45).stroke_width(1))])?;
        // Between two beams of a belt of twelve.
        let (sin, cos) = 75f64.to_radians().sin_cos();
        let text = format!("{} m", (radius * 100.0).round() / 100.0);
        label(chart, text, (radius * cos, radius * sin + 0.025 * extent), SMALL, GREY, HPos::Center)?;
    }
    Ok(())
}

/// A beam from its origin to the edge of the chart.
fn beam(chart: &mut Chart, origin: [f64; 2], direction: [f64; 2], extent: f64) -> Result<(), OutputError> {
    let end = [0, 1].map(|i| origin[i] + 4.0 * extent * direction[i]);
    let line = clipped(vec![(origin[0], origin[1]), (end[0], end[1])], extent);
    draw(chart, [PathElement::new(line, GREEN.stroke_width(3))])
}

fn dashes(chart: &mut Chart, [from, to]: [Place; 2], colour: impl Color) -> Result<(), OutputError> {
    let at = |i: i32| {
        let weight = f64::from(i) / 16.0;
        (from.0 + weight * (to.0 - from.0), from.1 + weight * (to.1 - from.1))
    };
    draw(chart, (0..16).step_by(2).map(|i| PathElement::new([at(i), at(i + 1)], colour.stroke_width(2))))
}

/// A dimension line with end marks and a text under it.
fn dimension(chart: &mut Chart, ends: [Place; 2], extent: f64, text: String) -> Result<(), OutputError> {
    let tick = 0.025 * extent;
    let marks = ends.map(|(x, y)| [(x, y - tick), (x, y + tick)]);
    draw(chart, [ends, marks[0], marks[1]].map(|line| PathElement::new(line, INK.stroke_width(2))))?;
    // Off the middle, where the belt is.
    let at = (0.75 * ends[0].0 + 0.25 * ends[1].0, ends[0].1 - 0.05 * extent);
    label(chart, text, at, TEXT, INK, HPos::Center)
}

fn circle(centre: Place, radius: f64) -> Vec<Place> {
    (0..=120)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * 3.0).to_radians().sin_cos();
            (centre.0 + radius * cos, centre.1 + radius * sin)
        })
        .collect()
}

fn closed(line: &[Place]) -> Vec<Place> {
    line.iter().chain(line.first()).copied().collect()
}

/// Unit vector from the origin; upwards at the origin itself.
fn unit((x, y): Place) -> Place {
    let length = x.hypot(y);
    if length > 0.0 { (x / length, y / length) } else { (0.0, 1.0) }
}

/// The part of a polygon inside the square of half width `extent` (Sutherland and Hodgman): the backend draws over the
/// edge of a chart.
fn clipped(polygon: Vec<Place>, extent: f64) -> Vec<Place> {
    // Inside where a x + b y <= extent.
    [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].into_iter().fold(polygon, |polygon, (a, b)| {
        let beyond = |(x, y): Place| a * x + b * y - extent;
        let previous = polygon.iter().cycle().skip(polygon.len().saturating_sub(1));
        let mut kept = Vec::new();
        for (&from, &to) in previous.zip(&polygon) {
            let (before, after) = (beyond(from), beyond(to));
            if (before <= 0.0) != (after <= 0.0) {
                let weight = before / (before - after);
                kept.push((from.0 + weight * (to.0 - from.0), from.1 + weight * (to.1 - from.1)));
            }
            if after <= 0.0 {
                kept.push(to);
            }
        }
        kept
    })
}

/// Sign in front of a legend line.
enum Symbol {
    Dot(RGBColor),
    Ring(RGBColor),
    Cross(RGBColor),
    Line(RGBColor),
    Dashes(RGBColor),
    Bar(RGBColor),
    Patch(RGBAColor),
}

/// The column right of a plot: title, meaning of the symbols, figures.
struct Legend {
    title: String,
    lines: Vec<(Option<Symbol>, String)>,
}

impl Legend {
    fn new(title: &str) -> Self {
        Self { title: title.to_owned(), lines: Vec::new() }
    }

    fn add(&mut self, symbol: Symbol, text: &str) {
        self.lines.push((Some(symbol), text.to_owned()));
    }

    fn text(&mut self, text: &str) {
        self.lines.push((None, text.to_owned()));
    }

    /// A line with a figure, if there is one.
    fn figure(&mut self, name: &str, value: Option<f64>, unit: &str) {
        if let Some(value) = value {
            self.text(&format!("{name} {value:.2} {unit}"));
        }
    }

    fn draw(&self, area: &Area) -> Result<(), OutputError> {
        let write = |text: &str, at: (i32, i32), size: i32, bold: bool| {
            let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
            let style = ("sans-serif", size, style).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(text.to_owned(), at, style)).map_err(failed)
        };
        write(&self.title, (8, 50), TITLE, true)?;
        let mut y = 115;
        for (i, (symbol, text)) in self.lines.iter().enumerate() {
            // A gap between symbols and plain lines.
            if i > 0 && symbol.is_none() != self.lines[i - 1].0.is_none() {
                y += LINE / 2;
            }
            if let Some(symbol) = symbol {
                symbol.draw(area, 28, y)?;
            }
            write(text, (if symbol.is_some() { 68 } else { 8 }, y), SMALL + 1, false)?;
            y += LINE;
        }
        Ok(())
    }
}

impl Symbol {
    fn draw(&self, area: &Area, x: i32, y: i32) -> Result<(), OutputError> {
        let line = |from: (i32, i32), to: (i32, i32), colour: &RGBColor, width: u32| {
            let ends = [(x + from.0, y + from.1), (x + to.0, y + to.1)];
            area.draw(&PathElement::new(ends, colour.stroke_width(width))).map_err(failed)
        };
        match self {
            Self::Dot(colour) => area.draw(&Circle::new((x, y), 7, colour.filled())).map_err(failed),
            Self::Ring(colour) => area.draw(&Circle::new((x, y), 10, colour.stroke_width(2))).map_err(failed),
            Self::Cross(colour) => area.draw(&Cross::new((x, y), 9, colour.stroke_width(4))).map_err(failed),
            Self::Line(colour) => line((-20, 0), (20, 0), colour, 3),
            Self::Dashes(colour) => {
                line((-20, 0), (-12, 0), colour, 2)?;
                line((-4, 0), (4, 0), colour, 2)?;
                line((12, 0), (20, 0), colour, 2)
            }
            Self::Bar(colour) => {
                line((0, -14), (0, 14), colour, 3)?;
                line((-6, -14), (6, -14), colour, 3)?;
                line((-6, 14), (6, 14), colour, 3)
            }
            Self::Patch(colour) => {
                let corners = [(x - 20, y - 12), (x + 20, y + 12)];
                area.draw(&Rectangle::new(corners, colour.filled())).map_err(failed)?;
                area.draw(&Rectangle::new(corners, GREY.stroke_width(1))).map_err(failed)
            }
        }
    }
}
