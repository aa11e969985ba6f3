//! The rig file and the optics of the instrument in f64.

mod model;
mod optics;
mod water;

pub use model::*;
pub use optics::*;
pub use water::*;
