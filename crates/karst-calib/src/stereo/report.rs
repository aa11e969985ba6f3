//! From the joint fit to its result.

use karst_rig::{CameraModel, Pose};
use nalgebra::{DMatrix, Matrix6, SymmetricEigen};

use super::joint::{Joint, holdout};
use super::{CalibratedStereo, CornerResidual, Pair, Parameter, StereoError, StereoSettings, StereoWarning};
use crate::{
    Warning,
    bundle::{BoardView, JointUnknowns, TubeAndWater},
    camera::{FittedView, GATE_SIGMAS, report, rms},
    refine::{Loss, POSE},
};

impl Joint {
    pub fn result(mut self, settings: &StereoSettings) -> Result<CalibratedStereo, StereoError> {
        let loss = self.bundle.final_fit(&self.views, &self.unknowns);
        let (bundle, views, unknowns) = (&self.bundle, &self.views, &self.unknowns);
        let sigma = bundle.sigma(views);
        let limit_px = GATE_SIGMAS * sigma;
        let covariance = bundle
            .covariance(views, unknowns, loss)
            .ok_or_else(|| StereoError::Unobservable { quantity: self.weakest(loss, sigma) })?;
        let lengths = bundle.lengths(views);
        let inliers: Vec<BoardView> = views
            .iter()
            .zip(&lengths)
            .map(|(view, lengths)| {
                let inliers = view.corners.iter().zip(lengths).filter(|(_, length)| **length <= limit_px);
                BoardView { corners: inliers.map(|(corner, _)| *corner).collect(), ..view.clone() }
            })
            .collect();
        let holdout_rms_px = holdout(bundle, &inliers, unknowns, f64::INFINITY);
        let camera = |camera: usize| {
            let fitted: Vec<FittedView> = views
                .iter()
                .zip(&lengths)
                .filter(|(view, _)| view.camera == camera)
                .map(|(view, lengths)| FittedView {
                    name: &view.name,
                    pose: bundle.camera_poses[camera].inv_mul(&bundle.boards[view.board]),
                    corners: &view.corners,
                    lengths: lengths.clone(),
                })
                .collect();
            let (from, terms) = (unknowns.camera_column(camera), &unknowns.cameras[camera]);
            let own = covariance.view((from, from), (terms.len(), terms.len())).into_owned();
            let model = CameraModel { pose: bundle.camera_poses[camera].into(), ..bundle.models[camera].clone() };
            let mut result = report(&model, &fitted, terms, &settings.cameras[camera], &own, limit_px)
                .map_err(|source| StereoError::Camera { camera: camera + 1, source })?;
            result.holdout_rms_px = holdout_rms_px;
            result.degrees.clone_from(&self.degrees[camera]);
            result.rejected_views.clone_from(&self.rejected_views[camera]);
            if self.all_mirrored {
                result.warnings.push(Warning::AllMirrored);
            }
            Ok(result)
        };
        let cameras = [camera(0)?, camera(1)?];

        let relative = bundle.camera_poses[0].inv_mul(&bundle.camera_poses[1]);
        let from = unknowns.relative_column();
        let in_rig: Matrix6<f64> = covariance.fixed_view::<POSE, POSE>(from, from).into_owned();
        let mut to_camera = Matrix6::zeros();
        let turn = bundle.camera_poses[0].rotation.inverse().to_rotation_matrix();
        for at in [0, 3] {
            to_camera.fixed_view_mut::<3, 3>(at, at).copy_from(turn.matrix());
        }
        let relative_covariance = to_camera * in_rig * to_camera.transpose();
        let baseline_mm = relative.translation.vector.norm();
        let along = relative.translation.vector / baseline_mm;
        let variance = along.dot(&(relative_covariance.fixed_view::<3, 3>(3, 3) * along));

        let globals = unknowns.len();
        let names = parameter_names(unknowns);
        let parameters: Vec<Parameter> = (names.into_iter().enumerate())
            .map(|(column, (name, unit))| Parameter { name, unit, sigma: covariance[(column, column)].sqrt() })
            .collect();
        let residuals = self.residuals(limit_px);
        let pairs = self.pairs.iter().enumerate().filter_map(|(board, pair)| {
            let (pair, turned) = pair.clone()?;
            let of_camera = |camera: usize| {
                let own = views.iter().zip(&lengths).filter(|(view, _)| view.board == board && view.camera == camera);
                rms(own.flat_map(|(_, lengths)| lengths.iter().copied()))
            };
            Some(Pair { pair, rms_px: [of_camera(0), of_camera(1)], turned })
        });
        let all = || lengths.iter().flatten().copied();
        let mut result = CalibratedStereo {
            relative,
            relative_covariance,
            baseline_mm,
            baseline_sigma_mm: variance.sqrt(),
            rotation_deg: Pose::from(relative).rotation_deg,
            tube: bundle.tube_and_water.map(|TubeAndWater { tube, water_index }| (tube, water_index)),
            parameters,
            covariance: covariance.view((0, 0), (globals, globals)).into_owned(),
            pairs: pairs.collect(),
            rejected_pairs: self.rejected_pairs.clone(),
            single_views: self.single_views.clone(),
            residuals,
            rms_px: rms(all()),
            rms_inliers_px: rms(all().filter(|length| *length <= limit_px)),
            holdout_rms_px,
            warnings: Vec::new(),
            cameras,
        };
        result.warnings = self.warnings(&result);
        Ok(result)
    }

    /// The unknown with most part in the combination of unknowns that is known least.
    fn weakest(&self, loss: Loss, sigma: f64) -> String {
        let (mut matrix, _) = self.bundle.normal_equations(&self.views, &self.unknowns, loss, sigma);
        matrix.fill_upper_triangle_with_lower_triangle();
        let scale = matrix.diagonal().map(|value| 1.0 / value.max(f64::MIN_POSITIVE).sqrt());
        let scaled = DMatrix::from_diagonal(&scale) * matrix * DMatrix::from_diagonal(&scale);
        let names = parameter_names(&self.unknowns);
        let part = SymmetricEigen::try_new(scaled, f64::EPSILON, 10_000).map(|eigen| {
            let weakest = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
            weakest.rows(0, names.len()).iamax()
        });
        part.and_then(|column| names.get(column)).map_or_else(|| "some quantity".to_owned(), |(name, _)| name.clone())
    }

    fn residuals(&self, limit_px: f64) -> Vec<CornerResidual> {
        let mut residuals = Vec::new();
        for (view, of_view) in self.views.iter().zip(self.bundle.residuals(&self.views)) {
            for (corner, residual) in view.corners.iter().zip(of_view) {
                residuals.push(CornerResidual {
                    view: view.name.clone(),
                    camera: view.camera + 1,
                    index: corner.index,
                    pixel: corner.pixel.into(),
                    residual_px: residual.map(Into::into),
                    inlier: residual.is_some_and(|residual| residual.norm() <= limit_px),
                });
            }
        }
        residuals
    }

    fn warnings(&self, result: &CalibratedStereo) -> Vec<StereoWarning> {
        const GOOD_PAIRS: usize = 6;
        const REJECTED_PART: f64 = 0.2;
        const SMALL_BASELINE_MM: f64 = 10.0;
        const BASELINE_PART: f64 = 1e-3;
        const TURN_MRAD: f64 = 5.0;
        /// Change against a prior, in its standard deviations.
        const IMPLAUSIBLE: f64 = 4.0;

        let mut warnings = Vec::new();
        for (camera, own) in (1..).zip(&result.cameras) {
            let own = own.warnings.iter().cloned();
            warnings.extend(own.map(|warning| StereoWarning::Camera { camera, warning }));
        }
        let (pairs, rejected) = (result.pairs.len(), result.rejected_pairs.len());
        if pairs < GOOD_PAIRS {
            warnings.push(StereoWarning::FewPairs { pairs, expected: GOOD_PAIRS });
        }
        if rejected as f64 > REJECTED_PART * (pairs + rejected) as f64 {
            warnings.push(StereoWarning::ManyRejected { rejected, pairs: pairs + rejected });
        }
        let baseline_mm = result.baseline_mm;
        if baseline_mm < SMALL_BASELINE_MM {
            warnings.push(StereoWarning::SmallBaseline { baseline_mm });
        }
        let mut check = |quantity, sigma: f64, limit: f64, unit| {
            if sigma.is_nan() || sigma > limit {
                warnings.push(StereoWarning::Uncertain { quantity, sigma, limit, unit });
            }
        };
        check("the baseline", result.baseline_sigma_mm, BASELINE_PART * baseline_mm, "mm");
        let turn = (0..3).map(|axis| result.relative_covariance[(axis, axis)].sqrt()).fold(0.0, f64::max);
        check("the rotation of camera 2 against camera 1", 1e3 * turn, TURN_MRAD, "mrad");
        for (free, parameter) in self.unknowns.terms.iter().zip(&result.parameters[self.unknowns.terms_column()..]) {
            let (quantity, limit) = free.term.quantity_and_limit();
            check(quantity, parameter.sigma, limit, parameter.unit);
        }
        if let (Some(now), Some(nominal)) = (&self.bundle.tube_and_water, &self.unknowns.nominal) {
            for free in &self.unknowns.terms {
                let (change, unit) = (free.term.change(now, nominal), free.term.unit());
                if let Some(sigma) = free.prior.filter(|sigma| change.abs() > IMPLAUSIBLE * sigma) {
                    let (quantity, _) = free.term.quantity_and_limit();
                    warnings.push(StereoWarning::Implausible { quantity, change, sigma, unit });
                }
            }
        }
        warnings
    }
}

/// Name and unit of each unknown but for the poses of the boards.
fn parameter_names(unknowns: &JointUnknowns) -> Vec<(String, &'static str)> {
    let mut names = Vec::new();
    for (camera, terms) in (1..).zip(&unknowns.cameras) {
        let mut add = |name: String, unit| names.push((format!("camera{camera}.{name}"), unit));
        for power in &terms.powers {
            add(format!("polynomial[{power}]"), "");
        }
        for axis in 0..2 {
            add(format!("centre_px[{axis}]"), "px");
        }
        add("affine[0]".to_owned(), "");
        add("shear".to_owned(), "");
        if terms.tangential {
            add("tangential[0]".to_owned(), "");
            add("tangential[1]".to_owned(), "");
        }
    }
    for axis in 0..3 {
        names.push((format!("camera2.turn[{axis}]"), "rad"));
    }
    for axis in 0..3 {
        names.push((format!("camera2.position_mm[{axis}]"), "mm"));
    }
    names.extend(unknowns.terms.iter().map(|free| (free.term.name(), free.term.unit())));
    names
}
