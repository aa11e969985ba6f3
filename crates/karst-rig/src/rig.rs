//! The shipped rigs and the parts of a rig that follow from its data.

use crate::{
    Camera, CameraModel, FitError, Pose, Rig, TracedCamera, camera_optics::RIM_MARGIN_PX, fit_axial, fit_laser_pose,
};

/// How far beyond the mirror's rim a fitted model holds, px.
const FIT_MARGIN_PX: f64 = 4.0;

impl Default for Rig {
    /// The default rig: a calibrated instrument with small, known misalignments everywhere (`rigs/default.toml`).
    fn default() -> Self {
        shipped(Self::DEFAULT_TOML, "default.toml")
    }
}

impl Rig {
    /// The file of the default rig, commented field by field: a pattern for other rigs.
    pub const DEFAULT_TOML: &str = include_str!("../rigs/default.toml");

    /// The file of the ideal rig: a pattern for the drawing that a calibration starts from.
    pub const IDEAL_TOML: &str = include_str!("../rigs/ideal.toml");

    /// The default rig without any misalignment (`rigs/ideal.toml`).
    pub fn ideal() -> Self {
        shipped(Self::IDEAL_TOML, "ideal.toml")
    }

    /// Camera `index` (0 or 1) traced through tube and water. None: there is no such camera, it has no model in air, or
    /// the rig has no tube.
    pub fn traced_camera(&self, index: usize) -> Option<TracedCamera> {
        let camera = self.cameras.get(index)?;
        Some(TracedCamera {
            air: camera.air.clone()?,
            tube: self.tube?,
            water_index: self.water.index(),
            max_radius_px: camera.mirror_radius_px + RIM_MARGIN_PX,
        })
    }

    /// Camera `index` (0 or 1) as it works in the water: its `water` model, or else the axial model fitted to its traced
    /// `air` model. A rig without a tube works in the medium its models were calibrated in: its `air` model holds as it
    /// is.
    pub fn water_camera(&self, index: usize) -> Result<CameraModel, FitError> {
        let camera = self.cameras.get(index).ok_or(FitError::NoModel)?;
        if let Some(water) = &camera.water {
            return Ok(water.clone());
        }
        let Some(traced) = self.traced_camera(index) else {
            return camera.air.clone().ok_or(FitError::NoModel);
        };
        let (model, _) = fit_axial(&traced, fitted_radius_px(camera), self.reconstruction.range_mm)?;
        Ok(model)
    }

    /// Pose of camera `index` for the spots of each laser, given its model in the water from `water_camera`: that of the
    /// model, corrected for the skew of the rays behind a misaligned tube where the model was fitted.
    pub fn laser_poses(&self, index: usize, model: &CameraModel) -> Result<Vec<Pose>, FitError> {
        let camera = self.cameras.get(index).ok_or(FitError::NoModel)?;
        match self.traced_camera(index) {
            Some(traced) if camera.water.is_none() => self
                .lasers
                .iter()
                .map(|laser| {
                    let range_mm = self.reconstruction.range_mm;
                    fit_laser_pose(&traced, model, laser, fitted_radius_px(camera), range_mm)
                })
                .collect(),
            _ => Ok(vec![model.pose; self.lasers.len()]),
        }
    }
}

fn fitted_radius_px(camera: &Camera) -> [f64; 2] {
    [camera.inner_radius_px, camera.mirror_radius_px + FIT_MARGIN_PX]
}

fn shipped(text: &str, file_name: &str) -> Rig {
    Rig::from_toml(text, file_name).expect("a test reads the shipped rigs")
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector2};

    #[test]
    fn the_belt_is_imaged_between_the_radii_from_300_to_4800_mm() {
        for rig in [Rig::default(), Rig::ideal()] {
            for (index, camera) in rig.cameras.iter().enumerate() {
                let traced = rig.traced_camera(index).unwrap();
                let centre = Vector2::from(traced.air.centre_px);
                for laser in &rig.lasers {
                    for range in [300.0, 1000.0, 4800.0] {
                        let point = Point3::from(laser.origin_mm) + range * laser.direction();
                        let radius = (traced.project(point).unwrap() - centre).norm();
                        assert!(radius > camera.inner_radius_px && radius < camera.mirror_radius_px);
                    }
                }
            }
        }
    }

    #[test]
    fn without_a_tube_the_model_in_air_holds_as_it_is() {
        let rig = Rig { tube: None, ..Rig::default() };
        let model = rig.water_camera(1).unwrap();
        assert_eq!(Some(&model), rig.cameras[1].air.as_ref());
        let poses = rig.laser_poses(1, &model).unwrap();
        assert_eq!(poses, vec![model.pose; rig.lasers.len()]);
    }

    #[test]
    fn a_camera_that_is_not_there_has_no_model() {
        let mut rig = Rig::default();
        assert_eq!(rig.water_camera(2), Err(FitError::NoModel));
        rig.cameras[0].air = None;
        assert_eq!(rig.water_camera(0), Err(FitError::NoModel));
        assert!(rig.traced_camera(0).is_none());
    }

    #[test]
    fn the_ideal_rig_has_a_baseline_of_500_mm_and_12_lasers_30_degrees_apart() {
        let rig = Rig::ideal();
        let [first, second] = [0, 1].map(|i| rig.traced_camera(i).unwrap().air.pose.position_mm);
        assert_eq!(second[2] - first[2], 500.0);
        assert_eq!(rig.lasers.len(), 12);
        for (index, laser) in rig.lasers.iter().enumerate() {
            assert_eq!(laser.azimuth_deg, 30.0 * index as f64);
        }
    }
}
