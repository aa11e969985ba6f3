//! `cargo xtask hw`: everything about the gateware of `hw-ip`.

mod convert;
mod formal;
mod regs;
mod setup;
mod sim;

use std::path::PathBuf;

use anyhow::{Context, bail};

use crate::root;

const HELP: &str = "usage: cargo xtask hw COMMAND

  setup         install the tools: Debian packages, and Python packages into target/hw/python
  regs          generate everything that follows from the register description
  sim [--full]  simulate every block against the crates; a sample of the operands without --full
  formal        prove the stream properties, and let mutants fail";

/// Carries out `cargo xtask hw ARGUMENTS`.
pub fn command(arguments: &[String]) -> anyhow::Result<()> {
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["setup"] => setup::install(),
        ["regs"] => regs::write(),
        ["sim"] => sim::run_all(false),
        ["sim", "--full"] => sim::run_all(true),
        ["formal"] => formal::run_all(),
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
