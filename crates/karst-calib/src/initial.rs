//! First guess of a camera from plane boards, without any knowledge of it.
//!
//! Whatever f is, a corner lies on the line from the image centre in the direction of (x, y) of its point: linear in
//! the first two rows of the board's pose (Scaramuzza et al., IROS 2006), and, with the centre unknown too, bilinear like
//! a fundamental matrix whose left epipole is the centre (Hartley, Kang, ICCV 2005).

use karst_rig::{CameraModel, NORMAL_RADIUS_PX};
use nalgebra::{
    Cholesky, DMatrix, DVector, Isometry3, Matrix3, Rotation3, SMatrix, SVector, SymmetricEigen, Translation3,
    UnitQuaternion, Vector2, Vector3,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::refine::Observation;

/// Random samples of the search for the centre.
const SAMPLES: usize = 200;
/// Corners of a sample. Eight define a centre; more make a sample that holds under noise, and are still likely to be free
/// of outliers.
const SAMPLE_CORNERS: usize = 16;
/// Passes of iterative reweighting.
const PASSES: usize = 4;
/// Passes of choosing the side of each board.
const SIDE_PASSES: usize = 5;

/// The part of a board's pose that the directions of its corners from the image centre tell.
#[derive(Debug, Clone)]
pub(crate) struct RadialPose {
    /// First two rows of (r1, r2, t), t in mm.
    rows: [Vector3<f64>; 2],
    /// (r31, r32) but for a common sign.
    third: Vector2<f64>,
    /// Distance of each corner from its line, px.
    pub residuals: Vec<f64>,
}

/// Board coordinates moved and scaled to around 1, for the condition of the equations.
struct BoardUnit {
    middle: Vector2<f64>,
    scale: f64,
}

impl BoardUnit {
    /// None: all corners are in one place.
    fn new(corners: &[Observation]) -> Option<Self> {
        let count = corners.len().max(1) as f64;
        let middle = corners.iter().map(|corner| corner.board.coords.xy()).sum::<Vector2<f64>>() / count;
        let scale = corners.iter().map(|corner| (corner.board.coords.xy() - middle).norm()).sum::<f64>() / count;
        (scale > 0.0).then_some(Self { middle, scale })
    }

    fn of(&self, corner: &Observation) -> Vector3<f64> {
        ((corner.board.coords.xy() - self.middle) / self.scale).push(1.0)
    }

    /// A row in these coordinates as a row in mm.
    fn row_in_mm(&self, row: Vector3<f64>) -> Vector3<f64> {
        (row.xy() / self.scale).push(row.z - row.xy().dot(&self.middle) / self.scale)
    }
}

impl RadialPose {
    /// None: the corners do not define a pose, for instance because they are on one line.
    pub fn new(corners: &[Observation], centre: Vector2<f64>) -> Option<Self> {
        let unit = BoardUnit::new(corners)?;
        let offsets: Vec<Vector2<f64>> =
            corners.iter().map(|corner| (corner.pixel - centre) / NORMAL_RADIUS_PX).collect();
        let points: Vec<Vector3<f64>> = corners.iter().map(|corner| unit.of(corner)).collect();
        let mut weights = vec![1.0; corners.len()];
        let mut rows = [Vector3::zeros(); 2];
        let mut residuals = Vec::new();
        for _ in 0..PASSES {
            // u (row 2 . point) - v (row 1 . point) = 0
            let mut matrix = SMatrix::<f64, 6, 6>::zeros();
            for ((offset, point), weight) in offsets.iter().zip(&points).zip(&weights) {
                let [p, q] = [point * -offset.y, point * offset.x];
                let equation = SVector::<f64, 6>::from_column_slice(&[p.x, p.y, p.z, q.x, q.y, q.z]);
                matrix += *weight * equation * equation.transpose();
            }
            let eigen = SymmetricEigen::try_new(matrix, f64::EPSILON, 1000)?;
            let solution = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
            rows = [solution.fixed_rows::<3>(0).into_owned(), solution.fixed_rows::<3>(3).into_owned()];
            let directions = points.iter().map(|point| Vector2::new(rows[0].dot(point), rows[1].dot(point)));
            let lengths: Vec<(f64, f64)> = offsets
                .iter()
                .zip(directions)
                .map(|(offset, direction)| {
                    let length = direction.norm().max(1e-12);
                    (NORMAL_RADIUS_PX * offset.perp(&direction).abs() / length, length)
                })
                .collect();
            residuals = lengths.iter().map(|(residual, _)| *residual).collect();
            let scale = 2.0 * median(residuals.clone()) + 1e-6;
            // Equations are residuals times lengths: weigh that out, or far points count for more.
            weights = lengths.iter().map(|(r, length)| 1.0 / ((1.0 + (r / scale).powi(2)) * length * length)).collect();
        }
        // Corners are on the side of the centre that their points are on.
        let side: f64 = offsets
            .iter()
            .zip(&points)
            .map(|(offset, point)| offset.dot(&Vector2::new(rows[0].dot(point), rows[1].dot(point))).signum())
            .sum();
        let mut rows = rows.map(|row| unit.row_in_mm(row) * side.signum());
        // The first two columns of the rotation have equal lengths and are at right angles.
        let (first, second) = (Vector2::new(rows[0].x, rows[1].x), Vector2::new(rows[0].y, rows[1].y));
        let difference = second.norm_squared() - first.norm_squared();
        let product = -first.dot(&second);
        let root = difference.hypot(2.0 * product);
        let third = if difference >= 0.0 {
            let r31 = (0.5 * (difference + root)).sqrt();
            Vector2::new(r31, if r31 > 0.0 { product / r31 } else { 0.0 })
        } else {
            let r32 = (0.5 * (root - difference)).sqrt();
            Vector2::new(product / r32, r32)
        };
        let scale = (first.norm_squared() + third.x * third.x).sqrt();
        rows = rows.map(|row| row / scale);
        let finite = scale > 0.0 && rows.iter().flat_map(|row| row.iter()).all(|value| value.is_finite());
        finite.then_some(Self { rows, third: third / scale, residuals })
    }

    /// |cos| of the angle between the board's normal and the camera's axis.
    pub fn frontal(&self) -> f64 {
        (self.rows[0].x * self.rows[1].y - self.rows[0].y * self.rows[1].x).abs()
    }

    /// For each corner s, distance from the axis (mm) and height over the board's origin (mm, but for a sign).
    fn terms<'a>(
        &'a self,
        corners: &'a [Observation],
        centre: Vector2<f64>,
    ) -> impl Iterator<Item = (f64, f64, f64)> + Clone + 'a {
        corners.iter().map(move |corner| {
            let offset = corner.pixel - centre;
            let board = corner.board.coords.xy().push(1.0);
            let across = Vector2::new(self.rows[0].dot(&board), self.rows[1].dot(&board));
            let rho = offset.norm().max(1e-9);
            (rho / NORMAL_RADIUS_PX, offset.dot(&across) / rho, self.third.dot(&board.xy()))
        })
    }

    fn pose(&self, side: f64, height: f64) -> Isometry3<f64> {
        let column = |axis: usize| Vector3::new(self.rows[0][axis], self.rows[1][axis], side * self.third[axis]);
        let (x, y) = (column(0), column(1));
        let rotation = Rotation3::from_matrix(&Matrix3::from_columns(&[x, y, x.cross(&y)]));
        Isometry3::from_parts(
            Translation3::new(self.rows[0].z, self.rows[1].z, height),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }
}

/// The image centre, by random samples: the one with the least median distance of all corners from their lines.
pub(crate) fn find_centre(views: &[Vec<Observation>], image_size_px: [u32; 2]) -> Option<Vector2<f64>> {
    let size = Vector2::from(image_size_px.map(f64::from));
    // A fixed seed: the same corners give the same result.
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut samples: Vec<Vec<Observation>> = views.to_vec();
    for _ in 0..SAMPLES {
        let corners = &views[random.random_range(0..views.len())];
        samples.push((0..SAMPLE_CORNERS).map(|_| corners[random.random_range(0..corners.len())]).collect());
    }
    let middle = 0.5 * size;
    let in_reach = |centre: &Vector2<f64>| (0..2).all(|axis| (centre[axis] - middle[axis]).abs() <= size[axis]);
    let candidates = samples.iter().filter_map(|sample| centre_of(sample)).filter(in_reach);
    let scored = candidates.chain([middle]).map(|centre| (centre_score(views, centre), centre));
    scored.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(score, _)| score.is_finite()).map(|(_, centre)| centre)
}

/// Median distance of corners from their lines, px.
fn centre_score(views: &[Vec<Observation>], centre: Vector2<f64>) -> f64 {
    let residuals = views.iter().flat_map(|corners| match RadialPose::new(corners, centre) {
        Some(pose) => pose.residuals,
        None => vec![f64::INFINITY; corners.len()],
    });
    median(residuals.collect())
}

/// The image centre by the corners of one board.
fn centre_of(corners: &[Observation]) -> Option<Vector2<f64>> {
    let unit = BoardUnit::new(corners)?;
    let middle = corners.iter().map(|corner| corner.pixel).sum::<Vector2<f64>>() / corners.len() as f64;
    let scale = corners.iter().map(|corner| (corner.pixel - middle).norm()).sum::<f64>() / corners.len() as f64;
    let mut matrix = SMatrix::<f64, 9, 9>::zeros();
    for corner in corners {
        let pixel = ((corner.pixel - middle) / scale).push(1.0);
        // (u, v, 1) F (x, y, 1)' = 0, the elements of F row by row
        let equation = SVector::<f64, 9>::from_column_slice((unit.of(corner) * pixel.transpose()).as_slice());
        matrix += equation * equation.transpose();
    }
    let eigen = SymmetricEigen::try_new(matrix, f64::EPSILON, 1000)?;
    let solution = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let fundamental = Matrix3::from_row_slice(solution.as_slice());
    let eigen = SymmetricEigen::try_new(fundamental * fundamental.transpose(), f64::EPSILON, 1000)?;
    let epipole = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let centre = epipole.xy() / epipole.z * scale + middle;
    (centre.x.is_finite() && centre.y.is_finite()).then_some(centre)
}

/// A parabola (coefficients 0 and 2) as polynomial, and the poses of the boards. None: the equations have no solution with
/// a positive f at the centre.
pub(crate) fn parabola_and_poses(
    views: &[Vec<Observation>],
    radial: &[RadialPose],
    centre: Vector2<f64>,
) -> Option<([f64; 2], Vec<Isometry3<f64>>)> {
    // s z = distance f: linear in the coefficients and in the height of each board. Mirrored heights with mirrored f
    // solve it as well: of the two, f is positive.
    let mut sides = vec![1.0; views.len()];
    for (view, side) in sides.iter_mut().enumerate() {
        let own = solve_parabola(&views[view..=view], &radial[view..=view], &[1.0], centre);
        *side = own.map_or(1.0, |(parabola, _)| parabola[0].signum());
    }
    let mut solution = None;
    for _ in 0..SIDE_PASSES {
        let (mut parabola, mut heights) = solve_parabola(views, radial, &sides, centre)?;
        if parabola[0] < 0.0 {
            parabola = parabola.map(|a| -a);
            sides.iter_mut().for_each(|side| *side = -*side);
            heights.iter_mut().for_each(|height| *height = -*height);
        }
        // A board's own equations may have been too weak to tell its side; the common parabola is not.
        let better: Vec<f64> =
            (0..views.len()).map(|view| better_side(&views[view], &radial[view], parabola, centre)).collect();
        solution = Some((parabola, heights));
        if better == sides {
            break;
        }
        sides = better;
    }
    let (parabola, heights) = solution.filter(|(parabola, _)| parabola[0] > 0.0)?;
    let poses = radial.iter().zip(&sides).zip(heights).map(|((pose, &side), height)| pose.pose(side, height));
    Some((parabola, poses.collect()))
}

fn solve_parabola(
    views: &[Vec<Observation>],
    radial: &[RadialPose],
    sides: &[f64],
    centre: Vector2<f64>,
) -> Option<([f64; 2], Vec<f64>)> {
    let size = 2 + views.len();
    let mut matrix = DMatrix::zeros(size, size);
    let mut right = DVector::zeros(size);
    for (view, ((corners, pose), side)) in views.iter().zip(radial).zip(sides).enumerate() {
        let scale = 2.0 * median(pose.residuals.clone()) + 1e-6;
        for ((s, distance, height), residual) in pose.terms(corners, centre).zip(&pose.residuals) {
            let weight = 1.0 / (1.0 + (residual / scale).powi(2));
            let row = [(0, distance), (1, distance * s * s), (2 + view, -s)];
            for (i, a) in row {
                right[i] += weight * a * s * side * height;
                for (j, b) in row {
                    matrix[(i, j)] += weight * a * b;
                }
            }
        }
    }
    let solution: DVector<f64> = Cholesky::new(matrix)?.solve(&right);
    solution
        .iter()
        .all(|value: &f64| value.is_finite())
        .then(|| ([solution[0], solution[1]], solution.as_slice()[2..].to_vec()))
}

/// The side of a board, 1 or -1, that fits better to a known parabola.
fn better_side(corners: &[Observation], pose: &RadialPose, parabola: [f64; 2], centre: Vector2<f64>) -> f64 {
    let ray = |s: f64, distance: f64| distance * (parabola[0] + parabola[1] * s * s) / s;
    let (side, _) = side_and_height(pose.terms(corners, centre), ray);
    side
}

/// The side of a board that fits better to known rays, and the height of its origin there, mm. `terms` are those of its
/// corners; `ray` is the height of a ray (s) at a distance from the axis.
fn side_and_height(terms: impl Iterator<Item = (f64, f64, f64)> + Clone, ray: impl Fn(f64, f64) -> f64) -> (f64, f64) {
    let [front, back] = [1.0, -1.0].map(|side| {
        // Each corner tells the height of the board's origin; on the right side they agree.
        let heights: Vec<f64> = terms.clone().map(|(s, distance, height)| ray(s, distance) - side * height).collect();
        let middle = median(heights.clone());
        let spread = median(heights.iter().map(|height| (height - middle).abs()).collect());
        (spread, side, middle)
    });
    let (_, side, height) = if front.0 <= back.0 { front } else { back };
    (side, height)
}

/// Pose of a board in the frame of a known camera (compact or axial). None: the corners do not define one.
pub(crate) fn board_pose(model: &CameraModel, corners: &[Observation]) -> Option<Isometry3<f64>> {
    board_pose_by(model, corners, |slope, s, distance| distance * slope + NORMAL_RADIUS_PX * horner(&model.axial, s))
}

/// The same for rays that do not go straight: `height` of a ray from its slope (tangent of elevation) at the camera, s, and
/// the distance from the axis.
pub(crate) fn board_pose_by(
    model: &CameraModel,
    corners: &[Observation],
    height: impl Fn(f64, f64, f64) -> f64,
) -> Option<Isometry3<f64>> {
    let corrected: Vec<Observation> =
        corners.iter().map(|corner| Observation { pixel: model.corrected(corner.pixel), ..*corner }).collect();
    let radial = RadialPose::new(&corrected, Vector2::zeros())?;
    let ray = |s: f64, distance: f64| height(horner(&model.polynomial, s) / s, s, distance);
    let (side, height) = side_and_height(radial.terms(&corrected, Vector2::zeros()), ray);
    height.is_finite().then(|| radial.pose(side, height))
}

fn horner(coefficients: &[f64], s: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c)
}

/// Median; NaN of nothing.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
