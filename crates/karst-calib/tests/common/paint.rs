//! Painted pictures of boards.

use image::{GrayImage, Luma};
use karst_rig::{Board, CameraModel};
use nalgebra::{Isometry3, Point3, Rotation3, Vector2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use crate::common::{SIZE, facing, truth};

pub const BOARD: Board = Board { columns: 9, rows: 6, square_mm: 40.0 };
/// Samples along each side of a pixel.
const SAMPLES: u32 = 4;
/// Grey levels of paint and background.
pub const DARK: f64 = 40.0;
pub const LIGHT: f64 = 190.0;
const BACKGROUND: f64 = 90.0;

/// A board in a light frame, as the camera sees it through pixels of full area, blurred by about half a pixel.
pub fn paint(camera: &CameraModel, pose: &Isometry3<f64>, board: &Board, noise: f64) -> GrayImage {
    let [width, height] = SIZE;
    let inverse = pose.inverse();
    let grey_at = |u: f64, v: f64| {
        let ray = camera.ray(Vector2::new(u, v));
        let (origin, direction) = (inverse * Point3::origin(), inverse * ray.direction);
        let distance = -origin.z / direction.z;
        let at = origin + distance * direction;
        let beyond = |value: f64, count: usize| {
            let squares = value / board.square_mm;
            (-squares).max(squares - (count - 1) as f64)
        };
        let outside = beyond(at.x, board.columns).max(beyond(at.y, board.rows));
        match outside {
            _ if distance <= 0.0 || outside > 2.0 => BACKGROUND,
            _ if outside <= 1.0 && board.is_dark([at.x, at.y]) => DARK,
            _ => LIGHT,
        }
    };
    let sharp = |x: u32, y: u32| {
        let place = |pixel: u32, sample: u32| f64::from(pixel) + (f64::from(sample) + 0.5) / f64::from(SAMPLES) - 0.5;
        let samples = (0..SAMPLES).flat_map(|j| (0..SAMPLES).map(move |i| (i, j)));
        samples.map(|(i, j)| grey_at(place(x, i), place(y, j))).sum::<f64>() / f64::from(SAMPLES * SAMPLES)
    };
    // Far from the board there is nothing to sample.
    let corners: Vec<Vector2<f64>> = (0..board.corners()).map(|index| true_pixel(camera, pose, board, index)).collect();
    let near = |x: u32, y: u32| {
        let at = Vector2::new(f64::from(x), f64::from(y));
        corners.iter().any(|corner| (corner - at).amax() < 80.0)
    };
    let grey = |x: u32, y: u32| if near(x, y) { sharp(x, y) } else { BACKGROUND };
    let picture: Vec<f64> = (0..width * height).map(|at| grey(at % width, at / width)).collect();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let errors = Normal::new(0.0, noise).unwrap();
    GrayImage::from_fn(width, height, |x, y| {
        let mut grey = errors.sample(&mut random);
        for (dx, dy) in (0..3).flat_map(|dy| (0..3).map(move |dx| (dx, dy))) {
            let (u, v) = ((x + dx).clamp(1, width) - 1, (y + dy).clamp(1, height) - 1);
            let weight = [0.15, 0.7, 0.15];
            grey += weight[dx as usize] * weight[dy as usize] * picture[(v * width + u) as usize];
        }
        Luma([grey.round().clamp(0.0, 255.0) as u8])
    })
}

/// Poses all around the camera, tilted, near and far.
pub fn poses() -> Vec<Isometry3<f64>> {
    let camera = truth();
    let around = (0..6).map(|i| {
        let azimuth = f64::from(i) * 1.05;
        let pixel = Vector2::from(camera.centre_px) + 220.0 * Vector2::new(azimuth.cos(), azimuth.sin());
        let tilt = 0.35 * f64::from(i % 3 - 1);
        facing(
            &camera,
            pixel,
            400.0 + 40.0 * f64::from(i),
            Rotation3::from_euler_angles(tilt, -tilt, 0.9 * f64::from(i)),
        )
    });
    around.collect()
}

pub fn true_pixel(camera: &CameraModel, pose: &Isometry3<f64>, board: &Board, index: usize) -> Vector2<f64> {
    let [x, y] = board.corner_mm(index);
    camera.project(pose * Point3::new(x, y, 0.0), 420.0).unwrap()
}
