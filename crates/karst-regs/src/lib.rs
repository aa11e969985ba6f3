#![doc = include_str!("../README.md")]
#![cfg_attr(not(feature = "model"), no_std)]

mod bus;
mod driver;
mod field;
mod flags;
pub mod map;
mod mmio;
#[cfg(feature = "model")]
pub mod model;
mod results;
mod settings;
pub mod soc;
mod words;

pub use bus::RegisterBus;
pub use driver::{Capacity, Counters, Frame, Karst, LoadError, ProbeError, ReadError, Status};
pub use field::Field;
pub use flags::{Events, Faults};
pub use mmio::Mmio;
pub use results::{CameraFrame, SpotRecord};
pub use settings::{Settings, SettingsError};
pub use words::{MAX_BLOCK_WORDS, OTHER_BLOCKS, RigWords};
