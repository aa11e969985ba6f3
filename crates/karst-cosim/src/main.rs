//! `karst-cosim`: a command per comparison.

mod detector;
mod math;
mod points;
mod registers;
mod top;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::ensure;
use clap::{Parser, Subcommand};

use detector::Latency;
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
        /// Its generic G_BITS_PER_STAGE.
        #[arg(long, default_value_t = 3)]
        bits_per_stage: u32,
        /// The simulation.
        executable: PathBuf,
    },
    /// Feed frames to simulated detectors and compare every record with the crate's.
    Detector {
        /// How many random small frames.
        #[arg(long, default_value_t = 60)]
        random: u64,
        /// How many rendered frames.
        #[arg(long, default_value_t = 2)]
        rendered: usize,
        /// The simulation with 4 pixels per clock, 1024 lasers and 2048 x 2048 pixels.
        #[arg(long)]
        large: Option<PathBuf>,
        /// The simulations with 1, 2, 4 and 8 pixels per clock, in this order.
        #[arg(required = true)]
        executables: Vec<PathBuf>,
    },
    /// Run the whole simulated IP next to its software model, compare every register, and measure.
    Top {
        /// How many random small frames.
        #[arg(long, default_value_t = 30)]
        random: u64,
        /// How many rendered pairs of frames.
        #[arg(long, default_value_t = 1)]
        rendered: usize,
        /// Print what was measured as JSON.
        #[arg(long)]
        json: bool,
        /// The simulation for 720 lasers with 1 pixel per clock.
        #[arg(long)]
        large: Option<PathBuf>,
        /// The simulations for 12 lasers with 1 and, if wanted, with 8 pixels per clock, in this order.
        #[arg(required = true)]
        executables: Vec<PathBuf>,
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
        /// Accesses alone, no events and results.
        #[arg(long)]
        accesses: bool,
        /// The file to write.
        file: PathBuf,
    },
}

fn compare_detectors(
    random: u64,
    rendered: usize,
    large: Option<&Path>,
    executables: &[PathBuf],
) -> anyhow::Result<()> {
    const EQUAL: &str = "every bit equal, every clock as the cycle model says";
    if let Some(large) = large {
        let frames = detector::compare_large(large, random / 2)?;
        println!("{frames} random frames of up to 720 lasers and 2048 px, {EQUAL}");
        let Latency { last_mask, last_spot, frame } = detector::compare_720_lasers(large)?;
        println!(
            "720 spots: after the last pixel, {last_mask} clocks to the last laser's slots, {last_spot} to the last spot, \
             {frame} to the frame's record"
        );
    }
    let frames = detector::compare_random(executables, random)?;
    println!("{frames} random frames, {EQUAL}");
    let latencies = detector::compare_rendered(executables, rendered)?;
    println!("{rendered} rendered frames, {EQUAL}");
    for (i, latency) in latencies.iter().enumerate() {
        println!(
            "{} px/clk: after the last pixel, {} clocks to the last laser's slots, {} to the last spot, {} to the frame's \
             record",
            1 << i,
            latency.last_mask,
            latency.last_spot,
            latency.frame
        );
    }
    Ok(())
}

fn compare_points(count: u64, bits_per_stage: u32, executable: &Path) -> anyhow::Result<()> {
    println!("{}", points::compare(count, bits_per_stage, executable)?);
    for clocks in points::measure(bits_per_stage, executable)? {
        let points::FrameClocks { name, after_start } = clocks;
        println!("{name}: {after_start} clocks from the start to the last point");
    }
    Ok(())
}

/// Limits of what is measured, in clocks.
const POINTS_OF_12: u64 = 150;
const POINTS_OF_720: u64 = 8000;
const PIXELS: u64 = 1024 * 768;
const OVERHEAD: u64 = 582;

fn compare_top(
    random: u64,
    rendered: usize,
    json: bool,
    large: Option<&Path>,
    executables: &[PathBuf],
) -> anyhow::Result<()> {
    let executables: Vec<_> = [1, 8].into_iter().zip(executables.iter().map(PathBuf::as_path)).collect();
    if random > 0 {
        let frames = top::compare_random(&executables, random)?;
        println!("{frames} random frames, every register as in the model");
        let frames = top::compare_random_clocks(&executables, random)?;
        println!("{frames} random frames, every clock as the cycle model says");
    }
    let mut measured = Vec::new();
    if rendered > 0 {
        let clocks = top::compare_rendered(&executables, rendered)?[0];
        ensure!(
            clocks.points_after_last_pixel <= POINTS_OF_12,
            "{} clocks to 12 points",
            clocks.points_after_last_pixel
        );
        ensure!(clocks.frame <= PIXELS + OVERHEAD, "{} clocks for a frame", clocks.frame);
        measured.extend([
            ("points_after_last_pixel_12", clocks.points_after_last_pixel),
            ("results_after_last_pixel_12", clocks.results_after_last_pixel),
            ("frame_clocks", clocks.frame),
            ("overhead_clocks", clocks.frame.saturating_sub(PIXELS)),
        ]);
    }
    if let Some(large) = large {
        let points = top::compare_720_lasers(large)?.points_after_last_pixel;
        ensure!(points <= POINTS_OF_720, "{points} clocks to 720 points");
        measured.push(("points_after_last_pixel_720", points));
    }
    if json {
        let fields: Vec<String> = measured.iter().map(|(name, clocks)| format!("  \"{name}\": {clocks}")).collect();
        println!("{{\n{}\n}}", fields.join(",\n"));
    } else {
        for (name, clocks) in measured {
            println!("{name}: {clocks}");
        }
    }
    Ok(())
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Vectors { block, count, file } => math::write_vectors(block, count, &file),
        Command::Math { block, count, executable } => math::compare(block, count, &executable)
            .map(|count| println!("{}: {count} operands, every bit equal", block.name())),
        Command::PointVectors { count, commands, points } => points::write_vectors(count, &commands, &points),
        Command::Points { count, bits_per_stage, executable } => compare_points(count, bits_per_stage, &executable),
        Command::Detector { random, rendered, large, executables } => {
            compare_detectors(random, rendered, large.as_deref(), &executables)
        }
        Command::Top { random, rendered, json, large, executables } => {
            compare_top(random, rendered, json, large.as_deref(), &executables)
        }
        Command::Registers { count, lasers, accesses, file } => {
            registers::write_vectors(count, lasers, !accesses, &file)
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
