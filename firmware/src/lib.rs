//! The sensor's firmware: what it is made for. With the feature `images`, what the images share.
#![no_std]

#[cfg(feature = "images")]
mod image;
#[cfg(feature = "images")]
pub mod soc;

#[cfg(feature = "images")]
pub use image::{RECORDING, exit_failure, exit_success, panicked};

/// Lasers that the sensor can serve.
pub const LASERS: usize = 12;

/// Spots per camera and frame that it can take.
pub const SPOTS: usize = 4 * LASERS;

/// The watchdog bites when nothing has happened for this long, microseconds. Longer than any poll takes.
pub const WATCHDOG_US: u32 = 2_000_000;

/// Version of the firmware: major, minor, patch.
pub const PROGRAM: [u8; 3] = [0, 1, 0];
