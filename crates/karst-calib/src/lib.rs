#![doc = include_str!("../README.md")]

mod camera;
mod corners;
mod initial;
mod ocam;
mod refine;

pub use camera::{
    CalibratedCamera, CameraError, CameraSettings, CameraSigma, DEGREES, Outlier, RejectedView, ViewReason, ViewResult,
    Warning, calibrate_camera,
};
pub use corners::{Corner, CornerList, CornersError, View};
pub use ocam::{OcamError, OcamModel};
pub use refine::Projection;
