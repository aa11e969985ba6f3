//! What the steps of a calibration found, as it is kept from step to step and told in the report.

use karst_calib::{
    BIAS_RANGES_MM, CalibratedBelt, CalibratedStereo, CameraSettings, CornerList, InWater, RefractionComparison,
    RefractionError, compare_refraction,
};
use karst_rig::{CameraOptics, Rig, TracedCamera};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{Coverage, Manifest, inputs, with_cameras};
use crate::output::plot::CornerResidual;

/// The nearest spot of a beam is nearer than this many times the near end of the working range, or a nearer wall is asked
/// for.
const NEAR: f64 = 2.5;
/// The farthest spot of a beam is farther than this part of the far end of the working range.
const FAR: f64 = 0.4;

/// The baseline found is as in the drawing within this part: a drawing is a mechanical one.
const BASELINE_PART: f64 = 0.005;
/// The tube found is as in the drawing within these: position across its axis (mm) and direction (degrees).
const TUBE_OFFSET_MM: f64 = 5.0;
/// See `TUBE_OFFSET_MM`.
const TUBE_TILT_DEG: f64 = 1.0;
/// Boards in water fit tube and water of the drawing at most this many times worse than a model that knows neither.
const TUBE_MISFIT: f64 = 1.5;

/// The corners found in the pictures of one camera in one medium.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CornersResult {
    /// `air` or `water`.
    pub set: String,
    /// 1 or 2.
    pub camera: usize,
    /// Pictures looked at.
    pub pictures: usize,
    /// Pictures in which the board was found.
    pub found: usize,
    /// The others, with reasons.
    pub rejected: Vec<String>,
}

/// One camera. Residuals are lengths in the picture, RMS over corners.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraResult {
    /// RMS residual of all corners, px.
    pub rms_px: f64,
    /// RMS residual of the inliers, px.
    pub rms_inliers_px: f64,
    /// Corners in the views used.
    pub corners: usize,
    /// Of them, without the outliers.
    pub inliers: usize,
    /// Image centre, px.
    pub centre_px: [f64; 2],
    /// Degree of the polynomial.
    pub degree: usize,
    /// f / 512 px as a polynomial in s, as in the rig file.
    pub polynomial: Vec<f64>,
    /// Largest standard deviation of a ray's elevation where corners were, mrad.
    pub ray_sigma_mrad: f64,
    /// Radii at which corners were, px.
    pub radius_px: [f64; 2],
    /// Number of views used.
    pub views_used: usize,
    /// The views not used, with reasons.
    pub views_rejected: Vec<String>,
    /// The outliers.
    pub outliers: Vec<String>,
    /// How the corners cover the picture.
    pub coverage: Coverage,
    /// All corners.
    pub residuals: Vec<CornerResidual>,
}

/// A standard deviation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterSigma {
    /// The field of the rig file.
    pub name: String,
    /// Unit; empty for a ratio.
    pub unit: String,
    /// Standard deviation.
    pub sigma: f64,
}

/// One way to the model of a camera in the water.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WayResult {
    /// `traced` from air through tube and water, `axial` or `compact` fitted to boards in the water without the tube.
    pub way: String,
    /// RMS residual of the corners in the water, px.
    pub rms_px: f64,
    /// The same on corners held out of the fit, px.
    pub holdout_rms_px: Option<f64>,
    /// Mean range error with a perfectly known laser half way between the cameras, per cent, at [`BIAS_RANGES_MM`].
    pub bias_pct: [Option<f64>; BIAS_RANGES_MM.len()],
}

impl WayResult {
    /// The three ways to a camera in the water, range errors against the traced camera; and what may be wrong.
    pub fn compare(
        camera: &TracedCamera,
        water: &CornerList,
        settings: &CameraSettings,
        range_mm: [f64; 2],
    ) -> Result<(Vec<Self>, Vec<String>), RefractionError> {
        let compared = compare_refraction(camera, camera, water, settings, range_mm)?;
        let warnings = Self::warnings(&compared);
        let ways = [("traced", compared.traced), ("axial", compared.axial), ("compact", compared.compact)];
        Ok((ways.map(|(way, found)| Self::new(way, &found)).into(), warnings))
    }

    /// What may be wrong with a comparison.
    pub fn warnings(compared: &RefractionComparison) -> Vec<String> {
        let mut warnings: Vec<String> =
            compared.axial_warnings.iter().map(|warning| format!("axial model: {warning}")).collect();
        let (traced, axial) = (compared.traced.rms_px, compared.axial.rms_px);
        if traced > TUBE_MISFIT * axial {
            warnings.push(format!(
                "boards in water fit camera, tube and water with {traced:.3} px, a model that knows neither tube nor water with \
                 {axial:.3} px: are tube, temperature, salinity and the folders right?"
            ));
        }
        warnings
    }

    /// One way by its name.
    pub fn new(way: &str, found: &InWater) -> Self {
        Self {
            way: way.to_owned(),
            rms_px: found.rms_px,
            holdout_rms_px: found.holdout_rms_px,
            bias_pct: found.bias_pct,
        }
    }
}

/// Both cameras, and the tube.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CamerasResult {
    /// The cameras.
    pub cameras: [CameraResult; 2],
    /// Distance of the viewpoints, mm.
    pub baseline_mm: f64,
    /// Its standard deviation, mm.
    pub baseline_sigma_mm: f64,
    /// The same distance in the drawing, mm.
    pub baseline_drawn_mm: f64,
    /// Rotation from camera 2 to camera 1, degrees about x, then y, then z.
    pub rotation: [f64; 3],
    /// Number of pairs used.
    pub pairs_used: usize,
    /// The pairs not used, with reasons.
    pub pairs_rejected: Vec<String>,
    /// RMS residual of the inliers, px.
    pub rms_inliers_px: f64,
    /// The same on boards held out of the fit, px.
    pub holdout_rms_px: Option<f64>,
    /// For each camera the ways to its model in the water; none where no boards were in water, or a way failed (a
    /// warning).
    pub in_water: [Vec<WayResult>; 2],
    /// Standard deviations of all that was found.
    pub parameters: Vec<ParameterSigma>,
    /// What may be wrong.
    pub warnings: Vec<String>,
    /// What the cameras were calibrated with besides the corners: a later step refuses another board, tube or water.
    pub inputs: String,
}

/// One beam.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BeamResult {
    /// Spots used.
    pub spots: usize,
    /// Nearest and farthest spot, mm along the beam.
    pub range_mm: [f64; 2],
    /// Standard uncertainty across the beam at its origin, mm.
    pub origin_sigma_mm: f64,
    /// Standard uncertainty of the direction, mrad.
    pub direction_sigma_mrad: f64,
    /// RMS residual, px per axis.
    pub rms_px: f64,
    /// Chi squared per degree of freedom.
    pub chi2_per_dof: f64,
}

/// The belt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BeltResult {
    /// Pairs of pictures used.
    pub pictures: usize,
    /// Pairs that could not be read.
    pub pictures_failed: Vec<String>,
    /// The beams, in the order of the lasers.
    pub beams: Vec<BeamResult>,
    /// Smallest standard uncertainty of a spot position that explains the residuals, px per axis.
    pub sigma_floor_px: f64,
    /// Chi squared per degree of freedom.
    pub chi2_per_dof: f64,
    /// RMS residual, px per axis.
    pub rms_px: f64,
    /// Spots not used, with reasons.
    pub spots_rejected: Vec<String>,
}

fn rms(squares: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = squares.fold((0.0, 0_u32), |(sum, count), square| (sum + square, count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

impl CamerasResult {
    /// What a calibration of the cameras of a drawn rig found.
    ///
    /// `water` are the corners of boards in water, for the comparison of camera models.
    pub fn new(manifest: &Manifest, rig: &Rig, stereo: &CalibratedStereo, water: Option<&[CornerList; 2]>) -> Self {
        let camera = |index: usize| {
            let found = &stereo.cameras[index];
            let own = stereo.residuals.iter().filter(|corner| corner.camera == index + 1);
            let residuals: Vec<CornerResidual> = own
                .filter_map(|corner| {
                    let (pixel, outlier) = (corner.pixel, !corner.inlier);
                    Some(CornerResidual { pixel, residual_px: corner.residual_px?, outlier })
                })
                .collect();
            let inliers = residuals.iter().filter(|corner| !corner.outlier).map(|corner| corner.pixel);
            CameraResult {
                rms_px: found.rms_px,
                rms_inliers_px: found.rms_inliers_px,
                corners: found.corners,
                inliers: found.inliers,
                centre_px: found.model.centre_px,
                degree: found.degree,
                polynomial: found.model.polynomial.clone(),
                ray_sigma_mrad: found.sigma.ray_mrad,
                radius_px: found.radius_px,
                views_used: found.views.len(),
                views_rejected: found.rejected_views.iter().map(ToString::to_string).collect(),
                outliers: found.outliers.iter().map(ToString::to_string).collect(),
                coverage: Coverage::new(&rig.cameras[index], found.model.centre_px, inliers),
                residuals,
            }
        };
        let parameter = |parameter: &karst_calib::Parameter| ParameterSigma {
            name: parameter.name.clone(),
            unit: parameter.unit.to_owned(),
            sigma: parameter.sigma,
        };
        let mut warnings: Vec<String> = stereo.warnings.iter().map(ToString::to_string).collect();
        let baseline_drawn_mm = match (rig.camera_optics(0), rig.camera_optics(1)) {
            (Some(first), Some(second)) => {
                let viewpoint = |optics: &CameraOptics| Point3::from(optics.model().pose.position_mm);
                (viewpoint(&second) - viewpoint(&first)).norm()
            }
            _ => f64::NAN,
        };
        if (stereo.baseline_mm / baseline_drawn_mm - 1.0).abs() > BASELINE_PART {
            warnings.push(format!(
                "the baseline is {:.1} mm, in the drawing {baseline_drawn_mm:.1} mm: is the size of the squares right? All \
                 ranges are wrong by as much as it is",
                stereo.baseline_mm
            ));
        }
        if let (Some((found, _)), Some(drawn)) = (stereo.tube, rig.tube) {
            let motion = drawn.pose.isometry().inv_mul(&found.pose.isometry());
            let (offset_mm, tilt_deg) =
                (motion.translation.vector.xy().norm(), (motion * Vector3::z()).xy().norm().asin().to_degrees());
            if offset_mm > TUBE_OFFSET_MM || tilt_deg > TUBE_TILT_DEG {
                warnings.push(format!(
                    "the tube is {offset_mm:.1} mm and {tilt_deg:.2}° off the drawing: are folders swapped, or is the tube of the \
                     drawing another one?"
                ));
            }
        }
        let mut in_water = [Vec::new(), Vec::new()];
        let calibrated = with_cameras(rig, stereo);
        for (index, ways) in in_water.iter_mut().enumerate() {
            if let (Some(traced), Some(water)) = (calibrated.traced_camera(index), water) {
                let image_size_px = rig.cameras[index].image_size_px;
                let settings = CameraSettings { image_size_px, degree: None, tangential: true };
                match WayResult::compare(&traced, &water[index], &settings, rig.reconstruction.range_mm) {
                    Ok((found, own_warnings)) => {
                        warnings.extend(own_warnings.iter().map(|warning| format!("camera {}: {warning}", index + 1)));
                        *ways = found;
                    }
                    Err(error) => {
                        warnings.push(format!("camera {}: no comparison of models in the water: {error}", index + 1))
                    }
                }
            }
        }
        Self {
            cameras: [camera(0), camera(1)],
            in_water,
            baseline_mm: stereo.baseline_mm,
            baseline_sigma_mm: stereo.baseline_sigma_mm,
            baseline_drawn_mm,
            rotation: stereo.rotation_deg,
            pairs_used: stereo.pairs.len(),
            pairs_rejected: stereo.rejected_pairs.iter().map(ToString::to_string).collect(),
            rms_inliers_px: stereo.rms_inliers_px,
            holdout_rms_px: stereo.holdout_rms_px,
            parameters: stereo.parameters.iter().map(parameter).collect(),
            warnings,
            inputs: inputs(manifest, rig),
        }
    }

    /// What to photograph next, in sentences.
    pub fn advice(&self) -> Vec<String> {
        let gaps = |(index, camera): (usize, &CameraResult)| {
            let gaps = camera.coverage.gaps().into_iter();
            gaps.map(|gap| format!("Boards for camera {}: hardly any corners {gap}.", index + 1)).collect::<Vec<_>>()
        };
        self.cameras.iter().enumerate().flat_map(gaps).collect()
    }
}

impl BeltResult {
    /// What a calibration of the belt found in so many pairs of pictures.
    pub fn new(belt: &CalibratedBelt, pictures: usize, pictures_failed: Vec<String>) -> Self {
        let beam = |found: &karst_calib::CalibratedLaser| BeamResult {
            spots: found.spots.len(),
            range_mm: found
                .spots
                .iter()
                .fold([f64::INFINITY, 0.0], |[near, far], spot| [spot.along_mm.min(near), spot.along_mm.max(far)]),
            origin_sigma_mm: found.laser.origin_sigma_mm,
            direction_sigma_mrad: found.laser.direction_sigma_mrad,
            rms_px: rms(found.spots.iter().flat_map(|spot| spot.residual_px.as_flattened()).map(|r| r * r)),
            chi2_per_dof: found.chi2 / found.freedom.max(1) as f64,
        };
        Self {
            pictures,
            pictures_failed,
            beams: belt.lasers.iter().map(beam).collect(),
            sigma_floor_px: belt.sigma_floor_px,
            chi2_per_dof: belt.chi2_per_dof,
            rms_px: belt.rms_px,
            spots_rejected: belt.rejected.iter().map(ToString::to_string).collect(),
        }
    }

    /// What to photograph next for a working range (mm), in sentences.
    pub fn advice(&self, range_mm: [f64; 2]) -> Vec<String> {
        let beam = |(index, beam): (usize, &BeamResult)| {
            let [near, far] = beam.range_mm;
            let mut advice = Vec::new();
            if near > NEAR * range_mm[0] {
                advice.push(format!(
                    "Laser {index}: the nearest spot is {near:.0} mm away; add a wall at {:.0} mm.",
                    1.5 * range_mm[0]
                ));
            }
            if far < FAR * range_mm[1] {
                advice.push(format!(
                    "Laser {index}: the farthest spot is {far:.0} mm away; add a wall beyond {:.0} mm.",
                    FAR * range_mm[1]
                ));
            }
            advice
        };
        self.beams.iter().enumerate().flat_map(beam).collect()
    }
}
