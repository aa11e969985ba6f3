//! Ray tracing through the tube.
use crate::{CameraModel, Ray, Tube};
use nalgebra::{Point3, Vector2};

/// A camera model *in air* looking through the tube: every ray is refracted exactly, in three dimensions, at both tube
/// surfaces, whatever the misalignment between camera and tube.
#[derive(Debug, Clone)]
pub struct TracedCamera {
    /// Camera in air.
    pub air: CameraModel,
    /// Tube between the camera and the water.
    pub tube: Tube,
    /// Refractive index of the water.
    pub water_index: f64,
}

impl TracedCamera {
    /// Ray in the water, rig frame: origin on the tube's outer surface, unit direction. None: total reflection, or the
    /// ray never reaches the tube.
    pub fn ray(&self, _pixel: Vector2<f64>) -> Option<Ray> {
        todo!()
    }

    /// Image position of a point in the water (rig frame, mm). None: not imaged.
    pub fn project(&self, _point: Point3<f64>) -> Option<Vector2<f64>> {
        todo!()
    }
}

/// Direction of a unit ray after refraction at a surface with unit `normal`, from index `n1` to `n2` (Snell's law in
/// vector form). None: total internal reflection.
pub fn refract(
    _direction: nalgebra::Vector3<f64>,
    _normal: nalgebra::Vector3<f64>,
    _n1: f64,
    _n2: f64,
) -> Option<nalgebra::Vector3<f64>> {
    todo!()
}
