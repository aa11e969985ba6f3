//! What is built from a checkout of the project when it is needed first: the simulated SoC and its firmware.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime};

use anyhow::{Context, bail};
use indicatif::ProgressBar;

use super::complain;

/// A product, relative to the checkout as all paths here.
struct Product {
    what: &'static str,
    path: &'static str,
    /// Files and folders that it is made from.
    sources: &'static [&'static str],
    /// The arguments of `cargo xtask` that install the tools and make it.
    commands: [&'static [&'static str]; 2],
}

const SOC_SOURCES: &[&str] = &["hw-ip/rtl", "hw-ip/files.txt", "hw-ip/sim/soc_bench.sv", "hw-ip/sim/soc_harness.cpp"];

const SOC: Product = Product {
    what: "the simulated SoC",
    path: "target/hw/verilated-soc/soc",
    sources: SOC_SOURCES,
    commands: [&["hw", "setup"], &["hw", "soc"]],
};

/// The same, slower, and able to write waves.
const SOC_WAVES: Product = Product {
    what: "the simulated SoC with waves",
    path: "target/hw/verilated-soc-waves/soc-waves",
    sources: SOC_SOURCES,
    commands: [&["hw", "setup"], &["hw", "soc", "--waves"]],
};

const FIRMWARE: Product = Product {
    what: "the firmware",
    path: "target/firmware/riscv32imac-unknown-none-elf/release/sensor",
    sources: &[
        "firmware/src",
        "firmware/Cargo.toml",
        "Cargo.lock",
        "firmware/build.rs",
        "memory.x",
        "crates/karst-math/src",
        "crates/karst-core/src",
        "crates/karst-link/src",
        "crates/karst-regs/src",
        "crates/karst-sensor/src",
    ],
    commands: [&["firmware", "setup"], &["firmware", "build"]],
};

/// What a simulation of the sensor consists of.
pub struct Simulation {
    /// The program that simulates the SoC.
    pub soc: PathBuf,
    /// The sensor's program, an ELF file.
    pub firmware: PathBuf,
}

impl Simulation {
    /// Makes what is missing, or older than its sources. `waves`: the simulation can write waves.
    pub fn build(waves: bool) -> anyhow::Result<Self> {
        let root = checkout(Path::new(env!("CARGO_MANIFEST_DIR")))?;
        let soc = if waves { &SOC_WAVES } else { &SOC };
        Ok(Self { soc: build(root, soc)?, firmware: build(root, &FIRMWARE)? })
    }
}

/// The checkout that a folder is in.
fn checkout(folder: &Path) -> anyhow::Result<&Path> {
    let found = folder.ancestors().find(|folder| folder.join("hw-ip/files.txt").is_file());
    found.context(
        "the gateware and the firmware are not here: karst sim runs in a checkout of the project (git clone, then cargo run \
         --release -- sim)",
    )
}

fn build(root: &Path, product: &Product) -> anyhow::Result<PathBuf> {
    let path = root.join(product.path);
    let made = modified(&path);
    if made.is_none() || made < newest(root, product.sources)? {
        for arguments in product.commands {
            xtask(root, product.what, arguments)?;
        }
        if !path.is_file() {
            bail!("cargo xtask {} did not make {}", product.commands[1].join(" "), path.display());
        }
    }
    Ok(path)
}

fn modified(file: &Path) -> Option<SystemTime> {
    file.metadata().and_then(|data| data.modified()).ok()
}

/// When the last of these files was changed.
fn newest(root: &Path, sources: &[&str]) -> anyhow::Result<Option<SystemTime>> {
    let mut newest = None;
    let mut to_visit: Vec<PathBuf> = sources.iter().map(|source| root.join(source)).collect();
    while let Some(path) = to_visit.pop() {
        if path.is_dir() {
            for entry in path.read_dir().with_context(|| format!("cannot read {}", path.display()))? {
                to_visit.push(entry?.path());
            }
        } else {
            newest = newest.max(modified(&path));
        }
    }
    Ok(newest)
}

/// So many lines are told of what failed.
const TOLD: usize = 12;

/// Runs `cargo xtask`, and shows the last line of what it says.
fn xtask(root: &Path, what: &str, arguments: &[&str]) -> anyhow::Result<()> {
    let shown = format!("cargo xtask {}", arguments.join(" "));
    complain(format_args!("{what} first: {shown}"));
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(100));
    let mut child = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .arg("xtask")
        .args(arguments)
        .current_dir(root)
        .stdin(Stdio::null())
        // All that is to be told goes to standard error
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .context("cannot start cargo: the Rust tools are needed, https://rustup.rs has them")?;
    let mut last = VecDeque::new();
    for line in child.stderr.take().into_iter().flat_map(|stderr| BufReader::new(stderr).split(b'\n')) {
        let line = String::from_utf8_lossy(&line?).trim().to_owned();
        if !line.is_empty() {
            bar.set_message(line.clone());
            last.push_back(line);
        }
        if last.len() > TOLD {
            last.pop_front();
        }
    }
    let status = child.wait().with_context(|| shown.clone())?;
    bar.finish_and_clear();
    if !status.success() {
        let why = last.pop_back().unwrap_or_default();
        last.iter().for_each(complain);
        bail!("{shown}: {}", why.strip_prefix("error: ").unwrap_or(&why));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_checkout_it_is_told_where_to_run() {
        let elsewhere = tempfile::tempdir().unwrap();
        let error = checkout(elsewhere.path()).unwrap_err().to_string();
        assert!(error.contains("a checkout of the project"), "{error}");
        assert_eq!(
            checkout(Path::new(env!("CARGO_MANIFEST_DIR"))).unwrap().join("crates/karst"),
            Path::new(env!("CARGO_MANIFEST_DIR"))
        );
    }

    #[test]
    fn all_sources_are_there_and_the_newest_counts() {
        let root = checkout(Path::new(env!("CARGO_MANIFEST_DIR"))).unwrap();
        for product in [SOC, SOC_WAVES, FIRMWARE] {
            for source in product.sources {
                assert!(root.join(source).exists(), "{source}");
            }
        }
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("a")).unwrap();
        for (name, seconds) in [("a/old", 100), ("a/new", 200), ("b", 150)] {
            let file = std::fs::File::create(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)).unwrap();
        }
        let at = |seconds| Some(SystemTime::UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(newest(folder.path(), &["a", "b"]).unwrap(), at(200));
        assert_eq!(newest(folder.path(), &["b"]).unwrap(), at(150));
    }
}
