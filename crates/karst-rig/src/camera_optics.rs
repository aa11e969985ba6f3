//! One camera of an instrument as it works in the water: traced where that is possible, by its model otherwise.

use nalgebra::{Point3, Vector2};

use crate::{CameraModel, Ray, Rig, TracedCamera};

/// How far beyond the mirror's rim a point still has an image, px: the spot around it reaches into the mirror.
pub(crate) const RIM_MARGIN_PX: f64 = 16.0;

/// Pixel to ray in the water and back.
#[derive(Debug, Clone)]
pub enum CameraOptics {
    /// A camera in air that looks through the tube.
    Traced(TracedCamera),
    /// A model that holds as it is.
    Model {
        /// Pixel to ray.
        model: CameraModel,
        /// Largest radius, after the affine and tangential corrections, at which `project` finds a point, px.
        max_radius_px: f64,
    },
}

impl CameraOptics {
    /// Ray in the water, rig frame. None: the pixel does not see the water.
    pub fn ray(&self, pixel: Vector2<f64>) -> Option<Ray> {
        let ray = match self {
            Self::Traced(camera) => camera.ray(pixel)?,
            Self::Model { model, .. } => model.ray(pixel),
        };
        ray.direction.iter().chain(ray.origin.iter()).all(|c| c.is_finite()).then_some(ray)
    }

    /// Pixel of a point in the water (rig frame, mm). None: not imaged.
    pub fn project(&self, point: Point3<f64>) -> Option<Vector2<f64>> {
        match self {
            Self::Traced(camera) => camera.project(point),
            Self::Model { model, max_radius_px } => model.project(point, *max_radius_px),
        }
    }

    /// The camera model behind: in air where it is traced.
    pub fn model(&self) -> &CameraModel {
        match self {
            Self::Traced(camera) => &camera.air,
            Self::Model { model, .. } => model,
        }
    }
}

impl Rig {
    /// Camera `index` (0 or 1) as it works: traced through tube and water where the rig has a tube and the camera a model
    /// in air; without a tube the model in air as it is; without a model in air the one in the water. None: no such
    /// camera, or it has no model.
    pub fn camera_optics(&self, index: usize) -> Option<CameraOptics> {
        let camera = self.cameras.get(index)?;
        let max_radius_px = camera.mirror_radius_px + RIM_MARGIN_PX;
        if let Some(traced) = self.traced_camera(index) {
            return Some(CameraOptics::Traced(traced));
        }
        let [first, second] =
            if self.tube.is_some() { [&camera.water, &camera.air] } else { [&camera.air, &camera.water] };
        let model = first.clone().or_else(|| second.clone())?;
        Some(CameraOptics::Model { model, max_radius_px })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_and_projections_agree_with_and_without_a_tube() {
        for rig in [Rig::default(), Rig { tube: None, ..Rig::default() }] {
            for index in 0..2 {
                let optics = rig.camera_optics(index).unwrap();
                let point = Point3::new(800.0, -300.0, 40.0);
                let ray = optics.ray(optics.project(point).unwrap()).unwrap();
                let offset = point - ray.origin;
                assert!(offset.cross(&ray.direction).norm() < 1e-6);
            }
        }
    }

    #[test]
    fn a_camera_that_is_not_there_has_no_optics() {
        assert!(Rig::default().camera_optics(2).is_none());
    }
}
