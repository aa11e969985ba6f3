//! Proofs: properties of blocks for any length of time, and mutants of each block on which they fail.
//!
//! The properties are PSL, in a unit of `hw-ip/formal` with the block's name that sees into it. They are proven by
//! k-induction (what holds from the reset on for K clocks, and in a clock after any K clocks in which it held, holds for
//! ever), or by ABC's property-directed reachability, which itself finds what one clock has to know of the one before. A
//! proof is worth what it notices: each of the mutants has to fail.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

use super::convert::{Ghdl, formal};
use super::{hw_ip, in_parallel, setup, work_folder};
use crate::{output, run};

/// How a block is proven.
#[derive(Clone, Copy)]
enum Method {
    /// By k-induction: clocks of the base case and of the induction.
    Induction(u32),
    /// By reachability.
    Reachability,
}

use Method::{Induction, Reachability};

/// A block, in the size in which it is proven.
struct Proof {
    entity: &'static str,
    /// Folder of its file.
    folder: &'static str,
    /// Files that it needs, in the order of analysis.
    needs: &'static [&'static str],
    generics: &'static [&'static str],
    /// What is left out: outputs of these instances, and these signals, may be anything. As yosys selects them.
    cut: &'static [&'static str],
    method: Method,
    /// Changes of the source that the properties have to notice.
    mutants: &'static [[&'static str; 2]],
}

const PROOFS: [Proof; 22] = [
    Proof {
        entity: "fifo",
        folder: "rtl/detector",
        needs: &[],
        generics: &["G_WIDTH=4", "G_LOG2_DEPTH=2"],
        cut: &[],
        method: Induction(10),
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
        needs: &[],
        generics: &["G_PPC=4", "G_X_BITS=7", "G_Y_BITS=1"],
        cut: &[],
        method: Induction(8),
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
        needs: &[],
        generics: &["G_X_BITS=7", "G_Y_BITS=1", "G_LASER_BITS=1"],
        cut: &[],
        method: Induction(6),
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
        needs: &[],
        generics: &["G_X_BITS=7", "G_Y_BITS=1", "G_LASER_BITS=1", "G_SLOT_BITS=1"],
        cut: &[],
        method: Induction(5),
        mutants: &[
            // A cluster gives a frame's record, too
            ["frame_valid <= word_frame;", "frame_valid <= '1';"],
            // A frame gives a spot
            ["if word_frame = '0' then", "if true then"],
            // The first phase may end before it begins
            ["          is_last <= '0';\n          if word_valid", "          if word_valid"],
            // A phase goes on with the steps of the one before
            ["        step <= (others => '0');\n", ""],
        ],
    },
    Proof {
        entity: "cluster",
        folder: "rtl/detector",
        needs: &[],
        generics: &["G_X_BITS=7", "G_Y_BITS=1", "G_LASER_BITS=1", "G_SLOT_BITS=1"],
        cut: &["cluster/w:not_below", "cluster/w:negative"],
        method: Reachability,
        mutants: &[
            // The place changes a clock too early
            [
                "      write_next    <= write_laser & number(target);\n      write_address <= write_next;",
                "      write_address <= write_laser & number(target);",
            ],
            // Words come while those of the cluster before are on their way
            ["may_copy <= words_ready and not copies;", "may_copy <= words_ready;"],
            // The last laser has no mask
            ["if state = S_WALK and laser_is_last = '1' then", "if state = S_WALK and visit_is_last = '1' then"],
            // A run that joins clusters is never done
            ["go <= drained or not (joins or step.fewest);", "go <= not (joins or step.fewest);"],
            // After a cluster went to centroid there is no end
            ["if word_valid = '1' and word_last = '1' then", "if word_frame = '1' and word_last = '1' then"],
            // Sums are written before all clusters are in them
            ["        step.last <= go;", "        step.last <= '1';"],
        ],
    },
    Proof {
        entity: "spot_report",
        folder: "rtl/detector",
        needs: &["rtl/detector/fifo.vhd"],
        generics: &["G_X_BITS=7", "G_Y_BITS=1", "G_LASER_BITS=1", "G_SLOT_BITS=1"],
        cut: &[],
        method: Reachability,
        mutants: &[
            // A last laser without spots is forgotten
            ["(mask_slots /= NONE or mask_last = '1')", "mask_slots /= NONE"],
            // What is at the output is overwritten
            ["fetched_valid and (m_axis_tready or not m_axis_tvalid);", "fetched_valid;"],
            // A laser's second spot is forgotten when the next laser is there
            ["queue_ready <= nor slots_left;", "queue_ready <= '1';"],
            // The frame's record comes before the last spots
            ["spots_given <= spots_given or is_last;", "spots_given <= '1';"],
            // The frame's record is read where a spot's was
            [
                "when spots_given = '1' or frame_stored = '1' else\n                   resize(unsigned(laser)",
                "when spots_given = '1' else\n                   resize(unsigned(laser)",
            ],
        ],
    },
    Proof {
        entity: "detector",
        folder: "rtl/detector",
        needs: &[
            "rtl/math/rounding.vhd",
            "rtl/math/delay.vhd",
            "rtl/math/delay_memory.vhd",
            "rtl/math/multiply.vhd",
            "rtl/math/azimuth.vhd",
            "rtl/detector/fifo.vhd",
            "rtl/detector/frame_control.vhd",
            "rtl/detector/classify.vhd",
            "rtl/detector/segment.vhd",
            "rtl/detector/serialize.vhd",
            "rtl/detector/sector.vhd",
            "rtl/detector/run.vhd",
            "rtl/detector/cluster.vhd",
            "rtl/detector/centroid.vhd",
            "rtl/detector/spot_report.vhd",
        ],
        // 8 pixels per clock fill the first buffer fastest
        generics: &["G_PPC=8", "G_X_BITS=7", "G_Y_BITS=1", "G_LASER_BITS=1", "G_SLOT_BITS=1"],
        cut: &[
            "segment*/c:*classify_i",
            "detector/w:beats_out",
            "detector/c:run_i",
            "detector/c:cluster_i",
            "detector/c:centroid_i",
            "detector/c:report_i",
        ],
        method: Induction(65),
        // In smaller buffers, which fill within the clocks of the base case
        mutants: &[
            // Beats are on their way for more clocks than words fit
            ["G_LOG2_DEPTH => 9, G_MARGIN => BEAT_MARGIN", "G_LOG2_DEPTH => 4, G_MARGIN => 10"],
            // Hits are
            ["G_LOG2_DEPTH => 9, G_MARGIN => HIT_MARGIN", "G_LOG2_DEPTH => 4, G_MARGIN => 16"],
        ],
    },
    Proof {
        entity: "sqrt_sequential",
        folder: "rtl/math",
        needs: &[],
        generics: &["G_WIDTH=6", "G_ROUND=true"],
        cut: &[],
        method: Induction(10),
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
        needs: &[],
        generics: &["G_NUMERATOR_WIDTH=5", "G_DENOMINATOR_WIDTH=4", "G_QUOTIENT_WIDTH=4"],
        cut: &[],
        method: Induction(12),
        mutants: &[
            ["done <= not out_ready;", "done <= '0';"],
            ["in_ready  <= not busy and not done;", "in_ready  <= not busy;"],
        ],
    },
    Proof {
        entity: "pairing",
        folder: "rtl/reconstructor",
        needs: &[],
        generics: &["G_SLOT_BITS=1"],
        cut: &[],
        method: Induction(12),
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
        entity: "candidates",
        folder: "rtl/reconstructor",
        needs: &["rtl/reconstructor/reconstructor_pkg.vhd"],
        generics: &["G_LASERS=2", "G_SLOT_BITS=2"],
        cut: &[],
        method: Induction(7),
        mutants: &[
            // A bank seems settled just after a mask
            ["for i in valid_at'range loop", "for i in 2 to FOUND + 1 loop"],
            // The farthest slot is kept for the laser of another mask
            ["farthest_ones(to_integer(place_at(FOUND)))", "farthest_ones(to_integer(mask_place))"],
            // A slot without a spot is the farthest one
            ["rounds(round - 1)(2 * i + 1).any = '1' and (rounds", "(rounds"],
            // Masks change without news
            ["if mask_valid = '1' then\n        masks", "if true then\n        masks"],
            // Radii go to the wrong bank
            ["spot_place <= spot_bank &", "spot_place <= mask_bank &"],
        ],
    },
    Proof {
        entity: "best_point",
        folder: "rtl/reconstructor",
        needs: &["rtl/reconstructor/reconstructor_pkg.vhd"],
        generics: &["G_PAYLOAD_WIDTH=2"],
        cut: &[],
        method: Induction(8),
        mutants: &[
            // A pair is compared with the best one before the pair before it
            [
                "((was_better = '1' and beats_before = '1') or (was_better = '0' and beats_best = '1'))",
                "(beats_best = '1')",
            ],
            // The nearest point is the best one
            ["beats_best   <= '1' when along > best_along", "beats_best   <= '1' when along < best_along"],
            // A point of one camera replaces one of two
            ["(pair_single = best_single and", "(true and"],
            // Pairs that do not count are taken
            ["pair_counts = '1' and pair_outcome = POINT", "pair_outcome = POINT"],
            // The outcome of the laser before goes on
            ["so_far_or_reason <= pair_reason when pair_first = '1' else so_far;", "so_far_or_reason <= so_far;"],
        ],
    },
    Proof {
        entity: "wishbone_to_axi_lite",
        folder: "rtl/soc",
        needs: &[],
        generics: &["G_ADDRESS_BITS=4"],
        cut: &[],
        method: Reachability,
        mutants: &[
            // A request is passed on again while it is acknowledged
            ["if stb = '1' and acknowledged = '0' then", "if stb = '1' then"],
            // An address is withdrawn when the data are taken
            ["if m_axi_awready = '1' then", "if m_axi_awready = '1' or m_axi_wready = '1' then"],
            // A write reads, too
            ["arvalid   <= not we;", "arvalid   <= '1';"],
            // Writes have no data if the slave waits with the address
            ["wvalid    <= we;", "wvalid    <= we and m_axi_awready;"],
            // An access never ends
            ["          under_way    <= '0';\n          acknowledged <= '1';", "          acknowledged <= '1';"],
            // The error of an access stays for the next one
            ["      err          <= '0';\n      if under_way", "      if under_way"],
            // Errors of reads are not told
            [
                "(m_axi_bvalid and m_axi_bresp(1)) or (m_axi_rvalid and m_axi_rresp(1))",
                "m_axi_bvalid and m_axi_bresp(1)",
            ],
            // EXOKAY is told as an error
            ["m_axi_rresp(1))", "(m_axi_rresp(1) or m_axi_rresp(0)))"],
            // An access is acknowledged before its answer
            ["if m_axi_bvalid = '1' or m_axi_rvalid = '1' then", "if true then"],
        ],
    },
    Proof {
        entity: "wishbone_bus",
        folder: "rtl/soc",
        needs: &["rtl/soc/generated/soc_map_pkg.vhd"],
        generics: &[],
        cut: &[],
        method: Induction(4),
        mutants: &[
            // The map of the IP repeats
            ["elsif region = KARST_REGION and is_karst = '1' then", "elsif region = KARST_REGION then"],
            // The request after one to nothing is acknowledged at once
            ["acknowledged <= is_nothing and not acknowledged;", "acknowledged <= is_nothing;"],
            // An access to nothing is no error
            ["err             <= acknowledged;", "err             <= '0';"],
            // The IP gets requests to peripherals, too
            ["      peripherals_stb <= stb;", "      peripherals_stb <= stb;\n      karst_stb       <= stb;"],
            // An access to nothing never ends
            ["      is_nothing <= stb;", "      is_nothing <= '0';"],
            // An access to nothing reads as one to the RAM
            ["dat_miso        <= (others => '0');", "dat_miso        <= ram_dat;"],
        ],
    },
    Proof {
        entity: "uart_transmit",
        folder: "rtl/soc",
        needs: &[],
        generics: &[],
        cut: &[],
        // A start bit and the first data bits
        method: Induction(16),
        mutants: &[
            // Every other bit is left out
            ["shift    <= '1' & shift(8 downto 1);", "shift    <= \"11\" & shift(8 downto 2);"],
            // Bits are a clock too long
            ["elsif wait_for > 1 then", "elsif wait_for > 0 then"],
            // A byte is taken while another one is sent
            ["in_ready <= '1' when left = 0 else '0';", "in_ready <= '1' when left <= 9 else '0';"],
            // There is no start bit
            ["shift    <= in_data & '0';", "shift    <= '1' & in_data;"],
        ],
    },
    Proof {
        entity: "uart_receive",
        folder: "rtl/soc",
        needs: &[],
        generics: &[],
        cut: &[],
        // A start bit and the first data bits
        method: Induction(14),
        mutants: &[
            // The highest bit comes first
            ["shift <= line(1) & shift(7 downto 1);", "shift <= shift(6 downto 0) & line(1);"],
            // Bits are looked at where they end
            ["wait_for <= '0' & clocks_per_bit(15 downto 1);", "wait_for <= clocks_per_bit;"],
            // A bit is looked at a clock later than the one before it
            ["elsif wait_for > 1 then", "elsif wait_for > 0 then"],
            // Bits are looked at a clock too early
            ["if line(2 downto 1) = \"10\" then", "if line(1 downto 0) = \"10\" then"],
        ],
    },
    Proof {
        entity: "frame_gate",
        folder: "rtl/top",
        needs: &[],
        generics: &["G_DATA_BITS=4", "G_Y_BITS=2"],
        cut: &[],
        method: Induction(8),
        mutants: &[
            // A beat overwrites one that is not taken
            ["slot_free(camera)     <= m_axis_tready(camera) or not held(camera);", "slot_free(camera)     <= '1';"],
            // The end of a frame is lost if the next one is not taken
            ["(now_taken(camera) or (s_axis_tuser(camera) and frame_taken(camera)))", "now_taken(camera)"],
            // Half a pair is taken
            ["takes(camera)      <= taken(OTHER) when is_partner(camera) = '1' else", "takes(camera)      <="],
            // The first pair after a reset has the other bank
            ["pair_bank <= '1';", "pair_bank <= '0';"],
            // Beats of frames that are not taken come out
            ["held(camera) <= passes(camera);", "held(camera) <= beat_taken(camera);"],
        ],
    },
    Proof {
        entity: "frame_tags",
        folder: "rtl/top",
        needs: &[],
        generics: &[],
        cut: &[],
        method: Induction(5),
        mutants: &[
            // There is room while records of two frames wait
            ["not unmasked(1) and not unrecorded(1);", "not unmasked(1);"],
            // A frame that goes in while one comes out is not counted
            ["elsif more = '0' and less = '1' then", "elsif less = '1' then"],
            // Records are of the frame that masks come of
            ["record_bank   <= banks(to_integer(records));", "record_bank   <= banks(to_integer(masks));"],
            // The frame before becomes one of a pair
            ["paired(to_integer(newest)) <= finish_paired;", "paired(to_integer(newest + 1)) <= finish_paired;"],
            // The last frame's bank becomes that of the one before it, too
            ["        newest                        <= newest + 1;\n", ""],
        ],
    },
    Proof {
        entity: "frame_results",
        folder: "rtl/top",
        needs: &["rtl/regs/generated/karst_map_pkg.vhd"],
        generics: &["G_Y_BITS=2"],
        cut: &[],
        method: Induction(10),
        mutants: &[
            // A camera's record is taken while a point is written
            ["(not s_axis_tlast(0) or not point_valid)", "'1'"],
            // Both cameras' records are taken at once
            ["not (point_valid or (is_ours(0) and is_last(0)))", "not point_valid"],
            // Records of the next pair go into this one
            [
                "<= record_paired(camera) and not counted(camera) when record_bank(camera) = bank else '0';",
                "<= record_paired(camera);",
            ],
            // Records of frames without a partner are written
            ["<= record_paired(camera) and not counted(camera) when", "<= not counted(camera) when"],
            // Points are made before the masks of camera 2
            ["all_masked(at(bank)) and all_masked(2 + at(bank)) and", "all_masked(at(bank)) and"],
            // The frame's record does not wait for that of camera 2
            ["pointed and counted(0) and counted(1) and", "pointed and counted(0) and"],
            // Spots are counted on from those of the frame before
            ["          spots(camera) <= (others => '0');\n          if", "          if"],
            // The clocks of the pair are told of the other bank
            [
                "unsigned(ends(at(bank))) - unsigned(starts(at(bank)))",
                "unsigned(ends(at(bank))) - unsigned(starts(at(not bank)))",
            ],
        ],
    },
    Proof {
        entity: "axi_lite_slave",
        folder: "rtl/regs",
        needs: &[],
        generics: &["G_ADDRESS_BITS=4"],
        cut: &[],
        method: Induction(15),
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
        needs: &[],
        generics: &[],
        cut: &[],
        method: Induction(8),
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
        needs: &[],
        generics: &["G_PPC=8", "G_X_BITS=7", "G_Y_BITS=1"],
        cut: &[],
        method: Induction(10),
        mutants: &[
            // A beat overwrites the one that waits
            ["<= (can_work and not (held_user and in_frame)) or not held_valid;", "<= '1';"],
            // Ends come that no frame has
            ["if end_pending = '1' and pausing = '0' and room = '1' then", "if pausing = '0' and room = '1' then"],
            // A frame that a new one cuts short has no end
            ["end_pending  <= '1';\n        is_truncated <= '1';", "is_truncated <= '1';"],
            // A row goes on where the one before it ended
            ["            x         <= (others => '0');\n", ""],
            // The last row comes a row late
            ["is_last_y <= '1' when next_y = last_y else '0';", "is_last_y <= '1' when y = last_y else '0';"],
            // A short row without a pause
            ["            is_long   <= '0';\n", ""],
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

/// The generics with which a block is proven.
pub fn size_of(entity: &str) -> &'static [&'static str] {
    PROOFS.iter().find(|proof| proof.entity == entity).map_or(&[], |proof| proof.generics)
}

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
        let entity = self.entity;
        let model = self.model(&self.source(), "")?;
        match self.method {
            Induction(depth) => {
                ensure!(holds_by_smt(&model, depth, false)?, "{entity}: a property fails within {depth} clocks");
                ensure!(holds_by_smt(&model, depth, true)?, "{entity}: the induction over {depth} clocks fails");
            }
            Reachability => ensure!(holds_by_reachability(&model)?, "{entity}: a property fails"),
        }
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
        let model = self.model(&mutated, &variant)?;
        let holds = match self.method {
            Induction(depth) => holds_by_smt(&model, depth, false)?,
            Reachability => holds_by_reachability(&model)?,
        };
        ensure!(!holds, "{entity}: no property notices `{to}`");
        Ok(())
    }

    /// The block as a model for the solver.
    fn model(&self, source: &Path, variant: &str) -> anyhow::Result<PathBuf> {
        let folder = work_folder()?.join(format!("formal-{}{variant}", self.entity));
        let ghdl = Ghdl::new(folder.clone())?;
        let mut synth = ghdl.command("--synth");
        synth.arg("--out=verilog").args(self.generics.iter().map(|generic| format!("-g{generic}")));
        synth.args(self.needs).arg(source).arg(format!("formal/{}.psl", self.entity)).args(["-e", self.entity]);
        let verilog = formal(&output(synth)?)?;
        std::fs::write(folder.join("model.v"), verilog).context("cannot write the model")?;
        let mut yosys = Command::new("yosys");
        let commands = match self.method {
            // What no property depends on goes. Merging what is equal lets the induction know that registers of the properties and of the block are
            Induction(_) => {
                "delete -output; memory_map; opt -full -share_all; dffunmap; opt_clean -purge; write_smt2 -wires model.smt2"
            }
            Reachability => {
                "setundef -undriven -anyseq; delete -output; memory_map; opt -full; techmap; opt -fast; dffunmap; \
                 abc -g AND -fast; opt_clean; write_aiger -I -B -zinit model.aig"
            }
        };
        let mut cut = String::new();
        if !self.cut.is_empty() {
            let parts = self.cut.iter().map(|part| format!("select -assert-any {part}; cutpoint {part}; "));
            cut = format!("hierarchy -top {}; proc; {}", self.entity, parts.collect::<String>());
        }
        let script = format!("read_verilog -formal -sv model.v; {cut}prep -flatten -top {}; {commands}", self.entity);
        yosys.args(["-q", "-p", &script]).current_dir(&folder);
        run(yosys)?;
        Ok(folder)
    }
}

/// Whether all properties hold, from reset on for some clocks, or by induction over them.
fn holds_by_smt(model: &Path, depth: u32, induction: bool) -> anyhow::Result<bool> {
    let mut solver = Command::new("yosys-smtbmc");
    solver.args(["-s", "yices", "-t", &depth.to_string()]).args(induction.then_some("-i"));
    solver.arg("model.smt2").current_dir(model).env("PATH", setup::path_with_python_tools()?);
    verdict(solver, "Status: PASSED", "Status: FAILED")
}

/// Whether all properties hold in every state that can be reached.
fn holds_by_reachability(model: &Path) -> anyhow::Result<bool> {
    let mut solver = Command::new("yosys-abc");
    solver.args(["-c", "read_aiger model.aig; fold; strash; pdr; print_status"]).current_dir(model);
    verdict(solver, "Property proved.", "was asserted in frame")
}

/// What a solver finds out.
fn verdict(mut solver: Command, proven: &str, refuted: &str) -> anyhow::Result<bool> {
    let result = solver.output().with_context(|| format!("cannot start {}", solver.get_program().to_string_lossy()))?;
    let text = String::from_utf8_lossy(&result.stdout);
    match (text.contains(proven), text.contains(refuted)) {
        (true, false) => Ok(true),
        (false, true) => Ok(false),
        _ => bail!("the solver ended without a status:\n{text}{}", String::from_utf8_lossy(&result.stderr)),
    }
}
