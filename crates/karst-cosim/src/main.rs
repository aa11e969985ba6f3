#![doc = include_str!("../README.md")]

mod math;
mod points;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use math::Block;

#[derive(Parser)]
#[command(about, version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Write operands and results of a math block for its VHDL bench, one pair a line, in hexadecimal.
    Vectors {
        /// The block.
        block: Block,
        /// How many pairs besides the edge operands.
        #[arg(long, default_value_t = 1000)]
        count: u64,
        /// The file to write.
        file: PathBuf,
    },
    /// Feed operands to a simulated math block and compare every result with the crate's.
    Math {
        /// The block.
        block: Block,
        /// How many operands besides the edge operands.
        #[arg(long, default_value_t = 200_000)]
        count: u64,
        /// The simulation.
        executable: PathBuf,
    },
    /// Write commands and points of the reconstructor for its VHDL bench, one a line, in hexadecimal.
    PointVectors {
        /// How many lasers.
        #[arg(long, default_value_t = 1000)]
        count: u64,
        /// The file of commands to write.
        commands: PathBuf,
        /// The file of points to write.
        points: PathBuf,
    },
    /// Feed random spots to a simulated reconstructor and compare every point with the crate's.
    Points {
        /// How many lasers, each with up to four spots per camera.
        #[arg(long, default_value_t = 50_000)]
        count: u64,
        /// The simulation.
        executable: PathBuf,
    },
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Vectors { block, count, file } => math::write_vectors(block, count, &file),
        Command::Math { block, count, executable } => math::compare(block, count, &executable)
            .map(|count| println!("{}: {count} operands, every bit equal", block.name())),
        Command::PointVectors { count, commands, points } => points::write_vectors(count, &commands, &points),
        Command::Points { count, executable } => points::compare(count, &executable).map(|seen| println!("{seen}")),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
