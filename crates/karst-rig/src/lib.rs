//! The rig file and the optics of the instrument in f64.

mod axial;
mod camera;
mod model;
mod optics;
mod rig;
mod water;

pub use axial::*;
pub use model::*;
pub use optics::*;
