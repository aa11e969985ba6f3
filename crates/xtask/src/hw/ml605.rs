//! Netlists for the ML605 (XC6VLX240T), placed and routed by ISE only: that is not run here.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};

use super::convert::Library;
use super::synth::for_virtex6;
use super::wrap::{ports, wrapper};
use super::{hw_ip, work_folder};
use crate::run;

/// The block that goes onto the board.
pub const TOP: &str = "karst_top";

/// What goes with the netlists as it is.
const FILES: [&str; 3] = ["ml605.ucf", "build.sh", "README.md"];

/// Writes two netlists of a block, with what ISE needs besides, into a folder of `target/hw`:
///
/// * `BLOCK.edf`: the block without pads, for somebody's own design;
/// * `ml605.edf`: the block in a wrapper of few pins, to learn its clock rate.
pub fn write(block: &str, folder: &str) -> anyhow::Result<()> {
    let folder = work_folder()?.join(folder);
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let library = Library::new(work_folder()?.join("library-ml605"), &[])?;
    library.convert(block, &[], &folder.join("block.v"))?;
    let verilog = std::fs::read_to_string(folder.join("block.v")).context("the conversion has gone")?;
    std::fs::write(folder.join("wrapper.v"), wrapper(&verilog, block)?).context("cannot write the wrapper")?;
    let sources = hw_ip().join("boards/ml605");
    for file in FILES.iter().chain(&["ml605.v"]) {
        std::fs::copy(sources.join(file), folder.join(file)).with_context(|| format!("cannot copy {file}"))?;
    }

    let alone = format!("{block}.edf");
    synthesise(&folder, "block.v", block, &format!("-noiopad -noclkbuf -edif {alone}"))?;
    synthesise(&folder, "block.v wrapper.v ml605.v", "ml605", "-edif ml605.edf")?;
    let names: Vec<String> = ports(&verilog, block)?.into_iter().map(|port| port.name).collect();
    check(&folder.join(alone), &names)?;
    check(&folder.join("ml605.edf"), &["SYSCLK_P", "SYSCLK_N", "CPU_RESET", "GPIO_LED_0"])?;
    println!("{}: netlists of {block}. ISE places and routes them: not run here", folder.display());
    Ok(())
}

/// Block by block: ISE optimises across blocks, and yosys takes long for the whole as one.
fn synthesise(folder: &Path, sources: &str, top: &str, options: &str) -> anyhow::Result<()> {
    let mut yosys = Command::new("yosys");
    let script = for_virtex6(sources, top, &format!("-ise {options}"));
    yosys.args(["-q", "-p", &script]).current_dir(folder);
    run(yosys)
}

/// A netlist has to have these ports.
fn check<S: AsRef<str>>(netlist: &Path, ports: &[S]) -> anyhow::Result<()> {
    let text = std::fs::read_to_string(netlist).with_context(|| format!("no netlist {}", netlist.display()))?;
    for port in ports {
        let port = port.as_ref();
        let is_there =
            [format!("(port {port} "), format!("(port (array {port} "), format!("(port (array (rename {port} ")]
                .iter()
                .any(|beginning| text.contains(beginning));
        ensure!(is_there, "{} has no port {port}", netlist.display());
    }
    Ok(())
}
