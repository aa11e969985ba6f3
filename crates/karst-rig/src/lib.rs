#![doc = include_str!("../README.md")]

mod axial;
mod camera;
mod check;
mod file;
mod model;
mod optics;
mod rig;
mod water;

pub use axial::*;
pub use check::*;
pub use file::*;
pub use model::*;
pub use optics::*;
