#![doc = include_str!("../README.md")]

mod bundle;
mod camera;
mod corners;
mod file;
mod initial;
mod mei;
mod ocam;
mod refine;
mod refraction;
mod result;
mod stereo;

pub use camera::{DEGREES, calibrate_camera};
pub use corners::{Corner, CornerList, View};
pub use file::FileError;
pub use mei::{ConversionError, Converted, MeiModel};
pub use ocam::{OcamError, OcamModel};
pub use refine::Projection;
pub use refraction::{
    BIAS_RANGES_MM, InWater, RefractionComparison, RefractionError, calibrate_axial, compare_refraction,
};
pub use result::{
    CalibratedCamera, CameraError, CameraSettings, CameraSigma, Outlier, RejectedView, ViewReason, ViewResult, Warning,
};
pub use stereo::{
    BoardSet, CalibratedStereo, CornerResidual, Known, Medium, Pair, PairReason, Parameter, RejectedPair, StereoError,
    StereoSettings, StereoWarning, TubeKnowledge, TubeSettings, calibrate_stereo,
};
