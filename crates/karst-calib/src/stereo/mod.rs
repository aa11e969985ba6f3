//! Calibration of two cameras together, in air and through tube and water.

mod check;
mod joint;
mod pairing;
mod report;
mod result;
mod start;

use joint::Joint;
pub use result::{
    BoardSet, CalibratedStereo, CornerResidual, Known, Pair, PairReason, Parameter, RejectedPair, StereoError,
    StereoSettings, StereoWarning, TubeKnowledge, TubeSettings,
};
use start::Start;

/// Calibrates two cameras together from boards that both see, and the tube around them from boards in water.
///
/// Each camera is calibrated on its own to start with: from its boards in air or, where it has fewer than three of these,
/// from those in water: Snell's law takes their compact model to air, and a fit through a tube around the camera's own axis
/// improves it. The first relative pose is the one that most pairs agree with. Then both cameras, the relative pose, what
/// is not known of tube and water, and the poses of all boards are refined together, rays traced through the misaligned
/// tube exactly.
///
/// No board tells where the rig frame is: camera 1 keeps the pose given.
pub fn calibrate_stereo(sets: &[BoardSet], settings: &StereoSettings) -> Result<CalibratedStereo, StereoError> {
    check::settings(sets, settings)?;
    check::lists(sets, settings)?;
    let starts = [Start::new(sets, settings, 0)?, Start::new(sets, settings, 1)?];
    for camera in 0..2 {
        if starts[camera].all_mirrored && !starts[1 - camera].all_mirrored {
            return Err(StereoError::MirroredOrder { camera: camera + 1 });
        }
    }
    let mut joint = Joint::new(sets, settings, starts)?;
    joint.fit()?;
    joint.result(settings)
}
