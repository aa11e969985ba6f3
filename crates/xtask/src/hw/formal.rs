//! Proofs: properties of blocks by k-induction, and mutants of each block on which they fail.
//!
//! The properties are PSL, in a unit of `hw-ip/formal` with the block's name that sees into it. Unbounded: what holds from the reset on for K clocks, and in a clock after any K clocks in which it held, holds for
//! ever. A proof is worth what it notices: each of the mutants has to fail.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

use super::convert::{Ghdl, formal};
use super::{hw_ip, in_parallel, setup, work_folder};
use crate::{output, run};

/// A block whose file stands alone, in the size in which it is proven.
struct Proof {
    entity: &'static str,
    /// Folder of its file.
    folder: &'static str,
    generics: &'static [&'static str],
    /// Clocks of the base case and of the induction.
    depth: u32,
    /// Changes of the source that the properties have to notice.
    mutants: &'static [[&'static str; 2]],
}

const PROOFS: [Proof; 11] = [
    Proof {
        entity: "fifo",
        folder: "rtl/detector",
        generics: &["G_WIDTH=4", "G_LOG2_DEPTH=2"],
        depth: 10,
        mutants: &[
            // The fetched word is overwritten before it moves on
            ["not is_empty and (move or not fetched_valid);", "not is_empty;"],
            // The word at the output is overwritten before it is taken
            ["out_ready or not valid;", "'1';"],
            // Words are overwritten in the full memory
            ["in_valid and not count(G_LOG2_DEPTH);", "in_valid;"],
        ],
    },
    Proof {
        entity: "serialize",
        folder: "rtl/detector",
        generics: &["G_PPC=4", "G_X_BITS=7", "G_Y_BITS=1"],
        depth: 8,
        mutants: &[
            // The beat goes after its first hit
            ["in_ready <= not valid or (room and is_last);", "in_ready <= not valid or room;"],
            // A beat overwrites one that can not go yet
            ["in_ready <= not valid or (room and is_last);", "in_ready <= not valid or is_last;"],
            // The first of the waiting hits comes again and again
            ["rest    := waiting and not lowest(waiting);", "rest    := waiting;"],
            // From right to left
            ["for lane in 0 to G_PPC - 1 loop\n      result", "for lane in G_PPC - 1 downto 0 loop\n      result"],
        ],
    },
    Proof {
        entity: "run",
        folder: "rtl/detector",
        generics: &["G_X_BITS=7", "G_Y_BITS=1", "G_LASER_BITS=1"],
        depth: 6,
        mutants: &[
            // A new run overwrites one that can not go yet
            ["not ending and (hit.joins or not open_run or vacant);", "not ending;"],
            // Hits of the next frame enter before the end is taken
            ["not row_valid and not ending and (hit.joins", "not row_valid and (hit.joins"],
            // Hits come while two of them wait
            ["in_ready  <= not spare_valid;", "in_ready  <= '1';"],
            // The hit that waits comes twice
            ["spare_valid <= in_valid and not moves;", "spare_valid <= in_valid;"],
            // What is at the output is overwritten
            ["if vacant = '1' then", "if vacant = '1' or give = '1' or open_run = '1' then"],
        ],
    },
    Proof {
        entity: "centroid",
        folder: "rtl/detector",
        generics: &["G_X_BITS=7", "G_Y_BITS=1", "G_LASER_BITS=1", "G_SLOT_BITS=1"],
        depth: 5,
        mutants: &[
            // A cluster gives a frame's record, too
            ["frame_valid <= word_frame;", "frame_valid <= '1';"],
            // A frame gives a spot
            ["if word_frame = '0' then", "if true then"],
            // The first phase may end before it begins
            ["          is_last <= '0';\n          if word_valid", "          if word_valid"],
            // A phase goes on with the steps of the one before
            ["        step    <= (others => '0');\n", ""],
        ],
    },
    Proof {
        entity: "sqrt_sequential",
        folder: "rtl/math",
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
        entity: "divide_sequential",
        folder: "rtl/math",
        generics: &["G_NUMERATOR_WIDTH=5", "G_DENOMINATOR_WIDTH=4", "G_QUOTIENT_WIDTH=4"],
        depth: 12,
        mutants: &[
            ["done <= not out_ready;", "done <= '0';"],
            ["in_ready  <= not busy and not done;", "in_ready  <= not busy;"],
        ],
    },
    Proof {
        entity: "pairing",
        folder: "rtl/reconstructor",
        generics: &["G_SLOT_BITS=1"],
        depth: 12,
        mutants: &[
            // Rays that are still under way are read
            ["take  <= walking and ends and not held;", "take  <= walking and ends;"],
            // The second spots of camera 1 are left out
            ["elsif phase = BOTH and more_1 = '1' then", "elsif phase = BOTH and more_1 = '1' and more_2 = '1' then"],
            // The last laser is left out
            ["        if left = 1 then", "        if left = 2 then"],
        ],
    },
    Proof {
        entity: "frame_gate",
        folder: "rtl/top",
        generics: &["G_DATA_BITS=4", "G_Y_BITS=2"],
        depth: 8,
        mutants: &[
            // A beat overwrites one that is not taken
            ["slot_free(camera)     <= m_axis_tready(camera) or not held(camera);", "slot_free(camera)     <= '1';"],
            // The end of a frame is lost if the next one is not taken
            ["(now_taken(camera) or (s_axis_tuser(camera) and frame_taken(camera)))", "now_taken(camera)"],
            // Half a pair is taken
            ["takes(camera)      <= taken(OTHER) when is_partner(camera) = '1' else", "takes(camera)      <="],
            // Beats of frames that are not taken come out
            ["held(camera) <= passes(camera);", "held(camera) <= beat_taken(camera);"],
        ],
    },
    Proof {
        entity: "axi_lite_slave",
        folder: "rtl/regs",
        generics: &["G_ADDRESS_BITS=4"],
        depth: 15,
        mutants: &[
            // A write response is withdrawn
            ["if s_axi_bready = '1' then", "if true then"],
            // A write response is lost
            ["write_address_held and write_data_held and not bvalid", "write_address_held and write_data_held"],
            // An address is overwritten by the next one
            ["if s_axi_arvalid = '1' and read_address_held = '0' then", "if s_axi_arvalid = '1' then"],
            // A write does not wait for its data
            ["write_address_held and write_data_held and not bvalid", "write_address_held and not bvalid"],
            // Reads never get their turn
            ["elsif read_waits = '1' then", "elsif read_waits = '1' and write_address_held = '1' then"],
        ],
    },
    Proof {
        entity: "result_banks",
        folder: "rtl/regs",
        generics: &[],
        depth: 8,
        mutants: &[
            // The bank changes while it is read
            ["if is_read = '0' and (one_waits = '1' or done = '1') then", "if one_waits = '1' or done = '1' then"],
            // The frame that waits is forgotten when the next one is done
            ["          one_waits <= done;", "          one_waits <= '0';"],
            // The next frame is written over the one that waits
            ["        writing      <= waiting;\n", ""],
            // The bank that was read is read again instead of the one that waits
            ["          reading <= waiting;\n", ""],
        ],
    },
    Proof {
        entity: "frame_control",
        folder: "rtl/detector",
        generics: &["G_PPC=8", "G_X_BITS=7", "G_Y_BITS=1"],
        depth: 10,
        mutants: &[
            // A beat overwrites the one that waits
            ["<= (can_work and not (held_user and in_frame)) or not held_valid;", "<= '1';"],
            // Ends come that no frame has
            ["if end_pending = '1' and pausing = '0' and room = '1' then", "if pausing = '0' and room = '1' then"],
            // A frame that a new one cuts short has no end
            ["end_pending  <= '1';\n        is_truncated <= '1';", "is_truncated <= '1';"],
            // A row goes on where the one before it ended
            ["            x        <= (others => '0');\n", ""],
            // Pixels beyond the width go through
            ["out_valid <= not is_full;", "out_valid <= '1';"],
            // Pixels outside a frame go through
            ["if held_user = '1' or in_frame = '1' then", "if true then"],
            // The next frame's end counts this one's damages, too
            ["        damaged         <= (others => '0');\n      end if;", "      end if;"],
        ],
    },
];

/// What is to be found out: that the block of a proof holds, or that one of its mutants does not.
type Job = (&'static Proof, Option<usize>);

/// Proves the blocks that are named, or all if none is, and lets every mutant of them fail.
pub fn run_all(named: &[&str]) -> anyhow::Result<()> {
    if let Some(unknown) = named.iter().find(|name| PROOFS.iter().all(|proof| proof.entity != **name)) {
        bail!("no proof of {unknown}; there are {}", PROOFS.map(|proof| proof.entity).join(" "));
    }
    let proofs = || PROOFS.iter().filter(|proof| named.is_empty() || named.contains(&proof.entity));
    let jobs: Vec<Job> = proofs()
        .flat_map(|proof| (0..proof.mutants.len()).map(Some).chain([None]).map(move |mutant| (proof, mutant)))
        .collect();
    in_parallel(&jobs, |(proof, mutant)| match mutant {
        None => proof.prove(),
        Some(number) => proof.refute(*number),
    })?;
    for proof in proofs() {
        println!("{}: proven; {} mutants noticed", proof.entity, proof.mutants.len());
    }
    Ok(())
}

impl Proof {
    fn source(&self) -> PathBuf {
        hw_ip().join(self.folder).join(format!("{}.vhd", self.entity))
    }

    fn prove(&self) -> anyhow::Result<()> {
        let (entity, depth) = (self.entity, self.depth);
        let model = self.model(&self.source(), "")?;
        ensure!(self.holds(&model, false)?, "{entity}: a property fails within {depth} clocks");
        ensure!(self.holds(&model, true)?, "{entity}: the induction over {depth} clocks fails");
        Ok(())
    }

    fn refute(&self, number: usize) -> anyhow::Result<()> {
        let entity = self.entity;
        let [from, to] = self.mutants[number];
        let source = self.source();
        let text = std::fs::read_to_string(&source).with_context(|| format!("cannot read {}", source.display()))?;
        ensure!(text.matches(from).count() == 1, "{entity}: mutant {number} does not fit the source: `{from}`");
        let variant = format!("-mutant-{number}");
        let mutated = work_folder()?.join(format!("{entity}{variant}.vhd"));
        std::fs::write(&mutated, text.replace(from, to)).context("cannot write the mutant")?;
        ensure!(!self.holds(&self.model(&mutated, &variant)?, false)?, "{entity}: no property notices `{to}`");
        Ok(())
    }

    /// The block as a model for the solver.
    fn model(&self, source: &Path, variant: &str) -> anyhow::Result<PathBuf> {
        let folder = work_folder()?.join(format!("formal-{}{variant}", self.entity));
        let ghdl = Ghdl::new(folder.clone())?;
        let mut synth = ghdl.command("--synth");
        synth.arg("--out=verilog").args(self.generics.iter().map(|generic| format!("-g{generic}")));
        synth.arg(source).arg(format!("formal/{}.psl", self.entity)).args(["-e", self.entity]);
        let verilog = formal(&output(synth)?)?;
        std::fs::write(folder.join("model.v"), verilog).context("cannot write the model")?;
        let mut yosys = Command::new("yosys");
        // Merging what is equal lets the induction know that registers of the properties and of the block are
        let script = format!(
            "read_verilog -formal -sv model.v; prep -flatten -top {}; memory_map; opt -full -share_all; dffunmap; \
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
