//! The calibration of a whole instrument from a folder of pictures.

mod coverage;
mod manifest;
mod report;
mod results;
mod rig;
mod spots;

pub use coverage::Coverage;
pub use manifest::*;
pub use report::{Report, html};
pub use results::*;
pub use rig::*;
pub use spots::find_spots;
