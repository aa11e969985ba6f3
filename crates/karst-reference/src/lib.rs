#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod beam;
mod reconstruct;

pub use beam::{BeamRay, mono, stereo};
pub use reconstruct::{Estimates, Point, Reference, ReferenceSpot};
