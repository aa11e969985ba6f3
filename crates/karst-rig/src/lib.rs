//! The rig file and the optics of the instrument in f64.

mod axial;
mod camera;
mod fixed_point;
mod model;
mod optics;
mod rig;
mod water;
mod water_camera;

pub use axial::*;
pub use fixed_point::{FixedPointError, FixedRig};
pub use water_camera::WaterCamera;
pub use model::*;
pub use optics::*;
