//! Size of the blocks on a Virtex-6 (`synth_xilinx -family xc6v` of yosys), against the committed table.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};

use super::convert::Library;
use super::{hw_ip, work_folder};
use crate::run;

/// Blocks with their default generics, as the table has them.
const BLOCKS: [&str; 17] = [
    "sqrt",
    "sqrt_sequential",
    "divide",
    "divide_sequential",
    "horner",
    "polar",
    "fifo",
    "frame_control",
    "classify",
    "segment",
    "serialize",
    "sector",
    "run",
    "cluster",
    "centroid",
    "detector",
    "registers",
];

/// Blocks that take minutes: not in a sample.
const LARGE_BLOCKS: [&str; 5] = ["divide", "horner", "sector", "centroid", "detector"];

/// What a block takes.
#[derive(Debug, Default, PartialEq, Eq)]
struct Resources {
    /// LUTs of any use: logic, inverters, shift registers, memory.
    lut: u32,
    ff: u32,
    carry4: u32,
    /// In halves of a 36-kbit memory.
    bram18: u32,
    dsp: u32,
    latches: u32,
}

/// What `run_all` does with the figures.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Compare the small blocks with the table.
    Sample,
    /// Compare with the table.
    Check,
    /// Compare, and print them as JSON.
    Json,
    /// Write the table.
    Update,
}

/// Synthesises every block.
pub fn run_all(mode: Mode) -> anyhow::Result<()> {
    let work = work_folder()?;
    let library = Library::new(work.join("library-synth"), &[])?;
    let mut table = String::from("block              lut    ff  carry4  bram18  dsp\n");
    let mut json = Vec::new();
    for block in BLOCKS.into_iter().filter(|block| mode != Mode::Sample || !LARGE_BLOCKS.contains(block)) {
        let folder = work.join(format!("synth-{block}"));
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        library.convert(block, &[], &folder.join("block.v"))?;
        let r = synthesise(&folder, block).with_context(|| format!("{block} is not synthesised"))?;
        ensure!(r.latches == 0, "{block} has {} latches", r.latches);
        writeln!(table, "{block:17} {:>4} {:>5} {:>7} {:>7} {:>4}", r.lut, r.ff, r.carry4, r.bram18, r.dsp)?;
        json.push(format!(
            "  \"{block}\": {{\"lut\": {}, \"ff\": {}, \"carry4\": {}, \"bram\": {}, \"dsp\": {}, \"latches\": {}}}",
            r.lut,
            r.ff,
            r.carry4,
            f64::from(r.bram18) / 2.0,
            r.dsp,
            r.latches
        ));
    }
    let path = hw_ip().join("synth/resources.txt");
    if mode == Mode::Update {
        return std::fs::write(&path, table).with_context(|| format!("cannot write {}", path.display()));
    }
    if mode == Mode::Json {
        println!("{{\n{}\n}}", json.join(",\n"));
    }
    let committed = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    for row in table.lines() {
        let known = committed.lines().any(|line| line == row);
        ensure!(known, "not in {}, which `cargo xtask hw synth --update` writes:\n{row}", path.display());
    }
    Ok(())
}

fn synthesise(folder: &Path, top: &str) -> anyhow::Result<Resources> {
    let mut yosys = Command::new("yosys");
    let script = format!(
        "read_verilog block.v; synth_xilinx -flatten -family xc6v -noiopad -top {top}; tee -q -o stat.txt stat"
    );
    yosys.args(["-q", "-p", &script]).current_dir(folder);
    run(yosys)?;
    let stat = std::fs::read_to_string(folder.join("stat.txt")).context("yosys has written no statistics")?;
    resources(&stat)
}

/// Reads yosys' statistics of one flat module.
fn resources(stat: &str) -> anyhow::Result<Resources> {
    let mut found = Resources::default();
    for line in stat.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [cell, count] = words.as_slice() else { continue };
        let Ok(count) = count.parse::<u32>() else { continue };
        match *cell {
            "RAM32M" | "RAM64M" => found.lut += 4 * count,
            "RAM32X1D" | "RAM64X1D" => found.lut += 2 * count,
            "CARRY4" => found.carry4 += count,
            "RAMB18E1" => found.bram18 += count,
            "RAMB36E1" => found.bram18 += 2 * count,
            "DSP48E1" => found.dsp += count,
            "BUFG" | "MUXF7" | "MUXF8" => {}
            cell if cell.starts_with("LUT") || cell.starts_with("SRL") || cell == "INV" => found.lut += count,
            cell if cell.starts_with("FD") => found.ff += count,
            cell if cell.starts_with("LD") || cell.contains("latch") => found.latches += count,
            cell => anyhow::bail!("unknown cell {cell}"),
        }
    }
    ensure!(found != Resources::default(), "the statistics are empty");
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_counted_by_what_they_take() {
        let stat = "   Number of cells:     20\n     LUT3     5\n     INV  1\n     RAM64M  2\n     SRL16E 3\n     FDRE 7\n\
                    \x20    RAMB36E1 1\n     RAMB18E1 1\n     DSP48E1 4\n     CARRY4 6\n";
        let expected = Resources { lut: 17, ff: 7, carry4: 6, bram18: 3, dsp: 4, latches: 0 };
        assert_eq!(resources(stat).unwrap(), expected);
    }

    #[test]
    fn latches_are_seen_and_unknown_cells_refused() {
        assert_eq!(resources("  LDCE 2\n").unwrap().latches, 2);
        assert!(resources("  WHAT 2\n").is_err());
    }
}
