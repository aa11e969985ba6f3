//! The clocks of every block, by the names of the constants and headers in `hw-ip/rtl`. The only place to change when a
//! pipeline there gets deeper: `cargo xtask hw sim` compares the model with the simulated gateware.

/// `frame_control.vhd`.
pub(crate) mod frame_control {
    /// After a frame, and after a row of less than [`long_row`] pixels.
    pub const PAUSE: u32 = 20;

    /// Fewest pixels of a row that is not followed by a pause.
    pub const fn long_row(pixels_per_clock: u32) -> u32 {
        128 + PAUSE * pixels_per_clock
    }
}

/// `segment.vhd`.
pub(crate) mod segment {
    pub const LATENCY: usize = 11;
}

/// `serialize.vhd`.
pub(crate) mod serialize {
    /// From the register of the beat, which the model has, to the hit.
    pub const OUTPUT: usize = 1;
}

/// `sector.vhd`.
pub(crate) mod sector {
    pub const LATENCY: usize = 26;
}

/// `detector.vhd`.
pub(crate) mod detector {
    /// Words of each of the two buffers.
    pub const BUFFER_DEPTH: usize = 512;
    pub const BEAT_MARGIN: usize = 16;
    pub const HIT_MARGIN: usize = 40;
    pub const QUIET_BITS: u32 = 6;
}

/// `cluster.vhd`.
pub(crate) mod cluster {
    /// Words of a cluster: one step each.
    pub const WORDS: u64 = 12;
    /// Words that tell whether a cluster is near a run, and whether a visit closes it: one step each.
    pub const NEAR_WORDS: u64 = 3;
    pub const VISIT_WORDS: u64 = 2;
    /// S_LOOK and S_FLAGS.
    pub const FLAGS: u64 = 2;
    /// S_DECIDE.
    pub const DECIDE: u64 = 1;
    /// From a step to the clock in which the unit that compares is done with it (`drained`), to the one in which all units
    /// are (`emptied`), and to its word at the output.
    pub const DRAINED: u64 = 6;
    pub const EMPTIED: u64 = 8;
    pub const OUTPUT: u64 = 7;
    /// From the first step of a visit to the clock whose row it compares with.
    pub const ROW: u64 = 1;
}

/// `centroid.vhd`.
pub(crate) mod centroid {
    /// Clocks of a phase beside its steps, and of the phases after the last word and before the record.
    const PHASE: u64 = 2;
    const FIRST_AND_LAST: u64 = 3;
    const INVERSE_FRACTION: u64 = 24;
    const FRACTION: u64 = 14;
    const NOISE_FRACTION: u64 = 16;

    /// From the last word of a spot to its record.
    pub fn latency(x_bits: u32) -> u64 {
        let x_bits = u64::from(x_bits);
        let inverse = x_bits + INVERSE_FRACTION + 1;
        let root = x_bits + 6;
        let column = (x_bits + FRACTION + 1).max(INVERSE_FRACTION + 1);
        let row = NOISE_FRACTION + INVERSE_FRACTION;
        inverse + root + column + row + 4 * PHASE + FIRST_AND_LAST
    }
}

/// `reconstructor_pkg.vhd` and `reconstructor.vhd`.
pub(crate) mod reconstructor {
    /// G_TERMS of karst_top.
    const TERMS: u64 = 8;
    const TO_RIG: u64 = 4;
    /// `best_point.vhd`.
    const BEST_POINT: u64 = 2;
    /// From a pair of `pairing` to `pair_valid(0)`.
    const READ: u64 = 2;

    /// `candidates.vhd`: until the farthest spot of a laser is known.
    pub fn settling(slot_bits: u32) -> u64 {
        2 + u64::from(slot_bits)
    }

    fn divide(quotient_width: u64, bits_per_stage: u64) -> u64 {
        (quotient_width + 1).div_ceil(bits_per_stage) + 2
    }

    fn root(root_width: u64, bits_per_stage: u64) -> u64 {
        (root_width + 1).div_ceil(bits_per_stage) + 1
    }

    fn reciprocal(bits_per_stage: u64) -> u64 {
        3 + 17_u64.div_ceil(bits_per_stage)
    }

    fn exact_reciprocal(bits_per_stage: u64) -> u64 {
        reciprocal(bits_per_stage) + 5
    }

    fn few(bits_per_stage: u64) -> u64 {
        bits_per_stage.min(2)
    }

    /// From a spot to the ray that can be read: T_LINE.
    pub fn line(bits_per_stage: u64) -> u64 {
        let camera_ray = 14 + root(32, few(bits_per_stage)) + 3 * (TERMS - 1);
        let beam_ray = 9 + exact_reciprocal(bits_per_stage);
        1 + camera_ray + beam_ray
    }

    /// From the last pair of a laser to its point.
    pub fn point(bits_per_stage: u64, paper: bool) -> u64 {
        let fusion = exact_reciprocal(bits_per_stage);
        let gain = 16 + reciprocal(bits_per_stage);
        let across = (gain + 11).max(17 + 2 * reciprocal(bits_per_stage));
        let average = 1 + divide(34, 2 * bits_per_stage);
        let mean = fusion + gain + 10 + average + TO_RIG;
        let point = fusion + across + 8;
        READ + if paper { mean } else { point } + BEST_POINT
    }
}

/// `result_banks.vhd` and the interrupt's register.
pub(crate) mod registers {
    /// From `results_done` to the interrupt, if the frame before is acknowledged.
    pub const INTERRUPT: u64 = 2;
}
