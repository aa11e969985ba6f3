#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

mod calibration;
mod camera;
mod cluster;
mod detector;
mod fixed_rig;
mod fusion;
mod paper;
mod reconstruct;
mod segment;
mod weighted;

pub use calibration::{Calibration, LaserCalibration, LaserFrame};
pub use camera::{CameraCalibration, CameraRay, MAX_COEFFICIENTS};
pub use cluster::{Bounds, Cluster};
pub use detector::{ConfigError, DetectorConfig, FrameStatus, ObservedHit, RowError, Spot, SpotDetector, SpotNoise};
pub use fixed::types::I18F14;
pub use fixed_rig::{FixedRig, RigError};
pub use fusion::{BeamRay, Estimates};
pub use reconstruct::{Method, NoPoint, Point, ReconstructionSettings, reconstruct};
pub use segment::Thresholds;

#[cfg(test)]
extern crate std;
