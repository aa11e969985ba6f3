//! Calibration of one camera from pictures of a plane board.

use karst_rig::{CameraModel, MAX_POLYNOMIAL_COEFFICIENT, NORMAL_RADIUS_PX, Pose};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector2, Vector3};

use crate::{
    CalibratedCamera, CameraError, CameraSettings, CameraSigma, Corner, CornerList, Outlier, RejectedView, View,
    ViewReason, ViewResult, Warning,
    initial::{RadialPose, find_centre, median, parabola_and_poses},
    refine::{self, Loss, Observation, Scene, Unknowns, sigma_px},
    result::MIN_CORNERS,
};

/// Degrees that are tried when none is given.
pub const DEGREES: std::ops::RangeInclusive<usize> = 2..=6;
/// Fewest views that determine a camera.
pub(crate) const MIN_VIEWS: usize = 3;
/// Boards within this angle of one another are parallel, degrees.
const PARALLEL_DEG: f64 = 5.0;
/// Inliers are nearer to their expected position than this many standard deviations per axis. Of normally distributed
/// corners one in 460 is not.
pub(crate) const GATE_SIGMAS: f64 = 3.5;
/// A board does not fit when half of its corners are off by more than this part of its size in the picture, and by more
/// than `MISFIT_PX`.
pub(crate) const MISFIT_PART: f64 = 0.03;
/// See `MISFIT_PART`.
pub(crate) const MISFIT_PX: f64 = 2.0;
/// A view does not fit when its median residual is this many times that of all.
pub(crate) const MISFIT_RATIO: f64 = 6.0;
/// Inliers must be within this part of the image width, rms, or nothing was calibrated.
const POOR_FIT_PART: f64 = 0.01;
/// Standard deviations beyond which a quantity is unknown: of rays, of the centre, of the affine terms.
const RAY_LIMIT_MRAD: f64 = 50.0;
/// See `RAY_LIMIT_MRAD`.
const CENTRE_LIMIT_PX: f64 = 20.0;
/// See `RAY_LIMIT_MRAD`.
const AFFINE_LIMIT: f64 = 0.05;
/// Parts the views are split into for hold-out.
pub(crate) const FOLDS: usize = 4;
/// A lower degree is preferred unless the hold-out error falls by more than this part.
pub(crate) const DEGREE_GAIN: f64 = 0.01;

/// The views in use and those rejected, kept in step.
struct Used<'a> {
    list: Vec<&'a View>,
    views: Vec<Vec<Observation>>,
    rejected: Vec<RejectedView>,
}

impl<'a> Used<'a> {
    fn new(list: &'a CornerList) -> Self {
        let mut used = Self { list: Vec::new(), views: Vec::new(), rejected: Vec::new() };
        for view in &list.views {
            if view.corners.len() < MIN_CORNERS {
                used.reject_view(view, ViewReason::TooFewCorners, None);
                continue;
            }
            used.list.push(view);
            used.views.push(observations(view));
        }
        used
    }

    fn reject_view(&mut self, view: &View, reason: ViewReason, residual_px: Option<f64>) {
        self.rejected.push(RejectedView { view: view.name.clone(), reason, residual_px });
    }

    fn reject(&mut self, index: usize, reason: ViewReason, residual_px: Option<f64>) {
        let view = self.list.remove(index);
        self.views.remove(index);
        self.reject_view(view, reason, residual_px);
    }

    fn check_count(&self) -> Result<(), CameraError> {
        let misfits = self.rejected.iter().filter(|view| view.reason == ViewReason::NotTheBoard).count();
        let (found, rejected) = (self.views.len(), self.rejected.clone());
        if misfits > found {
            return Err(CameraError::NotABoard { found: misfits, views: found + rejected.len(), rejected });
        }
        if found < MIN_VIEWS {
            return Err(CameraError::TooFewViews { found, expected: MIN_VIEWS, rejected });
        }
        Ok(())
    }
}

/// Calibrates a camera from the corners of a plane board in at least three views with different tilts.
///
/// Linear first guess (poses from the directions of corners, image centre by random samples, a parabola as polynomial),
/// then robust non-linear refinement of everything together, then a least-squares fit of the inliers. The size of the board
/// only scales the poses: one camera cannot tell whether it is right.
pub fn calibrate_camera(list: &CornerList, settings: &CameraSettings) -> Result<CalibratedCamera, CameraError> {
    check_settings(settings)?;
    check_corners(list, settings.image_size_px)?;
    let mut used = Used::new(list);
    used.check_count()?;

    let mut scene = first_guess(&mut used, settings)?;
    let start_degree = settings.degree.unwrap_or(4).min(4);
    robust_fit(&mut scene, &used.views, &Unknowns::of_degree(2, false));
    robust_fit(&mut scene, &used.views, &Unknowns::of_degree(start_degree, settings.tangential));
    reject_misfits(&mut scene, &mut used)?;
    let all_mirrored = reject_mirrored(&mut scene, &mut used)?;
    check_tilts(&scene)?;
    robust_fit(&mut scene, &used.views, &Unknowns::of_degree(start_degree, settings.tangential));

    let (degree, degrees) = match settings.degree {
        Some(degree) => (degree, Vec::new()),
        None => choose_degree(&scene, &used.views, settings.tangential),
    };
    let unknowns = Unknowns::of_degree(degree, settings.tangential);
    scene.model.polynomial.truncate(degree + 1);
    robust_fit(&mut scene, &used.views, &unknowns);
    let loss = final_fit(&mut scene, &used.views, &unknowns);
    let limit_px = GATE_SIGMAS * robust_sigma(&scene, &used.views);
    let unobservable = CameraError::Unobservable { quantity: "some combination of camera and poses" };
    let covariance = scene.covariance(&used.views, &unknowns, loss).ok_or(unobservable)?;
    let lengths = residual_lengths(&scene, &used.views);
    let mut views = Vec::new();
    for (((view, corners), pose), lengths) in used.list.iter().zip(&used.views).zip(&scene.poses).zip(lengths) {
        views.push(FittedView { name: &view.name, pose: *pose, corners, lengths });
    }
    let mut result = report(&scene.model, &views, &unknowns, settings, &covariance, limit_px)?;
    result.rejected_views = used.rejected.clone();
    result.holdout_rms_px = holdout(&scene, &inliers(&scene, &used.views, limit_px), &unknowns, f64::INFINITY);
    result.degrees = degrees;
    if all_mirrored {
        result.warnings.push(Warning::AllMirrored);
    }
    Ok(result)
}

/// The corners of a view as the fit takes them.
pub(crate) fn observations(view: &View) -> Vec<Observation> {
    let observation = |corner: &Corner| Observation {
        index: corner.index,
        board: Point3::new(corner.board_mm[0], corner.board_mm[1], 0.0),
        pixel: corner.pixel.into(),
    };
    view.corners.iter().map(observation).collect()
}

pub(crate) fn check_settings(settings: &CameraSettings) -> Result<(), CameraError> {
    let [width, height] = settings.image_size_px;
    if width.min(height) < 16 || width.max(height) > 65535 {
        let expected = "16 to 65535 px each way";
        return Err(CameraError::Setting { what: "image size", found: format!("{width} x {height}"), expected });
    }
    match settings.degree {
        Some(degree) if !(2..=7).contains(&degree) => {
            Err(CameraError::Setting { what: "degree", found: degree.to_string(), expected: "2 to 7" })
        }
        _ => Ok(()),
    }
}

pub(crate) fn check_corners(list: &CornerList, image_size_px: [u32; 2]) -> Result<(), CameraError> {
    for view in &list.views {
        for corner in &view.corners {
            let (view, index, pixel) = (view.name.clone(), corner.index, corner.pixel);
            if !pixel.iter().chain(&corner.board_mm).all(|value| value.is_finite()) {
                return Err(CameraError::NotFinite { view, index });
            }
            // Pixels reach half a pixel beyond their centres.
            let inside = |axis: usize| (-0.5..=f64::from(image_size_px[axis]) - 0.5).contains(&pixel[axis]);
            if !inside(0) || !inside(1) {
                return Err(CameraError::OutsideImage { view, index, pixel, image_size_px });
            }
        }
    }
    Ok(())
}

/// Diagonal of the corners' bounding box.
pub(crate) fn extent(points: impl Iterator<Item = Vector2<f64>>) -> f64 {
    let start = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    let (least, most) = points.fold(start, |(least, most), point| (least.inf(&point), most.sup(&point)));
    (most - least).norm()
}

fn first_guess(used: &mut Used, settings: &CameraSettings) -> Result<Scene, CameraError> {
    let not_a_board = |used: &Used| CameraError::NotABoard {
        found: used.views.len(),
        views: used.views.len() + used.rejected.len(),
        rejected: used.rejected.clone(),
    };
    let centre = find_centre(&used.views, settings.image_size_px).ok_or_else(|| not_a_board(used))?;
    let mut radial = Vec::new();
    for view in (0..used.views.len()).rev() {
        let pose = RadialPose::new(&used.views[view], centre);
        let residual = pose.as_ref().map(|pose| median(pose.residuals.clone()));
        let size = extent(used.views[view].iter().map(|corner| corner.pixel));
        match pose {
            Some(pose) if residual.is_some_and(|r| r <= MISFIT_PX.max(MISFIT_PART * size)) => radial.push(pose),
            _ => used.reject(view, ViewReason::NotTheBoard, residual),
        }
    }
    radial.reverse();
    used.check_count()?;
    let tilt = radial.iter().map(|pose| pose.frontal().min(1.0).acos().to_degrees()).fold(0.0, f64::max);
    if tilt < PARALLEL_DEG {
        let quantity = "the scale of f against the distance of the boards";
        return Err(CameraError::Parallel { within_deg: tilt, quantity });
    }
    let (parabola, poses) = parabola_and_poses(&used.views, &radial, centre)
        .ok_or(CameraError::Unobservable { quantity: "the polynomial" })?;
    let model = CameraModel {
        pose: Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] },
        centre_px: centre.into(),
        affine: [1.0, 0.0, 0.0],
        tangential: [0.0; 2],
        polynomial: vec![parabola[0], 0.0, parabola[1]],
        axial: Vec::new(),
    };
    Ok(Scene { model, poses })
}

/// Length of the residual of each corner, px; infinite where the camera does not see it.
pub(crate) fn residual_lengths(scene: &Scene, views: &[Vec<Observation>]) -> Vec<Vec<f64>> {
    let length = |view: usize, corner: &Observation| scene.residual(view, corner).map_or(f64::INFINITY, |r| r.norm());
    let of_view = |(view, corners): (usize, &Vec<Observation>)| corners.iter().map(|c| length(view, c)).collect();
    views.iter().enumerate().map(of_view).collect()
}

/// As `sigma_px`, of all corners.
pub(crate) fn robust_sigma(scene: &Scene, views: &[Vec<Observation>]) -> f64 {
    sigma_px(residual_lengths(scene, views).concat())
}

/// Robust refinement, its scale following the residuals down.
pub(crate) fn robust_fit(scene: &mut Scene, views: &[Vec<Observation>], unknowns: &Unknowns) {
    refine::robust_fit(scene, |scene| robust_sigma(scene, views), |scene, loss, _| scene.refine(views, unknowns, loss));
}

fn reject_misfits(scene: &mut Scene, used: &mut Used) -> Result<(), CameraError> {
    let lengths = residual_lengths(scene, &used.views);
    let limit = (MISFIT_RATIO * median(lengths.concat())).max(MISFIT_PX);
    for view in (0..used.views.len()).rev() {
        let residual = median(lengths[view].clone());
        if residual > limit {
            used.reject(view, ViewReason::NotTheCamera, Some(residual).filter(|r| r.is_finite()));
            scene.poses.remove(view);
        }
    }
    used.check_count()
}

/// Whether a board shows its back.
pub(crate) fn is_mirrored(pose: &Isometry3<f64>) -> bool {
    // With x right and y down on the board, its z points away from who looks at its front.
    (pose.rotation * Vector3::z()).dot(&pose.translation.vector) < 0.0
}

/// Rejects the views whose board shows its back while most show their front, or the other way round. Returns whether all
/// that remain show their back.
///
/// A plane board and its mirror image fit equally well, at mirrored poses: only the side that is seen tells them apart.
fn reject_mirrored(scene: &mut Scene, used: &mut Used) -> Result<bool, CameraError> {
    let mirrored: Vec<bool> = scene.poses.iter().map(is_mirrored).collect();
    let count = mirrored.iter().filter(|&&mirrored| mirrored).count();
    let most = 2 * count > mirrored.len();
    let lengths = residual_lengths(scene, &used.views);
    for view in (0..mirrored.len()).rev().filter(|&view| mirrored[view] != most) {
        used.reject(view, ViewReason::Mirrored, Some(median(lengths[view].clone())));
        scene.poses.remove(view);
    }
    used.check_count()?;
    Ok(most)
}

fn check_tilts(scene: &Scene) -> Result<(), CameraError> {
    let normals: Vec<Vector3<f64>> = scene.poses.iter().map(|pose| pose.rotation * Vector3::z()).collect();
    let angles = normals.iter().flat_map(|a| normals.iter().map(|b| a.dot(b).abs().min(1.0).acos().to_degrees()));
    let within_deg = angles.fold(0.0, f64::max);
    if within_deg < PARALLEL_DEG {
        let quantity = "the image centre and the affine terms against the tilt of the boards";
        return Err(CameraError::Parallel { within_deg, quantity });
    }
    Ok(())
}

/// The fit that counts: nearly least squares, but no corner pulls harder than one at the limit of the loss.
pub(crate) fn final_fit(scene: &mut Scene, views: &[Vec<Observation>], unknowns: &Unknowns) -> Loss {
    refine::final_fit(scene, |scene| robust_sigma(scene, views), |scene, loss, _| scene.refine(views, unknowns, loss))
}

pub(crate) fn inliers(scene: &Scene, views: &[Vec<Observation>], limit_px: f64) -> Vec<Vec<Observation>> {
    let lengths = residual_lengths(scene, views);
    let of_view = |(corners, lengths): (&Vec<Observation>, &Vec<f64>)| -> Vec<Observation> {
        corners.iter().zip(lengths).filter(|(_, length)| **length <= limit_px).map(|(corner, _)| *corner).collect()
    };
    views.iter().zip(&lengths).map(of_view).collect()
}

/// RMS residual in views that the camera was not fitted to: of each, the pose comes from every other corner and the rest is
/// measured, both ways. Residuals count up to `limit_px`. None: too few views.
pub(crate) fn holdout(scene: &Scene, views: &[Vec<Observation>], unknowns: &Unknowns, limit_px: f64) -> Option<f64> {
    if views.len() < MIN_VIEWS + 1 {
        return None;
    }
    // At least `MIN_VIEWS` remain to be fitted.
    let folds = if views.len() >= 2 * FOLDS { FOLDS } else { views.len() };
    let loss = Loss::final_of(robust_sigma(scene, views));
    let (mut sum, mut count) = (0.0, 0);
    for fold in 0..folds {
        let fitted: Vec<usize> = (0..views.len()).filter(|view| view % folds != fold).collect();
        let mut camera =
            Scene { model: scene.model.clone(), poses: fitted.iter().map(|&view| scene.poses[view]).collect() };
        let corners: Vec<Vec<Observation>> = fitted.iter().map(|&view| views[view].clone()).collect();
        camera.refine(&corners, unknowns, loss);
        for view in (fold..views.len()).step_by(folds) {
            for half in 0..2 {
                let mut held = Scene { model: camera.model.clone(), poses: vec![scene.poses[view]] };
                let part = |half| views[view].iter().copied().skip(half).step_by(2).collect::<Vec<_>>();
                held.refine(&[part(half)], &Unknowns { poses: true, ..Unknowns::default() }, loss);
                for corner in part(1 - half) {
                    let residual = held.residual(0, &corner).map_or(limit_px.min(1e3), |r| r.norm().min(limit_px));
                    sum += residual * residual;
                    count += 1;
                }
            }
        }
    }
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}

/// Whether the rig file and the gateware's number format take the polynomial.
fn fits_rig_file(model: &CameraModel) -> bool {
    model.polynomial.iter().all(|a| a.abs() < MAX_POLYNOMIAL_COEFFICIENT)
}

/// The lowest degree that predicts views it was not fitted to as well as any, among those that fit the rig file.
fn choose_degree(scene: &Scene, views: &[Vec<Observation>], tangential: bool) -> (usize, Vec<(usize, f64)>) {
    // One limit for all, or the degree with the most outliers would look best.
    let limit = GATE_SIGMAS * robust_sigma(scene, views);
    let mut degrees = Vec::new();
    for degree in DEGREES {
        let unknowns = Unknowns::of_degree(degree, tangential);
        let mut trial = scene.clone();
        trial.model.polynomial.truncate(degree + 1);
        robust_fit(&mut trial, views, &unknowns);
        if fits_rig_file(&trial.model) {
            degrees.extend(holdout(&trial, views, &unknowns, limit).map(|rms| (degree, rms)));
        }
    }
    let best = degrees.iter().map(|(_, rms)| *rms).fold(f64::INFINITY, f64::min);
    let chosen = degrees.iter().find(|(_, rms)| *rms <= (1.0 + DEGREE_GAIN) * best);
    // Without enough views to hold some out, the degree that suits most cameras.
    (chosen.map_or(4, |(degree, _)| *degree), degrees)
}

/// A view at the end of the fit.
pub(crate) struct FittedView<'a> {
    pub name: &'a str,
    /// Board frame to camera frame, mm.
    pub pose: Isometry3<f64>,
    pub corners: &'a [Observation],
    /// Length of the residual of each corner, px; infinite where the camera does not see it.
    pub lengths: Vec<f64>,
}

/// RMS of the residuals that are there: a corner that the camera does not see has none; it is named among the outliers.
pub(crate) fn rms(lengths: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = lengths.filter(|r| r.is_finite()).fold((0.0, 0_u32), |(sum, count), r| (sum + r * r, count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

/// The result of a fit, without what only the caller knows: hold-out, degrees tried, rejected views. The first rows of
/// `covariance` are the camera's unknowns.
pub(crate) fn report(
    model: &CameraModel,
    fitted: &[FittedView],
    unknowns: &Unknowns,
    settings: &CameraSettings,
    covariance: &DMatrix<f64>,
    limit_px: f64,
) -> Result<CalibratedCamera, CameraError> {
    let all = || fitted.iter().flat_map(|view| &view.lengths).copied();
    let rms_inliers_px = rms(all().filter(|r| *r <= limit_px));
    let width = f64::from(settings.image_size_px[0]);
    if rms_inliers_px > POOR_FIT_PART * width {
        return Err(CameraError::PoorFit { rms_px: rms_inliers_px, limit_px: POOR_FIT_PART * width });
    }
    let mut views = Vec::new();
    let mut outliers = Vec::new();
    let mut radius_px = [f64::INFINITY, 0.0];
    for view in fitted {
        let mut inliers = 0;
        for (corner, &length) in view.corners.iter().zip(&view.lengths) {
            if length <= limit_px {
                let radius = model.corrected(corner.pixel).norm();
                radius_px = [radius.min(radius_px[0]), radius.max(radius_px[1])];
                inliers += 1;
            } else {
                outliers.push(Outlier {
                    view: view.name.to_owned(),
                    index: corner.index,
                    pixel: corner.pixel.into(),
                    residual_px: Some(length).filter(|length| length.is_finite()),
                    limit_px,
                });
            }
        }
        views.push(ViewResult {
            view: view.name.to_owned(),
            pose: view.pose,
            corners: view.corners.len(),
            inliers,
            rms_px: rms(view.lengths.iter().copied()),
        });
    }
    let sigma = sigma(model, unknowns, covariance, radius_px)?;
    let mut result = CalibratedCamera {
        model: model.clone(),
        image_size_px: settings.image_size_px,
        sigma,
        degree: unknowns.powers.last().copied().unwrap_or_default(),
        rms_px: rms(all()),
        rms_inliers_px,
        holdout_rms_px: None,
        degrees: Vec::new(),
        corners: views.iter().map(|view| view.corners).sum(),
        inliers: views.iter().map(|view| view.inliers).sum(),
        views,
        rejected_views: Vec::new(),
        outliers,
        radius_px,
        warnings: Vec::new(),
    };
    let board = fitted.iter().flat_map(|view| view.corners).map(|corner| corner.board.coords.xy());
    result.warnings = warnings(&result, extent(board));
    Ok(result)
}

/// Standard deviations of the camera's terms, from the scatter of the residuals.
fn sigma(
    model: &CameraModel,
    unknowns: &Unknowns,
    covariance: &DMatrix<f64>,
    radius_px: [f64; 2],
) -> Result<CameraSigma, CameraError> {
    let unobservable = |quantity| CameraError::Unobservable { quantity };
    let sigma_of = |i: usize| covariance[(i, i)].sqrt();
    let powers = unknowns.powers.len();
    let by_power = |from: usize, powers: &[usize], length: usize| {
        let mut sigmas = vec![0.0; length];
        for (i, &power) in powers.iter().enumerate() {
            sigmas[power] = sigma_of(from + i);
        }
        sigmas
    };
    let after = powers + unknowns.axial.len();
    let ray = |step: u32| {
        let s = (radius_px[0] + (radius_px[1] - radius_px[0]) * f64::from(step) / 16.0) / NORMAL_RADIUS_PX;
        let by_coefficient = DVector::from_iterator(powers, unknowns.powers.iter().map(|&power| s.powi(power as i32)));
        let variance = by_coefficient.dot(&(covariance.view((0, 0), (powers, powers)) * &by_coefficient));
        let f = model.polynomial.iter().rev().fold(0.0, |sum, c| sum * s + c);
        // Elevation atan(f / s)
        1e3 * variance.sqrt() * s / (s * s + f * f)
    };
    let pair = |from: usize| [sigma_of(from), sigma_of(from + 1)];
    let sigma = CameraSigma {
        polynomial: by_power(0, &unknowns.powers, model.polynomial.len()),
        axial: by_power(powers, &unknowns.axial, model.axial.len()),
        ray_mrad: (0..=16).map(ray).fold(0.0, f64::max),
        centre_px: pair(after),
        affine: pair(after + 2),
        tangential: if unknowns.tangential { pair(after + 4) } else { [0.0; 2] },
    };
    // Not above the limit, so that a value that is no number is an error too.
    let known = |sigma: f64, limit: f64| sigma <= limit;
    if !known(sigma.ray_mrad, RAY_LIMIT_MRAD) {
        return Err(unobservable("the polynomial"));
    }
    if !known(sigma.centre_px[0].max(sigma.centre_px[1]), CENTRE_LIMIT_PX) {
        return Err(unobservable("the image centre"));
    }
    if !known(sigma.affine[0].max(sigma.affine[1]), AFFINE_LIMIT) {
        return Err(unobservable("the affine terms"));
    }
    Ok(sigma)
}

fn warnings(result: &CalibratedCamera, size_mm: f64) -> Vec<Warning> {
    /// Part of the image size by which centres are off at most; published catadioptric cameras reach 6 %.
    const CENTRE_PART: f64 = 0.08;
    const CENTRE_SIGMA_PX: f64 = 1.0;
    const RAY_SIGMA_MRAD: f64 = 2.0;
    const SMALL_BOARD_MM: f64 = 10.0;
    const OUTLIER_PART: f64 = 0.05;

    let mut warnings = Vec::new();
    let (centre_px, image_size_px) = (result.model.centre_px, result.image_size_px);
    let off = |axis: usize| {
        let size = f64::from(image_size_px[axis]);
        (centre_px[axis] - 0.5 * (size - 1.0)).abs() > CENTRE_PART * size
    };
    if off(0) || off(1) {
        warnings.push(Warning::CentreOffMiddle { centre_px, image_size_px });
    }
    if size_mm < SMALL_BOARD_MM {
        warnings.push(Warning::SmallBoard { size_mm });
    }
    let centre_sigma = result.sigma.centre_px[0].max(result.sigma.centre_px[1]);
    if centre_sigma > CENTRE_SIGMA_PX {
        let quantity = "the image centre";
        warnings.push(Warning::Uncertain { quantity, sigma: centre_sigma, limit: CENTRE_SIGMA_PX, unit: "px" });
    }
    let sigma = result.sigma.ray_mrad;
    if sigma > RAY_SIGMA_MRAD {
        let quantity = "the elevation of the rays";
        warnings.push(Warning::Uncertain { quantity, sigma, limit: RAY_SIGMA_MRAD, unit: "mrad" });
    }
    if !fits_rig_file(&result.model) {
        let coefficient = result.model.polynomial.iter().fold(0.0, |most: f64, a| most.max(a.abs()));
        warnings.push(Warning::LargeCoefficient { coefficient });
    }
    let outliers = result.outliers.len();
    if outliers as f64 > OUTLIER_PART * result.corners as f64 {
        warnings.push(Warning::ManyOutliers { outliers, corners: result.corners });
    }
    warnings
}
