//! A small made-up frame for the detector.

use karst_core::{DetectorConfig, I18F14, SpotDetector, SpotNoise, Thresholds};
use karst_link::{FrameEnd, LaserSpot, Message};

use crate::LASERS;

/// Size of the frame, px.
const WIDTH: u16 = 192;
const HEIGHT: u16 = 144;

/// The spots, px from the image centre at (96, 72): one per laser, and a weaker second one at two thirds of that.
const SPOTS: [[i32; 2]; LASERS] = [
    [60, 0],
    [52, 30],
    [30, 52],
    [0, 60],
    [-30, 52],
    [-52, 30],
    [-60, 0],
    [-52, -30],
    [-30, -52],
    [0, -60],
    [30, -52],
    [52, -30],
];

/// A detector for the made-up frame.
pub fn new_detector() -> Option<SpotDetector<LASERS>> {
    SpotDetector::new(DetectorConfig {
        width: WIDTH,
        height: HEIGHT,
        thresholds: Thresholds::default(),
        centre: [I18F14::from_num(96), I18F14::from_num(72)],
        mirror_radius: 70 * 16,
        inner_radius: 10 * 16,
        cluster_gap: 3,
        min_pixels: 3,
        clockwise: false,
        azimuths: (0..LASERS).map(|laser| (laser * 65536 / LASERS) as u16).collect(),
        sector_half_width: 2000,
        noise: SpotNoise { floor: 2416, noise: 130_000 },
    })
    .ok()
}

/// A made-up frame, row by row: spots of rising size, haze, specks of one pixel, and a green patch.
pub struct Scene {
    row: [u8; 3 * WIDTH as usize],
}

impl Scene {
    /// The empty scene.
    pub fn new() -> Self {
        Self { row: [0; 3 * WIDTH as usize] }
    }

    /// Number of rows.
    pub fn rows(&self) -> u16 {
        HEIGHT
    }

    /// A row, R, G, B of each pixel.
    pub fn row(&mut self, y: u16) -> &[u8] {
        for (x, pixel) in self.row.as_chunks_mut().0.iter_mut().enumerate() {
            *pixel = colour(x as i32, y.into());
        }
        &self.row
    }
}

impl Default for Scene {
    fn default() -> Self {
        Self::new()
    }
}

fn colour(x: i32, y: i32) -> [u8; 3] {
    let noise = ((x * 7919 + y * 104_729) as u32).wrapping_mul(0x9e37_79b1) >> 16;
    if noise.is_multiple_of(997) {
        return [30, 210, 40];
    }
    let patch = if x > 130 && y < 30 { 40 } else { 0 };
    let light = (0_i32..).zip(&SPOTS).fold(0, |light, (i, [dx, dy])| {
        let lit = |brightness: i32, [dx, dy]: [i32; 2]| {
            let distance = (x - 96 - dx).pow(2) + (y - 72 - dy).pow(2);
            (brightness * (8 + 4 * i) / (8 + 4 * i + distance * distance)).max(0)
        };
        light + lit(300 + 60 * i, [*dx, *dy]) + lit(160, [dx * 2 / 3, dy * 2 / 3])
    });
    let channel = |light: i32| (light + (noise & 15) as i32).clamp(0, 255) as u8;
    [channel(light * 15 / 100), channel(light + patch), channel(light / 4)]
}

/// Finds the spots of the frame and sends them.
pub(crate) fn check(mut send: impl FnMut(Message)) {
    let Some(mut detector) = new_detector() else { return };
    let mut scene = Scene::new();
    detector.start_frame();
    for y in 0..scene.rows() {
        // A row that is not taken would show in the status
        let _ = detector.row(scene.row(y));
    }
    let status = detector.end_frame();
    let mut spots = 0;
    for laser in 0..LASERS {
        for spot in detector.spots(laser) {
            send(Message::Spot(LaserSpot { frame: 0, camera: 0, laser: laser as u16, spot }));
            spots += 1;
        }
    }
    send(Message::FrameEnd(FrameEnd { frame: 0, lasers: 0, spots, detectors: [status; 2] }));
}
