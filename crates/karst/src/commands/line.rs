//! Lines to sensors: serial ports, and the simulated sensor.

use std::io::{Read, Write};
use std::time::Duration;

use anyhow::Context;
use karst::sensor::soc::{CLOCKS_PER_BIT, CLOCKS_PER_US};
use karst::sensor::{SensorClient, SimulatedSoc};
use karst_core::FixedRig;
use karst_link::Mode;
use karst_rig::Rig;

/// Bits per second if nothing else is asked for: those of the sensor's SoC as it is built, within 2 %.
pub const BAUD: u32 = 3_000_000;

const _: () = assert!(BAUD.abs_diff(CLOCKS_PER_US as u32 * 1_000_000 / CLOCKS_PER_BIT) * 50 <= BAUD);

/// A read from a port waits this long.
const READ_TIMEOUT: Duration = Duration::from_millis(50);

/// What a sensor is spoken with over.
pub trait Line: Read + Write {}

impl<T: Read + Write> Line for T {}

/// A sensor and where it is.
pub struct Connection {
    /// The sensor.
    pub client: SensorClient<Box<dyn Line>>,
    /// The port, or that it is a simulated one.
    pub place: String,
}

impl Connection {
    /// Finds the sensor at a serial port.
    pub fn open(port: &str, baud: u32) -> anyhow::Result<Self> {
        let line = serialport::new(port, baud).timeout(READ_TIMEOUT).open().with_context(|| {
            let ports: Vec<String> =
                serialport::available_ports().unwrap_or_default().into_iter().map(|port| port.port_name).collect();
            let known = if ports.is_empty() { "none".to_owned() } else { ports.join(", ") };
            format!("cannot open the serial port {port} (found on this computer: {known})")
        })?;
        Self::new(Box::new(line), format!("{port} at {baud} baud"))
    }

    /// Finds the sensor on any line.
    pub fn new(line: Box<dyn Line>, place: String) -> anyhow::Result<Self> {
        let client = SensorClient::connect(line).with_context(|| place.clone())?;
        Ok(Self { client, place })
    }

    /// Finds the sensor that is simulated clock by clock.
    pub fn simulated(sensor: &SimulatedSoc, place: String) -> anyhow::Result<Self> {
        let client = SensorClient::connect_by(Box::new(sensor.clone()) as Box<dyn Line>, sensor.clock());
        Ok(Self { client: client.with_context(|| place.clone())?, place })
    }
}

/// Name of a mode, as on the command line.
pub fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Accelerated => "accelerated",
        Mode::Software => "software",
    }
}

/// The rig as it is loaded into a sensor.
pub fn fixed<const LASERS: usize>(rig: &Rig) -> anyhow::Result<FixedRig<LASERS>> {
    Ok(rig.to_fixed(&rig.water_cameras()?)?)
}
