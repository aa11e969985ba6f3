//! The calibration of a whole instrument in fixed point.

use fixed::types::I18F14;
use heapless::Vec;
use karst_math::high_product_of_signed;

use crate::camera::CameraCalibration;
use crate::reconstruct::ReconstructionSettings;

/// A camera as seen from one laser's frame.
///
/// The laser frame has its origin on the beam and the axes *along* the beam, *up* (across the beam, as near to the rig
/// axis as possible) and *across* (completing the right-handed frame).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LaserFrame {
    /// Rotation from the camera's frame, rows along, up, across, Q2.30.
    pub rotation: [[i32; 3]; 3],
    /// The camera's viewpoint (along, up, across), mm in Q12.20.
    pub viewpoint: [i32; 3],
}

/// One laser beam: a line with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LaserCalibration {
    /// Point of the beam from which ranges count, rig frame, mm in Q12.20.
    pub origin: [i32; 3],
    /// Unit vectors along, up and across in the rig frame, Q2.30.
    pub axes: [[i32; 3]; 3],
    /// Variance of the origin across the beam, per axis, mm^2 in Q.32, at most 1024 mm^2.
    pub origin_variance: u64,
    /// Variance of the direction, per axis, rad^2 in Q.44, at most (20 mrad)^2.
    pub direction_variance: u64,
    /// The two cameras as seen from this laser.
    pub cameras: [LaserFrame; 2],
}

impl LaserCalibration {
    /// Variance of the beam's position across itself at a distance (mm, Q.2), mm^2 in Q.20; at most 2048 mm^2 count.
    pub(crate) fn variance_at(&self, quarters: u32) -> u32 {
        // Q.4 times Q.42
        let grown = (u64::from(quarters * quarters) * u64::from((self.direction_variance >> 2) as u32)) >> 26;
        if grown >> 31 != 0 {
            return MAX_BEAM_VARIANCE;
        }
        // At most 2^30 and at most 2^31
        let variance = (self.origin_variance >> 12) as u32 + grown as u32;
        variance.min(MAX_BEAM_VARIANCE)
    }
}

/// Largest variance of a beam's position that counts, mm^2 in Q.20.
const MAX_BEAM_VARIANCE: u32 = (1 << 31) - 1;

/// Everything the reconstruction needs to know of an instrument with up to `LASERS` lasers.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Calibration<const LASERS: usize> {
    /// The two cameras.
    pub cameras: [CameraCalibration; 2],
    /// The lasers, in the order of their sectors.
    pub lasers: Vec<LaserCalibration, LASERS>,
    /// Acceptance limits.
    pub settings: ReconstructionSettings,
}

/// The beam frame's coordinates (mm, Q.16) back in the rig frame, mm in Q18.14.
pub(crate) fn to_rig(laser: &LaserCalibration, beam: [i32; 3]) -> [I18F14; 3] {
    core::array::from_fn(|axis| {
        // Q.16 times Q.30, each product at Q.14
        let products = [0, 1, 2].map(|i| high_product_of_signed(beam[i], laser.axes[i][axis]));
        I18F14::from_bits((laser.origin[axis] >> 6) + products[0] + products[1] + products[2])
    })
}
