//! Made-up pictures: a spot for each laser where it belongs, and single bright pixels anywhere.

use karst_core::DetectorConfig;

const SPOT: [u8; 3] = [20, 200, 30];

/// Distance of the spots from the image centre, of the mirror's radius.
const RADIUS: f64 = 0.9;

/// What is in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scene {
    /// Pixels of a spot; of lasers that are too close to each other, fewer, so that the spots do not touch.
    pub spot_pixels: u32,
    /// Share of all pixels that are bright without a laser, 0 to 1.
    pub stray: f64,
}

impl Default for Scene {
    fn default() -> Self {
        Self { spot_pixels: 21, stray: 0.0 }
    }
}

impl Scene {
    /// The picture of a camera: R, G, B of each pixel.
    pub fn picture<const LASERS: usize>(&self, config: &DetectorConfig<LASERS>) -> Vec<u8> {
        let (width, height) = (usize::from(config.width), usize::from(config.height));
        let mut rgb = vec![0; 3 * width * height];
        let mut light = |x: f64, y: f64| {
            if (0.0..width as f64).contains(&x) && (0.0..height as f64).contains(&y) {
                let at = 3 * (y as usize * width + x as usize);
                rgb[at..at + 3].copy_from_slice(&SPOT);
            }
        };
        let radius = RADIUS * f64::from(config.mirror_radius) / 16.0;
        let spacing = std::f64::consts::TAU * radius / config.azimuths.len() as f64;
        let room = std::f64::consts::FRAC_PI_4 * (spacing - 1.0).max(0.0).powi(2);
        let offsets = disc(self.spot_pixels.min(room as u32).max(1) as usize);
        for &azimuth in &config.azimuths {
            let angle = f64::from(azimuth) / 65536.0 * std::f64::consts::TAU;
            let (sin, cos) = if config.clockwise { -angle } else { angle }.sin_cos();
            let [x, y] = config.centre.map(|c| c.to_num::<f64>());
            for (dx, dy) in &offsets {
                light((x + radius * cos).round() + dx, (y + radius * sin).round() + dy);
            }
        }
        // Evenly spread by the golden ratio, in x and in y
        let count = (self.stray * (width * height) as f64) as u64;
        for i in 0..count {
            let part = |step: f64| (i as f64 * step).fract();
            light((part(0.754_877_666) * width as f64).floor(), (part(0.569_840_291) * height as f64).floor());
        }
        rgb
    }
}

/// The pixels nearest to a point.
fn disc(count: usize) -> Vec<(f64, f64)> {
    let side = (count as f64).sqrt() as i32 + 1;
    let mut offsets: Vec<(i32, i32)> = (-side..=side).flat_map(|y| (-side..=side).map(move |x| (x, y))).collect();
    offsets.sort_by_key(|(x, y)| x * x + y * y);
    offsets.truncate(count);
    offsets.into_iter().map(|(x, y)| (x.into(), y.into())).collect()
}
