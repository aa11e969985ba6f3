//! The `karst` command: flooded caves and pipes in 3-D, from two omnidirectional pictures with laser spots.

// println! and eprintln! panic when nobody reads any more (`karst ... | head`): `print` and `complain` do not.
#![warn(clippy::print_stdout, clippy::print_stderr)]

mod commands;

use std::panic::resume_unwind;
use std::process::ExitCode;
use std::thread;

use anyhow::Context;
use clap::Parser;
use commands::{Command, complain, message};

/// Flooded caves and pipes in 3-D, from two omnidirectional pictures with laser spots.
#[derive(Debug, Parser)]
#[command(
    version,
    after_help = "Examples:
  karst demo                                              a rendered frame to a report, no input needed
  karst render --out survey --frames 20 --to 0,0,2000     a survey along a gallery
  karst reconstruct --rig survey/rig.toml survey/camera1 survey/camera2 --out result
  karst monitor --simulated                               a live sensor without hardware
  karst eval                                              the accuracy table
  karst budget                                            clocks and milliseconds of a frame in the sensor

Exit status: 0 done, 1 failed or a budget missed, 2 wrong usage, 3 some frames of a sequence failed."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// Calibrations for 720 lasers are large values, and Windows gives its main thread one megabyte.
const STACK_BYTES: usize = 16 << 20;

fn main() -> ExitCode {
    let command = Cli::parse().command;
    let worker = thread::Builder::new().stack_size(STACK_BYTES).spawn(|| command.run());
    let done = match worker.context("cannot start a thread") {
        Ok(worker) => worker.join().unwrap_or_else(|panic| resume_unwind(panic)),
        Err(error) => Err(error),
    };
    match done {
        Ok(code) => code,
        Err(error) => {
            complain(format_args!("error: {}", message(&error)));
            ExitCode::FAILURE
        }
    }
}
