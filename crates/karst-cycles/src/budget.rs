//! The table: what takes how long, and how long it may.

use heapless::Vec as FixedVec;
use karst_core::{ConfigError, DetectorConfig, I18F14, SpotNoise, Thresholds};
use karst_link::Mode;

use crate::detector::Generics;
use crate::firmware::PROCESSOR;
use crate::frames::{Camera, FrameClocks, frames};
use crate::scene::Scene;
use crate::top::{Reconstruction, TopGenerics};

/// Most lasers.
pub const MOST_LASERS: usize = 720;

/// The paper's picture, px, its time for a frame, its camera's period, its clocks for a point and its overhead for a frame.
const PAPER_PICTURE: [u16; 2] = [1024, 768];
const PAPER_FRAME_MS: f64 = 2.86;
const CAMERA_PERIOD_MS: f64 = 33.0;
const PAPER_POINT_CLOCKS: u64 = 100;
const PAPER_POINTS: &str = "the paper: 100 clocks per laser";
const PAPER_OVERHEAD_CLOCKS: u64 = 582;

/// Our limits for the last point after the last pixel.
const POINTS_OF_12: u64 = 150;
const POINTS_OF_720: u64 = 8000;

/// What is to be predicted.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// The detectors' configurations.
    pub detectors: [DetectorConfig<MOST_LASERS>; 2],
    /// Pixels per clock and camera: 1, 2, 4 or 8.
    pub pixels_per_clock: u32,
    /// Idle clocks of the cameras.
    pub camera: Camera,
    /// What they see.
    pub scene: Scene,
    /// How points are fused.
    pub reconstruction: Reconstruction,
    /// The clock, Hz.
    pub clock_hz: f64,
    /// Who makes the points that are sent.
    pub mode: Mode,
    /// Of the serial line.
    pub bits_per_second: f64,
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct BudgetRow {
    /// What takes the time.
    pub name: String,
    /// Clocks it takes.
    pub clocks: u64,
    /// Clocks it may take.
    pub limit_clocks: u64,
    /// Who says so.
    pub limit: &'static str,
}

impl BudgetRow {
    /// Whether the limit is kept.
    pub fn met(&self) -> bool {
        self.clocks <= self.limit_clocks
    }
}

/// Detectors for cameras that look along the axis at evenly spaced lasers, the mirror in the middle of the picture.
pub fn detectors(width: u16, height: u16, lasers: u16) -> [DetectorConfig<MOST_LASERS>; 2] {
    let radius = 0.47 * f64::from(width.min(height));
    let lasers = lasers.clamp(1, MOST_LASERS as u16);
    let azimuth = |laser: u16| (u32::from(laser) * 65536 / u32::from(lasers)) as u16;
    [false, true].map(|clockwise| DetectorConfig {
        width,
        height,
        thresholds: Thresholds::default(),
        centre: [width, height].map(|size| I18F14::from_num(size) / 2),
        mirror_radius: (16.0 * radius) as u16,
        inner_radius: (16.0 * 0.05 * radius) as u16,
        cluster_gap: 3,
        min_pixels: 1,
        clockwise,
        azimuths: (0..lasers).map(azimuth).collect::<FixedVec<_, MOST_LASERS>>(),
        sector_half_width: (32768 / u32::from(lasers)) as u16,
        noise: SpotNoise { floor: 2416, noise: 83443 },
    })
}

impl Scenario {
    /// How the IP has to be built for it.
    pub fn generics(&self) -> TopGenerics {
        let bits = |value: usize| value.next_power_of_two().trailing_zeros();
        let x_bits = self.detectors.iter().map(|config| bits(config.width.into())).max();
        let detector = Generics {
            pixels_per_clock: self.pixels_per_clock,
            x_bits: x_bits.unwrap_or_default().max(10),
            laser_bits: bits(self.lasers()).max(1),
            ..Generics::default()
        };
        TopGenerics { detector, ..TopGenerics::default() }
    }

    fn lasers(&self) -> usize {
        self.detectors[0].azimuths.len()
    }

    /// The paper's picture, one pixel per clock, with so many lasers.
    fn of_paper(&self, lasers: u16) -> Self {
        let [width, height] = PAPER_PICTURE;
        Self {
            detectors: detectors(width, height, lasers),
            pixels_per_clock: 1,
            camera: Camera::default(),
            scene: Scene::default(),
            ..self.clone()
        }
    }

    /// Two frames, one after the other.
    pub fn frames(&self) -> Result<[FrameClocks; 2], ConfigError> {
        let configs = self.detectors.each_ref();
        let pictures = configs.map(|config| self.scene.picture(config));
        let pictures = pictures.each_ref().map(Vec::as_slice);
        let found = frames(&self.generics(), configs, self.reconstruction, pictures, self.camera, 2)?;
        Ok([0, 1].map(|frame| found.get(frame).copied().unwrap_or_default()))
    }

    /// The table.
    pub fn budget(&self) -> Result<Vec<BudgetRow>, ConfigError> {
        let of_ms = |ms: f64| (ms * self.clock_hz / 1000.0) as u64;
        let period = (of_ms(CAMERA_PERIOD_MS), "33 ms: a camera of 30 frames per second");
        let row =
            |name: &str, clocks, (limit_clocks, limit)| BudgetRow { name: name.into(), clocks, limit_clocks, limit };
        let lasers = self.lasers() as u64;
        let [first, second] = self.frames()?;
        let config = &self.detectors[0];
        let beats = u64::from(config.width) * u64::from(config.height) / u64::from(self.pixels_per_clock);
        let blanking = (u64::from(config.height) - 1) * u64::from(self.camera.row_blanking);
        let frame = first.results - first.first_pixel;
        let after = |frame: &FrameClocks| frame.points - frame.last_pixel;
        let mut rows = vec![
            row("first pixel to results", frame, (of_ms(PAPER_FRAME_MS), "2.86 ms: the paper's frame")),
            row(
                "of these, not for pixels",
                frame - beats - blanking,
                (PAPER_OVERHEAD_CLOCKS, "the rest of 2.86 ms in the paper"),
            ),
            row("last pixel to last point", after(&first), (lasers * PAPER_POINT_CLOCKS, PAPER_POINTS)),
            row("from frame to frame", second.first_pixel - first.first_pixel, period),
        ];
        for (lasers, target) in [(12, POINTS_OF_12), (MOST_LASERS as u16, POINTS_OF_720)] {
            let points = after(&self.of_paper(lasers).frames()?[0]);
            let name = format!("paper's picture, {lasers} lasers");
            rows.push(row(&name, points, (target, "target: last pixel to last point")));
            rows.push(row(&name, points, (u64::from(lasers) * PAPER_POINT_CLOCKS, PAPER_POINTS)));
        }
        let clocks_per_bit = (self.clock_hz / self.bits_per_second).round() as u64;
        let sensor = PROCESSOR.frame(self.mode, lasers, clocks_per_bit);
        let results = first.results - first.last_pixel;
        rows.extend([
            row("last pixel to first byte", results + sensor.first_byte, period),
            row("last pixel to last byte", results + sensor.last_byte, period),
            row("processor, per frame", sensor.done, period),
            row("serial line, per frame", sensor.line, period),
        ]);
        Ok(rows)
    }
}
