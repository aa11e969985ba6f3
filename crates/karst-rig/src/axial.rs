//! From a camera in air behind a tube to a camera in the water.
//!
//! Behind a coaxial tube every ray stays in its meridional plane, so a second polynomial, the height at which the ray
//! leaves the axis, makes the model exact. A camera that is off the tube's axis or tilted against it sees slightly
//! skewed rays; to first order a small change of pose, centre and decentring absorbs the skew, so these are fitted too.

use crate::{
    CameraModel, Laser, MAX_AXIAL_COEFFICIENT, MAX_COEFFICIENTS, MAX_POLYNOMIAL_COEFFICIENT, NORMAL_RADIUS_PX, Pose,
    TracedCamera, camera::horner,
};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

/// Coefficients of either polynomial.
const POLYNOMIAL_TERMS: usize = 7;
const AXIAL_TERMS: usize = MAX_COEFFICIENTS;
/// Directions and radii of the grid of pixels.
const AZIMUTHS: u32 = 16;
const RADII: u32 = 24;
/// Distances from the tube's axis along each ray.
const RANGES: u32 = 4;
/// Points along a beam, and how far around it: generously more than a calibrated laser is off.
const BEAM_RANGES: u32 = 16;
const BEAM_OFFSET_MM: f64 = 2.0;
const BEAM_OFFSET_RAD: f64 = 4e-3;
/// Smallest sine of elevation that weights a ray: that of the far end of the working range.
const MIN_SINE: f64 = 0.05;
/// Adjusted alignment: position across the axis (mm), rotation (rad), centre (px), decentring terms.
const ALIGNMENT: usize = 9;
/// Steps of the numeric derivative, in the units of `ALIGNMENT`.
const STEPS: [f64; ALIGNMENT] = [1e-3, 1e-3, 1e-6, 1e-6, 1e-6, 1e-3, 1e-3, 1e-6, 1e-6];
/// How far the alignment may move from the one in air at the price of 1 mm of error: keeps the fit well posed where
/// two parameters do nearly the same.
const PRIOR: [f64; ALIGNMENT] = [1.0, 1.0, 0.01, 0.01, 0.01, 10.0, 10.0, 0.01, 0.01];
/// Size of an axial coefficient at the price of 1 mm of error: keeps the powers of s from growing against each other.
const AXIAL_PRIOR: f64 = 100.0;
/// Motion of a camera for one laser: position (mm) and rotation (rad) in its own frame.
const MOTION: usize = 6;
/// Steps of the numeric derivative, in the units of `MOTION`.
const MOTION_STEPS: [f64; MOTION] = [1e-3, 1e-3, 1e-3, 1e-6, 1e-6, 1e-6];
/// As `PRIOR`, for the motion.
const MOTION_PRIOR: [f64; MOTION] = [100.0, 100.0, 100.0, 0.1, 0.1, 0.1];
/// Gauss-Newton steps: the problem is nearly linear.
const MAX_STEPS: u32 = 4;

/// How well a fitted model follows the traced rays: angle between model ray and traced point, as seen from the
/// viewpoint, over the whole grid of pixels and ranges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitResidual {
    /// Root mean square, rad.
    pub rms_rad: f64,
    /// Largest, rad.
    pub max_rad: f64,
}

/// Why no camera in the water could be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FitError {
    /// A pixel of the valid image has no ray in the water.
    #[error("a pixel between the inner radius and the mirror's rim does not see the water through the tube")]
    NoRay,
    /// The equations have no solution, for example because of values that are not finite.
    #[error("the camera model in the water has no least-squares solution")]
    NoSolution,
    /// A coefficient is beyond `MAX_POLYNOMIAL_COEFFICIENT` or `MAX_AXIAL_COEFFICIENT`.
    #[error("a coefficient of the camera model in the water is too large for fixed point")]
    CoefficientTooLarge,
    /// There is no such camera, or it has no model.
    #[error("the rig has no model of the camera")]
    NoModel,
}

/// Axial model of a traced camera, valid between the two image radii (px) and the two distances from the tube's axis
/// (mm).
pub fn fit_axial(
    traced: &TracedCamera,
    radius_px: [f64; 2],
    range_mm: [f64; 2],
) -> Result<(CameraModel, FitResidual), FitError> {
    fit(traced, radius_px, &spaced_ranges(range_mm, RANGES), AXIAL_TERMS)
}

/// Ranges in geometric progression.
fn spaced_ranges([near, far]: [f64; 2], count: u32) -> Vec<f64> {
    (0..count).map(|i| near * (far / near).powf(f64::from(i) / f64::from(count - 1))).collect()
}

/// Compact model of a traced camera, as an in-water calibration with targets at one distance from the tube's axis
/// gives it (mm). Right at that distance only: for comparison.
pub fn fit_compact(
    traced: &TracedCamera,
    radius_px: [f64; 2],
    calibration_distance_mm: f64,
) -> Result<(CameraModel, FitResidual), FitError> {
    fit(traced, radius_px, &[calibration_distance_mm], 0)
}

/// Range error of one camera and a perfectly known laser: `model` of the camera against what it sees, as a part of the
/// range (mm along the beam). None: the spot is not imaged, or its ray does not cross the beam.
pub fn mono_bias(traced: &TracedCamera, model: &CameraModel, laser: &Laser, range_mm: f64) -> Option<f64> {
    let origin = Point3::from(laser.origin_mm);
    let ray = model.ray(traced.project(origin + range_mm * laser.direction())?);
    // Along the beam, up, across.
    let frame = laser.frame();
    let (start, direction) = (frame * (ray.origin - origin), frame * ray.direction);
    let along = start.x - start.y / direction.y * direction.x;
    (along > 0.0 && along.is_finite()).then(|| along / range_mm - 1.0)
}

/// Pose of a fitted camera for the spots of one laser.
///
/// The skew of the rays behind a misaligned tube varies with azimuth in a way that no single pose follows. The spots of
/// one laser all lie at nearly one azimuth: there a small motion of the camera, of its own for each laser, absorbs the
/// rest of the skew. It holds between the two image radii (px) and the two ranges along the beam (mm).
pub fn fit_laser_pose(
    traced: &TracedCamera,
    model: &CameraModel,
    laser: &Laser,
    radius_px: [f64; 2],
    range_mm: [f64; 2],
) -> Result<Pose, FitError> {
    let samples = beam_samples(traced, laser, radius_px, range_mm)?;
    let to_rig = model.pose.isometry();
    let mut motion = [0.0; MOTION];
    for _ in 0..MAX_STEPS {
        let errors = beam_errors(model, &to_rig, &motion, &samples);
        let mut jacobian = DMatrix::zeros(errors.len(), MOTION);
        for k in 0..MOTION {
            let mut moved = motion;
            moved[k] += MOTION_STEPS[k];
            let change = beam_errors(model, &to_rig, &moved, &samples) - &errors;
            jacobian.set_column(k, &(change / MOTION_STEPS[k]));
        }
        let change = gauss_newton_step(jacobian, errors)?;
        for (value, change) in motion.iter_mut().zip(&change) {
            *value += change;
        }
    }
    Ok((to_rig * rigid_motion(motion)).into())
}

fn rigid_motion([x, y, z, rx, ry, rz]: [f64; MOTION]) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_scaled_axis(Vector3::new(rx, ry, rz)))
}

/// Points around a beam that are imaged between two radii, and their images.
fn beam_samples(
    traced: &TracedCamera,
    laser: &Laser,
    [inner, outer]: [f64; 2],
    range_mm: [f64; 2],
) -> Result<Vec<Sample>, FitError> {
    let direction = laser.direction();
    let across = Vector3::z().cross(&direction);
    let up = direction.cross(&across);
    let centre = Vector2::from(traced.air.centre_px);
    let mut samples = Vec::new();
    for range in spaced_ranges(range_mm, BEAM_RANGES) {
        let beam = Point3::from(laser.origin_mm) + range * direction;
        let offset = BEAM_OFFSET_MM + BEAM_OFFSET_RAD * range;
        for (i, j) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let point = beam + offset * (i * across + j * up);
            if let Some(pixel) = traced.project(point)
                && (inner..=outer).contains(&(pixel - centre).norm())
            {
                samples.push(sample(traced, pixel, point)?);
            }
        }
    }
    Ok(samples)
}

fn beam_errors(
    model: &CameraModel,
    to_rig: &Isometry3<f64>,
    motion: &[f64; MOTION],
    samples: &[Sample],
) -> DVector<f64> {
    let to_rig = to_rig * rigid_motion(*motion);
    let samples = samples.iter().flat_map(|sample| errors(model, &to_rig, sample));
    let prior = motion.iter().zip(MOTION_PRIOR).map(|(value, scale)| value / scale);
    DVector::from_vec(samples.chain(prior).collect())
}

/// A traced ray at one range.
struct Sample {
    pixel: Vector2<f64>,
    point: Point3<f64>,
    /// Cosine of the ray's elevation: from height to distance across the ray.
    cosine: f64,
    /// From distance across the ray to range error of a laser spot.
    weight: f64,
}

fn fit(
    traced: &TracedCamera,
    radius_px: [f64; 2],
    ranges_mm: &[f64],
    axial_terms: usize,
) -> Result<(CameraModel, FitResidual), FitError> {
    let samples = samples(traced, radius_px, ranges_mm)?;
    let mut fit = Fit {
        air: &traced.air,
        samples: &samples,
        alignment: [0.0; ALIGNMENT],
        polynomial: vec![0.0; POLYNOMIAL_TERMS],
        axial: vec![0.0; axial_terms],
    };
    // The derivative by alignment needs polynomials that are about right.
    fit.improve(false)?;
    for _ in 0..MAX_STEPS {
        fit.improve(true)?;
    }
    let (model, _) = fit.model();
    let beyond = |coefficients: &[f64], limit: f64| coefficients.iter().any(|c| c.abs() >= limit);
    if beyond(&model.polynomial, MAX_POLYNOMIAL_COEFFICIENT) || beyond(&model.axial, MAX_AXIAL_COEFFICIENT) {
        return Err(FitError::CoefficientTooLarge);
    }
    let residual = residual(&model, &samples);
    Ok((model, residual))
}

fn samples(traced: &TracedCamera, radius_px: [f64; 2], ranges_mm: &[f64]) -> Result<Vec<Sample>, FitError> {
    let tube = traced.tube.pose.isometry();
    let centre = Vector2::from(traced.air.centre_px);
    let [inner, outer] = radius_px;
    let mut samples = Vec::new();
    for i in 0..RADII {
        // Chebyshev nodes: denser at the ends, where polynomials err most.
        let angle = std::f64::consts::PI * (f64::from(i) + 0.5) / f64::from(RADII);
        let radius = 0.5 * (inner + outer) + 0.5 * (outer - inner) * angle.cos();
        for j in 0..AZIMUTHS {
            let azimuth = std::f64::consts::TAU * f64::from(j) / f64::from(AZIMUTHS);
            let pixel = centre + radius * Vector2::new(azimuth.cos(), azimuth.sin());
            let ray = traced.ray(pixel).ok_or(FitError::NoRay)?;
            let start = tube.inverse_transform_point(&ray.origin).coords.xy().norm();
            let across = tube.inverse_transform_vector(&ray.direction).xy().norm();
            for range in ranges_mm {
                let point = ray.origin + (range - start) / across * ray.direction;
                samples.push(sample(traced, pixel, point)?);
            }
        }
    }
    Ok(samples)
}

fn sample(traced: &TracedCamera, pixel: Vector2<f64>, point: Point3<f64>) -> Result<Sample, FitError> {
    let ray = traced.ray(pixel).ok_or(FitError::NoRay)?;
    let sine = traced.tube.pose.isometry().inverse_transform_vector(&ray.direction).z;
    Ok(Sample { pixel, point, cosine: (1.0 - sine * sine).sqrt(), weight: 1.0 / sine.abs().max(MIN_SINE) })
}

/// A model in the water in terms of the free parameters.
#[derive(Clone)]
struct Fit<'a> {
    air: &'a CameraModel,
    samples: &'a [Sample],
    alignment: [f64; ALIGNMENT],
    polynomial: Vec<f64>,
    axial: Vec<f64>,
}

impl Fit<'_> {
    /// The camera, and the transform from its frame to the rig frame.
    ///
    /// What cannot be observed stays as in air: the position along the axis (it is the constant axial term) and the
    /// affine matrix (to first order nothing here changes it, and its antisymmetric part is a rotation).
    fn model(&self) -> (CameraModel, Isometry3<f64>) {
        let [x, y, rx, ry, rz, u, v, p1, p2] = self.alignment;
        let to_rig = self.air.pose.isometry() * rigid_motion([x, y, 0.0, rx, ry, rz]);
        let camera = CameraModel {
            pose: to_rig.into(),
            centre_px: [self.air.centre_px[0] + u, self.air.centre_px[1] + v],
            affine: self.air.affine,
            tangential: [self.air.tangential[0] + p1, self.air.tangential[1] + p2],
            polynomial: self.polynomial.clone(),
            axial: self.axial.clone(),
        };
        (camera, to_rig)
    }

    /// The errors of each sample, mm, then the price of the alignment.
    fn errors(&self) -> DVector<f64> {
        let (camera, to_rig) = self.model();
        let samples = self.samples.iter().flat_map(|sample| errors(&camera, &to_rig, sample));
        let prior = self.alignment.iter().zip(PRIOR).map(|(value, scale)| value / scale);
        let size = self.axial.iter().map(|value| value / AXIAL_PRIOR);
        DVector::from_vec(samples.chain(prior).chain(size).collect())
    }

    /// One Gauss-Newton step of the polynomials, and of the alignment if wanted.
    fn improve(&mut self, with_alignment: bool) -> Result<(), FitError> {
        let errors = self.errors();
        let linear = POLYNOMIAL_TERMS + self.axial.len();
        let columns = linear + if with_alignment { ALIGNMENT } else { 0 };
        let mut jacobian = DMatrix::zeros(errors.len(), columns);
        let (camera, to_rig) = self.model();
        for (i, sample) in self.samples.iter().enumerate() {
            let (s, along, _, _) = position(&camera, &to_rig, sample);
            let scale = -sample.cosine * sample.weight;
            for k in 0..POLYNOMIAL_TERMS {
                jacobian[(2 * i, k)] = scale * along * s.powi(k as i32 - 1);
            }
            for k in 0..self.axial.len() {
                jacobian[(2 * i, POLYNOMIAL_TERMS + k)] = scale * NORMAL_RADIUS_PX * s.powi(k as i32);
            }
        }
        let size_row = 2 * self.samples.len() + ALIGNMENT;
        for k in 0..self.axial.len() {
            jacobian[(size_row + k, POLYNOMIAL_TERMS + k)] = 1.0 / AXIAL_PRIOR;
        }
        for (k, step) in (linear..columns).zip(0..) {
            let mut moved = self.clone();
            moved.alignment[step] += STEPS[step];
            jacobian.set_column(k, &((moved.errors() - &errors) / STEPS[step]));
        }
        let change = gauss_newton_step(jacobian, errors)?;
        let parameters = self.polynomial.iter_mut().chain(&mut self.axial).chain(&mut self.alignment);
        for (parameter, change) in parameters.zip(&change) {
            *parameter += change;
        }
        Ok(())
    }
}

/// The change of the parameters that minimises the linearised errors.
fn gauss_newton_step(jacobian: DMatrix<f64>, errors: DVector<f64>) -> Result<DVector<f64>, FitError> {
    let columns = jacobian.ncols();
    // By orthogonal decomposition: powers of s are far too alike for the normal equations.
    let decomposition = jacobian.qr();
    let mut rhs = -errors;
    decomposition.q_tr_mul(&mut rhs);
    decomposition
        .r()
        .solve_upper_triangular(&rhs.rows(0, columns))
        .filter(|change| change.iter().all(|value| value.is_finite()))
        .ok_or(FitError::NoSolution)
}

/// Normalised radius of a sample's pixel, and the sample's point in the cylinder coordinates of that pixel's
/// meridional plane: along it, across it, height.
fn position(camera: &CameraModel, to_rig: &Isometry3<f64>, sample: &Sample) -> (f64, f64, f64, f64) {
    let corrected = camera.corrected(sample.pixel);
    let radius = corrected.norm();
    let point = to_rig.inverse_transform_point(&sample.point).coords;
    (radius / NORMAL_RADIUS_PX, point.xy().dot(&corrected) / radius, point.xy().perp(&corrected) / radius, point.z)
}

/// Range error from elevation and error across, mm.
fn errors(camera: &CameraModel, to_rig: &Isometry3<f64>, sample: &Sample) -> [f64; 2] {
    let (s, along, across, height) = position(camera, to_rig, sample);
    let z_v = NORMAL_RADIUS_PX * horner(&camera.axial, s);
    let elevation = height - z_v - along * horner(&camera.polynomial, s) / s;
    [elevation * sample.cosine * sample.weight, across]
}

fn residual(model: &CameraModel, samples: &[Sample]) -> FitResidual {
    let (mut sum, mut max_rad) = (0.0, 0.0_f64);
    for sample in samples {
        let ray = model.ray(sample.pixel);
        let offset = sample.point - ray.origin;
        let angle = offset.cross(&ray.direction).norm() / offset.norm();
        sum += angle * angle;
        max_rad = max_rad.max(angle);
    }
    FitResidual { rms_rad: (sum / samples.len() as f64).sqrt(), max_rad }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Ray, Rig};

    const RADIUS_PX: [f64; 2] = [105.0, 364.0];
    const RANGE_MM: [f64; 2] = [250.0, 6000.0];

    /// A carelessly built rig: cameras 1 mm and up to 6 mrad off the tube's axis.
    fn misaligned() -> Rig {
        let mut rig = Rig::default();
        let [first, second] = &mut rig.cameras;
        first.air.as_mut().unwrap().pose = Pose { position_mm: [0.8, -0.9, -249.0], rotation_deg: [0.2, -0.15, 1.0] };
        second.air.as_mut().unwrap().pose = Pose { position_mm: [-1.0, 0.5, 251.0], rotation_deg: [179.85, 0.2, -1.0] };
        rig.tube.as_mut().unwrap().pose.rotation_deg = [0.1, -0.1, 0.0];
        rig
    }

    fn midpoint([a, b]: &[Ray; 2]) -> Point3<f64> {
        let base = b.origin - a.origin;
        let cosine = a.direction.dot(&b.direction);
        let (p, q) = (base.dot(&a.direction), base.dot(&b.direction));
        let sine2 = 1.0 - cosine * cosine;
        nalgebra::center(
            &(a.origin + (p - cosine * q) / sine2 * a.direction),
            &(b.origin + (cosine * p - q) / sine2 * b.direction),
        )
    }

    /// Largest position errors (mm) of points on and 4 mrad around the beams at one range: by either camera and the
    /// height of the point, and by both cameras.
    fn worst_errors(rig: &Rig, models: [&[CameraModel]; 2], range: f64) -> [f64; 2] {
        let traced = [0, 1].map(|i| rig.traced_camera(i).unwrap());
        let (mut mono, mut stereo) = (0.0_f64, 0.0_f64);
        for (k, laser) in rig.lasers.iter().enumerate() {
            let direction = laser.direction();
            let across = Vector3::z().cross(&direction);
            for (up, side) in [(0.0, 0.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                let off_beam = 4e-3 * (up * Vector3::z() + side * across);
                let point = Point3::from(laser.origin_mm) + range * (direction + off_beam);
                let rays = [0, 1].map(|i| models[i][k].ray(traced[i].project(point).unwrap()));
                for ray in &rays {
                    let distance = (point.z - ray.origin.z) / ray.direction.z;
                    let estimate = ray.origin + distance * ray.direction;
                    mono = mono.max((estimate - point).norm());
                }
                stereo = stereo.max((midpoint(&rays) - point).norm());
            }
        }
        [mono, stereo]
    }

    fn assert_errors(rig: &Rig, with_laser_poses: bool, limits_mm: [f64; 2]) {
        let models = [0, 1].map(|i| {
            let model = rig.water_camera(i).unwrap();
            let poses =
                if with_laser_poses { rig.laser_poses(i, &model).unwrap() } else { vec![model.pose; rig.lasers.len()] };
            let posed = |pose| CameraModel { pose, ..model.clone() };
            poses.into_iter().map(posed).collect::<Vec<_>>()
        });
        for range in [300.0, 400.0, 500.0, 700.0, 1000.0, 1500.0, 2000.0, 3000.0, 4800.0] {
            let limit = limits_mm[usize::from(range > 3000.0)];
            let errors = worst_errors(rig, [&models[0], &models[1]], range);
            assert!(errors[0] < limit && errors[1] < limit, "{range} mm: {errors:?} mm");
        }
    }

    #[test]
    fn laser_poses_of_the_default_rig_err_below_0_3_mm_up_to_4_8_m() {
        assert_errors(&Rig::default(), true, [0.25, 0.3]);
    }

    #[test]
    fn laser_poses_of_a_misaligned_rig_err_below_0_3_mm_up_to_3_m_and_0_6_mm_at_4_8_m() {
        assert_errors(&misaligned(), true, [0.3, 0.6]);
    }

    #[test]
    fn one_pose_is_enough_for_a_coaxial_camera() {
        assert_errors(&Rig::ideal(), false, [0.3, 0.3]);
    }

    #[test]
    fn one_pose_of_the_default_rig_errs_below_3_mm_up_to_3_m_and_5_mm_at_4_8_m() {
        assert_errors(&Rig::default(), false, [3.0, 5.0]);
    }

    #[test]
    fn fitted_coefficients_stay_within_the_limits_of_fixed_point() {
        for rig in [Rig::default(), Rig::ideal(), misaligned()] {
            for i in 0..2 {
                let model = rig.water_camera(i).unwrap();
                let largest = |c: &[f64]| c.iter().fold(0.0_f64, |max, c| max.max(c.abs()));
                assert!(model.polynomial.len() <= MAX_COEFFICIENTS);
                assert!(model.axial.len() <= MAX_COEFFICIENTS);
                assert!(largest(&model.polynomial) < MAX_POLYNOMIAL_COEFFICIENT / 2.0);
                assert!(largest(&model.axial) < MAX_AXIAL_COEFFICIENT);
            }
        }
    }

    #[test]
    fn residuals_of_the_default_rig_are_below_0_1_px_rms() {
        for i in 0..2 {
            let traced = Rig::default().traced_camera(i).unwrap();
            let (_, residual) = fit_axial(&traced, RADIUS_PX, RANGE_MM).unwrap();
            // 4.6 mrad/px
            assert!(residual.rms_rad < 4.6e-4 && residual.max_rad < 1.5e-3);
        }
    }

    /// Error of camera 1 and a laser of the ideal rig, in % of the range.
    fn mono_errors(model: &CameraModel) -> [f64; 7] {
        let rig = Rig::ideal();
        let traced = rig.traced_camera(0).unwrap();
        [300.0, 400.0, 700.0, 1000.0, 2000.0, 3000.0, 4800.0]
            .map(|range| 100.0 * mono_bias(&traced, model, &rig.lasers[0], range).unwrap())
    }

    #[test]
    fn compact_model_is_biased_with_range_as_the_closed_form_says() {
        let traced = Rig::ideal().traced_camera(0).unwrap();
        let (model, _) = fit_compact(&traced, RADIUS_PX, 700.0).unwrap();
        let expected = [9.4, 4.1, 0.0, -1.1, -2.3, -2.6, -2.9];
        let errors = mono_errors(&model);
        for (error, expected) in errors.iter().zip(expected) {
            assert!((error - expected).abs() < 0.3, "{errors:?}");
        }
    }

    #[test]
    fn axial_model_is_within_0_05_percent_from_0_3_to_4_8_m() {
        let traced = Rig::ideal().traced_camera(0).unwrap();
        let (model, _) = fit_axial(&traced, RADIUS_PX, RANGE_MM).unwrap();
        let errors = mono_errors(&model);
        assert!(errors.iter().all(|error| error.abs() < 0.05), "{errors:?}");
    }

    #[test]
    fn a_camera_outside_the_tube_cannot_be_fitted() {
        let mut traced = Rig::default().traced_camera(0).unwrap();
        traced.air.pose.position_mm[0] = 80.0;
        assert_eq!(fit_axial(&traced, RADIUS_PX, RANGE_MM), Err(FitError::NoRay));
        traced.air.pose.position_mm[0] = f64::NAN;
        assert_eq!(fit_axial(&traced, RADIUS_PX, RANGE_MM), Err(FitError::NoRay));
    }

    #[test]
    fn values_that_are_not_finite_have_no_fit() {
        let traced = Rig::default().traced_camera(0).unwrap();
        let range_mm = [f64::NAN, 6000.0];
        assert_eq!(fit_axial(&traced, RADIUS_PX, range_mm), Err(FitError::NoSolution));
    }
}
