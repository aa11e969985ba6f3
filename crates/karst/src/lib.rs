#![doc = include_str!("../README.md")]

pub mod calibration;
pub mod eval;
pub mod input;
pub mod instrument;
pub mod output;
pub mod result;
pub mod sensor;
