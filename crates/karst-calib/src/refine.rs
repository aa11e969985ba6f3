//! Robust non-linear least squares over a camera model and the poses of the boards it sees.

use karst_rig::{CameraModel, NORMAL_RADIUS_PX};
use nalgebra::{
    Cholesky, DMatrix, DVector, Isometry3, Matrix2, Matrix2x3, Point3, Translation3, UnitQuaternion, Vector2, Vector3,
};

use crate::initial::median;

/// Newton steps for the radius that sees a point.
const PROJECTION_STEPS: u32 = 50;
/// Steps of the optimisation.
const MAX_STEPS: u32 = 200;
/// The optimisation ends when a step lowers the cost by less than this part.
const COST_TOLERANCE: f64 = 1e-12;
/// Damping beyond which no step can be expected to lower the cost any more.
const MAX_DAMPING: f64 = 1e12;
/// Residual that counts for a point the model does not see, px.
pub(crate) const UNSEEN_RESIDUAL_PX: f64 = 1e3;
/// Scale of the Cauchy loss, on the way to the solution, standard deviations per axis.
const CAUCHY_SIGMAS: f64 = 3.0;
/// Scale of the Huber loss, at the solution, standard deviations per axis. Corners beyond are one in 1100 of normally
/// distributed ones; the tails of real ones are heavier, and fade out slowly.
const HUBER_SIGMAS: f64 = 3.75;
/// Fits with a new scale of the loss.
const SCALE_PASSES: usize = 8;
/// Median of the length of a 2-D normal vector, standard deviations per axis.
const MEDIAN_SIGMAS: f64 = 1.1774;
/// Smallest standard deviation per axis that is believed, px: perfect synthetic corners must not all be outliers.
const LEAST_SIGMA_PX: f64 = 1e-6;
/// Parameters of a pose.
pub(crate) const POSE: usize = 6;

/// Where a camera model sees a point, and how that changes.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    /// The pixel, px.
    pub pixel: Vector2<f64>,
    /// Normalised radius s.
    pub s: f64,
    /// (u', v') / 512 px.
    pub ideal: Vector2<f64>,
    /// Derivative of the pixel by the point, px/mm.
    pub by_point: Matrix2x3<f64>,
    /// Derivative of the pixel by f / 512 px; times s^i it is the derivative by coefficient i.
    pub by_f: Vector2<f64>,
    /// The same for z_v / 512 mm.
    pub by_axial: Vector2<f64>,
    /// Derivative of the pixel by (u'', v'') / 512 px.
    pub by_corrected: Matrix2<f64>,
}

impl Projection {
    /// Where `model` (its pose ignored) sees `point` in the camera frame, mm. Of several radii that see it, the
    /// one that Newton's method reaches from `near`, a pixel. None: there is none.
    pub fn new(model: &CameraModel, point: Point3<f64>, near: Vector2<f64>) -> Option<Self> {
        let across = point.coords.xy();
        let distance = across.norm();
        let mut s = model.corrected(near).norm() / NORMAL_RADIUS_PX;
        // On the axis any azimuth will do.
        let azimuth = if distance > 0.0 { across / distance } else { Vector2::x() };
        let mut converged = false;
        for _ in 0..PROJECTION_STEPS {
            // distance * f = rho * (z - z_v), as in CameraModel::project
            let (excess, by_s) = excess(model, distance, point.z, s);
            let step = excess / by_s;
            s -= step;
            if !step.is_finite() {
                return None;
            }
            if step.abs() <= 1e-14 * (1.0 + s.abs()) {
                converged = true;
                break;
            }
        }
        let (_, by_s) = excess(model, distance, point.z, s);
        // The excess falls with the radius where rays turn away from the viewing direction; elsewhere is a mirror image.
        if !converged || s < 0.0 || by_s.is_nan() || by_s >= 0.0 {
            return None;
        }
        let pixel = model.pixel(azimuth * (s * NORMAL_RADIUS_PX))?;
        let (ideal, by_corrected) = image_terms(model, pixel)?;
        let (f, _) = horner_with_derivative(&model.polynomial, s);
        let turn = if distance > 1e-9 { s / distance } else { f / point.z };
        let outwards = azimuth * azimuth.transpose();
        let by_across = turn * (Matrix2::identity() - outwards) - outwards * (f / by_s);
        let mut by_point = Matrix2x3::zeros();
        by_point.fixed_view_mut::<2, 2>(0, 0).copy_from(&(by_corrected * by_across));
        by_point.set_column(2, &(by_corrected * azimuth * (s / by_s)));
        let by_f = by_corrected * azimuth * (-distance / by_s);
        let by_axial = by_corrected * azimuth * (-s * NORMAL_RADIUS_PX / by_s);
        Some(Self { pixel, s, ideal, by_point, by_f, by_axial, by_corrected })
    }
}

/// What vanishes at the radius that sees a point at `distance` from the axis and height `z`, and its derivative by s.
fn excess(model: &CameraModel, distance: f64, z: f64, s: f64) -> (f64, f64) {
    let (f, f_slope) = horner_with_derivative(&model.polynomial, s);
    let (axial, axial_slope) = horner_with_derivative(&model.axial, s);
    let height = z - NORMAL_RADIUS_PX * axial;
    (distance * f - s * height, distance * f_slope - height + s * NORMAL_RADIUS_PX * axial_slope)
}

/// (u', v') / 512 px of a pixel, and the derivative of the pixel by (u'', v'') / 512 px.
pub(crate) fn image_terms(model: &CameraModel, pixel: Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    let [c, d, e] = model.affine;
    let affine = Matrix2::new(c, d, e, 1.0);
    let ideal = affine.try_inverse()? * (pixel - Vector2::from(model.centre_px)) / NORMAL_RADIUS_PX;
    let by_corrected = NORMAL_RADIUS_PX * affine * model.decentring_jacobian(ideal).try_inverse()?;
    Some((ideal, by_corrected))
}

pub(crate) fn horner_with_derivative(coefficients: &[f64], s: f64) -> (f64, f64) {
    coefficients.iter().rev().fold((0.0, 0.0), |(sum, slope), c| (sum * s + c, slope * s + sum))
}

/// One corner: where it is on the board and in the picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Observation {
    /// Number of the corner.
    pub index: usize,
    pub board: Point3<f64>,
    pub pixel: Vector2<f64>,
}

/// Which terms of the camera model are unknown.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Unknowns {
    /// Powers of s in f.
    pub powers: Vec<usize>,
    /// Powers of s in z_v.
    pub axial: Vec<usize>,
    pub centre: bool,
    /// Aspect c and symmetric shear d = e: the other two terms are a rotation about the axis and the unit of f.
    pub affine: bool,
    pub tangential: bool,
    /// The poses of all boards.
    pub poses: bool,
}

impl Unknowns {
    /// All terms of a polynomial of this degree. It has no linear term: f is smooth at the centre.
    pub fn of_degree(degree: usize, tangential: bool) -> Self {
        let powers = std::iter::once(0).chain(2..=degree).collect();
        Self { powers, axial: Vec::new(), centre: true, affine: true, tangential, poses: true }
    }

    pub fn len(&self) -> usize {
        let terms = self.powers.len() + self.axial.len();
        terms + 2 * (usize::from(self.centre) + usize::from(self.affine) + usize::from(self.tangential))
    }

    /// Derivatives of a pixel by the unknown terms.
    pub fn derivatives(&self, projection: &Projection, into: &mut Vec<Vector2<f64>>) {
        into.clear();
        into.extend(self.powers.iter().map(|&power| projection.by_f * projection.s.powi(power as i32)));
        into.extend(self.axial.iter().map(|&power| projection.by_axial * projection.s.powi(power as i32)));
        let [x, y] = projection.ideal.into();
        if self.centre {
            into.extend([Vector2::x(), Vector2::y()]);
        }
        if self.affine {
            into.extend([Vector2::new(x, 0.0), Vector2::new(y, x)].map(|by| by * NORMAL_RADIUS_PX));
        }
        if self.tangential {
            let r2 = x * x + y * y;
            let by_p1 = Vector2::new(2.0 * x * y, r2 + 2.0 * y * y);
            let by_p2 = Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y);
            into.extend([by_p1, by_p2].map(|by| -(projection.by_corrected * by)));
        }
    }

    /// Adds a step to the unknown terms of a model.
    pub fn add(&self, model: &mut CameraModel, step: &[f64]) {
        let mut step = step.iter();
        let mut next = || step.next().copied().unwrap_or_default();
        for (powers, coefficients) in [(&self.powers, &mut model.polynomial), (&self.axial, &mut model.axial)] {
            for &power in powers {
                if coefficients.len() <= power {
                    coefficients.resize(power + 1, 0.0);
                }
                coefficients[power] += next();
            }
        }
        if self.centre {
            model.centre_px = model.centre_px.map(|value| value + next());
        }
        if self.affine {
            model.affine[0] += next();
            let shear = next();
            model.affine[1] += shear;
            model.affine[2] += shear;
        }
        if self.tangential {
            model.tangential = model.tangential.map(|value| value + next());
        }
    }
}

/// How much large residuals count.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Loss {
    /// r^2 up to c px, 2 c r - c^2 beyond.
    Huber(f64),
    /// c^2 ln(1 + r^2 / c^2), c in px: hardly anything beyond a few c.
    Cauchy(f64),
}

impl Loss {
    /// The loss of the fit that counts, for corners with this standard deviation per axis, px.
    pub fn final_of(sigma_px: f64) -> Self {
        Self::Huber(HUBER_SIGMAS * sigma_px)
    }

    /// Cost and weight of a squared residual.
    pub fn of(self, squared: f64) -> (f64, f64) {
        match self {
            Self::Huber(c) if squared <= c * c => (squared, 1.0),
            Self::Huber(c) => (c * (2.0 * squared.sqrt() - c), c / squared.sqrt()),
            Self::Cauchy(c) => (c * c * (squared / (c * c)).ln_1p(), 1.0 / (1.0 + squared / (c * c))),
        }
    }
}

/// A camera and the boards in front of it.
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    pub model: CameraModel,
    /// Board frame to camera frame, mm.
    pub poses: Vec<Isometry3<f64>>,
}

impl Scene {
    /// Residual of a corner, observed minus expected, px. None: the model does not see it.
    pub fn residual(&self, view: usize, observation: &Observation) -> Option<Vector2<f64>> {
        let point = self.poses[view] * observation.board;
        Projection::new(&self.model, point, observation.pixel).map(|seen| observation.pixel - seen.pixel)
    }

    fn cost(&self, views: &[Vec<Observation>], loss: Loss) -> f64 {
        let residuals = views.iter().enumerate().flat_map(|(view, corners)| {
            corners
                .iter()
                .map(move |corner| self.residual(view, corner).map_or(UNSEEN_RESIDUAL_PX.powi(2), |r| r.norm_squared()))
        });
        residuals.map(|squared| loss.of(squared).0).sum()
    }

    /// Normal matrix and right-hand side: first the unknown terms of the camera, then each pose's rotation and position.
    fn normal_equations(
        &self,
        views: &[Vec<Observation>],
        unknowns: &Unknowns,
        loss: Loss,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let camera = unknowns.len();
        let size = camera + if unknowns.poses { POSE * views.len() } else { 0 };
        let mut matrix = DMatrix::zeros(size, size);
        let mut right = DVector::zeros(size);
        let mut derivatives = Vec::new();
        for (view, corners) in views.iter().enumerate() {
            let pose = &self.poses[view];
            for corner in corners {
                let turned = pose.rotation * corner.board;
                let point = turned + pose.translation.vector;
                let Some(projection) = Projection::new(&self.model, point, corner.pixel) else {
                    continue;
                };
                let residual = corner.pixel - projection.pixel;
                let (_, weight) = loss.of(residual.norm_squared());
                unknowns.derivatives(&projection, &mut derivatives);
                if unknowns.poses {
                    derivatives.extend(by_pose(&projection.by_point, &turned.coords));
                }
                let place = |i: usize| if i < camera { i } else { i + POSE * view };
                for (i, by_i) in derivatives.iter().enumerate() {
                    right[place(i)] += weight * by_i.dot(&residual);
                    for (j, by_j) in derivatives[..=i].iter().enumerate() {
                        matrix[(place(i), place(j))] += weight * by_i.dot(by_j);
                    }
                }
            }
        }
        (matrix, right)
    }

    fn moved(&self, unknowns: &Unknowns, step: &[f64]) -> Self {
        let (camera, poses) = step.split_at(unknowns.len());
        let mut moved = self.clone();
        unknowns.add(&mut moved.model, camera);
        for (pose, step) in moved.poses.iter_mut().zip(poses.chunks_exact(POSE)) {
            *pose = moved_pose(pose, step);
        }
        moved
    }

    /// Lowers the cost of all residuals as far as it goes.
    pub fn refine(&mut self, views: &[Vec<Observation>], unknowns: &Unknowns, loss: Loss) {
        levenberg_marquardt(
            self,
            |scene| scene.cost(views, loss),
            |scene| scene.normal_equations(views, unknowns, loss),
            |scene, step| scene.moved(unknowns, step),
            COST_TOLERANCE,
        );
    }

    /// Covariance of all unknowns, from the scatter of the residuals and the normal matrix. None: some combination of
    /// them does not follow from the residuals.
    pub fn covariance(&self, views: &[Vec<Observation>], unknowns: &Unknowns, loss: Loss) -> Option<DMatrix<f64>> {
        let (matrix, _) = self.normal_equations(views, unknowns, loss);
        let residuals = views
            .iter()
            .enumerate()
            .flat_map(|(view, corners)| corners.iter().filter_map(move |corner| self.residual(view, corner)));
        covariance(matrix, residuals, loss)
    }
}

/// A pose after a step: rotation vector (rad) and shift (mm), both along the axes of the frame that the pose leads to.
pub(crate) fn moved_pose(pose: &Isometry3<f64>, step: &[f64]) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(&step[..3]));
    let shift = Vector3::from_column_slice(&step[3..POSE]);
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + shift),
        UnitQuaternion::new_normalize((turn * pose.rotation).into_inner()),
    )
}

/// Derivatives of a pixel by the step of a board's pose, given those by the point and the turned point of the board.
pub(crate) fn by_pose(by_point: &Matrix2x3<f64>, turned: &Vector3<f64>) -> [Vector2<f64>; POSE] {
    let by_turn = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| by_point * axis.cross(turned));
    let by_shift = [0, 1, 2].map(|axis| by_point.column(axis).into_owned());
    [by_turn[0], by_turn[1], by_turn[2], by_shift[0], by_shift[1], by_shift[2]]
}

/// Standard deviation per axis, px, from the median length of residuals: outliers do not move it.
pub(crate) fn sigma_px(lengths: Vec<f64>) -> f64 {
    (median(lengths) / MEDIAN_SIGMAS).clamp(LEAST_SIGMA_PX, 1e3)
}

/// Robust refinement, its scale following the residuals down. `refine` takes a loss and the standard deviation it is for.
pub(crate) fn robust_fit<S>(state: &mut S, sigma_of: impl Fn(&S) -> f64, refine: impl Fn(&mut S, Loss, f64)) {
    let mut last = f64::INFINITY;
    for _ in 0..SCALE_PASSES {
        let sigma = sigma_of(state);
        if sigma > 0.99 * last {
            break;
        }
        last = sigma;
        refine(state, Loss::Cauchy(CAUCHY_SIGMAS * sigma), sigma);
    }
}

/// The fit that counts: nearly least squares, but no residual pulls harder than one at the limit of the loss.
pub(crate) fn final_fit<S>(state: &mut S, sigma_of: impl Fn(&S) -> f64, refine: impl Fn(&mut S, Loss, f64)) -> Loss {
    let mut sigma = sigma_of(state);
    for _ in 0..SCALE_PASSES {
        refine(state, Loss::final_of(sigma), sigma);
        let last = sigma;
        sigma = sigma_of(state);
        if (sigma - last).abs() <= 1e-3 * last {
            break;
        }
    }
    Loss::final_of(sigma)
}

/// Lowers the cost of a state until a step lowers it by less than the part `tolerance`, given the normal matrix (lower
/// triangle) and right-hand side at a state and the state after a step.
pub(crate) fn levenberg_marquardt<S>(
    state: &mut S,
    cost_of: impl Fn(&S) -> f64,
    equations: impl Fn(&S) -> (DMatrix<f64>, DVector<f64>),
    moved: impl Fn(&S, &[f64]) -> S,
    tolerance: f64,
) {
    let mut cost = cost_of(state);
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let (matrix, right) = equations(state);
        let last_cost = cost;
        while damping < MAX_DAMPING {
            let mut damped = matrix.clone();
            for i in 0..damped.nrows() {
                damped[(i, i)] *= 1.0 + damping;
            }
            let trial = Cholesky::new(damped).map(|factor| moved(state, factor.solve(&right).as_slice()));
            if let Some(trial) = trial {
                let trial_cost = cost_of(&trial);
                if trial_cost < cost {
                    *state = trial;
                    cost = trial_cost;
                    damping = (0.1 * damping).max(1e-12);
                    break;
                }
            }
            damping *= 10.0;
        }
        // Also ends when no damping helped: the cost is then the last one.
        if last_cost - cost <= tolerance * last_cost {
            return;
        }
    }
}

/// Covariance of the unknowns, from the normal matrix (lower triangle) and the scatter of the residuals. None: some
/// combination of the unknowns does not follow from the residuals.
pub(crate) fn covariance(
    matrix: DMatrix<f64>,
    residuals: impl Iterator<Item = Vector2<f64>>,
    loss: Loss,
) -> Option<DMatrix<f64>> {
    let inverse = Cholesky::new(matrix)?.inverse();
    let (mut sum, mut values) = (0.0, 0);
    for residual in residuals {
        // What a residual pulls with: its length up to the limit of the loss.
        let (_, weight) = loss.of(residual.norm_squared());
        sum += (weight * residual).norm_squared();
        values += 2;
    }
    let freedom = values - i32::try_from(inverse.nrows()).ok()?;
    (freedom > 0).then(|| inverse * (sum / f64::from(freedom)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use karst_rig::Pose;

    #[test]
    fn derivatives_of_an_axial_projection_are_those_by_differences() {
        let model = CameraModel {
            pose: Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] },
            centre_px: [513.0, 382.0],
            affine: [1.001, 0.002, 0.002],
            tangential: [1e-3, -2e-3],
            polynomial: vec![0.3, 0.1, -0.8, 0.05],
            axial: vec![0.0, 0.2, -0.3],
        };
        let (point, near) = (Point3::new(600.0, -200.0, 150.0), Vector2::new(700.0, 320.0));
        let seen = Projection::new(&model, point, near).unwrap();
        let ray = model.ray(seen.pixel);
        assert!((point - ray.origin).cross(&ray.direction).norm() < 1e-9);
        let unknowns = Unknowns {
            powers: vec![0, 1, 2, 3],
            axial: vec![1, 2],
            centre: true,
            affine: true,
            tangential: true,
            poses: false,
        };
        let mut derivatives = Vec::new();
        unknowns.derivatives(&seen, &mut derivatives);
        assert_eq!(derivatives.len(), unknowns.len());
        for (i, expected) in derivatives.iter().enumerate() {
            let at = |change: f64| {
                let (mut moved, mut step) = (model.clone(), vec![0.0; unknowns.len()]);
                step[i] = change;
                unknowns.add(&mut moved, &step);
                Projection::new(&moved, point, near).unwrap().pixel
            };
            let found = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((found - expected).norm() < 1e-5 * (1.0 + expected.norm()), "{i}: {found}, {expected}");
        }
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-4);
            let at = |point| Projection::new(&model, point, near).unwrap().pixel;
            let found = (at(point + step) - at(point - step)) / 2e-4;
            assert!((found - seen.by_point.column(axis)).norm() < 1e-6, "{axis}: {found}");
        }
    }
}
