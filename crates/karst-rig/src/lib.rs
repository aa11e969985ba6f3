#![doc = include_str!("../README.md")]

mod axial;
mod board;
mod camera;
mod camera_optics;
mod check;
mod file;
mod fixed_point;
mod frame;
mod medium;
mod model;
mod optics;
mod rig;
mod water;
mod water_camera;

pub use axial::*;
pub use board::Board;
pub use camera_optics::CameraOptics;
pub use check::*;
pub use file::*;
pub use fixed_point::FixedPointError;
pub use medium::Medium;
pub use model::*;
pub use optics::*;
pub use water_camera::WaterCamera;
