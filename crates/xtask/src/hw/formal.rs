//! Proofs: the properties in the blocks by k-induction, and mutants of each block on which they fail.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

use super::convert::{Ghdl, formal};
use super::{hw_ip, setup, work_folder};
use crate::{output, run};

/// A block whose file stands alone, in the size in which it is proven.
struct Proof {
    file: &'static str,
    entity: &'static str,
    generics: &'static [&'static str],
    /// Clocks of the base case and of the induction.
    depth: u32,
    /// Changes of the source that the properties have to notice.
    mutants: &'static [[&'static str; 2]],
}

const PROOFS: [Proof; 5] = [
    Proof {
        file: "rtl/detector/fifo.vhd",
        entity: "fifo",
        generics: &["G_WIDTH=4", "G_LOG2_DEPTH=2"],
        depth: 10,
        mutants: &[
            // The word at the output is overwritten before it is taken
            ["count /= 0 and (valid = '0' or out_ready = '1')", "count /= 0"],
            // Words are overwritten in the full memory
            ["full      <= count(G_LOG2_DEPTH);", "full      <= '0';"],
        ],
    },
    Proof {
        file: "rtl/detector/serialize.vhd",
        entity: "serialize",
        generics: &["G_PPC=4", "G_X_BITS=7", "G_Y_BITS=1"],
        depth: 8,
        mutants: &[
            // The beat goes after its first hit
            ["in_ready    <= room and not others_wait;", "in_ready    <= room;"],
            // The first hit comes again and again
            [" given <= given or (waiting and std_ulogic_vector(unsigned(not waiting) + 1));", " given <= given;"],
        ],
    },
    Proof {
        file: "rtl/detector/run.vhd",
        entity: "run",
        generics: &["G_X_BITS=7", "G_Y_BITS=1", "G_LASER_BITS=1"],
        depth: 6,
        mutants: &[
            // A new run overwrites one that can not go yet
            ["not ending and (hit_joins or not open_run or vacant);", "not ending;"],
            // Hits of the next frame enter before the end is taken
            ["not row_valid and not ending and (hit_joins", "not row_valid and (hit_joins"],
            // What is at the output is overwritten
            ["if vacant = '1' then", "if vacant = '1' or give = '1' or open_run = '1' then"],
        ],
    },
    Proof {
        file: "rtl/math/sqrt_sequential.vhd",
        entity: "sqrt_sequential",
        generics: &["G_WIDTH=6", "G_ROUND=true"],
        depth: 10,
        mutants: &[
            // The result goes before it is taken
            ["done <= not out_ready;", "done <= '0';"],
            // An operand is taken and forgotten
            ["'1' when steps_left = 0 and done = '0' else '0'", "'1' when steps_left = 0 else '0'"],
        ],
    },
    Proof {
        file: "rtl/math/divide_sequential.vhd",
        entity: "divide_sequential",
        generics: &["G_NUMERATOR_WIDTH=5", "G_DENOMINATOR_WIDTH=4", "G_QUOTIENT_WIDTH=4"],
        depth: 12,
        mutants: &[
            ["done <= not out_ready;", "done <= '0';"],
            ["in_ready  <= not busy and not done;", "in_ready  <= not busy;"],
        ],
    },
];

/// Proves every block and lets every mutant fail.
pub fn run_all() -> anyhow::Result<()> {
    for proof in &PROOFS {
        let entity = proof.entity;
        let source = hw_ip().join(proof.file);
        let text = std::fs::read_to_string(&source).with_context(|| format!("cannot read {}", source.display()))?;
        let model = proof.model(&source, "")?;
        ensure!(proof.holds(&model, false)?, "{entity}: a property fails within {} clocks", proof.depth);
        ensure!(proof.holds(&model, true)?, "{entity}: the induction over {} clocks fails", proof.depth);
        println!("{entity}: proven");
        for (i, [from, to]) in proof.mutants.iter().enumerate() {
            ensure!(text.matches(from).count() == 1, "{entity}: mutant {i} does not fit the source: `{from}`");
            let name = format!("-mutant-{i}");
            let mutated = work_folder()?.join(format!("{entity}{name}.vhd"));
            std::fs::write(&mutated, text.replace(from, to)).context("cannot write the mutant")?;
            ensure!(!proof.holds(&proof.model(&mutated, &name)?, false)?, "{entity}: no property notices `{to}`");
            println!("{entity}: mutant `{to}` fails");
        }
    }
    Ok(())
}

impl Proof {
    /// The block as a model for the solver.
    fn model(&self, source: &Path, variant: &str) -> anyhow::Result<PathBuf> {
        let folder = work_folder()?.join(format!("formal-{}{variant}", self.entity));
        let ghdl = Ghdl::new(folder.clone())?;
        let mut analyse = ghdl.command("-a");
        analyse.arg(source);
        run(analyse)?;
        let mut synth = ghdl.command("--synth");
        synth.args(["--out=verilog", "-gG_FORMAL=true"]);
        synth.args(self.generics.iter().map(|generic| format!("-g{generic}"))).arg(self.entity);
        let verilog = formal(&output(synth)?)?;
        std::fs::write(folder.join("model.v"), verilog).context("cannot write the model")?;
        let mut yosys = Command::new("yosys");
        let script = format!(
            "read_verilog -formal -sv model.v; prep -flatten -top {}; memory_map; opt -full; dffunmap; \
             write_smt2 -wires model.smt2",
            self.entity
        );
        yosys.args(["-q", "-p", &script]).current_dir(&folder);
        run(yosys)?;
        Ok(folder)
    }

    /// Whether all properties hold: from reset on, or by induction.
    fn holds(&self, folder: &Path, induction: bool) -> anyhow::Result<bool> {
        let mut solver = Command::new("yosys-smtbmc");
        solver.args(["-s", "yices", "-t", &self.depth.to_string()]).args(induction.then_some("-i"));
        solver.arg("model.smt2").current_dir(folder).env("PATH", setup::path_with_python_tools()?);
        let result = solver.output().context("cannot start yosys-smtbmc")?;
        let text = String::from_utf8_lossy(&result.stdout);
        match (text.contains("Status: PASSED"), text.contains("Status: FAILED")) {
            (true, false) => Ok(true),
            (false, true) => Ok(false),
            _ => bail!("the solver ended without a status:\n{text}{}", String::from_utf8_lossy(&result.stderr)),
        }
    }
}
