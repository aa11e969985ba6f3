//! A small instrument, its pictures, and what karst-core makes of them.

use std::cell::RefCell;
use std::convert::Infallible;
use std::f64::consts::TAU;
use std::rc::Rc;

use karst_core::{
    Calibration, CameraCalibration, DetectorConfig, Estimates, FrameStatus, I18F14, LaserCalibration, LaserFrame,
    Method, NoPoint, Point, ReconstructionSettings, Spot, SpotDetector, SpotNoise, Thresholds, reconstruct,
};
use karst_regs::model::Model;
use karst_regs::{RegisterBus, Settings};

pub const LASERS: usize = 12;
pub const WIDTH: u16 = 192;
pub const HEIGHT: u16 = 192;
const CENTRE: f64 = 96.0;
/// Component of every ray along the camera's axis, px.
const FORWARD: f64 = 40.0;

/// Settings that are not borrowed.
#[derive(Clone)]
pub struct Instrument {
    pub calibration: Calibration<LASERS>,
    pub detectors: [DetectorConfig<LASERS>; 2],
    pub method: Method,
}

impl Instrument {
    /// Two cameras that look at each other, `half_baseline` mm from the plane of the lasers.
    pub fn new(half_baseline: f64, method: Method) -> Self {
        let detector = |clockwise| DetectorConfig {
            width: WIDTH,
            height: HEIGHT,
            thresholds: Thresholds::default(),
            centre: [I18F14::from_num(CENTRE); 2],
            mirror_radius: 92 * 16,
            inner_radius: 50 * 16,
            cluster_gap: 3,
            min_pixels: 3,
            clockwise,
            azimuths: (0..LASERS).map(|laser| (laser * 65536 / LASERS) as u16).collect(),
            sector_half_width: 2000,
            noise: SpotNoise { floor: 2416, noise: 83443 },
        };
        let camera = CameraCalibration {
            centre: [I18F14::from_num(CENTRE); 2],
            inverse_affine: [1 << 30, 0, 0, 1 << 30],
            decentring: [0, 0],
            polynomial: [(FORWARD / 512.0 * f64::from(1 << 26)) as i32].into_iter().collect(),
            axial: [12_345, -6_789].into_iter().collect(),
        };
        let calibration = Calibration {
            cameras: [camera.clone(), camera],
            lasers: (0..LASERS).map(|laser| laser_calibration(laser, half_baseline)).collect(),
            settings: ReconstructionSettings {
                range: [I18F14::from_num(100), I18F14::from_num(4000)],
                chi2_max: I18F14::from_num(30),
                single_camera: true,
            },
        };
        Self { calibration, detectors: [detector(false), detector(true)], method }
    }

    pub fn settings(&self) -> Settings<'_, LASERS> {
        Settings {
            calibration: &self.calibration,
            detectors: [&self.detectors[0], &self.detectors[1]],
            method: self.method,
        }
    }

    /// Spots of both cameras and points of the lasers, by karst-core alone, without the single estimates.
    pub fn expected(&self, pictures: &[Vec<Vec<u8>>; 2]) -> Expected {
        let [first, second] = [0, 1].map(|camera| {
            let mut detector = SpotDetector::<LASERS, 4>::new(self.detectors[camera].clone()).unwrap();
            detector.start_frame();
            for row in &pictures[camera] {
                // Rows of a wrong length are wanted in some tests
                let _ = detector.row(row);
            }
            let status = detector.end_frame();
            (status, (0..LASERS).map(|laser| detector.spots(laser).to_vec()).collect::<Vec<_>>())
        });
        let points = (0..LASERS)
            .map(|laser| {
                let spots = [first.1[laser].as_slice(), second.1[laser].as_slice()];
                without_estimates(reconstruct(&self.calibration, laser, spots, self.method))
            })
            .collect();
        Expected { status: [first.0, second.0], spots: [first.1, second.1], points }
    }
}

/// A point as the IP gives it.
pub fn without_estimates(point: Result<Point, NoPoint>) -> Result<Point, NoPoint> {
    point.map(|point| Point { estimates: Estimates::default(), ..point })
}

#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    pub status: [FrameStatus; 2],
    pub spots: [Vec<Vec<Spot>>; 2],
    pub points: Vec<Result<Point, NoPoint>>,
}

fn laser_calibration(laser: usize, half_baseline: f64) -> LaserCalibration {
    let (sin, cos) = (laser as f64 / LASERS as f64 * TAU).sin_cos();
    // Rows along, up, across in the rig frame
    let axes = [[cos, sin, 0.0], [0.0, 0.0, 1.0], [sin, -cos, 0.0]];
    let q30 = |v: f64| (v * f64::from(1 << 30)) as i32;
    let q20 = |v: f64| (v * f64::from(1 << 20)) as i32;
    let frame = |z: f64, signs: [f64; 3]| LaserFrame {
        rotation: axes.map(|row| [0, 1, 2].map(|i| q30(row[i] * signs[i]))),
        viewpoint: [0.0, z, 0.0].map(q20),
    };
    LaserCalibration {
        origin: [0, 1 << 10, -5],
        axes: axes.map(|row| row.map(q30)),
        origin_variance: (3 << 32) + 77,
        direction_variance: (1 << 32) + 99,
        cameras: [frame(-half_baseline, [1.0; 3]), frame(half_baseline, [1.0, -1.0, -1.0])],
    }
}

/// The pictures of both cameras: a spot at a radius (px) for each laser that has one.
pub fn pictures(radii: &[Option<u8>; LASERS]) -> [Vec<Vec<u8>>; 2] {
    [1.0, -1.0].map(|sign| {
        let mut rows = vec![vec![0; 3 * usize::from(WIDTH)]; usize::from(HEIGHT)];
        for (laser, radius) in radii.iter().enumerate() {
            let Some(radius) = radius else { continue };
            let (sin, cos) = (laser as f64 / LASERS as f64 * TAU).sin_cos();
            let [x, y] = [cos, sign * sin].map(|v| (CENTRE + v * f64::from(*radius)).round() as usize);
            for row in &mut rows[y - 1..=y + 1] {
                for column in x - 1..=x + 1 {
                    row[3 * column..3 * column + 3].copy_from_slice(&[20, 150 + radius, 30]);
                }
            }
        }
        rows
    })
}

/// Radii that give a point for each laser.
pub const ALL: [Option<u8>; LASERS] = {
    let mut radii = [None; LASERS];
    let mut laser = 0;
    while laser < LASERS {
        radii[laser] = Some(66 + 2 * laser as u8);
        laser += 1;
    }
    radii
};

/// A model that the test still gets at while the driver has it.
#[derive(Clone, Default)]
pub struct Shared(pub Rc<RefCell<Model<LASERS>>>);

impl RegisterBus for Shared {
    type Error = Infallible;

    fn read32(&mut self, address: u32) -> Result<u32, Infallible> {
        self.0.borrow_mut().read32(address)
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), Infallible> {
        self.0.borrow_mut().write32(address, value)
    }
}

impl Shared {
    pub fn row(&self, camera: usize, start: bool, rgb: &[u8]) {
        self.0.borrow_mut().row(camera, start, rgb);
    }
}
