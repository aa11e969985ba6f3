#![doc = include_str!("../README.md")]

mod belt;
mod bundle;
mod camera;
mod corners;
mod file;
mod find;
mod initial;
mod mei;
mod ocam;
mod opencv;
mod pictures;
mod refine;
mod refraction;
mod result;
mod saddle;
mod stereo;

pub use belt::{
    BeamSpot, BeltError, BeltPicture, BeltSpot, CalibratedBelt, CalibratedLaser, RejectedSpot, SpotReason,
    calibrate_belt,
};
pub use camera::{DEGREES, calibrate_camera};
pub use corners::{Corner, CornerList, View};
pub use file::FileError;
pub use find::{NotFound, find_corners};
pub use mei::{ConversionError, Converted, MeiModel};
pub use ocam::{OcamError, OcamModel};
pub use opencv::is_opencv;
pub use pictures::{FoundBoards, PictureReason, PicturesError, RejectedPicture, find_boards, picture_files};
pub use refine::Projection;
pub use refraction::{
    BIAS_RANGES_MM, InWater, RefractionComparison, RefractionError, calibrate_axial, compare_refraction,
};
pub use result::{
    CalibratedCamera, CameraError, CameraSettings, CameraSigma, Outlier, RejectedView, ViewReason, ViewResult, Warning,
};
pub use stereo::{
    BoardSet, CalibratedStereo, CornerResidual, Known, Pair, PairReason, Parameter, RejectedPair, StereoError,
    StereoSettings, StereoWarning, TubeKnowledge, TubeSettings, calibrate_stereo,
};
