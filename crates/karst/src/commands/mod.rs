//! The commands, one per file.

mod budget;
mod calibrate;
mod calibrate_belt;
mod calibrate_refraction;
mod calibrate_rig;
mod calibrate_stereo;
mod checkout;
mod configure;
mod demo;
mod detect;
mod eval;
mod files;
mod line;
mod monitor;
mod reconstruct;
mod render;
mod rig;
mod session;
mod sim;

use std::fmt::Display;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use clap::{Args, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use karst::instrument::{Arithmetic, Instrument};
use karst_rig::{Board, Rig};
use serde::Serialize;

/// Exit status when some frames of a sequence failed and the rest went on.
const SOME_FRAMES_FAILED: u8 = 3;

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a stereo pair in a flooded gallery, measure it and write a report
    Demo(demo::Demo),
    /// Render stereo pairs with their truth
    Render(render::Render),
    /// Find the laser spots in one picture
    Detect(detect::Detect),
    /// Turn stereo pairs into points
    Reconstruct(reconstruct::Reconstruct),
    /// Show what a sensor measures, live
    Monitor(monitor::Monitor),
    /// Run the sensor's firmware and gateware in simulation
    Sim(sim::Sim),
    /// Send a sensor its calibration and settings
    Configure(configure::Configure),
    /// Measure the accuracy on the standard rendered scenes
    Eval(eval::Eval),
    /// Predict how long a frame takes in the sensor, and hold it against what it may take
    Budget(budget::Budget),
    /// Find the parameters of an instrument from its pictures
    #[command(subcommand)]
    Calibrate(calibrate::CalibrateCommand),
    /// Show, check or make a rig file
    #[command(subcommand)]
    Rig(rig::RigCommand),
}

impl Command {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Demo(command) => command.run(),
            Self::Render(command) => command.run(),
            Self::Detect(command) => command.run(),
            Self::Reconstruct(command) => command.run(),
            Self::Monitor(command) => command.run(),
            Self::Sim(command) => command.run(),
            Self::Configure(command) => command.run(),
            Self::Eval(command) => command.run(),
            Self::Budget(command) => command.run(),
            Self::Calibrate(command) => command.run(),
            Self::Rig(command) => command.run(),
        }
    }
}

/// How points are computed.
#[derive(Debug, Clone, Copy, Args)]
struct Chain {
    /// How the estimates become a point
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// Number format of the reconstruction
    #[arg(long, value_enum, default_value_t)]
    arithmetic: Arithmetic,
}

#[derive(Debug, Clone, Copy, Default, ValueEnum)]
enum Method {
    /// Weighted least squares with standard deviation and chi-squared gate
    #[default]
    Weighted,
    /// The paper's: box midpoint, farthest spot, plain average
    Paper,
}

impl From<Method> for karst_core::Method {
    fn from(method: Method) -> Self {
        match method {
            Method::Weighted => Self::Weighted,
            Method::Paper => Self::Paper,
        }
    }
}

/// The rig of a file, or the default rig.
fn load_rig(path: Option<&Path>) -> anyhow::Result<Rig> {
    Ok(path.map_or_else(|| Ok(Rig::default()), Rig::load)?)
}

/// The instrument of a rig. Fields that are right one by one can still make a rig that cannot measure.
fn set_up(rig: Rig, path: Option<&Path>) -> anyhow::Result<Instrument> {
    Instrument::new(rig).with_context(|| path.map_or("default rig".into(), |path| path.display().to_string()))
}

/// A line on standard output. A reader that has seen enough (`karst ... | head`) is no failure.
fn print(line: impl Display) -> anyhow::Result<()> {
    print_to_reader(line).map(drop)
}

/// The same, and whether somebody reads it.
fn print_to_reader(line: impl Display) -> anyhow::Result<bool> {
    let mut output = io::stdout().lock();
    match writeln!(output, "{line}").and_then(|()| output.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(false),
        result => result.map(|()| true).context("cannot write to standard output"),
    }
}

fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    print(serde_json::to_string_pretty(value)?)
}

/// A line on standard error; without a reader there is nobody to tell.
pub fn complain(line: impl Display) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// An error and its causes in one line. Many errors spell out their cause themselves: it is not said twice.
pub fn message(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |line, cause| match line.as_str() {
        "" => cause,
        said if said.contains(&cause) => line,
        _ => format!("{line}: {cause}"),
    })
}

/// `1 frame`, `2 frames`.
fn count(number: usize, noun: &str) -> String {
    format!("{number} {noun}{}", if number == 1 { "" } else { "s" })
}

/// A progress bar on standard error, hidden when that is no terminal.
fn progress(length: usize, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}");
    let bar = ProgressBar::new(length as u64).with_message(what);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Shows that something without steps goes on, on standard error.
fn spinner(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(what);
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

fn write_text(path: PathBuf, text: &str) -> anyhow::Result<()> {
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// Value of an option: a number that is not infinite (the parser of f64 takes `nan` and `inf`).
fn finite(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

/// Value of an option: a positive number.
fn positive(text: &str) -> Result<f64, &'static str> {
    finite(text).filter(|&number| number > 0.0).ok_or("expected a positive number")
}

/// Value of an option: zero or a positive number.
fn not_negative(text: &str) -> Result<f64, &'static str> {
    finite(text).filter(|&number| number >= 0.0).ok_or("expected zero or a positive number")
}

/// Value of an option: three numbers separated by commas.
fn triple(text: &str) -> Result<[f64; 3], &'static str> {
    let numbers: Option<Vec<f64>> = text.split(',').map(finite).collect();
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or("expected three numbers such as 0,0,1500")
}

/// Value of `--board`.
fn board(text: &str) -> Result<Board, &'static str> {
    let board = || {
        let [columns, rows, square] = text.split('x').collect::<Vec<_>>().try_into().ok()?;
        Some(Board {
            columns: columns.trim().parse().ok()?,
            rows: rows.trim().parse().ok()?,
            square_mm: positive(square).ok()?,
        })
    };
    board().ok_or("expected inner corners along both sides and the side of a square in mm, such as 9x6x60")
}
