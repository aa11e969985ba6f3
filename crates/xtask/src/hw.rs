//! `cargo xtask hw`: everything about the gateware of `hw-ip`.

mod convert;
mod formal;
mod formal_axi;
mod regs;
mod setup;
mod sim;
mod synth;

use std::path::PathBuf;

use anyhow::{Context, bail};

use crate::root;

const HELP: &str = "usage: cargo xtask hw COMMAND

  setup         install the tools: Debian packages, and Python packages into target/hw/python
  regs          generate everything that follows from the register description
  sim [--full]  simulate every block against the crates; a sample of the operands without --full
  soc           build the simulation of the whole SoC, for karst-cosim; prints where it is
  formal        prove the stream properties, and let mutants fail
  synth [--json | --update]
                sizes on a Virtex-6 against hw-ip/synth/resources.txt";

/// Carries out `cargo xtask hw ARGUMENTS`.
pub fn command(arguments: &[String]) -> anyhow::Result<()> {
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["setup"] => setup::install(),
        ["regs"] => regs::write(),
        ["sim"] => sim::run_all(false),
        ["sim", "--full"] => sim::run_all(true),
        ["soc"] => sim::build_soc().map(|program| println!("{}", program.display())),
        ["formal"] => formal::run_all().and_then(|()| formal_axi::prove_all()),
        ["synth"] => synth::run_all(synth::Mode::Check),
        ["synth", "--json"] => synth::run_all(synth::Mode::Json),
        ["synth", "--update"] => synth::run_all(synth::Mode::Update),
        _ => bail!("unknown hw command\n\n{HELP}"),
    }
}

/// The part of the whole test run that is about the gateware. Without the tools it is skipped, except in continuous
/// integration (`CI` set), where that is an error.
pub fn test() -> anyhow::Result<()> {
    regs::check()?;
    if let Err(missing) = setup::check() {
        if std::env::var_os("CI").is_some() {
            return Err(missing);
        }
        eprintln!("SKIPPED: everything about the gateware. {missing:#}");
        return Ok(());
    }
    formal::run_all()?;
    formal_axi::prove_all()?;
    synth::run_all(synth::Mode::Sample)?;
    sim::run_all(false)
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
