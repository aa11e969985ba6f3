#![doc = include_str!("../README.md")]

mod camera;
mod corners;
mod file;
mod find;
mod initial;
mod mei;
mod ocam;
mod refine;
mod result;
mod saddle;

pub use camera::{DEGREES, calibrate_camera};
pub use corners::{Corner, CornerList, View};
pub use file::FileError;
pub use find::{NotFound, find_corners};
pub use mei::{ConversionError, Converted, MeiModel};
pub use ocam::{OcamError, OcamModel};
pub use refine::Projection;
pub use result::{
    CalibratedCamera, CameraError, CameraSettings, CameraSigma, Outlier, RejectedView, ViewReason, ViewResult, Warning,
};
