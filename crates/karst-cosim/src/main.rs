#![doc = include_str!("../README.md")]

mod math;
mod registers;

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
    /// Write random accesses and events, and what the software model of the register block makes of them, for its VHDL
    /// bench.
    Registers {
        /// How many.
        #[arg(long, default_value_t = 3000)]
        count: u64,
        /// Lasers that the register block is built for.
        #[arg(long, default_value_t = 4)]
        lasers: usize,
        /// The file to write.
        file: PathBuf,
    },
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Vectors { block, count, file } => math::write_vectors(block, count, &file),
        Command::Math { block, count, executable } => math::compare(block, count, &executable)
            .map(|count| println!("{}: {count} operands, every bit equal", block.name())),
        Command::Registers { count, lasers, file } => registers::write_vectors(count, lasers, &file),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
