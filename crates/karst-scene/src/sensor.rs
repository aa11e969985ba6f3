//! From light to grey levels.

use crate::{Noise, Sensor};
use image::{Rgb, Rgb32FImage, RgbImage};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Largest grey level.
pub(crate) const FULL_DN: f64 = 255.0;

impl Sensor {
    /// Grey level of a linear one, without clipping, noise and quantisation.
    pub fn response(&self, linear_dn: f64) -> f64 {
        if self.gamma == 1.0 { linear_dn } else { FULL_DN * (linear_dn.max(0.0) / FULL_DN).powf(1.0 / self.gamma) }
    }

    /// Variance of the noise at a linear grey level, DN².
    pub fn variance(&self, linear_dn: f64) -> f64 {
        // A saturated pixel holds the full well: no more shot noise than that.
        self.noise.map_or(0.0, |n| linear_dn.clamp(0.0, FULL_DN) / n.electrons_per_dn + n.read_dn * n.read_dn)
    }

    /// Noise, clipping, response curve and quantisation to 8 bits. Shot noise is normal, not Poisson: below the some ten
    /// electrons where the two differ, the read noise hides both.
    pub(crate) fn expose(&self, linear: &Rgb32FImage, mut rng: ChaCha8Rng) -> RgbImage {
        let curve: Option<Vec<f32>> = (self.gamma != 1.0).then(|| {
            (0..=CURVE_STEPS).map(|i| self.response(FULL_DN * i as f64 / CURVE_STEPS as f64) as f32).collect()
        });
        let level = |dn: f32| {
            let dn = dn.clamp(0.0, FULL_DN as f32);
            match &curve {
                Some(curve) => curve[(dn * (CURVE_STEPS as f32 / FULL_DN as f32)) as usize],
                None => dn,
            }
        };
        let mut image = RgbImage::new(linear.width(), linear.height());
        for (Rgb(out), Rgb(dn)) in image.pixels_mut().zip(linear.pixels()) {
            for (out, dn) in out.iter_mut().zip(dn) {
                let noisy = match self.noise {
                    Some(Noise { electrons_per_dn, read_dn }) => {
                        let variance =
                            dn.clamp(0.0, FULL_DN as f32) / electrons_per_dn as f32 + (read_dn * read_dn) as f32;
                        let normal: f32 = StandardNormal.sample(&mut rng);
                        dn + normal * variance.sqrt()
                    }
                    None => *dn,
                };
                // The cast saturates: it clips.
                *out = (level(noisy) + 0.5) as u8;
            }
        }
        image
    }
}

/// Steps of the tabulated response curve: finer than the quantisation wherever the curve is not steeper than 16.
const CURVE_STEPS: usize = 16 * 255;
