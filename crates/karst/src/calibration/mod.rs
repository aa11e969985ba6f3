//! The calibration of a whole instrument from a folder of pictures.

mod coverage;
mod manifest;
mod results;
mod spots;

pub use coverage::Coverage;
pub use manifest::*;
pub use results::*;
pub use spots::find_spots;
