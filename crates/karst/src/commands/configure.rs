//! `karst configure`: sends a sensor its calibration and settings.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::{ArgGroup, Args, ValueEnum};
use karst::instrument::method_name;
use karst::sensor::{MOST_LASERS, SimulatedSensor};
use karst_core::{FixedRig, I18F14};
use karst_link::{Message, Settings, calibration_crc};
use karst_regs::RigWords;
use serde::Serialize;

use super::line::{BAUD, Connection, fixed, mode_name};
use super::{Method, complain, count, finite, load_rig, print, print_json, progress};

#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("what").required(true).multiple(true).args(
        ["rig", "mode", "method", "lasers", "spots", "trigger_hz", "read"]
    )),
    after_help = "Examples:
  karst configure /dev/ttyUSB0 --rig my-rig.toml --lasers on
  karst configure /dev/ttyUSB0 --mode software --trigger-hz 10
  karst configure /dev/ttyUSB0 --read --rig my-rig.toml
  karst configure --simulated --rig my-rig.toml --lasers on --json

What is not given stays as it is. Everything is read back and compared. --read changes nothing; with --rig it fails if the
sensor has another calibration. The sensor forgets all of it when it is switched off."
)]
pub struct Configure {
    /// Serial port of the sensor, such as /dev/ttyUSB0 or COM3
    #[arg(required_unless_present = "simulated", conflicts_with = "simulated")]
    port: Option<String>,
    /// Bits per second on the serial line
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
    /// A simulated sensor in this program, which has just been switched on: a rehearsal
    #[arg(long)]
    simulated: bool,
    /// Rig file: the calibration to use
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Where the points are computed; both give the same
    #[arg(long, value_enum)]
    mode: Option<Mode>,
    /// How the estimates become a point
    #[arg(long, value_enum)]
    method: Option<Method>,
    /// Switch the lasers
    #[arg(long, value_enum)]
    lasers: Option<Switch>,
    /// Send the spots of both cameras, too
    #[arg(long, value_enum)]
    spots: Option<Switch>,
    /// Exposures per second; 0: the cameras run on their own
    #[arg(long = "trigger-hz", value_name = "HZ", value_parser = trigger_period_us, id = "trigger_hz")]
    trigger_period_us: Option<u32>,
    /// Only read back what the sensor has
    #[arg(long, conflicts_with_all = ["mode", "method", "lasers", "spots", "trigger_hz"])]
    read: bool,
    /// Print what the sensor has as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Mode {
    /// By the gateware
    Accelerated,
    /// By the CPU of the sensor
    Software,
}

impl From<Mode> for karst_link::Mode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Accelerated => Self::Accelerated,
            Mode::Software => Self::Software,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Switch {
    On,
    Off,
}

/// Value of `--trigger-hz`.
fn trigger_period_us(text: &str) -> Result<u32, &'static str> {
    match finite(text) {
        Some(0.0) => Ok(0),
        Some(hz) if (0.001..=1000.0).contains(&hz) => Ok((1e6 / hz).round() as u32),
        _ => Err("expected 0, or 0.001 to 1000"),
    }
}

/// What the sensor has, as `--json` prints it.
#[derive(Serialize)]
struct Found {
    /// Version of the sensor's program.
    program: String,
    /// Protocol spoken.
    protocol: u8,
    /// Most lasers it can serve.
    most_lasers: u16,
    mode: &'static str,
    method: &'static str,
    lasers_on: bool,
    spots: bool,
    /// Exposures per second; none: the cameras run on their own.
    trigger_hz: Option<f64>,
    calibration: Option<FoundCalibration>,
    /// Whether the calibration is that of the rig file; none: no rig file.
    is_rig: Option<bool>,
}

#[derive(Serialize)]
struct FoundCalibration {
    /// Its fingerprint.
    crc: String,
    lasers: usize,
    image_sizes_px: [[u16; 2]; 2],
    /// Working range along the beams, mm.
    range_mm: [f64; 2],
}

impl Configure {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let rig = self.rig.as_ref().map(|path| {
            let rig = load_rig(Some(path))?;
            fixed::<MOST_LASERS>(&rig).with_context(|| path.display().to_string())
        });
        let rig = rig.transpose()?;
        let mut connection = match &self.port {
            Some(port) => Connection::open(port, self.baud)?,
            None => {
                let lasers = rig.as_ref().map_or(0, |rig| rig.calibration.lasers.len());
                let sensor = SimulatedSensor::new(lasers, std::iter::empty());
                Connection::new(Box::new(sensor), "simulated sensor".to_owned())?
            }
        };
        let changed = if self.read { Ok(()) } else { self.change(&mut connection, rig.as_ref()) };
        // They may say why something did not go well
        while let Ok(Some(message)) = connection.client.receive(Duration::ZERO) {
            if let Message::Log(log) = message {
                complain(format_args!("sensor says: {}", log.text));
            }
        }
        let found = changed.and_then(|()| read_back(&mut connection, rig.as_ref()));
        let found = found.with_context(|| connection.place.clone())?;
        if self.json {
            print_json(&found)?;
        } else {
            found.print(&connection.place)?;
        }
        if found.is_rig == Some(false) {
            bail!("{}: the calibration of the sensor is not that of the rig file", connection.place);
        }
        Ok(ExitCode::SUCCESS)
    }

    fn change(&self, connection: &mut Connection, rig: Option<&FixedRig<MOST_LASERS>>) -> anyhow::Result<()> {
        let is_on = |switch| matches!(switch, Switch::On);
        let before = connection.client.settings()?;
        let settings = Settings {
            mode: self.mode.map_or(before.mode, Into::into),
            method: self.method.map_or(before.method, Into::into),
            spots: self.spots.map_or(before.spots, is_on),
            lasers: self.lasers.map_or(before.lasers, is_on),
            trigger_period_us: self.trigger_period_us.unwrap_or(before.trigger_period_us),
        };
        if settings != before {
            connection.client.set_settings(&settings)?;
        }
        // Last, because frames come with it: the lasers are on by then
        if let Some(rig) = rig {
            let bar = progress(0, "sending the calibration");
            let sent = connection.client.set_calibration(rig, |there, parts| {
                bar.set_length(parts as u64);
                bar.set_position(there as u64);
            });
            bar.finish_and_clear();
            sent?;
        }
        Ok(())
    }
}

fn read_back(connection: &mut Connection, rig: Option<&FixedRig<MOST_LASERS>>) -> anyhow::Result<Found> {
    let client = &mut connection.client;
    let settings = client.settings()?;
    let calibration = client.calibration()?;
    let [major, minor, patch] = client.hello().program;
    Ok(Found {
        program: format!("{major}.{minor}.{patch}"),
        protocol: client.protocol(),
        most_lasers: client.hello().lasers,
        mode: mode_name(settings.mode),
        method: method_name(settings.method),
        lasers_on: settings.lasers,
        spots: settings.spots,
        trigger_hz: (settings.trigger_period_us != 0).then(|| 1e6 / f64::from(settings.trigger_period_us)),
        is_rig: rig.map(|rig| calibration.as_ref().map(RigWords::from) == Some(rig.into())),
        calibration: calibration.map(|calibration| FoundCalibration {
            crc: format!("{:08x}", calibration_crc(&RigWords::from(&calibration))),
            lasers: calibration.calibration.lasers.len(),
            image_sizes_px: calibration.detectors.each_ref().map(|detector| [detector.width, detector.height]),
            range_mm: calibration.calibration.settings.range.map(I18F14::to_num),
        }),
    })
}

impl Found {
    fn print(&self, place: &str) -> anyhow::Result<()> {
        let Self { program, protocol, most_lasers, mode, method, .. } = self;
        let on = |on| if on { "on" } else { "off" };
        print(format_args!("{place}: version {program}, protocol {protocol}, up to {}", lasers(*most_lasers)))?;
        let trigger = self.trigger_hz.map_or("cameras run on their own".to_owned(), |hz| format!("trigger {hz:.3} Hz"));
        let [lasers_on, spots] = [on(self.lasers_on), on(self.spots)];
        print(format_args!("settings: {mode}, {method}, lasers {lasers_on}, spots {spots}, {trigger}"))?;
        let Some(FoundCalibration { crc, lasers: number, image_sizes_px: [a, b], range_mm: [near, far] }) =
            &self.calibration
        else {
            return print("no calibration: it measures nothing");
        };
        print(format_args!(
            "calibration {crc}: {}, cameras {} x {} and {} x {} px, range {near:.0} to {far:.0} mm",
            lasers(*number as u16),
            a[0],
            a[1],
            b[0],
            b[1]
        ))?;
        match self.is_rig {
            Some(true) => print("it is that of the rig file, value by value"),
            _ => Ok(()),
        }
    }
}

fn lasers(number: u16) -> String {
    count(number.into(), "laser")
}
