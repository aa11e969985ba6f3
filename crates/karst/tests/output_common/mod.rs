//! A made-up but plausible frame: an irregular gallery, twelve lasers, one spot rejected, one never found.

#![allow(dead_code, reason = "every test file uses its own part")]

use image::{Rgb, RgbImage};
use karst::result::*;
use karst_rig::Rig;
use nalgebra::Point3;

/// Laser without any spot.
pub const DARK: usize = 4;
/// Laser whose spots disagree.
pub const REJECTED: usize = 9;

/// True range along the beam of laser `laser` in frame `frame`, mm.
fn true_range_mm(laser: usize, frame: usize) -> f64 {
    let azimuth = (laser as f64 * 30.0).to_radians();
    1900.0 + 600.0 * (azimuth + 0.4).cos() + 350.0 * (2.0 * azimuth + 0.1 * frame as f64).sin() + 30.0 * frame as f64
}

/// The wall in the belt plane, mm.
pub fn outline_mm(frame: usize) -> Vec<[f64; 2]> {
    (0..360)
        .map(|degree| {
            let azimuth = f64::from(degree).to_radians();
            let radius = 1900.0
                + 600.0 * (azimuth + 0.4).cos()
                + 350.0 * (2.0 * azimuth + 0.1 * frame as f64).sin()
                + 30.0 * frame as f64
                + 60.0 * (6.0 * azimuth).sin().powi(2) * (azimuth * 1.5).cos();
            [radius * azimuth.cos(), radius * azimuth.sin()]
        })
        .collect()
}

/// A repeatable number of about zero mean and unit variance: the sum of twelve uniform ones.
fn noise(seed: usize) -> f64 {
    let uniform = |i: u64| {
        let mut bits = (12 * seed as u64 + i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (bits >> 33) as f64 / (1u64 << 31) as f64
    };
    (0..12).map(uniform).sum::<f64>() - 6.0
}

/// The section of frame `frame`.
pub fn section(frame: usize) -> Section {
    let rig = Rig::ideal();
    let lasers = rig.lasers.iter().enumerate().map(|(k, laser)| {
        let range = true_range_mm(k, frame);
        let origin = Point3::from(laser.origin_mm);
        let truth = origin + range * laser.direction();
        let pixels = [0, 1].map(|i| rig.traced_camera(i).unwrap().project(truth).map(|p| [p.x, p.y]));
        let sigma = 0.5 + 0.9 * (range / 1000.0).powi(2);
        let error = sigma * noise(frame * 12 + k);
        let position = truth + error * laser.direction();
        let spot = |i: usize| {
            let [x, y] = pixels[i]?;
            let shift = if k == REJECTED { 3.0 * i as f64 } else { 0.05 };
            let pixel = [x + shift, y - shift];
            let bounds = [pixel[0] - 4.0, pixel[1] - 3.0, pixel[0] + 4.0, pixel[1] + 3.0].map(|v| v as u16);
            Some(SpotResult { pixel, sigma_px: 0.03 + 0.01 * (range / 1000.0), pixels: 38, saturated: 5, bounds })
        };
        LaserResult {
            laser: k,
            status: match k {
                DARK => "no spot in camera 1 & 2".into(),
                REJECTED => "chi squared 41.7 > 16.3".into(),
                _ => "point".into(),
            },
            point: (k != DARK && k != REJECTED).then(|| PointResult {
                position_mm: position.into(),
                range_mm: position.x.hypot(position.y),
                sigma_mm: Some(sigma),
                chi2: Some(3.0 + noise(k + 77)),
                estimates_mm: [
                    Some(range + error + 2.1 * noise(k + 5)),
                    (k != 2).then_some(range + error - 1.6 * noise(k + 9)),
                    Some(range + error + 4.0 * noise(k + 31)),
                ],
            }),
            spots: if k == DARK { [None, None] } else { [spot(0), spot(1)] },
            truth: Some(TruthResult {
                position_mm: Some(truth.into()),
                range_mm: Some(truth.x.hypot(truth.y)),
                pixels,
                visible: [true; 2],
            }),
        }
    });
    Section {
        frame: format!("gallery_{frame:04}"),
        method: "weighted".into(),
        arithmetic: "fixed".into(),
        lasers: lasers.collect(),
        detector: [
            DetectorCounters { hits: 431, outside: 3, overflow: 0, spots: Some(12) },
            DetectorCounters { hits: 418, outside: 0, overflow: 0, spots: Some(11) },
        ],
        timing: Some(Timing { detect_ms: 1.62, reconstruct_ms: 0.018 }),
    }
}

/// The image of camera `camera` (0 or 1) that goes with a section: haze, noise and the spots.
pub fn image(section: &Section, camera: usize) -> RgbImage {
    let mut image = RgbImage::from_fn(1024, 768, |x, y| {
        let radius = (f64::from(x) - 511.5).hypot(f64::from(y) - 383.5);
        let haze = if radius < 360.0 { 14.0 + 10.0 * (-radius / 150.0).exp() } else { 3.0 };
        let grain = 3.0 * noise((y * 1024 + x) as usize);
        Rgb([haze * 0.6 + grain, haze + grain, haze * 1.2 + grain].map(|v| v.clamp(0.0, 255.0) as u8))
    });
    for laser in &section.lasers {
        let Some(pixel) = laser.truth.as_ref().and_then(|t| t.pixels[camera]) else { continue };
        let peak = if laser.laser == DARK { 18.0 } else { 330.0 };
        for y in -12i64..=12 {
            for x in -12i64..=12 {
                let at = [pixel[0].round() as i64 + x, pixel[1].round() as i64 + y];
                let distance = (at[0] as f64 - pixel[0]).hypot(at[1] as f64 - pixel[1]);
                let light = peak * (-distance * distance / 8.0).exp();
                if let Some(Rgb(channels)) = image.get_pixel_mut_checked(at[0] as u32, at[1] as u32) {
                    for (channel, share) in channels.iter_mut().zip([0.35, 1.0, 0.45]) {
                        *channel = (f64::from(*channel) + share * light).min(255.0) as u8;
                    }
                }
            }
        }
    }
    image
}
