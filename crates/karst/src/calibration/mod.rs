//! The calibration of a whole instrument from a folder of pictures.

mod manifest;

pub use manifest::*;
