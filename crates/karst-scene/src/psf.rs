//! Point spread function, integrated over the area of each pixel.

use std::f64::consts::PI;

/// Light below this is left out, DN.
const NEGLIGIBLE_DN: f64 = 0.01;
/// Widest window, in standard deviations.
const MAX_SIGMAS: f64 = 7.0;

/// A rectangle of an image, in one channel, DN.
#[derive(Debug, Clone)]
pub(crate) struct Plane {
    /// Top left pixel.
    pub x0: usize,
    pub y0: usize,
    pub width: usize,
    pub height: usize,
    pub dn: Vec<f32>,
}

impl Plane {
    /// The pixels from `min` to `max` (px, both included) that lie in an image.
    pub fn within(min: [f64; 2], max: [f64; 2], image: [usize; 2]) -> Self {
        // Float to integer casts saturate, so positions far outside give an empty plane.
        let start: [usize; 2] = std::array::from_fn(|i| (min[i].floor().max(0.0) as usize).min(image[i]));
        let end: [usize; 2] =
            std::array::from_fn(|i| ((max[i].ceil() + 1.0).max(0.0) as usize).clamp(start[i], image[i]));
        let [width, height] = [end[0] - start[0], end[1] - start[1]];
        Self { x0: start[0], y0: start[1], width, height, dn: vec![0.0; width * height] }
    }

    /// Adds a Gaussian of `flux` (DN px) and standard deviation `sigma_px` around a position in the image.
    pub fn splat(&mut self, position: [f64; 2], flux: f64, sigma_px: f64) {
        let half = reach(flux, sigma_px);
        if half <= 0.0 || !position.iter().all(|p| p.is_finite()) {
            return;
        }
        let range = |p: f64, start: usize, len: usize| {
            let first = (p - half + 0.5).floor() - start as f64;
            let last = (p + half + 0.5).floor() - start as f64;
            (first.max(0.0) as usize).min(len)..((last + 1.0).max(0.0) as usize).min(len)
        };
        let (xs, ys) = (range(position[0], self.x0, self.width), range(position[1], self.y0, self.height));
        let across = shares(position[0] - self.x0 as f64, xs.clone(), sigma_px);
        let down = shares(position[1] - self.y0 as f64, ys.clone(), sigma_px);
        for (y, v) in ys.zip(&down) {
            let row = &mut self.dn[y * self.width..][xs.clone()];
            for (dn, u) in row.iter_mut().zip(&across) {
                *dn += (flux * u * v) as f32;
            }
        }
    }
}

/// Radius beyond which a Gaussian of `flux` (DN px) is negligible, px.
pub(crate) fn reach(flux: f64, sigma_px: f64) -> f64 {
    let peak = flux / (2.0 * PI * sigma_px * sigma_px);
    if peak > NEGLIGIBLE_DN { sigma_px * (2.0 * (peak / NEGLIGIBLE_DN).ln()).sqrt().min(MAX_SIGMAS) + 1.0 } else { 0.0 }
}

/// Integrals of a normal density over pixels.
fn shares(centre: f64, pixels: std::ops::Range<usize>, sigma: f64) -> Vec<f64> {
    let scale = 1.0 / (sigma * std::f64::consts::SQRT_2);
    let below = |edge: f64| 0.5 * libm::erf((edge - centre) * scale);
    let mut left = below(pixels.start as f64 - 0.5);
    pixels
        .map(|x| {
            let right = below(x as f64 + 0.5);
            let share = right - left;
            left = right;
            share
        })
        .collect()
}

/// Pixels, row by row, spread by a Gaussian. Each holds the mean over its area already. Beyond the border, the nearest
/// pixel counts.
pub(crate) fn blurred(pixels: &[[f32; 4]], width: usize, sigma_px: f64) -> Vec<[f32; 4]> {
    let half = (4.0 * sigma_px).ceil() as isize;
    let weights: Vec<f64> = (-half..=half).map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let weights: Vec<f32> = weights.iter().map(|weight| (weight / sum) as f32).collect();
    let height = pixels.len() / width.max(1);
    // `count` pixels in a line, `stride` apart.
    let spread = |from: &[[f32; 4]], at: usize, position: usize, count: usize, stride: usize| {
        let start = at - position * stride;
        let mut mean = [0.0; 4];
        for (weight, offset) in weights.iter().zip(-half..) {
            let nearest = (position as isize + offset).clamp(0, count as isize - 1) as usize;
            for (mean, value) in mean.iter_mut().zip(from[start + nearest * stride]) {
                *mean += weight * value;
            }
        }
        mean
    };
    let rows: Vec<_> = (0..pixels.len()).map(|i| spread(pixels, i, i % width, width, 1)).collect();
    (0..pixels.len()).map(|i| spread(&rows, i, i / width, height, width)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_splat_keeps_its_flux_and_centroid() {
        let mut plane = Plane::within([10.0, 20.0], [59.0, 69.0], [100, 100]);
        plane.splat([33.3, 44.8], 5000.0, 1.2);
        let (mut sum, mut sx, mut sy) = (0.0, 0.0, 0.0);
        for y in 0..plane.height {
            for x in 0..plane.width {
                let dn = f64::from(plane.dn[y * plane.width + x]);
                sum += dn;
                sx += dn * (x + plane.x0) as f64;
                sy += dn * (y + plane.y0) as f64;
            }
        }
        assert!((sum - 5000.0).abs() < 0.1, "{sum}");
        assert!((sx / sum - 33.3).abs() < 1e-4 && (sy / sum - 44.8).abs() < 1e-4, "{} {}", sx / sum, sy / sum);
    }

    #[test]
    fn splats_outside_or_without_position_change_nothing() {
        let mut plane = Plane::within([-5.0, -5.0], [9.0, 9.0], [100, 100]);
        assert_eq!((plane.x0, plane.y0, plane.width, plane.height), (0, 0, 10, 10));
        for position in [[-500.0, 5.0], [5.0, 1e300], [f64::NAN, 5.0], [f64::INFINITY, 0.0]] {
            plane.splat(position, 1e5, 1.0);
        }
        assert!(plane.dn.iter().all(|dn| *dn == 0.0));
        assert_eq!(Plane::within([200.0, 0.0], [300.0, 5.0], [100, 100]).dn.len(), 0);
        assert_eq!(Plane::within([f64::NAN; 2], [f64::NAN; 2], [100, 100]).dn.len(), 0);
    }
}
