//! The images in QEMU.

use std::path::Path;
use std::process::Command;

use anyhow::Context;

use super::image::Images;
use super::setup::QEMU;
use super::work_folder;
use crate::{cargo, path, run};

/// Seconds after which an image counts as hung. They take a few.
const TIMEOUT_S: &str = "300";

/// Runs the self-test and compares what it sends.
pub fn run_all(images: &Images) -> anyhow::Result<()> {
    let results = work_folder()?.join("results.bin");
    std::fs::write(&results, simulate(&images.get("selftest"))?)
        .with_context(|| format!("cannot write {}", results.display()))?;
    let check = ["run", "--quiet", "--release", "-p", "karst-fwcheck", "--", "compare"];
    let mut compare = cargo(&check);
    compare.args([path(&images.recording)?, path(&results)?]);
    run(compare)
}

/// Runs an image to its end and gives its standard output. One instruction takes one tick of the counters.
pub fn simulate(image: &Path) -> anyhow::Result<Vec<u8>> {
    let mut qemu = Command::new("timeout");
    qemu.args([TIMEOUT_S, QEMU, "-machine", "virt", "-bios", "none", "-display", "none", "-icount", "shift=0"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(image);
    crate::output_bytes(qemu)
}
