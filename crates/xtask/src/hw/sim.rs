//! Simulation of the gateware against the crates.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

use super::convert::Library;
use super::{enables, faults, hw_ip, parts, setup, slices, waves, work_folder};
use crate::{cargo, firmware, run, touch};

/// Math blocks: the name in karst-cosim, in the order of `math_blocks.vhd`, and whether the output may be held back.
const MATH_BLOCKS: [(&str, bool); 15] = [
    ("sqrt-floor", false),
    ("sqrt-round", false),
    ("sqrt-narrow", false),
    ("divide", false),
    ("divide-narrow", false),
    ("horner", false),
    ("azimuth", false),
    ("azimuth-narrow", false),
    ("sqrt-sequential", true),
    ("divide-sequential", true),
    ("reciprocal", false),
    ("reciprocal-coarse1", false),
    ("reciprocal-coarse2", false),
    ("reciprocal-coarse3", false),
    ("reciprocal-coarse4", false),
];

/// Operands per math block in a sample, in the full run, and for the slow VHDL bench.
const SAMPLE: u64 = 200_000;
const FULL: u64 = 10_000_000;
const BENCH: u64 = 1_000;

/// A build of the SoC's simulation.
#[derive(Clone, Copy)]
pub enum SocBuild {
    /// As it is.
    Plain,
    /// It can write waves, and is slower for it.
    Waves,
}

/// Makes the simulation of the SoC; gives its program.
pub fn build_soc(build: SocBuild) -> anyhow::Result<PathBuf> {
    let work = work_folder()?;
    soc(&work, &Library::new(work.join("library"), &[])?, build)
}

/// What is simulated: the name of a part, and how.
type Part = (&'static str, fn(&Path, &Library, bool) -> anyhow::Result<()>);
const PARTS: [Part; 6] = [
    ("registers", simulate_registers),
    ("soc", simulate_soc),
    ("math", math_blocks),
    ("reconstructor", reconstructors),
    ("detector", detectors),
    ("top", tops),
];

/// Runs every bench and every simulation, or those of some parts.
pub fn run_parts(full: bool, parts: &[&str]) -> anyhow::Result<()> {
    if let Some(unknown) = parts.iter().find(|part| PARTS.iter().all(|(name, _)| name != *part)) {
        let names = PARTS.map(|(name, _)| name).join(", ");
        bail!("there is no part {unknown:?} to simulate, but {names}");
    }
    let work = work_folder()?;
    let benches = ["sim/math_blocks.vhd", "sim/tb_math.vhd", "sim/tb_registers.vhd", "sim/tb_reconstructor.vhd"];
    let library = Library::new(work.join("library"), &benches)?;
    let wanted = PARTS.iter().filter(|(name, _)| parts.is_empty() || parts.contains(name));
    wanted.into_iter().try_for_each(|(_, simulate)| simulate(&work, &library, full))
}

/// Every math block, on the VHDL itself and converted.
fn math_blocks(work: &Path, library: &Library, full: bool) -> anyhow::Result<()> {
    for (number, (name, handshake)) in MATH_BLOCKS.into_iter().enumerate() {
        let block = format!("G_BLOCK={number}");

        let vectors = work.join(format!("{name}.txt"));
        run(cosim(&["vectors", name, "--count", &BENCH.to_string(), path(&vectors)?]))?;
        let generics = [block.clone(), format!("G_HANDSHAKE={handshake}"), format!("G_FILE={}", path(&vectors)?)];
        library.simulate("tb_math", &generics)?;

        let harness = Harness { file: "sim/math_harness.cpp", ..Harness::default() };
        let executable = verilate(work, library, name, ("math_blocks", &[block]), &[], &harness)?;
        let count = if full { FULL } else { SAMPLE };
        run(cosim(&["math", name, "--count", &count.to_string(), path(&executable)?]))?;
    }
    Ok(())
}

/// The whole IP next to its software model; in the full run with 8 pixels per clock, and for 720 lasers, too.
fn tops(work: &Path, library: &Library, full: bool) -> anyhow::Result<()> {
    let (random, rendered) = if full { ("500", "4") } else { ("16", "1") };
    let mut compare = cosim(&["top", "--random", random, "--rendered", rendered]);
    compare.arg(top(work, library, "top", 1, &[])?);
    if full {
        compare.arg(top(work, library, "top-8", 8, &[])?);
        compare.arg("--large").arg(top(work, library, "top-720", 1, &["G_LASERS=720"])?);
    }
    run(compare)
}

/// Measures the clocks from pixels to points, and prints them.
pub fn measure(json: bool) -> anyhow::Result<()> {
    let work = work_folder()?;
    let library = Library::new(work.join("library-latency"), &[])?;
    let mut measure = cosim(&["top", "--random", "0", "--rendered", "3"]);
    measure.args(json.then_some("--json"));
    measure.arg(top(&work, &library, "top", 1, &[])?);
    measure.arg("--large").arg(top(&work, &library, "top-720", 1, &["G_LASERS=720"])?);
    run(measure)
}

fn top(work: &Path, library: &Library, name: &str, pixels: u32, generics: &[&str]) -> anyhow::Result<PathBuf> {
    let mut generics: Vec<String> = generics.iter().map(|&generic| generic.to_owned()).collect();
    generics.push(format!("G_PPC={pixels}"));
    let seen = hw_ip().join("sim/top.vlt");
    let define = format!("-DPPC={pixels}");
    let harness = Harness { file: "sim/top_harness.cpp", define: &define, ..Harness::default() };
    verilate(work, library, name, ("karst_top", &generics), &[&seen], &harness)
}

/// Lasers through the reconstructor in a sample, in the full run, and for the slow VHDL bench.
const LASERS_SAMPLE: u64 = 50_000;
const LASERS_FULL: u64 = 1_000_000;
const LASERS_BENCH: u64 = 60;

/// Spots through the reconstructor; in the full run with other depths of its divisions, too.
fn reconstructors(work: &Path, library: &Library, full: bool) -> anyhow::Result<()> {
    let (commands, points) = (work.join("commands.txt"), work.join("points.txt"));
    run(cosim(&["point-vectors", "--count", &LASERS_BENCH.to_string(), path(&commands)?, path(&points)?]))?;
    let files = [format!("G_COMMANDS={}", path(&commands)?), format!("G_POINTS={}", path(&points)?)];
    library.simulate("tb_reconstructor", &files)?;

    let depths: &[u32] = if full { &[3, 1, 2, 4] } else { &[3] };
    for &bits in depths {
        let name = format!("reconstructor-{bits}");
        let generics = ["G_LASERS=720".to_owned(), format!("G_BITS_PER_STAGE={bits}")];
        let harness = Harness { file: "sim/reconstructor_harness.cpp", ..Harness::default() };
        let executable = verilate(work, library, &name, ("reconstructor", &generics), &[], &harness)?;
        let count = if full && bits == 3 { LASERS_FULL } else { LASERS_SAMPLE };
        let (count, bits) = (count.to_string(), bits.to_string());
        run(cosim(&["points", "--count", &count, "--bits-per-stage", &bits, path(&executable)?]))?;
    }
    Ok(())
}

/// Frames through the detector at every number of pixels per clock.
fn detectors(work: &Path, library: &Library, full: bool) -> anyhow::Result<()> {
    let (random, rendered) = if full { ("1500", "50") } else { ("300", "2") };
    let mut compare = cosim(&["detector", "--random", random, "--rendered", rendered]);
    let simulation = |name: &str, pixels: u32, generics: &[&str]| {
        let mut generics: Vec<String> = generics.iter().map(|&generic| generic.to_owned()).collect();
        generics.push(format!("G_PPC={pixels}"));
        let define = format!("-DPPC={pixels}");
        let harness = Harness { file: "sim/detector_harness.cpp", define: &define, ..Harness::default() };
        verilate(work, library, name, ("detector", &generics), &[], &harness)
    };
    compare.arg("--large");
    compare.arg(simulation("detector-large", 4, &["G_X_BITS=11", "G_Y_BITS=11", "G_LASER_BITS=10"])?);
    for pixels in [1, 2, 4, 8] {
        compare.arg(simulation(&format!("detector-{pixels}"), pixels, &[])?);
    }
    run(compare)
}

/// The SoC: everything but the processor in a bench of its own, then all of it with the firmware.
fn simulate_soc(work: &Path, library: &Library, full: bool) -> anyhow::Result<()> {
    // A library of its own: in the other one the stubs would stand in for the processor and the IP
    let list = std::fs::read_to_string(hw_ip().join("files.txt")).context("cannot read hw-ip/files.txt")?;
    let needed =
        |file: &&str| ["rtl/regs/", "rtl/soc/", "rtl/detector/fifo.vhd"].iter().any(|part| file.starts_with(part));
    let stubs = ["sim/processor_stub.vhd", "sim/karst_stub.vhd", "sim/tb_soc.vhd"];
    let (soc_files, regs_files): (Vec<&str>, Vec<&str>) =
        list.lines().filter(needed).partition(|file| file.starts_with("rtl/soc/"));
    let files: Vec<&Path> =
        regs_files.into_iter().chain([stubs[1]]).chain(soc_files).chain([stubs[0], stubs[2]]).map(Path::new).collect();
    let with_stubs = Library::of(work.join("library-soc"), &files)?;
    let vectors = work.join("soc.txt");
    let (count, lasers) = (SOC_ACCESSES.to_string(), SOC_LASERS.to_string());
    run(cosim(&["registers", "--accesses", "--count", &count, "--lasers", &lasers, path(&vectors)?]))?;
    with_stubs.simulate("tb_soc", &[format!("G_LASERS={lasers}"), format!("G_FILE={}", path(&vectors)?)])?;

    let soc = soc(work, library, SocBuild::Plain)?;
    let firmware = firmware::sensor()?;
    let mut scenarios = cargo(&["test", "--quiet", "--release", "-p", "karst-scenarios", "--", "--ignored"]);
    scenarios.args(if full { [].as_slice() } else { &["--skip", "full"] });
    scenarios.env("KARST_SOC", soc).env("KARST_FIRMWARE", firmware);
    run(scenarios)?;
    let karst = |arguments: &[&str]| {
        let mut command = cargo(&["run", "--quiet", "--release", "-p", "karst", "--"]);
        command.args(arguments);
        run(command)
    };
    karst(&["sim", "--frames", "3", "--full-rate"])?;
    // As the README has it
    let places = ["pc", "simulated"].map(|name| work.join("sections").join(name));
    karst(&["demo", "--out", path(&places[0])?])?;
    karst(&["sim", "--out", path(&places[1])?])?;
    let points = places.map(|place| std::fs::read(place.join("points.ply")));
    let [Ok(pc), Ok(simulated)] = points else { bail!("karst demo or karst sim leaves no points.ply") };
    ensure!(pc == simulated, "karst demo and karst sim leave different points");
    if full {
        let (file, from, clocks) = (work.join("waves.vcd"), 1000, 500);
        let [first, count] = [from, clocks].map(|number: u64| number.to_string());
        karst(&["sim", "--dump-waves", path(&file)?, "--waves-from", &first, "--waves-clocks", &count])?;
        let dumped = std::fs::read_to_string(&file).with_context(|| format!("no waves in {}", file.display()))?;
        waves::check(&dumped, from, clocks)?;
    }
    Ok(())
}

/// Random accesses to the IP's registers over the processor's bus, and for how many lasers.
const SOC_ACCESSES: u64 = 2_000;
const SOC_LASERS: u32 = 12;

/// What rests in the simulated SoC most of the time, and takes long otherwise.
const SOC_PARTS: [&str; 5] = ["reconstructor", "azimuth", "cluster", "centroid", "spot_report"];

/// The program that simulates the SoC.
fn soc(work: &Path, library: &Library, build: SocBuild) -> anyhow::Result<PathBuf> {
    // Waves show parts as all the rest
    let (name, options, parts): (_, &[&str], &[&str]) = match build {
        SocBuild::Plain => ("soc", &["-MAKEFLAGS", "OPT_FAST=-O2"], &SOC_PARTS),
        SocBuild::Waves => ("soc-waves", &["--trace"], &[]),
    };
    let harness = Harness { file: "sim/soc_harness.cpp", define: "-DPPC=1", options, bench: Some("soc_bench"), parts };
    let sources = [hw_ip().join("sim/soc_bench.sv"), setup::processor()?];
    let program = verilate(work, library, name, ("soc", &[]), &sources.each_ref().map(PathBuf::as_path), &harness)?;
    touch(&program)?;
    Ok(program)
}

/// Random traffic on the register block, built for few lasers and for twelve.
fn simulate_registers(work: &Path, library: &Library, full: bool) -> anyhow::Result<()> {
    let count = if full { 100_000 } else { 5_000 };
    for lasers in [4, 12] {
        let vectors = work.join(format!("registers-{lasers}.txt"));
        let (count, lasers) = (count.to_string(), lasers.to_string());
        run(cosim(&["registers", "--count", &count, "--lasers", &lasers, path(&vectors)?]))?;
        library.simulate("tb_registers", &[format!("G_LASERS={lasers}"), format!("G_FILE={}", path(&vectors)?)])?;
    }
    Ok(())
}

/// What drives a simulation.
#[derive(Default)]
struct Harness<'a> {
    /// C++ source within `hw-ip`.
    file: &'a str,
    /// Compiler option for it.
    define: &'a str,
    /// Options of Verilator.
    options: &'a [&'a str],
    /// Module around the entity that can let faults in.
    bench: Option<&'a str>,
    /// Entities that become models of their own.
    parts: &'a [&'a str],
}

/// Makes a program of an entity with its generics, more sources and a harness.
fn verilate(
    work: &Path,
    library: &Library,
    name: &str,
    (entity, generics): (&str, &[String]),
    sources: &[&Path],
    harness: &Harness,
) -> anyhow::Result<PathBuf> {
    let verilog = work.join(format!("{name}.v"));
    library.convert(entity, generics, &verilog)?;
    let converted = std::fs::read_to_string(&verilog).context("the conversion has gone")?;
    let mut rewritten = enables::gather(&slices::forward(&converted));
    if harness.bench.is_some() {
        rewritten = faults::let_in(&rewritten)?;
    }
    let models = if harness.parts.is_empty() {
        PartModels::default()
    } else {
        let (rest, parts) = parts::take_out(&rewritten, harness.parts)?;
        let whole = work.join(format!("{name}-whole.v"));
        write(&whole, &rewritten)?;
        rewritten = rest;
        part_models(work, name, &parts, &whole, harness.options)?
    };
    write(&verilog, &rewritten)?;
    let folder = work.join(format!("verilated-{name}"));
    let flags = format!("{}{}", harness.define, models.flags);
    let mut simulation = verilator(harness.bench.unwrap_or(entity), "Vdut", &folder, &flags);
    simulation
        .arg("--exe")
        .args(harness.options)
        .args(sources)
        .arg(&verilog)
        .args(models.files)
        .arg(hw_ip().join(harness.file))
        .args(["-o", name]);
    run(simulation)?;
    Ok(folder.join(name))
}

/// What a simulation with parts needs besides its own Verilog.
#[derive(Default)]
struct PartModels {
    /// Flags of the compiler.
    flags: String,
    /// The models, and the C++ that gets at them.
    files: Vec<PathBuf>,
}

/// Makes the models of parts; `whole` has the Verilog of all of them.
fn part_models(
    work: &Path,
    name: &str,
    parts: &[parts::Part],
    whole: &Path,
    options: &[&str],
) -> anyhow::Result<PartModels> {
    let glue = work.join(format!("{name}-parts.cpp"));
    write(&glue, &parts::glue(parts))?;
    let mut models = PartModels { flags: format!(" -I{}", hw_ip().join("sim").display()), files: vec![glue] };
    for part in parts {
        let top = work.join(format!("{name}-{}.v", part.module));
        write(&top, &part.verilog)?;
        let folder = work.join(format!("verilated-{name}-{}", part.entity));
        let prefix = format!("V{}", part.entity);
        let mut model = verilator(&part.module, &prefix, &folder, "");
        // Its state is to be in one place
        model.arg("--flatten").args(options).arg(top).arg(whole);
        run(model)?;
        models.flags.push_str(&format!(" -I{}", folder.display()));
        models.files.push(folder.join(format!("{prefix}__ALL.a")));
    }
    Ok(models)
}

/// Makes a model of a module in a folder, with more flags of the compiler.
fn verilator(module: &str, prefix: &str, folder: &Path, flags: &str) -> Command {
    let mut verilator = Command::new("verilator");
    verilator
        .args(["--cc", "--build", "-O3", "-CFLAGS"])
        .arg(format!("-O2 {flags}"))
        // What runs at every clock, for which more brings little, and what runs once
        .args(["-MAKEFLAGS", "OPT_FAST=-O1", "-MAKEFLAGS", "OPT_SLOW=-O0"])
        .args(["--prefix", prefix, "--x-initial", "0"])
        // GHDL's Verilog is no one's to read
        .args(["-Wno-fatal", "-Wno-lint", "-Wno-style", "-Wno-COMBDLY", "-Wno-SYMRSVDWORD"])
        .args(["--top-module", module, "--Mdir"])
        .arg(folder)
        // Only results go to standard output
        .stdout(std::io::stderr());
    verilator
}

fn write(file: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))
}

fn cosim(arguments: &[&str]) -> Command {
    let mut command = cargo(&["run", "--quiet", "--release", "-p", "karst-cosim", "--"]);
    command.args(arguments);
    command
}

fn path(path: &Path) -> anyhow::Result<&str> {
    path.to_str().with_context(|| format!("{} is not valid UTF-8", path.display()))
}
