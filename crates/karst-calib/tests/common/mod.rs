//! Corners computed with a known camera.

#![allow(dead_code, reason = "every test file uses its own part")]

use karst_calib::{CameraSettings, Corner, CornerList, View};
use karst_rig::{CameraModel, Pose};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub const SIZE: [u32; 2] = [1024, 768];
pub const COLUMNS: usize = 9;
pub const ROWS: usize = 7;
pub const SQUARE_MM: f64 = 40.0;

pub fn truth() -> CameraModel {
    CameraModel {
        pose: Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] },
        centre_px: [518.3, 377.6],
        affine: [1.002, -0.0015, -0.0015],
        tangential: [0.0; 2],
        polynomial: vec![0.302, 0.0, -0.784, -0.0028, 0.1265],
        axial: vec![],
    }
}

/// A pose whose board is in sight around `pixel`, at `distance_mm`, turned by `turn` from facing the camera.
pub fn facing(camera: &CameraModel, pixel: Vector2<f64>, distance_mm: f64, turn: Rotation3<f64>) -> Isometry3<f64> {
    let direction = camera.ray(pixel).direction;
    let towards = Rotation3::face_towards(&direction, &Vector3::new(0.3, 0.5, 0.8));
    let middle = Vector3::new((COLUMNS - 1) as f64, (ROWS - 1) as f64, 0.0) * (0.5 * SQUARE_MM);
    let rotation = UnitQuaternion::from_rotation_matrix(&(towards * turn));
    Isometry3::from_parts(Translation3::from(distance_mm * direction - rotation * middle), rotation)
}

/// The corners of a board; None if not all are in sight.
pub fn view(camera: &CameraModel, pose: &Isometry3<f64>, name: String) -> Option<View> {
    let corner = |index: usize| {
        let board_mm = [(index % COLUMNS) as f64 * SQUARE_MM, (index / COLUMNS) as f64 * SQUARE_MM];
        let pixel = camera.project(pose * Point3::new(board_mm[0], board_mm[1], 0.0), 375.0)?;
        let inside = (0..2).all(|axis| (0.0..f64::from(SIZE[axis]) - 1.0).contains(&pixel[axis]));
        inside.then_some(Corner { index, board_mm, pixel: pixel.into() })
    };
    Some(View { name, corners: (0..COLUMNS * ROWS).map(corner).collect::<Option<_>>()? })
}

/// Boards all around the camera, tilted at random, with normally distributed errors of the corners.
pub fn corners(camera: &CameraModel, views: usize, sigma_px: f64, seed: u64) -> CornerList {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut list = CornerList { views: Vec::new(), image_size_px: None };
    while list.views.len() < views {
        let azimuth: f64 = random.random_range(0.0..std::f64::consts::TAU);
        let radius = random.random_range(100.0..300.0);
        let pixel = Vector2::from(camera.centre_px) + radius * Vector2::new(azimuth.cos(), azimuth.sin());
        let mut angle = || random.random_range(-0.7..0.7);
        let turn = Rotation3::from_euler_angles(angle(), angle(), 3.0 * angle());
        let pose = facing(camera, pixel, random.random_range(350.0..700.0), turn);
        list.views.extend(view(camera, &pose, format!("{}.png", list.views.len())));
    }
    for corner in list.views.iter_mut().flat_map(|view| &mut view.corners) {
        corner.pixel = corner.pixel.map(|value| {
            let error: f64 = StandardNormal.sample(&mut random);
            value + sigma_px * error
        });
    }
    list
}

pub fn settings() -> CameraSettings {
    CameraSettings { image_size_px: SIZE, degree: Some(4), tangential: false }
}
