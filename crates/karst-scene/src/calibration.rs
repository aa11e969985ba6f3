//! Scenes for the calibration of cameras: one board, in air or under water.

use crate::board::SeenCorner;
use crate::render::{Stage, Stream, random};
use crate::{PlacedBoard, Renderer, Scene, SceneError, Shape};
use karst_rig::{Board, Medium, Pose};
use nalgebra::{Matrix3, Point3, Rotation3, Unit, Vector2, Vector3};
use rand::RngExt;
use std::collections::{BTreeSet, HashMap};
use std::f64::consts::{PI, TAU};

/// Distance of the opposite walls of the pool, or room, around a board, mm.
const POOL_MM: f64 = 5000.0;
/// Grey level of the brightest white of a board, DN.
const WHITE_DN: f64 = 210.0;

/// Distances of a board's middle from the rig's axis, mm.
const DISTANCE_MM: [f64; 2] = [350.0, 1600.0];
/// Heights of a board's middle along the rig's axis, mm: beyond them no board is in both images.
const HEIGHT_MM: [f64; 2] = [-500.0, 500.0];
/// Largest angle between a board's normal and the way to the rig's axis, degrees.
const MAX_TILT_DEG: f64 = 45.0;
/// Largest turn of a board about its normal, degrees.
const MAX_ROLL_DEG: f64 = 30.0;
/// Largest angle between a board's normal and a line of sight, degrees. Detectors fail beyond.
const MAX_OBLIQUITY_DEG: f64 = 60.0;
/// Shortest side of a square in an image, px. Detectors fail below.
const MIN_SQUARE_PX: f64 = 6.0;
/// Side of the cells of the images in which boards are counted, px.
const CELL_PX: f64 = 40.0;
/// Poses tried at one distance, of which the one that adds most is taken.
const TRIES: usize = 60;
/// Distances tried for each pose wanted.
const DISTANCES_PER_POSE: usize = 50;

impl Scene {
    /// A board in a hexagonal pool 5 m wide, or in a room of that shape: lasers off, no particles, the lamp dimmed and the
    /// exposure set as an operator does for this distance. The brightest white has about 210 DN.
    pub fn calibration(board: PlacedBoard, medium: Medium) -> Self {
        let mut scene = Self {
            lasers: None,
            snow_per_m3: 0.0,
            board: Some(board),
            ..Self::new(Shape::HexagonalPool { across_flats_mm: POOL_MM })
        };
        if medium == Medium::Air {
            scene = scene.in_air();
        }
        let corners: Vec<_> = (0..board.board.corners()).map(|index| board.corner(index)).collect();
        let nearest_mm = corners.iter().map(|corner| corner.coords.norm()).fold(f64::INFINITY, f64::min);
        scene.light.lamp_w_m2 *= (nearest_mm * 1e-3).powi(2).min(1.0);
        let stage = Stage::new(&scene);
        let normal = board.pose.isometry() * -Vector3::z();
        let white = corners
            .into_iter()
            .flat_map(|corner| {
                let irradiance = stage.lamp_and_ambient(corner, Some(normal));
                let transmission = |c| stage.transmission(c, corner.coords.norm());
                [0, 1, 2].map(|c| board.light_albedo / PI * irradiance[c] * transmission(c))
            })
            .fold(0.0, f64::max);
        // Without light any exposure shows black.
        if white > 0.0 {
            scene.sensor.gain = WHITE_DN / white;
        }
        scene
    }

    /// The scene without water: nothing attenuates or scatters light, and no particles float.
    pub fn in_air(self) -> Self {
        let water = crate::WaterOptics { attenuation_per_m: [0.0; 3], backscatter_per_m: 0.0 };
        Self { water, snow_per_m3: 0.0, ..self }
    }
}

impl Renderer {
    /// `count` poses of a board (from its frame to the rig frame) from which both cameras see all its corners, at evenly
    /// spread distances of 0.35 to 1.6 m from the rig's axis as far as the board fits into both images. It is tilted by up
    /// to 45° about any axis and turned by up to 30° about its normal, and shown where boards have been least in both
    /// images. No side of a square is shorter than 6 px in an image, no line of sight more than 60° from the normal.
    /// Errors: the board has no meaning, or too few such poses are found, as of a board that is too large or too small.
    pub fn board_poses(&self, board: &Board, count: usize, seed: u64) -> Result<Vec<Pose>, SceneError> {
        PlacedBoard::new(*board, Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] }).check()?;
        let mut random = random(seed, Stream::BoardPoses, 0);
        // Steps of the golden ratio: any stretch of the sequence is spread evenly.
        let golden = (5f64.sqrt() - 1.0) / 2.0;
        let start: f64 = random.random();
        let mut boards_in_cell = HashMap::new();
        let mut poses = Vec::new();
        for i in 0..count.saturating_mul(DISTANCES_PER_POSE) {
            if poses.len() == count {
                break;
            }
            let distance = (start + golden * i as f64).fract();
            let tried = (0..TRIES).filter_map(|_| {
                let pose = pose(board, distance, std::array::from_fn(|_| random.random()));
                Some((pose, self.cells(&PlacedBoard::new(*board, pose))?))
            });
            // Half as much for every board that has been in the cell.
            let gain = |cells: &BTreeSet<Cell>| -> f64 {
                cells.iter().map(|cell| 0.5f64.powi(boards_in_cell.get(cell).copied().unwrap_or(0))).sum()
            };
            let best = tried.map(|(pose, cells)| (gain(&cells), pose, cells)).max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, pose, cells)) = best {
                poses.push(pose);
                for cell in cells {
                    *boards_in_cell.entry(cell).or_insert(0) += 1;
                }
            }
        }
        if poses.len() < count { Err(SceneError::NoBoardPose { found: poses.len(), count }) } else { Ok(poses) }
    }

    /// The cells of both images in which a board's corners are. None: not all of them are seen well.
    fn cells(&self, placed: &PlacedBoard) -> Option<BTreeSet<Cell>> {
        let normal = placed.pose.isometry() * -Vector3::z();
        let mut cells = BTreeSet::new();
        for (camera, view) in self.views.iter().enumerate() {
            let corners = (0..placed.board.corners()).map(|index| {
                let seen = SeenCorner::new(view, placed, index)?;
                let facing = normal.dot(&(seen.from - seen.point).normalize());
                (seen.in_field_from_front && facing >= MAX_OBLIQUITY_DEG.to_radians().cos()).then_some(seen.pixel)
            });
            let corners = corners.collect::<Option<Vec<_>>>()?;
            if shortest_side(&placed.board, &corners) < MIN_SQUARE_PX {
                return None;
            }
            cells.extend(corners.iter().map(|pixel| (camera, [pixel.x, pixel.y].map(|p| (p / CELL_PX) as u32))));
        }
        Some(cells)
    }
}

/// A camera, and a cell of its image.
type Cell = (usize, [u32; 2]);

/// Shortest distance between neighbouring corners, px.
fn shortest_side(board: &Board, corners: &[Vector2<f64>]) -> f64 {
    let along_x = corners.chunks(board.columns).flat_map(|row| row.windows(2)).map(|pair| (pair[0] - pair[1]).norm());
    let along_y = corners.iter().zip(&corners[board.columns..]).map(|(a, b)| (a - b).norm());
    along_x.chain(along_y).fold(f64::INFINITY, f64::min)
}

/// A pose from numbers between 0 and 1: distance, azimuth and height of the board's middle; tilt, its axis, and roll.
fn pose(board: &Board, distance: f64, [azimuth, height, tilt, axis, roll]: [f64; 5]) -> Pose {
    let between = |[from, to]: [f64; 2], t: f64| from + t * (to - from);
    // Even in the inverse: the size in the image is.
    let distance_mm = 1.0 / between(DISTANCE_MM.map(f64::recip), distance);
    let (sin, cos) = (TAU * azimuth).sin_cos();
    let outwards = Vector3::new(cos, sin, 0.0);
    let middle = Point3::from(distance_mm * outwards + between(HEIGHT_MM, height) * Vector3::z());
    // Upright for who looks outwards along the lasers: y down the axis, z away.
    let down = -Vector3::z();
    let upright = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[down.cross(&outwards), down, outwards]));
    let (sin, cos) = (TAU * axis).sin_cos();
    let tilt =
        Rotation3::from_axis_angle(&Unit::new_normalize(Vector3::new(cos, sin, 0.0)), tilt * MAX_TILT_DEG.to_radians());
    let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), (2.0 * roll - 1.0) * MAX_ROLL_DEG.to_radians());
    let rotation = upright * tilt * roll;
    let [x, y] = board.corner_mm(board.corners() - 1).map(|last| last / 2.0);
    let (x_deg, y_deg, z_deg) = rotation.euler_angles();
    Pose {
        position_mm: (middle - rotation * Vector3::new(x, y, 0.0)).coords.into(),
        rotation_deg: [x_deg, y_deg, z_deg].map(f64::to_degrees),
    }
}
