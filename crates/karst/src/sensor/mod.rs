//! The host's side of a sensor: its line, its frames, and a sensor without hardware.
//!
//! [`SensorClient`] speaks to a sensor over anything that reads and writes bytes, [`Assembler`] makes sections of its
//! messages, and [`SimulatedSensor`] is such a line with a whole sensor behind it. [`SimulatedSoc`] is one, too, with the
//! sensor's gateware and its program as they are.

mod client;
mod clock;
mod frames;
mod simulated;
mod simulated_soc;
pub mod soc;

pub use client::{ClientError, MOST_LASERS, SensorClient};
pub use clock::Clock;
pub use frames::{Assembler, FrameCounts, LOST, SensorFrame, as_sent};
pub use simulated::SimulatedSensor;
pub use simulated_soc::{FrameClocks, Pace, SimulatedSoc};

/// Version of this program, for [`karst_link::Hello`].
fn program_version() -> [u8; 3] {
    let parts = [env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), env!("CARGO_PKG_VERSION_PATCH")];
    parts.map(|number| number.parse().unwrap_or(u8::MAX))
}
