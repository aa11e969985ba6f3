//! `cargo xtask firmware`: the RISC-V images, and what they compute and cost in QEMU.

mod figures;
mod image;
mod setup;
mod sim;
mod stack;

use std::path::PathBuf;

use anyhow::{Context, bail};

use crate::{root, touch};

const HELP: &str = "usage: cargo xtask firmware COMMAND

  setup    install the tools: Debian packages
  build    build the images for riscv32imac-unknown-none-elf
  sim      run the self-test in QEMU and compare its results with the PC's, bit for bit
  figures  measure instructions and sizes, and write them to firmware/figures.toml
  test     sim, and compare the figures with the committed ones";

/// Carries out `cargo xtask firmware ARGUMENTS`.
pub fn command(arguments: &[String]) -> anyhow::Result<()> {
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["setup"] => setup::install(),
        ["build"] => sensor().map(drop),
        ["sim"] => sim::run_all(&image::build()?),
        ["figures"] => figures::write(&image::build()?),
        ["test"] => test(),
        _ => bail!("unknown firmware command\n\n{HELP}"),
    }
}

/// The part of the whole test run that is about the firmware. Without the tools it is skipped, except in continuous
/// integration (`CI` set), where that is an error.
pub fn test() -> anyhow::Result<()> {
    if let Err(missing) = setup::check() {
        if std::env::var_os("CI").is_some() {
            return Err(missing);
        }
        eprintln!("SKIPPED: everything about the firmware. {missing:#}");
        return Ok(());
    }
    let images = image::build()?;
    sim::run_all(&images)?;
    figures::check(&images)
}

/// Builds the sensor's image; gives where it is.
pub fn sensor() -> anyhow::Result<PathBuf> {
    setup::check()?;
    let image = image::build()?.get("sensor");
    touch(&image)?;
    Ok(image)
}

/// Folder of the firmware.
fn firmware() -> PathBuf {
    root().join("firmware")
}

/// The folder for what is made here, there after the call.
fn work_folder() -> anyhow::Result<PathBuf> {
    let folder = root().join("target/firmware");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    Ok(folder)
}
