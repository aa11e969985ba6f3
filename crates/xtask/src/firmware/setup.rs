//! The tools.

use std::path::Path;
use std::process::Command;

use anyhow::ensure;

use crate::run;

/// Files that have to be there, and the Debian packages that hold them. The compiler is Debian's, with the source of
/// `core`: it builds for RISC-V without anything to download, and is the same on every machine.
const TOOLS: [(&str, &str); 5] = [
    (RUSTC, "rustc-web"),
    (CARGO, "cargo-web"),
    ("/usr/lib/rustlib/src/rust/library/core", "rust-web-src"),
    (LINKER, "lld-22"),
    (QEMU, "qemu-system-misc"),
];

pub const RUSTC: &str = "/usr/bin/rustc";
pub const CARGO: &str = "/usr/bin/cargo";
pub const LINKER: &str = "/usr/bin/ld.lld-22";
pub const QEMU: &str = "/usr/bin/qemu-system-riscv32";

fn missing() -> Vec<&'static str> {
    TOOLS.iter().filter(|(file, _)| !Path::new(file).exists()).map(|(_, package)| *package).collect()
}

/// Says which tools are missing.
pub fn check() -> anyhow::Result<()> {
    let missing = missing();
    ensure!(missing.is_empty(), "Missing: {}. `cargo xtask firmware setup` installs them.", missing.join(", "));
    Ok(())
}

/// Installs what is missing.
pub fn install() -> anyhow::Result<()> {
    let packages = missing();
    if !packages.is_empty() {
        ensure!(
            Path::new("/usr/bin/apt-get").exists(),
            "this is no Debian system: the firmware's tools are the Debian packages {}",
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
