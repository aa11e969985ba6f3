//! The cameras as the reconstruction uses them.

use nalgebra::Vector2;

use crate::{CameraModel, FitError, Pose, Ray, Rig};

/// A camera in the water: one model, and for each laser the pose that fits the spots of that laser best.
#[derive(Debug, Clone, PartialEq)]
pub struct WaterCamera {
    /// Pixel to ray for all lasers.
    pub model: CameraModel,
    /// Pose for the spots of each laser.
    pub laser_poses: Vec<Pose>,
}

impl WaterCamera {
    /// Pose for the spots of a laser; that of the model for a laser that has none of its own.
    pub fn pose(&self, laser: usize) -> Pose {
        self.laser_poses.get(laser).copied().unwrap_or(self.model.pose)
    }

    /// Ray, rig frame, through a pixel of the spot of a laser.
    pub fn ray(&self, laser: usize, pixel: Vector2<f64>) -> Ray {
        let ray = self.model.ray(pixel);
        let correction = self.pose(laser).isometry() * self.model.pose.isometry().inverse();
        Ray { origin: correction * ray.origin, direction: correction * ray.direction }
    }
}

impl Rig {
    /// Both cameras in the water, fitted where the rig has them in air only.
    pub fn water_cameras(&self) -> Result<[WaterCamera; 2], FitError> {
        let camera = |index| {
            let model = self.water_camera(index)?;
            let laser_poses = self.laser_poses(index, &model)?;
            Ok(WaterCamera { model, laser_poses })
        };
        Ok([camera(0)?, camera(1)?])
    }
}
