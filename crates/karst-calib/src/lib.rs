#![doc = include_str!("../README.md")]

mod ocam;

pub use ocam::{OcamError, OcamModel};
