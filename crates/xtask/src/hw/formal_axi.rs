//! Proofs of the AXI4-Lite slave: an entity of `hw-ip/formal` around the block says what is assumed and what is proven, yosys and z3 do the rest.
//!
//! Unbounded, by k-induction: what holds from the reset on for K clocks, and in a clock after any K clocks in which it
//! held, holds for ever. A proof is worth what it notices: each of the mutants has to fail.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};

use super::convert::Library;
use super::{hw_ip, work_folder};
use crate::run;

struct Proof {
    /// Entity and file in `hw-ip/formal`.
    name: &'static str,
    /// The block, in `hw-ip/rtl`.
    block: &'static str,
    /// Outputs of the entity that have to be high whenever `assumed` is.
    proven: &'static [&'static str],
    /// Clocks of the induction.
    clocks: u32,
    /// Text of the block, and what a mistake makes of it.
    mutants: &'static [(&'static str, &'static str)],
}

const PROOFS: [Proof; 1] = [Proof {
    name: "axi_lite_slave_proof",
    block: "regs/axi_lite_slave.vhd",
    proven: &["proven_stay", "proven_count", "proven_data", "proven_request", "proven_waiting"],
    clocks: 14,
    mutants: &[
        // A write response is withdrawn
        ("if s_axi_bready = '1' then", "if true then"),
        // A write response is lost
        ("write_address_held and write_data_held and not bvalid", "write_address_held and write_data_held"),
        // An address is overwritten by the next one
        ("if s_axi_arvalid = '1' and read_address_held = '0' then", "if s_axi_arvalid = '1' then"),
        // A write does not wait for its data
        ("write_address_held and write_data_held and not bvalid", "write_address_held and not bvalid"),
        // Reads never get their turn
        ("elsif read_waits = '1' then", "elsif read_waits = '1' and write_address_held = '1' then"),
    ],
}];

/// Carries out all proofs.
pub fn prove_all() -> anyhow::Result<()> {
    let work = work_folder()?.join("formal");
    for proof in &PROOFS {
        let block = hw_ip().join("rtl").join(proof.block);
        let model = proof.model(&block, &work.join(proof.name))?;
        run(smtbmc(proof.clocks, &model, false))?;
        run(smtbmc(proof.clocks, &model, true))?;

        let source = std::fs::read_to_string(&block).with_context(|| format!("cannot read {}", block.display()))?;
        for (i, (right, wrong)) in proof.mutants.iter().enumerate() {
            ensure!(source.contains(right), "{} does not hold {right:?}", proof.block);
            let folder = work.join(format!("{}-mutant-{i}", proof.name));
            std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
            let mutant = folder.join("mutant.vhd");
            std::fs::write(&mutant, source.replacen(right, wrong, 1))
                .with_context(|| format!("cannot write {}", mutant.display()))?;
            let model = proof.model(&mutant, &folder)?;
            let found = smtbmc(proof.clocks, &model, false).output().context("cannot start yosys-smtbmc")?;
            let found = String::from_utf8_lossy(&found.stdout);
            ensure!(found.contains("Assert failed"), "{} does not notice {wrong:?}:\n{found}", proof.name);
        }
        eprintln!("{}: proven; {} mutants noticed", proof.name, proof.mutants.len());
    }
    Ok(())
}

impl Proof {
    /// The block with the entity around it, as a problem for the solver.
    fn model(&self, block: &Path, folder: &Path) -> anyhow::Result<PathBuf> {
        let entity = Path::new("formal").join(format!("{}.vhd", self.name));
        let library = Library::of(folder.to_owned(), &[block, &entity])?;
        let verilog = folder.join("proof.v");
        library.convert(self.name, &[], &verilog)?;

        let text = std::fs::read_to_string(&verilog).with_context(|| format!("cannot read {}", verilog.display()))?;
        let end = text.rfind("endmodule").with_context(|| format!("{} holds no module", verilog.display()))?;
        let mut with_properties = format!("{}  always @* assume (assumed);\n", &text[..end]);
        for name in self.proven {
            with_properties.push_str(&format!("  always @* {name}_holds: assert ({name});\n"));
        }
        with_properties.push_str("endmodule\n");
        std::fs::write(&verilog, with_properties).with_context(|| format!("cannot write {}", verilog.display()))?;

        let model = folder.join("proof.smt2");
        // Merging what is equal lets the induction know that the registers of entity and block are
        let script = format!(
            "read_verilog -sv -formal {}; prep -top {} -flatten; opt -full -share_all; async2sync; dffunmap; \
             write_smt2 -wires {}",
            verilog.display(),
            self.name,
            model.display()
        );
        let mut yosys = Command::new("yosys");
        yosys.args(["-q", "-p", &script]);
        run(yosys)?;
        Ok(model)
    }
}

fn smtbmc(clocks: u32, model: &Path, induction: bool) -> Command {
    let mut command = Command::new("yosys-smtbmc");
    command.args(["-s", "z3", "-t", &clocks.to_string()]);
    if induction {
        command.arg("-i");
    }
    command.arg(model);
    command
}
