//! The tools.

use std::process::{Command, Stdio};

use anyhow::ensure;

use crate::run;

/// Programs and the Debian packages that hold them.
const TOOLS: [(&str, &str); 6] =
    [("ghdl", "ghdl"), ("verilator", "verilator"), ("g++", "g++"), ("make", "make"), ("yosys", "yosys"), ("z3", "z3")];

/// Says which tools are missing.
pub fn check() -> anyhow::Result<()> {
    let missing: Vec<&str> =
        TOOLS.iter().filter(|(program, _)| !starts(program)).map(|(program, _)| *program).collect();
    ensure!(missing.is_empty(), "Missing: {}. `cargo xtask hw setup` installs them.", missing.join(", "));
    Ok(())
}

/// Installs what is missing.
pub fn install() -> anyhow::Result<()> {
    let packages: Vec<&str> =
        TOOLS.iter().filter(|(program, _)| !starts(program)).map(|(_, package)| *package).collect();
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
    check()
}

fn starts(program: &str) -> bool {
    Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}
