//! `cargo xtask`: the whole test run, the figures of the documentation, and the tools of firmware and gateware.

mod firmware;
mod hw;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::SystemTime;

use anyhow::{Context, bail, ensure};

const HELP: &str = "usage: cargo xtask COMMAND

  test      everything that has to hold: format, lints, documentation, all tests
  figures   render the pictures of docs/figures and refresh the measured tables of the README
  firmware  the RISC-V images: `cargo xtask firmware` lists the commands
  hw        the gateware of hw-ip: `cargo xtask hw` lists the commands
";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let result = match arguments.first().map(String::as_str) {
        Some("test") => test(),
        Some("figures") => figures(),
        Some("firmware") => firmware::command(&arguments[1..]),
        Some("hw") => hw::command(&arguments[1..]),
        _ => {
            eprint!("{HELP}");
            return ExitCode::from(2);
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Root of the workspace.
fn root() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.ancestors().nth(2).unwrap_or(manifest).to_owned()
}

fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).current_dir(root());
    command
}

fn run(mut command: Command) -> anyhow::Result<()> {
    let shown = format!("{command:?}");
    eprintln!("\n$ {shown}");
    let status = command.status().with_context(|| format!("cannot start {shown}"))?;
    ensure!(status.success(), "{shown} failed: {status}");
    Ok(())
}

fn output(command: Command) -> anyhow::Result<String> {
    let shown = format!("{command:?}");
    String::from_utf8(output_bytes(command)?).with_context(|| format!("{shown} printed something that is not text"))
}

fn output_bytes(mut command: Command) -> anyhow::Result<Vec<u8>> {
    let shown = format!("{command:?}");
    eprintln!("\n$ {shown}");
    let output = command.output().with_context(|| format!("cannot start {shown}"))?;
    ensure!(output.status.success(), "{shown} failed: {}\n{}", output.status, String::from_utf8_lossy(&output.stderr));
    Ok(output.stdout)
}

fn path(path: &Path) -> anyhow::Result<&str> {
    path.to_str().with_context(|| format!("{} is not valid UTF-8", path.display()))
}

/// Tells `karst sim`, which compares times, that a product is as new as its sources, also if nothing had to be made anew.
fn touch(product: &Path) -> anyhow::Result<()> {
    let touched = std::fs::File::options().append(true).open(product);
    touched.and_then(|file| file.set_modified(SystemTime::now())).with_context(|| product.display().to_string())
}

fn test() -> anyhow::Result<()> {
    if std::env::var_os("KARST_DATA").is_none() {
        eprintln!("SKIPPED: tests on real data. Set KARST_DATA to the folder that holds them.");
    }
    run(cargo(&["fmt", "--all", "--check"]))?;
    run(cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]))?;
    // With the loggers of firmware: the sensor's feature is that of all crates below it
    let mut with_defmt = cargo(&["clippy", "--features", "karst-sensor/defmt"]);
    with_defmt.args(["karst-core", "karst-link", "karst-regs", "karst-sensor"].map(|name| format!("-p{name}")));
    with_defmt.args(["--", "-D", "warnings"]);
    run(with_defmt)?;
    // Without the model: what firmware uses
    run(cargo(&["clippy", "-p", "karst-regs", "--", "-D", "warnings"]))?;
    let mut documentation = cargo(&["doc", "--workspace", "--no-deps", "--document-private-items"]);
    documentation.env("RUSTDOCFLAGS", "-D warnings");
    run(documentation)?;
    run(cargo(&["test", "--workspace"]))?;
    firmware::test()?;
    hw::test()?;
    // The first command of the README, as it stands there
    run(cargo(&["run", "--release", "--", "demo", "--out", "target/demo"]))
}

fn figures() -> anyhow::Result<()> {
    let demo = root().join("target/figures");
    let mut command = cargo(&["run", "--release", "-p", "karst", "--", "demo", "--out"]);
    command.arg(&demo);
    run(command)?;
    let figures = root().join("docs/figures");
    std::fs::create_dir_all(&figures).with_context(|| format!("cannot create {}", figures.display()))?;
    for camera in ["camera1", "camera2"] {
        let picture = demo.join(format!("demo_{camera}_spots.png"));
        image::open(&picture)
            .with_context(|| format!("cannot read {}", picture.display()))?
            .save(figures.join(format!("{camera}.jpg")))
            .with_context(|| format!("cannot write {camera}.jpg"))?;
    }
    let plot = demo.join("section.svg");
    std::fs::copy(&plot, figures.join("section.svg")).with_context(|| format!("cannot copy {}", plot.display()))?;
    refresh("accuracy", &output(cargo(&["run", "--release", "-p", "karst", "--", "eval"]))?)?;
    let speed = output(cargo(&["bench", "-p", "karst", "--bench", "chain"]))?;
    refresh("speed", &format!("```text\n{speed}```\n"))
}

/// Replaces what is between `<!-- name -->` and `<!-- /name -->` in the README.
fn refresh(name: &str, text: &str) -> anyhow::Result<()> {
    let path = root().join("README.md");
    let readme = std::fs::read_to_string(&path).context("cannot read README.md")?;
    let (begin, end) = (format!("<!-- {name} -->\n"), format!("<!-- /{name} -->"));
    let (Some(from), Some(to)) = (readme.find(&begin), readme.find(&end)) else {
        bail!("README.md has no place marked {begin}");
    };
    let refreshed = format!("{}{text}{}", &readme[..from + begin.len()], &readme[to..]);
    std::fs::write(&path, refreshed).context("cannot write README.md")
}
