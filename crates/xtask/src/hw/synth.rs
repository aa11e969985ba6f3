//! Size of the blocks on a Virtex-6 (`synth_xilinx -family xc6v` of yosys) and clock rate on an ECP5, against the
//! committed table.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

use super::convert::Library;
use super::{docs, ecp5, hw_ip, in_parallel, work_folder};
use crate::run;

/// Rows of the table: a block, after a colon its generics if they are not the default ones.
const ROWS: [&str; 54] = [
    "sqrt",
    "sqrt_sequential",
    "divide",
    "divide_sequential",
    "normalise",
    "reciprocal_coarse",
    "reciprocal",
    "horner",
    "azimuth",
    "camera_ray:G_TERMS=8,G_BITS_PER_STAGE=3",
    "beam_ray:G_BITS_PER_STAGE=3",
    "ray_memory:G_LASERS=12,G_SLOT_BITS=2",
    "candidates:G_LASERS=12,G_SLOT_BITS=2",
    "pairing",
    "crossing:G_BITS_PER_STAGE=3",
    "spread",
    "ratio",
    "chi_square",
    "fuse:G_BITS_PER_STAGE=3",
    "average:G_BITS_PER_STAGE=3",
    "to_rig",
    "best_point:G_PAYLOAD_WIDTH=168",
    "reconstructor",
    "fifo",
    "frame_control",
    "classify",
    "segment",
    "serialize",
    "sector",
    "run",
    "cluster",
    "centroid",
    "spot_report",
    "detector",
    "detector:G_PPC=8",
    "axi_lite_slave",
    "counters",
    "settings_memory",
    "settings_load",
    "detector_settings",
    "reconstructor_settings",
    "result_banks",
    "record_memory",
    "karst_regs",
    "registers",
    "frame_gate",
    "frame_tags",
    "frame_results",
    "karst_top",
    "uart",
    "timer_watchdog",
    "peripherals",
    "wishbone_bus",
    "wishbone_to_axi_lite",
];

/// Rows that take long: not in a sample.
const LARGE_ROWS: [&str; 16] = [
    "divide",
    "horner",
    "camera_ray:G_TERMS=8,G_BITS_PER_STAGE=3",
    "beam_ray:G_BITS_PER_STAGE=3",
    "crossing:G_BITS_PER_STAGE=3",
    "fuse:G_BITS_PER_STAGE=3",
    "average:G_BITS_PER_STAGE=3",
    "to_rig",
    "reconstructor",
    "sector",
    "cluster",
    "centroid",
    "detector",
    "detector:G_PPC=8",
    "registers",
    "karst_top",
];

/// Rows that are optimised block by block, each block once: as one flat design the larger ones take yosys over half an hour,
/// and in `camera_ray` and `fuse` it loses registers (see [`for_virtex6`]).
const BY_BLOCK: [&str; 4] =
    ["camera_ray:G_TERMS=8,G_BITS_PER_STAGE=3", "fuse:G_BITS_PER_STAGE=3", "reconstructor", "karst_top"];

/// Rows whose clock rate is in a sample.
const ROUTED_IN_A_SAMPLE: [&str; 2] = ["fifo", "serialize"];

/// Rows without a clock rate: nextpnr does not route in half an hour what fills the ECP5 that much.
const UNROUTED: [&str; 3] =
    ["camera_ray:G_TERMS=8,G_BITS_PER_STAGE=3", "beam_ray:G_BITS_PER_STAGE=3", "fuse:G_BITS_PER_STAGE=3"];

/// Clock rates that have to be reached, MHz.
const LEAST_MHZ: [(&str, f64); 2] = [("detector", 200.0), ("detector:G_PPC=8", 150.0)];

/// LUTs that all these rows may take together.
const MOST_LUT: (&[&str], u32) = (&["detector", "registers"], 3000);

/// The row of everything together, which has to fit into the board's FPGA.
const WHOLE: &str = "karst_top";

/// What the FPGA of the ML605, a Virtex-6 XC6VLX240T, has (Xilinx DS150).
const DEVICE: [(&str, u32, Part); 4] =
    [("LUT", 150_720, |r| r.lut), ("FF", 301_440, |r| r.ff), ("RAMB18", 832, |r| r.bram18), ("DSP48", 768, |r| r.dsp)];

/// One of the numbers of a size.
type Part = fn(&Resources) -> u32;

/// Multipliers of an ECP5-85F; none is as large as a DSP48E1 (Lattice FPGA-DS-02012).
const ECP5_MULTIPLIERS: u32 = 156;

/// How far a clock rate may be from the table's: it differs between versions of the router.
const MHZ_TOLERANCE: f64 = 0.10;

const TABLE_HEAD: &str = "block                                     lut    ff  carry4  bram18  dsp  ecp5_mhz";

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
    /// Compare the small rows with the table.
    Sample,
    /// Compare with the table.
    Check,
    /// Compare, and print them as JSON.
    Json,
    /// Write them into the table.
    Update,
}

/// A row's figures.
struct Measured {
    row: &'static str,
    resources: Resources,
    /// Clock rate on the ECP5, where it was routed and does fit.
    mhz: Option<f64>,
}

/// Synthesises the rows that are named, or all if none is.
pub fn run_all(mode: Mode, named: &[&str]) -> anyhow::Result<()> {
    if let Some(unknown) = named.iter().find(|row| !ROWS.contains(row)) {
        bail!("no row {unknown}; there are {}", ROWS.join(" "));
    }
    let rows: Vec<&str> = ROWS
        .into_iter()
        .filter(|row| named.is_empty() || named.contains(row))
        .filter(|row| mode != Mode::Sample || !LARGE_ROWS.contains(row))
        .collect();
    let is_routed = |row: &str| !UNROUTED.contains(&row) && (mode != Mode::Sample || ROUTED_IN_A_SAMPLE.contains(&row));
    let library = Library::new(work_folder()?.join("library-synth"), &[])?;
    let measured = in_parallel(&rows, |row| {
        measure(&library, row, is_routed(row)).with_context(|| format!("{row} is not synthesised"))
    })?;

    let path = hw_ip().join("synth/resources.txt");
    let mut table = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    match mode {
        Mode::Update => {
            table = updated(&table, &measured);
            std::fs::write(&path, &table).with_context(|| format!("cannot write {}", path.display()))?;
            docs::write()?;
        }
        Mode::Json => {
            let lines: Vec<String> = measured.iter().map(Measured::json).collect();
            println!("{{\n{}\n}}", lines.join(",\n"));
        }
        Mode::Sample | Mode::Check => {}
    }
    for m in &measured {
        m.compare(&table, is_routed(m.row)).with_context(|| {
            format!(
                "{} is not as {} says, which `cargo xtask hw synth --update` writes:\n{TABLE_HEAD}\n{}",
                m.row,
                path.display(),
                m.line()
            )
        })?;
    }
    if rows.len() == ROWS.len() { check_bars(&measured) } else { Ok(()) }
}

/// The rows of a block in the table, with the table's head.
pub fn rows_of(block: &str) -> anyhow::Result<String> {
    let path = hw_ip().join("synth/resources.txt");
    let table = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let is_of_block = |line: &&str| line.split([' ', ':']).next() == Some(block);
    let rows: String = table.lines().skip(1).filter(is_of_block).map(|line| format!("{line}\n")).collect();
    Ok(if rows.is_empty() { rows } else { format!("{TABLE_HEAD}\n{rows}") })
}

/// What the whole IP takes of the board's FPGA, as a sentence; nothing for any other block.
pub fn share_of_device(block: &str) -> anyhow::Result<String> {
    if block != WHOLE {
        return Ok(String::new());
    }
    let path = hw_ip().join("synth/resources.txt");
    let table = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let resources = Resources::of_line(known(&table, WHOLE).with_context(|| format!("no row {WHOLE}"))?)?;
    let share = |(name, has, takes): &(&str, u32, fn(&Resources) -> u32)| {
        let taken = takes(&resources);
        format!("{taken} of {has} {name} ({:.1} %)", 100.0 * f64::from(taken) / f64::from(*has))
    };
    Ok(format!("Of an XC6VLX240T: {}.", DEVICE.iter().map(share).collect::<Vec<_>>().join(", ")))
}

/// The table with new lines for what was measured.
fn updated(table: &str, measured: &[Measured]) -> String {
    let line = |row: &&str| {
        let new = measured.iter().find(|m| m.row == *row).map(Measured::line);
        new.or_else(|| known(table, row).map(str::to_owned))
    };
    let lines: Vec<String> = ROWS.iter().filter_map(line).collect();
    format!("{TABLE_HEAD}\n{}\n", lines.join("\n"))
}

/// A row's line in the table.
fn known<'a>(table: &'a str, row: &str) -> Option<&'a str> {
    table.lines().find(|line| line.split_whitespace().next() == Some(row))
}

/// Converts, synthesises and routes one block, and says which path is the slowest.
pub fn print_clock_rate(block: &str, generics: &[&str]) -> anyhow::Result<()> {
    let work = work_folder()?;
    let library = Library::new(work.join("library-synth"), &[])?;
    let folder = convert(&library, block, generics)?;
    let routed = ecp5::route(&folder, block)?;
    println!("{block}: {:.1} MHz; the slowest path:\n{}", routed.mhz, routed.path);
    Ok(())
}

fn measure(library: &Library, row: &'static str, is_routed: bool) -> anyhow::Result<Measured> {
    let mut words = row.split([':', ',']);
    let block = words.next().unwrap_or_default();
    let folder = convert(library, block, &words.collect::<Vec<_>>())?;
    let resources = synthesise(&folder, row, block)?;
    ensure!(resources.latches == 0, "{} latches", resources.latches);
    let mut mhz = None;
    if resources.dsp > ECP5_MULTIPLIERS {
        eprintln!("{row} does not fit into the ECP5: {} multipliers, and it has {ECP5_MULTIPLIERS}", resources.dsp);
    } else if is_routed {
        match ecp5::route(&folder, block) {
            Ok(routed) => {
                eprintln!("{row}: {:.1} MHz on the ECP5; the slowest path:\n{}", routed.mhz, routed.path);
                mhz = Some(routed.mhz);
            }
            Err(error) => eprintln!("{row} has no clock rate on the ECP5: {error:#}"),
        }
    }
    Ok(Measured { row, resources, mhz })
}

/// Writes a block as `block.v` into a folder of its own.
fn convert(library: &Library, block: &str, generics: &[&str]) -> anyhow::Result<PathBuf> {
    let name = std::iter::once(&block).chain(generics).copied().collect::<Vec<_>>().join("-").replace('=', "");
    let folder = work_folder()?.join(format!("synth-{name}"));
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let generics: Vec<String> = generics.iter().map(|generic| (*generic).to_owned()).collect();
    library.convert(block, &generics, &folder.join("block.v"))?;
    Ok(folder)
}

fn check_bars(measured: &[Measured]) -> anyhow::Result<()> {
    let find = |row| measured.iter().find(|m| m.row == row).with_context(|| format!("no row {row}"));
    for (row, least) in LEAST_MHZ {
        let mhz = find(row)?.mhz.unwrap_or(0.0);
        ensure!(mhz >= least, "{row} has to reach {least} MHz on the ECP5, and reaches {mhz:.1}");
    }
    let (rows, most) = MOST_LUT;
    let mut lut = 0;
    for row in rows {
        lut += find(row)?.resources.lut;
    }
    ensure!(lut <= most, "{} may take {most} LUT together, and take {lut}", rows.join(" and "));
    let whole = &find(WHOLE)?.resources;
    for (name, has, takes) in DEVICE {
        ensure!(takes(whole) <= has, "{WHOLE} takes {} {name}, and the board's FPGA has {has}", takes(whole));
    }
    Ok(())
}

impl Resources {
    /// Reads a row of the table.
    fn of_line(line: &str) -> anyhow::Result<Self> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [_, lut, ff, carry4, bram18, dsp, _] = words.as_slice() else { bail!("a row with other columns: {line}") };
        Ok(Self {
            lut: lut.parse()?,
            ff: ff.parse()?,
            carry4: carry4.parse()?,
            bram18: bram18.parse()?,
            dsp: dsp.parse()?,
            latches: 0,
        })
    }
}

impl Measured {
    /// The row of the table.
    fn line(&self) -> String {
        let r = &self.resources;
        let mhz = self.mhz.map_or("-".to_owned(), |mhz| format!("{mhz:.1}"));
        format!("{:38} {:>6} {:>5} {:>7} {:>7} {:>4} {mhz:>9}", self.row, r.lut, r.ff, r.carry4, r.bram18, r.dsp)
    }

    fn json(&self) -> String {
        let r = &self.resources;
        format!(
            "  \"{}\": {{\"lut\": {}, \"ff\": {}, \"carry4\": {}, \"bram\": {}, \"dsp\": {}, \"latches\": {}, \
             \"ecp5_fmax_mhz\": {}}}",
            self.row,
            r.lut,
            r.ff,
            r.carry4,
            f64::from(r.bram18) / 2.0,
            r.dsp,
            r.latches,
            self.mhz.map_or("null".to_owned(), |mhz| format!("{mhz:.1}"))
        )
    }

    /// The table has to hold the same sizes, and about the same clock rate if that was measured.
    fn compare(&self, table: &str, is_routed: bool) -> anyhow::Result<()> {
        let known = known(table, self.row).context("no such row")?;
        let (known_sizes, known_mhz) = known.rsplit_once(' ').context("a row of one word")?;
        let line = self.line();
        let sizes = line.rsplit_once(' ').map(|(sizes, _)| sizes);
        ensure!(sizes.map(str::trim_end) == Some(known_sizes.trim_end()), "its size is another one");
        if is_routed {
            let is_near = match (known_mhz.parse::<f64>().ok(), self.mhz) {
                (Some(known), Some(mhz)) => (mhz - known).abs() <= MHZ_TOLERANCE * known,
                (None, None) => true,
                _ => false,
            };
            ensure!(is_near, "its clock rate is farther away than {:.0} %", 100.0 * MHZ_TOLERANCE);
        }
        Ok(())
    }
}

/// Yosys' commands from sources to a Virtex-6 netlist.
///
/// Registers are moved into DSP blocks on the way, where yosys 0.23 can lose bits of a register that it moves in part: these
/// then have no driver, which is an error here.
pub fn for_virtex6(sources: &str, top: &str, options: &str) -> String {
    let synth = format!("synth_xilinx -family xc6v -top {top} {options}");
    format!("read_verilog {sources}; {synth} -run begin:map_memory; check -assert; {synth} -run map_memory:")
}

fn synthesise(folder: &Path, row: &str, top: &str) -> anyhow::Result<Resources> {
    let mut yosys = Command::new("yosys");
    let (before, after) = if BY_BLOCK.contains(&row) { ("", "flatten; clean;") } else { ("-flatten", "") };
    let script =
        format!("{}; {after} tee -q -o stat.txt stat", for_virtex6("block.v", top, &format!("-noiopad {before}")));
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
    fn sizes_are_compared_exactly_and_rates_nearly() {
        let measured =
            |lut, mhz| Measured { row: "one", resources: Resources { lut, ..Resources::default() }, mhz: Some(mhz) };
        let table = format!("{TABLE_HEAD}\n{}\n", measured(7, 100.0).line());
        assert!(measured(7, 91.0).compare(&table, true).is_ok());
        assert!(measured(7, 89.0).compare(&table, true).is_err());
        assert!(measured(7, 111.0).compare(&table, true).is_err());
        assert!(measured(7, 89.0).compare(&table, false).is_ok());
        assert!(measured(6, 100.0).compare(&table, true).is_err());
        assert!(Measured { mhz: None, ..measured(7, 0.0) }.compare(&table, true).is_err());
    }

    #[test]
    fn a_row_is_read_as_it_is_written() {
        let resources = Resources { lut: 1, ff: 2, carry4: 3, bram18: 4, dsp: 5, latches: 0 };
        for mhz in [None, Some(99.5)] {
            let line = Measured { row: "one", resources: Resources { ..resources }, mhz }.line();
            assert_eq!(Resources::of_line(&line).unwrap(), resources);
        }
        assert!(Resources::of_line("one 1 2").is_err());
    }

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
