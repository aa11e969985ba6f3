#![doc = include_str!("../README.md")]

mod camera;
mod corners;
mod file;
mod initial;
mod mei;
mod ocam;
mod refine;

pub use camera::{
    CalibratedCamera, CameraError, CameraSettings, CameraSigma, DEGREES, Outlier, RejectedView, ViewReason, ViewResult,
    Warning, calibrate_camera,
};
pub use corners::{Corner, CornerList, View};
pub use file::FileError;
pub use mei::{ConversionError, Converted, MeiModel};
pub use ocam::{OcamError, OcamModel};
pub use refine::Projection;
