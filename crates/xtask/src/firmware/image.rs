//! The images.

use std::path::PathBuf;
use std::process::Command;

use super::setup::{CARGO, LINKER, RUSTC};
use super::{firmware, work_folder};
use crate::{cargo, path, run};

const TARGET: &str = "riscv32imac-unknown-none-elf";

/// Calls of four bytes where eight are not needed, and the size of every function's stack frame for `stack.rs`.
const FLAGS: [&str; 2] = ["-Ctarget-feature=+relax", "-Zemit-stack-sizes"];

const IMAGES: [&str; 4] = ["algorithm", "costs", "selftest", "sensor"];

/// The images and what went into them.
pub struct Images {
    folder: PathBuf,
    /// The recording that the self-test runs on.
    pub recording: PathBuf,
}

impl Images {
    /// The image of a name.
    pub fn get(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}

/// Builds all images.
pub fn build() -> anyhow::Result<Images> {
    let recording = record()?;
    let mut command = debian_cargo(&recording)?;
    command.args(["build", "--release", "--locked", "--features", "images"]);
    for image in IMAGES {
        command.args(["--bin", image]);
    }
    run(command)?;
    Ok(Images { folder: work_folder()?.join(TARGET).join("release"), recording })
}

/// Writes the recording. It is the same every time, and the images depend on it.
fn record() -> anyhow::Result<PathBuf> {
    let recording = work_folder()?.join("recording.bin");
    run(cargo(&["run", "--quiet", "--release", "-p", "karst-fwcheck", "--", "record", path(&recording)?]))?;
    Ok(recording)
}

/// Debian's cargo and compiler for the target, with `core` from source: that is an unstable feature of cargo, which
/// RUSTC_BOOTSTRAP lets a stable one have.
fn debian_cargo(recording: &std::path::Path) -> anyhow::Result<Command> {
    let mut command = Command::new(CARGO);
    command
        .current_dir(firmware())
        .args(["-Zbuild-std=core", "--config", &format!("target.{TARGET}.linker = '{LINKER}'")])
        .args(["--config", &format!("target.{TARGET}.rustflags = {FLAGS:?}")])
        .env("CARGO_BUILD_TARGET", TARGET)
        .env("CARGO_TARGET_DIR", work_folder()?)
        .env("KARST_RECORDING", recording)
        .env("RUSTC", RUSTC)
        .env("RUSTC_BOOTSTRAP", "1");
    // Those of the cargo that runs this program are meant for another compiler
    for variable in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "RUSTUP_TOOLCHAIN", "RUSTDOC", "RUSTC_WRAPPER", "CARGO"] {
        command.env_remove(variable);
    }
    Ok(command)
}
