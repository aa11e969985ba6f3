//! A calibration board in the scene: where rays meet it, what light it sends, and the truth of its corners.

use crate::optics::{GRID_PX, View};
use crate::psf::blurred;
use crate::render::Stage;
use crate::scene::within;
use crate::{BoardTruth, CornerTruth, FIELD_MARGIN_PX, Hit, SceneError};
use karst_rig::{Board, Pose, Ray};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};

/// Width of the light margin around the outer squares, in squares.
pub const BOARD_MARGIN_SQUARES: usize = 1;
/// Albedo of the board's back.
pub const BOARD_BACK_ALBEDO: f64 = 0.3;

/// Most inner corners along one side.
const MAX_SIDE: usize = 100;
/// Points at which a pixel on an edge is sampled, even.
const SAMPLES: usize = 128;

/// A painted checkerboard in the scene: flat, opaque, Lambertian, thinner than any part of a pixel. Its front has a light
/// margin of [`BOARD_MARGIN_SQUARES`] around the outer squares, its back is even grey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedBoard {
    /// Squares and corners, 2 to 100 inner corners along each side.
    pub board: Board,
    /// From the board's frame to the rig frame. The board has to be clear of the instrument.
    pub pose: Pose,
    /// Albedo of the dark squares, 0 to 1.
    pub dark_albedo: f64,
    /// Albedo of the light squares and the margin, 0 to 1.
    pub light_albedo: f64,
}

impl PlacedBoard {
    /// A board painted matt black (albedo 0.05) and white (0.85).
    pub fn new(board: Board, pose: Pose) -> Self {
        Self { board, pose, dark_albedo: 0.05, light_albedo: 0.85 }
    }

    pub(crate) fn check(&self) -> Result<(), SceneError> {
        for (name, corners) in [("columns", self.board.columns), ("rows", self.board.rows)] {
            within(name, corners as f64, 2.0, MAX_SIDE as f64, "between 2 and 100")?;
        }
        within("square_mm", self.board.square_mm, f64::MIN_POSITIVE, f64::MAX, "positive")?;
        for value in self.pose.position_mm.into_iter().chain(self.pose.rotation_deg) {
            within("pose of the board", value, f64::MIN, f64::MAX, "finite")?;
        }
        within("dark_albedo", self.dark_albedo, 0.0, 1.0, "between 0 and 1")?;
        within("light_albedo", self.light_albedo, 0.0, 1.0, "between 0 and 1")
    }

    /// Position of an inner corner, rig frame.
    pub(crate) fn corner(&self, index: usize) -> Point3<f64> {
        let [x, y] = self.board.corner_mm(index);
        self.pose.isometry() * Point3::new(x, y, 0.0)
    }

    /// Column and row of the square of the pattern, margin and beyond included, in which a point of the plane lies.
    fn square(&self, point: Vector2<f64>) -> [i64; 2] {
        (point / self.board.square_mm).map(|value| value.floor() as i64).into()
    }

    /// Albedo of a square of the front. None: beyond the board.
    fn albedo(&self, square: [i64; 2]) -> Option<f64> {
        let outside = [self.board.columns, self.board.rows].map(|corners| corners as i64);
        // Squares -1 to `corners - 1` carry the pattern.
        let beyond = std::array::from_fn::<_, 2, _>(|i| (-1 - square[i]).max(square[i] - outside[i] + 1).max(0));
        let beyond = beyond[0].max(beyond[1]);
        if beyond > BOARD_MARGIN_SQUARES as i64 {
            return None;
        }
        let middle = square.map(|i| (i as f64 + 0.5) * self.board.square_mm);
        Some(if beyond == 0 && self.board.is_dark(middle) { self.dark_albedo } else { self.light_albedo })
    }
}

/// A board ready to be met by rays, rig frame.
pub(crate) struct Panel<'a> {
    placed: &'a PlacedBoard,
    to_rig: Isometry3<f64>,
}

impl<'a> Panel<'a> {
    pub fn new(placed: &'a PlacedBoard) -> Self {
        Self { placed, to_rig: placed.pose.isometry() }
    }

    /// Where a ray meets the board's plane, in its frame, and how far from the ray's origin.
    fn meets_plane(&self, ray: &Ray) -> Option<(Vector2<f64>, f64)> {
        let origin = self.to_rig.inverse_transform_point(&ray.origin);
        let direction = self.to_rig.inverse_transform_vector(&ray.direction);
        let t_mm = -origin.z / direction.z;
        (t_mm > 0.0 && t_mm.is_finite()).then(|| ((origin + t_mm * direction).xy().coords, t_mm))
    }

    /// Where a ray meets the board.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let (at, t_mm) = self.meets_plane(ray)?;
        self.placed.albedo(self.placed.square(at))?;
        Some(Hit { point: ray.origin + t_mm * ray.direction, normal: self.normal_towards(ray.origin), t_mm })
    }

    /// Whether a place is on the side of the board's front.
    fn is_front(&self, place: Point3<f64>) -> bool {
        self.to_rig.inverse_transform_point(&place).z < 0.0
    }

    /// Unit normal on the side of a place.
    fn normal_towards(&self, place: Point3<f64>) -> Vector3<f64> {
        self.to_rig * if self.is_front(place) { -Vector3::z() } else { Vector3::z() }
    }

    /// Albedo at a point of the board as it is seen from a place.
    pub fn albedo(&self, point: Point3<f64>, from: Point3<f64>) -> f64 {
        let at = self.to_rig.inverse_transform_point(&point).xy().coords;
        match self.placed.albedo(self.placed.square(at)) {
            Some(albedo) if self.is_front(from) => albedo,
            _ => BOARD_BACK_ALBEDO,
        }
    }

    /// Part of a pixel that the board covers, and the mean albedo of that part. The pixel is given by the points of the
    /// plane that its four corners see: top left, top right, bottom left, bottom right.
    fn covered(&self, corners: [Vector2<f64>; 4], front: bool) -> (f64, f64) {
        let albedo = |square| self.placed.albedo(square).map(|albedo| if front { albedo } else { BOARD_BACK_ALBEDO });
        let squares = corners.map(|at| self.placed.square(at));
        if squares.iter().all(|square| *square == squares[0]) {
            return albedo(squares[0]).map_or((0.0, 0.0), |albedo| (1.0, albedo));
        }
        let [a, b, c, d] = corners;
        let (mut inside, mut sum) = (0.0, 0.0);
        for [u, v] in sample_points() {
            let at = (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v;
            if let Some(albedo) = albedo(self.placed.square(at)) {
                inside += 1.0;
                sum += albedo;
            }
        }
        (inside / SAMPLES as f64, if inside > 0.0 { sum / inside } else { 0.0 })
    }
}

/// Evenly spread points of the unit square, in pairs opposite of its middle: their mean is the middle. No edge runs along
/// rows of them, whatever its direction: the share of a pixel on either side of an edge is right to some 1 / `SAMPLES`.
fn sample_points() -> impl Iterator<Item = [f64; 2]> {
    // Powers of the inverse of the plastic number: the R2 sequence.
    const STEP: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
    (0..SAMPLES / 2)
        .map(|i| STEP.map(|step| (0.5 + step * i as f64).fract()))
        .flat_map(|point| [point, point.map(|value| 1.0 - value)])
}

/// The board's light in a rectangle of an image, spread by the point spread function.
pub(crate) struct BoardLayer {
    x0: usize,
    y0: usize,
    width: usize,
    /// Per pixel the light in R, G and B, DN, and the part of the pixel that the board covers.
    pixels: Vec<[f32; 4]>,
}

impl BoardLayer {
    /// Puts the board in front of the light of a pixel.
    pub fn cover(&self, x: usize, y: usize, light: &mut [f32; 3]) {
        let (Some(column), Some(row)) = (x.checked_sub(self.x0), y.checked_sub(self.y0)) else {
            return;
        };
        if column < self.width
            && let Some([board @ .., coverage]) = self.pixels.get(row * self.width + column)
        {
            for (light, board) in light.iter_mut().zip(board) {
                *light = *light * (1.0 - coverage) + board;
            }
        }
    }
}

impl Stage<'_> {
    /// The light of the board in an image. None: no board, or not in this image.
    pub(crate) fn board_layer(&self, view: &View) -> Option<BoardLayer> {
        let placed = self.scene.board.as_ref()?;
        let panel = Panel::new(placed);
        let sensor = &self.scene.sensor;
        let (mut min, mut max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (i, ray) in view.grid.iter().enumerate() {
            if ray.is_some_and(|ray| panel.intersect(&ray).is_some()) {
                for (axis, node) in [i % view.grid_columns, i / view.grid_columns].into_iter().enumerate() {
                    min[axis] = min[axis].min((node * GRID_PX) as f64);
                    max[axis] = max[axis].max((node * GRID_PX) as f64);
                }
            }
        }
        if min[0] > max[0] {
            return None;
        }
        // The grid misses up to its step beyond; light is spread by some standard deviations.
        let margin = GRID_PX as f64 + 4.0 * sensor.blur_px.max(sensor.halo_px);
        let start = min.map(|p| (p - margin).max(0.0) as usize);
        let end: [usize; 2] = std::array::from_fn(|i| ((max[i] + margin) as usize + 1).min(view.size[i]));
        let [width, height] = std::array::from_fn(|i| end[i] - start[i]);

        // What the corners of the pixels see. Over one pixel, the map from there is bilinear within 0.001 px.
        let corners: Vec<_> = (0..=height)
            .flat_map(|row| (0..=width).map(move |column| (column, row)))
            .map(|(column, row)| {
                let pixel = Vector2::new((start[0] + column) as f64 - 0.5, (start[1] + row) as f64 - 0.5);
                if !view.may_see(pixel) {
                    return None;
                }
                let ray = view.ray(pixel)?;
                panel.meets_plane(&ray).map(|(at, _)| (at, ray.origin))
            })
            .collect();
        let pixels: Vec<_> = (0..height)
            .flat_map(|row| (0..width).map(move |column| row * (width + 1) + column))
            .map(|i| {
                let [Some(a), Some(b), Some(c), Some(d)] = [i, i + 1, i + width + 1, i + width + 2].map(|i| corners[i])
                else {
                    return [0.0; 4];
                };
                self.board_pixel(&panel, [a, b, c, d].map(|(at, _)| at), a.1)
            })
            .collect();
        let core = blurred(&pixels, width, sensor.blur_px);
        let halo = blurred(&pixels, width, sensor.halo_px);
        let share = sensor.halo as f32;
        let pixels = core
            .iter()
            .zip(&halo)
            .map(|(core, halo)| std::array::from_fn(|i| (1.0 - share) * core[i] + share * halo[i]))
            .collect();
        Some(BoardLayer { x0: start[0], y0: start[1], width, pixels })
    }

    /// Light of the board, DN, and coverage of a pixel whose corners see these points of the board's plane.
    fn board_pixel(&self, panel: &Panel, corners: [Vector2<f64>; 4], from: Point3<f64>) -> [f32; 4] {
        let (coverage, albedo) = panel.covered(corners, panel.is_front(from));
        if coverage == 0.0 {
            return [0.0; 4];
        }
        let [x, y] = (corners.iter().sum::<Vector2<f64>>() / 4.0).into();
        let point = panel.to_rig * Point3::new(x, y, 0.0);
        if self.is_in_wall(point) || self.is_hidden(point, from) {
            return [0.0; 4];
        }
        let distance_mm = (point - from).norm();
        let reflected = self.reflected_dn(point, panel.normal_towards(from), albedo, distance_mm);
        let haze = self.haze_dn(distance_mm);
        std::array::from_fn(|c| match c {
            3 => coverage as f32,
            c => coverage as f32 * (reflected[c] + haze[c]),
        })
    }

    /// The truth of the board.
    pub(crate) fn board_truth(&self, views: &[View; 2]) -> Option<BoardTruth> {
        let placed = self.scene.board?;
        let corners = views.each_ref().map(|view| {
            let corner = |index| {
                let seen = SeenCorner::new(view, &placed, index)?;
                let visible =
                    seen.in_field_from_front && !self.is_in_wall(seen.point) && !self.is_hidden(seen.point, seen.from);
                Some(CornerTruth { position_px: seen.pixel.into(), visible })
            };
            (0..placed.board.corners()).map(corner).collect()
        });
        Some(BoardTruth { board: placed.board, pose: placed.pose, corners })
    }
}

/// An inner corner as a camera sees it when nothing is in between.
pub(crate) struct SeenCorner {
    pub point: Point3<f64>,
    pub pixel: Vector2<f64>,
    /// Where the ray enters the water, or the viewpoint.
    pub from: Point3<f64>,
    /// The front is seen, in the used ring of the image by a margin.
    pub in_field_from_front: bool,
}

impl SeenCorner {
    /// None: the corner has no image.
    pub fn new(view: &View, placed: &PlacedBoard, index: usize) -> Option<Self> {
        let point = placed.corner(index);
        let pixel = view.project(point)?;
        let from = view.ray(pixel)?.origin;
        let in_field_from_front = Panel::new(placed).is_front(from) && view.in_field(pixel, FIELD_MARGIN_PX);
        Some(Self { point, pixel, from, in_field_from_front })
    }
}
