//! The calibration of a whole instrument from a folder of pictures.

mod coverage;
mod manifest;

pub use coverage::Coverage;
pub use manifest::*;
