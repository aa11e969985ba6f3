//! A camera in the water, three ways: traced from a calibration in air, fitted to boards in the water with an axial
//! polynomial, and fitted to the same boards as if all rays met in one point.

use std::collections::HashMap;

use karst_rig::{CameraModel, FitError, Laser, NORMAL_RADIUS_PX, TracedCamera, fit_axial, mono_bias};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::{
    CalibratedCamera, CameraError, CameraSettings, CornerList, View, ViewResult, Warning, calibrate_camera,
    camera::{
        DEGREE_GAIN, FittedView, GATE_SIGMAS, final_fit, holdout, inliers, observations, report, residual_lengths, rms,
        robust_fit, robust_sigma,
    },
    initial::board_pose,
    refine::{Observation, Scene, Unknowns},
};

/// Degree of f in the water when none is given.
const DEGREE: usize = 5;
/// Degree of the compact model that the axial one starts from.
const START_DEGREE: usize = 4;
/// Numbers of axial terms that are tried.
const AXIAL_TERMS: std::ops::RangeInclusive<usize> = 2..=4;
/// Standard deviation of z_v, against that at the middle radius, beyond which it is unknown, and beyond which it is
/// known poorly, mm.
const AXIAL_LIMIT_MM: f64 = 5.0;
/// See `AXIAL_LIMIT_MM`.
const AXIAL_SIGMA_MM: f64 = 1.0;
/// Corners are at one distance when those at the upper decile are less than this many times as far as those at the lower.
const ONE_DISTANCE: f64 = 1.5;
/// Radii at which the standard deviation of z_v is looked at.
const AXIAL_RADII: u32 = 16;
/// Ranges of the biases in [`InWater`], mm.
pub const BIAS_RANGES_MM: [f64; 7] = [300.0, 400.0, 700.0, 1000.0, 2000.0, 3000.0, 4800.0];
/// Lasers that the biases are a mean over.
const BIAS_LASERS: u32 = 12;

/// Calibrates a camera behind a tube from boards in the water at several distances, without any knowledge of the tube: f
/// and the axial polynomial z_v of [`CameraModel`] together.
///
/// The constant term of z_v is 0 by convention: for one camera it is the same as a shift of all boards along the axis.
/// Where the tube is not quite coaxial, the centre, the poses and the tangential terms (if wanted) take up what they can.
/// The degree of f is 5 if none is given; it has a linear term, as rays in the water are not smooth at the centre. The
/// number of axial terms is the lowest of 2 to 4 that predicts views held out of the fit as well as any.
///
/// Boards at one distance only tell little of z_v, by their tilts: a warning, and an error where that is too little.
pub fn calibrate_axial(list: &CornerList, settings: &CameraSettings) -> Result<CalibratedCamera, CameraError> {
    let compact = calibrate_camera(list, &CameraSettings { degree: Some(START_DEGREE), ..settings.clone() })?;
    let (names, views) = used_views(list, &compact);
    let start = Scene { model: compact.model.clone(), poses: compact.views.iter().map(|view| view.pose).collect() };
    let limit = GATE_SIGMAS * robust_sigma(&start, &views);
    let mut trials = Vec::new();
    for terms in AXIAL_TERMS {
        let degree = settings.degree.unwrap_or(DEGREE);
        let unknowns = Unknowns {
            powers: (0..=degree).collect(),
            axial: (1..=terms).collect(),
            ..Unknowns::of_degree(degree, settings.tangential)
        };
        let mut scene = start.clone();
        scene.model.polynomial.truncate(degree + 1);
        robust_fit(&mut scene, &views, &unknowns);
        let error = holdout(&scene, &views, &unknowns, limit);
        trials.push((error.unwrap_or(f64::INFINITY), scene, unknowns));
    }
    let best = trials.iter().map(|(error, ..)| *error).fold(f64::INFINITY, f64::min);
    let chosen = trials.into_iter().find(|(error, ..)| *error <= (1.0 + DEGREE_GAIN) * best);
    let unobservable = CameraError::Unobservable { quantity: "z_v, the height at which rays leave the axis," };
    let Some((_, mut scene, unknowns)) = chosen else { return Err(unobservable) };

    let loss = final_fit(&mut scene, &views, &unknowns);
    let limit_px = GATE_SIGMAS * robust_sigma(&scene, &views);
    let covariance = scene.covariance(&views, &unknowns, loss).ok_or(unobservable.clone())?;
    let lengths = residual_lengths(&scene, &views);
    let mut fitted = Vec::new();
    for (((name, corners), pose), lengths) in names.into_iter().zip(&views).zip(&scene.poses).zip(lengths) {
        fitted.push(FittedView { name, pose: *pose, corners, lengths });
    }
    let mut result = report(&scene.model, &fitted, &unknowns, settings, &covariance, limit_px)?;
    result.rejected_views = compact.rejected_views;
    result.holdout_rms_px = holdout(&scene, &inliers(&scene, &views, limit_px), &unknowns, f64::INFINITY);
    if compact.warnings.contains(&Warning::AllMirrored) {
        result.warnings.push(Warning::AllMirrored);
    }
    let sigma = axial_sigma_mm(&unknowns, &covariance, result.radius_px);
    if sigma.is_nan() || sigma > AXIAL_LIMIT_MM {
        return Err(unobservable);
    }
    if sigma > AXIAL_SIGMA_MM {
        let quantity = "z_v, the height at which rays leave the axis,";
        result.warnings.push(Warning::Uncertain { quantity, sigma, limit: AXIAL_SIGMA_MM, unit: "mm" });
    }
    let distances = views
        .iter()
        .zip(&scene.poses)
        .flat_map(|(corners, pose)| corners.iter().map(move |corner| (pose * corner.board).coords.xy().norm()));
    let mut distances: Vec<f64> = distances.collect();
    distances.sort_by(f64::total_cmp);
    let [near_mm, far_mm] = [distances.len() / 10, distances.len() * 9 / 10].map(|place| distances[place]);
    if far_mm < ONE_DISTANCE * near_mm {
        result.warnings.push(Warning::OneDistance { near_mm, far_mm });
    }
    Ok(result)
}

/// Names and corners of the views that a calibration used.
fn used_views<'a>(list: &'a CornerList, camera: &CalibratedCamera) -> (Vec<&'a str>, Vec<Vec<Observation>>) {
    let of_name: HashMap<&str, &View> = list.views.iter().map(|view| (view.name.as_str(), view)).collect();
    let used = camera.views.iter().filter_map(|view| of_name.get(view.view.as_str()));
    used.map(|view| (view.name.as_str(), observations(view))).unzip()
}

/// Largest standard deviation of z_v against its value at the middle radius, mm.
fn axial_sigma_mm(unknowns: &Unknowns, covariance: &DMatrix<f64>, [inner, outer]: [f64; 2]) -> f64 {
    let (from, terms) = (unknowns.powers.len(), unknowns.axial.len());
    let own = covariance.view((from, from), (terms, terms));
    let row = |part: f64| {
        let s = (inner + (outer - inner) * part) / NORMAL_RADIUS_PX;
        DVector::from_iterator(terms, unknowns.axial.iter().map(|&power| NORMAL_RADIUS_PX * s.powi(power as i32)))
    };
    let sigma = |step: u32| {
        let by_term = row(f64::from(step) / f64::from(AXIAL_RADII)) - row(0.5);
        by_term.dot(&(own * &by_term)).sqrt()
    };
    // A value that is no number stays.
    (0..=AXIAL_RADII).map(sigma).fold(0.0, |most, sigma| if sigma <= most { most } else { sigma })
}

/// Why there is no comparison.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RefractionError {
    /// A model could not be calibrated from the boards in the water.
    #[error("{model} model from boards in the water: {source}")]
    Camera {
        /// Which.
        model: &'static str,
        /// Why not.
        source: CameraError,
    },
    /// The camera in air has no model behind the tube.
    #[error("axial model by tracing: {0}")]
    Trace(FitError),
}

/// A camera in the water by one of the ways.
#[derive(Debug, Clone, PartialEq)]
pub struct InWater {
    /// The model, in the rig frame.
    pub model: CameraModel,
    /// RMS residual of all corners in the water, px.
    pub rms_px: f64,
    /// The same for corners held out of the fit, of poses and, for the models fitted to boards in the water, of the model;
    /// inliers of the compact and the axial fit count up to the limit of each. None: too few views.
    pub holdout_rms_px: Option<f64>,
    /// Range errors with a perfectly known laser across the rig's z axis at z = 0, mean over azimuth, per cent: for each of
    /// [`BIAS_RANGES_MM`]. None: out of sight.
    pub bias_pct: [Option<f64>; 7],
}

/// Three ways to a camera in the water.
#[derive(Debug, Clone, PartialEq)]
pub struct RefractionComparison {
    /// From air, by tracing through the tube: [`fit_axial`].
    pub traced: InWater,
    /// From boards in the water, axial: [`calibrate_axial`].
    pub axial: InWater,
    /// From boards in the water, with a single viewpoint: [`calibrate_camera`].
    pub compact: InWater,
    /// What may be wrong with the axial model from boards in the water.
    pub axial_warnings: Vec<Warning>,
}

/// Compares the ways to a camera in the water on the corners of boards in the water.
///
/// `traced` is the camera in air behind the tube, as calibrated (by [`calibrate_stereo`](crate::calibrate_stereo), or the
/// camera in air alone and the tube's data sheet); `range_mm` are the distances from the tube's axis in which its axial
/// model has to hold. `truth` is what range errors count against, the calibrated camera itself where nothing better is
/// known. Models fitted to boards in the water are laid into the rig frame so that their boards are where those of the
/// traced model are.
pub fn compare_refraction(
    traced: &TracedCamera,
    truth: &TracedCamera,
    list: &CornerList,
    settings: &CameraSettings,
    range_mm: [f64; 2],
) -> Result<RefractionComparison, RefractionError> {
    let failed = |model| move |source| RefractionError::Camera { model, source };
    let axial = calibrate_axial(list, settings).map_err(failed("axial"))?;
    let compact = calibrate_camera(list, settings).map_err(failed("compact"))?;
    let (by_tracing, _) = fit_axial(traced, axial.radius_px, range_mm).map_err(RefractionError::Trace)?;

    let (_, views) = used_views(list, &axial);
    let to_rig = by_tracing.pose.isometry();
    let pose =
        |(view, corners): (&ViewResult, &Vec<Observation>)| board_pose(&by_tracing, corners).unwrap_or(view.pose);
    let poses = axial.views.iter().zip(&views).map(pose).collect();
    let mut scene = Scene { model: by_tracing.clone(), poses };
    let unknowns = Unknowns { poses: true, ..Unknowns::default() };
    robust_fit(&mut scene, &views, &unknowns);
    final_fit(&mut scene, &views, &unknowns);
    let limit_px = GATE_SIGMAS * robust_sigma(&scene, &views);
    let boards: HashMap<&str, Isometry3<f64>> =
        axial.views.iter().zip(&scene.poses).map(|(view, pose)| (view.view.as_str(), to_rig * pose)).collect();

    let placed = |camera: &CalibratedCamera| {
        let (_, views) = used_views(list, camera);
        let (mut from, mut to) = (Vec::new(), Vec::new());
        for (view, corners) in camera.views.iter().zip(&views) {
            if let Some(board) = boards.get(view.view.as_str()) {
                from.extend(corners.iter().map(|corner| view.pose * corner.board));
                to.extend(corners.iter().map(|corner| board * corner.board));
            }
        }
        let model = CameraModel { pose: alignment(&from, &to).into(), ..camera.model.clone() };
        let (rms_px, holdout_rms_px) = (camera.rms_px, camera.holdout_rms_px);
        InWater { bias_pct: bias(truth, &model), model, rms_px, holdout_rms_px }
    };
    let traced = InWater {
        bias_pct: bias(truth, &by_tracing),
        rms_px: rms(residual_lengths(&scene, &views).concat().into_iter()),
        holdout_rms_px: holdout(&scene, &inliers(&scene, &views, limit_px), &unknowns, f64::INFINITY),
        model: by_tracing,
    };
    let (placed_axial, compact) = (placed(&axial), placed(&compact));
    Ok(RefractionComparison { traced, axial: placed_axial, compact, axial_warnings: axial.warnings })
}

/// Range errors of a model, per cent.
fn bias(truth: &TracedCamera, model: &CameraModel) -> [Option<f64>; 7] {
    let laser = |step: u32| Laser {
        origin_mm: [0.0; 3],
        azimuth_deg: 360.0 * f64::from(step) / f64::from(BIAS_LASERS),
        elevation_deg: 0.0,
        origin_sigma_mm: 0.0,
        direction_sigma_mrad: 0.0,
    };
    BIAS_RANGES_MM.map(|range| {
        let biases = (0..BIAS_LASERS).map(|step| mono_bias(truth, model, &laser(step), range));
        let sum: Option<f64> = biases.sum();
        sum.map(|sum| 100.0 * sum / f64::from(BIAS_LASERS))
    })
}

/// The motion that takes one list of points nearest to another, far points counting less as their errors are larger.
fn alignment(from: &[Point3<f64>], to: &[Point3<f64>]) -> Isometry3<f64> {
    let weights: Vec<f64> = from.iter().map(|point| 1.0 / point.coords.norm_squared().max(1.0)).collect();
    let total = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mean = |points: &[Point3<f64>]| {
        points.iter().zip(&weights).map(|(point, weight)| *weight * point.coords).sum::<Vector3<f64>>() / total
    };
    let (from_mean, to_mean) = (mean(from), mean(to));
    let pairs = from.iter().zip(to).zip(&weights);
    let products = pairs.map(|((a, b), weight)| *weight * (b.coords - to_mean) * (a.coords - from_mean).transpose());
    let rotation = Rotation3::from_matrix_eps(&products.sum::<Matrix3<f64>>(), 1e-14, 1000, Rotation3::identity());
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    Isometry3::from_parts(Translation3::from(to_mean - rotation * from_mean), rotation)
}
