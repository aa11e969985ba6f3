//! The rig file and the optics of the instrument in f64.

mod camera;
mod fixed_point;
mod model;
mod optics;
mod rig;
mod water;

pub use fixed_point::{FixedPointError, FixedRig};
pub use model::*;
pub use optics::*;
