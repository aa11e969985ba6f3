//! A whole instrument in fixed point, and whether it is one.

use core::fmt;

use fixed::types::I18F14;

use crate::calibration::{Calibration, LaserCalibration};
use crate::camera::CameraCalibration;
use crate::detector::{ConfigError, DetectorConfig};
use crate::reconstruct::ReconstructionSettings;

/// An instrument in fixed point, for up to `LASERS` lasers: what is loaded into the sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FixedRig<const LASERS: usize> {
    /// What the reconstruction needs.
    pub calibration: Calibration<LASERS>,
    /// What the spot detectors of the two cameras need.
    pub detectors: [DetectorConfig<LASERS>; 2],
}

/// Why a [`FixedRig`] can not be worked with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum RigError {
    /// The working range is empty, or begins in front of the lasers.
    Range,
    /// The limit of chi squared is not positive.
    Chi2,
    /// A direction cosine of a laser is above 1.
    Rotation {
        /// Index of the laser.
        laser: u16,
    },
    /// The uncertainty of a laser is above 32 mm or 20 mrad.
    Uncertainty {
        /// Index of the laser.
        laser: u16,
    },
    /// A camera has no polynomial, or an inverse affine matrix of zero.
    Camera {
        /// Camera, from 0.
        camera: u8,
    },
    /// A detector has another number of lasers than the calibration.
    DetectorLasers {
        /// Camera, from 0.
        camera: u8,
    },
    /// A detector refuses its configuration.
    Detector {
        /// Camera, from 0.
        camera: u8,
        /// What is wrong.
        error: ConfigError,
    },
}

impl fmt::Display for RigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Range => f.write_str("the working range is empty or begins below zero"),
            Self::Chi2 => f.write_str("the limit of chi squared is not positive"),
            Self::Rotation { laser } => write!(f, "laser {laser}: a direction cosine is above 1"),
            Self::Uncertainty { laser } => write!(f, "laser {laser}: its uncertainty is above 32 mm or 20 mrad"),
            Self::Camera { camera } => write!(f, "camera {camera}: its model has no polynomial or no scale"),
            Self::DetectorLasers { camera } => {
                write!(f, "camera {camera}: its detector has another number of lasers than the calibration")
            }
            Self::Detector { camera, error } => write!(f, "camera {camera}: {error}"),
        }
    }
}

impl core::error::Error for RigError {}

/// 1 in Q2.30.
const ONE: u32 = 1 << 30;

/// (32 mm)^2 in Q.32.
const MAX_ORIGIN_VARIANCE: u64 = 1024 << 32;

/// (20 mrad)^2 in Q.44.
const MAX_DIRECTION_VARIANCE: u64 = 7_036_874_418;

impl<const LASERS: usize> FixedRig<LASERS> {
    /// Whether every value is in the range that the algorithm documents.
    pub fn check(&self) -> Result<(), RigError> {
        self.calibration.settings.check()?;
        for (camera, model) in (0..).zip(&self.calibration.cameras) {
            model.check(camera)?;
        }
        for (laser, beam) in (0..).zip(&self.calibration.lasers) {
            beam.check(laser)?;
        }
        for (camera, detector) in (0..).zip(&self.detectors) {
            if detector.azimuths.len() != self.calibration.lasers.len() {
                return Err(RigError::DetectorLasers { camera });
            }
            detector.check().map_err(|error| RigError::Detector { camera, error })?;
        }
        Ok(())
    }
}

/// Whether no direction cosine is above 1. Three times the same code, and each of it unrolled, is much for the sensor.
#[inline(never)]
fn is_rotation(cosines: &[i32]) -> bool {
    cosines.iter().all(|cosine| cosine.unsigned_abs() <= ONE)
}

impl ReconstructionSettings {
    /// Whether the limits are some.
    pub fn check(&self) -> Result<(), RigError> {
        let [min, max] = self.range;
        if min < I18F14::ZERO || min >= max {
            return Err(RigError::Range);
        }
        if self.chi2_max <= I18F14::ZERO { Err(RigError::Chi2) } else { Ok(()) }
    }
}

impl CameraCalibration {
    /// Whether the model is one. `camera` is for the error.
    pub fn check(&self, camera: u8) -> Result<(), RigError> {
        let is_none = self.polynomial.is_empty() || self.inverse_affine == [0; 4];
        if is_none { Err(RigError::Camera { camera }) } else { Ok(()) }
    }
}

impl LaserCalibration {
    /// Whether the beam is one. `laser` is for the error.
    pub fn check(&self, laser: u16) -> Result<(), RigError> {
        let [first, second] = &self.cameras;
        for rotation in [&self.axes, &first.rotation, &second.rotation] {
            if !is_rotation(rotation.as_flattened()) {
                return Err(RigError::Rotation { laser });
            }
        }
        if self.origin_variance > MAX_ORIGIN_VARIANCE || self.direction_variance > MAX_DIRECTION_VARIANCE {
            return Err(RigError::Uncertainty { laser });
        }
        Ok(())
    }
}
