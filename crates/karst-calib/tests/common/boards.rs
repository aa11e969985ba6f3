//! Corners of boards computed with the default rig.

use karst_calib::{BoardSet, CameraSettings, Corner, CornerList, StereoSettings, TubeKnowledge, TubeSettings, View};
use karst_rig::Medium;
use karst_rig::{Board, Rig};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub const BOARD: Board = Board { columns: 9, rows: 6, square_mm: 40.0 };
const NOISE_PX: f64 = 0.05;
/// A view is a view when at least this many corners are in sight.
const LEAST_CORNERS: usize = 20;

/// Where a camera of the rig sees a point; None: outside of the image that is used.
pub fn see(rig: &Rig, camera: usize, medium: Medium, point: Point3<f64>) -> Option<Vector2<f64>> {
    let data = &rig.cameras[camera];
    let air = data.air.as_ref().unwrap();
    let pixel = match medium {
        Medium::Air => air.project(point, data.mirror_radius_px),
        Medium::Water => rig.traced_camera(camera).unwrap().project(point),
    }?;
    let radius = (pixel - Vector2::from(air.centre_px)).norm();
    (data.inner_radius_px..=data.mirror_radius_px).contains(&radius).then_some(pixel)
}

/// A board at `distance_mm` from the axis that faces it, tilted at random.
fn pose(boards: &Boards, random: &mut ChaCha8Rng) -> Isometry3<f64> {
    let Boards { board, range_mm: [near, far], tilt_rad, .. } = *boards;
    let azimuth: f64 = random.random_range(0.0..std::f64::consts::TAU);
    let distance = near * (far / near).powf(random.random_range(0.0..1.0));
    let height = 0.25 * distance * random.random_range(-1.0..1.0);
    let centre = Vector3::new(distance * azimuth.cos(), distance * azimuth.sin(), height);
    let mut angle = |limit: f64| random.random_range(-limit..limit);
    let outwards = Rotation3::face_towards(&centre, &Vector3::z());
    let turn = outwards * Rotation3::from_euler_angles(angle(tilt_rad), angle(tilt_rad), angle(3.0));
    let rotation = UnitQuaternion::from_rotation_matrix(&turn);
    let [x, y] = board.corner_mm(board.corners() - 1);
    let middle = Vector3::new(x, y, 0.0);
    Isometry3::from_parts(Translation3::from(centre - rotation * (0.5 * middle)), rotation)
}

fn view(rig: &Rig, board: &Board, camera: usize, medium: Medium, pose: &Isometry3<f64>, name: String) -> Option<View> {
    let corner = |index: usize| {
        let board_mm = board.corner_mm(index);
        let pixel = see(rig, camera, medium, pose * Point3::new(board_mm[0], board_mm[1], 0.0))?;
        Some(Corner { index, board_mm, pixel: pixel.into() })
    };
    let corners: Vec<Corner> = (0..board.corners()).filter_map(corner).collect();
    (corners.len() >= LEAST_CORNERS).then_some(View { name, corners })
}

/// What boards to compute.
#[derive(Clone, Copy)]
pub struct Boards {
    pub board: Board,
    pub pairs: usize,
    /// Distances from the axis.
    pub range_mm: [f64; 2],
    /// Largest tilt about either axis of the board.
    pub tilt_rad: f64,
}

impl Boards {
    pub fn new(medium: Medium, pairs: usize) -> Self {
        let range_mm = match medium {
            Medium::Air => [300.0, 1200.0],
            Medium::Water => [350.0, 1600.0],
        };
        Self { board: BOARD, pairs, range_mm, tilt_rad: 0.7 }
    }
}

/// Boards around the default rig that both cameras see, with normally distributed errors of the corners.
pub fn boards(medium: Medium, boards: Boards, seed: u64) -> BoardSet {
    let rig = &Rig::default();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut corners = [(); 2].map(|()| CornerList { views: Vec::new(), image_size_px: None });
    while corners[0].views.len() < boards.pairs {
        let pose = pose(&boards, &mut random);
        let name = format!("{:02}.png", corners[0].views.len());
        if let [Some(first), Some(second)] =
            [0, 1].map(|camera| view(rig, &boards.board, camera, medium, &pose, name.clone()))
        {
            corners[0].views.push(first);
            corners[1].views.push(second);
        }
    }
    for corner in corners.iter_mut().flat_map(|list| &mut list.views).flat_map(|view| &mut view.corners) {
        corner.pixel = corner.pixel.map(|value| {
            let error: f64 = StandardNormal.sample(&mut random);
            value + NOISE_PX * error
        });
    }
    let name = match medium {
        Medium::Air => "air",
        Medium::Water => "water",
    };
    BoardSet { name: name.to_owned(), medium, corners }
}

/// Camera 1 where it truly is, the tube as designed.
pub fn settings(rig: &Rig) -> StereoSettings {
    let camera = CameraSettings { image_size_px: [1024, 768], degree: Some(6), tangential: true };
    StereoSettings {
        cameras: [camera.clone(), camera],
        board: Some(BOARD),
        first_pose: rig.cameras[0].air.as_ref().unwrap().pose,
        tube: Some(TubeSettings {
            tube: Rig::ideal().tube.unwrap(),
            water_index: rig.water.index(),
            known: TubeKnowledge::default(),
        }),
    }
}
