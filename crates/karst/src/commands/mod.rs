//! The commands, one per file.

mod calibrate;
mod demo;
mod detect;
mod eval;
mod files;
mod reconstruct;
mod render;
mod rig;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::{Args, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use karst::instrument::Arithmetic;
use karst_rig::Rig;
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
    /// Measure the accuracy on the standard rendered scenes
    Eval(eval::Eval),
    /// Find the parameters of an instrument from its pictures
    #[command(subcommand)]
    Calibrate(calibrate::CalibrateCommand),
    /// Show or check a rig file
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
            Self::Eval(command) => command.run(),
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

fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    println!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
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

fn write_text(path: PathBuf, text: &str) -> anyhow::Result<()> {
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// Three numbers separated by commas.
fn triple(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let expected = || format!("found '{text}', expected three numbers such as 0,0,1500");
    numbers.map_err(|_| expected())?.try_into().map_err(|_| expected())
}
