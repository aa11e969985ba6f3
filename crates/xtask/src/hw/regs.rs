//! The register map and the processor's address space: everything that is generated from their one description each.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};

use super::{hw_ip, work_folder};
use crate::{root, run};

/// What is generated, and where it belongs.
const FILES: [(&str, &str); 10] = [
    ("karst_regs.vhd", "hw-ip/rtl/regs/generated/karst_regs.vhd"),
    ("karst_regs_pkg.vhd", "hw-ip/rtl/regs/generated/karst_regs_pkg.vhd"),
    ("karst_map_pkg.vhd", "hw-ip/rtl/regs/generated/karst_map_pkg.vhd"),
    ("karst.html", "hw-ip/rtl/regs/generated/karst.html"),
    ("register_map.md", "hw-ip/rtl/regs/generated/register_map.md"),
    ("karst.h", "hw-ip/rtl/regs/generated/karst.h"),
    ("map.rs", "crates/karst-regs/src/map.rs"),
    ("soc_map_pkg.vhd", "hw-ip/rtl/soc/generated/soc_map_pkg.vhd"),
    ("memory_map.md", "hw-ip/rtl/soc/generated/memory_map.md"),
    ("soc.rs", "crates/karst-regs/src/soc.rs"),
];

/// Generates the files anew.
pub fn write() -> anyhow::Result<()> {
    let folder = generate()?;
    for (name, destination) in FILES {
        let destination = root().join(destination);
        std::fs::copy(folder.join(name), &destination)
            .with_context(|| format!("cannot write {}", destination.display()))?;
    }
    Ok(())
}

/// Whether the generated files are the ones of the description. Without Python it is skipped, except in continuous
/// integration (`CI` set), where that is an error.
pub fn check() -> anyhow::Result<()> {
    if let Err(missing) = tools() {
        if std::env::var_os("CI").is_some() {
            return Err(missing);
        }
        eprintln!("SKIPPED: whether the generated register files are current. {missing:#}");
        return Ok(());
    }
    let folder = generate()?;
    for (name, committed) in FILES {
        let read =
            |path: PathBuf| std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()));
        let current = read(folder.join(name))? == read(root().join(committed))?;
        ensure!(current, "{committed} is not what the description gives: run `cargo xtask hw regs`");
    }
    Ok(())
}

fn generate() -> anyhow::Result<PathBuf> {
    let tools = tools()?;
    let folder = work_folder()?.join("regs");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let description = hw_ip().join("rtl/regs/karst.rdl");

    let mut vhdl = Command::new(tools.join("peakrdl"));
    vhdl.arg("regblock-vhdl").arg(&description).args(["-t", "karst_registers", "--cpuif", "passthrough"]);
    vhdl.args(["--module-name", "karst_regs", "--package-name", "karst_regs_pkg", "--type-style", "hier", "-o"]);
    run(with(vhdl, &folder))?;

    let mut header = Command::new(tools.join("peakrdl"));
    header.arg("c-header").arg(&description).args(["--type-style", "hier", "-o"]);
    run(with(header, &folder.join("karst.h")))?;

    for description in [description, hw_ip().join("rtl/soc/soc.rdl")] {
        let mut rest = Command::new(tools.join("python"));
        rest.arg(hw_ip().join("rtl/regs/export.py")).arg(&description);
        run(with(rest, &folder))?;
    }
    Ok(folder)
}

fn with(mut command: Command, last: &Path) -> Command {
    command.arg(last);
    command
}

/// The folder of the generators' programs: a Python environment with the versions of `requirements.txt`.
fn tools() -> anyhow::Result<PathBuf> {
    let environment = work_folder()?.join("python-registers");
    let requirements = hw_ip().join("rtl/regs/requirements.txt");
    let programs = environment.join("bin");
    // Written last: tells that the installation is complete, and of which versions
    let installed = environment.join("requirements.txt");
    let wanted = std::fs::read(&requirements).with_context(|| format!("cannot read {}", requirements.display()))?;
    if std::fs::read(&installed).is_ok_and(|found| found == wanted) {
        return Ok(programs);
    }
    let starts = Command::new("python3").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
    ensure!(starts, "Missing: python3.");
    let mut create = Command::new("python3");
    create.args(["-m", "venv", "--clear"]);
    run(with(create, &environment)).context("Python has no venv: install python3-venv")?;
    let mut install = Command::new(programs.join("python"));
    install.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "-r"]);
    run(with(install, &requirements)).context("pip could not install the generators")?;
    std::fs::copy(&requirements, &installed).with_context(|| format!("cannot write {}", installed.display()))?;
    Ok(programs)
}
