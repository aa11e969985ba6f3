//! `cargo xtask hw`: everything about the gateware of `hw-ip`.

mod convert;
mod docs;
mod ecp5;
mod enables;
mod faults;
mod formal;
mod ml605;
mod parts;
mod regs;
mod setup;
mod sim;
mod slices;
mod synth;
mod waves;
mod wrap;

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, bail};

use crate::root;

const HELP: &str = "usage: cargo xtask hw COMMAND

  setup         install the tools: Debian packages, and Python packages into target/hw/python
  regs          generate everything that follows from the register description
  docs          write the datasheet pages of hw-ip/doc/blocks
  sim [--full] [PART...]
                simulate every block against the crates, or those of registers, soc, math, reconstructor, detector, top;
                a sample of the operands without --full
  latency [--json]
                clocks from the last pixel to points and results, and of whole frames, as simulated
  soc [--waves] build the simulation of the whole SoC, for karst sim; prints where it is
  formal [BLOCK...]
                prove the stream properties, and let mutants fail
  synth [--json | --update] [ROW...]
                sizes on a Virtex-6 and clock rates on an ECP5 against hw-ip/synth/resources.txt
  fmax BLOCK [GENERIC=VALUE...]
                clock rate of one block on an ECP5, and its slowest path
  ml605         netlists for ISE, its constraints and its commands, into target/hw/ml605";

/// Carries out `cargo xtask hw ARGUMENTS`.
pub fn command(arguments: &[String]) -> anyhow::Result<()> {
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["setup"] => setup::install(),
        ["docs"] => docs::write(),
        ["regs"] => regs::write(),
        ["sim", "--full", parts @ ..] => sim::run_parts(true, parts),
        ["sim", parts @ ..] => sim::run_parts(false, parts),
        ["latency"] => sim::measure(false),
        ["latency", "--json"] => sim::measure(true),
        ["soc"] => sim::build_soc(sim::SocBuild::Plain).map(|program| println!("{}", program.display())),
        ["soc", "--waves"] => sim::build_soc(sim::SocBuild::Waves).map(|program| println!("{}", program.display())),
        ["formal", blocks @ ..] => formal::run_all(blocks),
        ["synth", "--json", rows @ ..] => synth::run_all(synth::Mode::Json, rows),
        ["synth", "--update", rows @ ..] => synth::run_all(synth::Mode::Update, rows),
        ["synth", rows @ ..] => synth::run_all(synth::Mode::Check, rows),
        ["fmax", block, generics @ ..] => synth::print_clock_rate(block, generics),
        ["ml605"] => ml605::write(ml605::TOP, "ml605"),
        _ => bail!("unknown hw command\n\n{HELP}"),
    }
}

/// The part of the whole test run that is about the gateware. Without the tools it is skipped, except in continuous
/// integration (`CI` set), where that is an error.
pub fn test() -> anyhow::Result<()> {
    regs::check()?;
    docs::check()?;
    if let Err(missing) = setup::check() {
        if std::env::var_os("CI").is_some() {
            return Err(missing);
        }
        eprintln!("SKIPPED: everything about the gateware. {missing:#}");
        return Ok(());
    }
    formal::run_all(&[])?;
    synth::run_all(synth::Mode::Sample, &[])?;
    ml605::write("serialize", "ml605-test")?;
    sim::run_parts(false, &[])
}

/// Folder of the gateware.
fn hw_ip() -> PathBuf {
    root().join("hw-ip")
}

/// The folder for what is made here, there after the call.
fn work_folder() -> anyhow::Result<PathBuf> {
    let folder = root().join("target/hw");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    Ok(folder)
}

/// Does a job for every item, as many at a time as there are processors. The results come in the order of the items.
fn in_parallel<T: Sync, R: Send>(items: &[T], job: impl Fn(&T) -> anyhow::Result<R> + Sync) -> anyhow::Result<Vec<R>> {
    let next = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<anyhow::Result<R>>>> = items.iter().map(|_| Mutex::new(None)).collect();
    let work = || {
        while let Some((item, result)) = {
            let number = next.fetch_add(1, Ordering::Relaxed);
            items.get(number).zip(results.get(number))
        } {
            if let Ok(mut result) = result.lock() {
                *result = Some(job(item));
            }
        }
    };
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(work);
        }
    });
    results
        .into_iter()
        .map(|result| result.into_inner().ok().flatten().context("a job has ended without a result")?)
        .collect()
}
