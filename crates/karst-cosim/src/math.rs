//! Operands and expected results of the math blocks. The numbers of the blocks and the places of the operands are those
//! of `hw-ip/sim/math_blocks.vhd`.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail, ensure};
use clap::ValueEnum;
use karst_math::{
    azimuth, div_round, horner_with_derivative, normalise, reciprocal, reciprocal_coarse, sqrt_floor, sqrt_round,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A block of `math_blocks.vhd`, in the order of its generic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Block {
    /// 64-bit root, rounded down.
    SqrtFloor,
    /// 64-bit root, rounded.
    SqrtRound,
    /// 23-bit root, rounded.
    SqrtNarrow,
    /// 64-bit division.
    Divide,
    /// 57 by 33 bits into 26.
    DivideNarrow,
    /// Five terms with the derivative.
    Horner,
    /// Coordinates below 2^16.
    Azimuth,
    /// Coordinates below 2^15.
    AzimuthNarrow,
    /// 64-bit root, rounded, one bit per clock.
    SqrtSequential,
    /// 64-bit division, one bit per clock.
    DivideSequential,
    /// Reciprocal of a word, above it the shift, three bits per stage.
    Reciprocal,
    /// The same without the step of Newton's method, one bit per stage.
    ReciprocalCoarse1,
    /// Two bits per stage.
    ReciprocalCoarse2,
    /// Three bits per stage.
    ReciprocalCoarse3,
    /// Four bits per stage.
    ReciprocalCoarse4,
}

/// Operands of one calculation, as the words of `in_data`.
type Operands = [u32; 6];

const COEFFICIENTS: usize = 5;

impl Block {
    /// The name on the command line.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Whether the result waits until it is taken. That of a pipeline does not.
    fn has_handshake(self) -> bool {
        matches!(self, Self::SqrtSequential | Self::DivideSequential)
    }

    /// What `out_data` has to be.
    fn twin(self, operands: &Operands) -> u64 {
        let wide = |i: usize| u64::from(operands[i]) | u64::from(operands[i + 1]) << 32;
        let both = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
        match self {
            Self::SqrtFloor => sqrt_floor(wide(0)).into(),
            Self::SqrtRound | Self::SqrtSequential => sqrt_round(wide(0)).into(),
            Self::SqrtNarrow => {
                let root = sqrt_round(wide(0));
                u64::from(root.min((1 << 12) - 1))
            }
            Self::Divide | Self::DivideSequential => div_round(wide(0) as i64, wide(2) as i64) as u64,
            Self::DivideNarrow => {
                let largest = (1 << 25) - 1;
                div_round(wide(0) as i64, wide(2) as i64).clamp(-largest, largest) as u64
            }
            Self::Reciprocal => {
                let (normalised, shift) = normalise(operands[0]);
                both(reciprocal(normalised), shift)
            }
            Self::ReciprocalCoarse1 | Self::ReciprocalCoarse2 | Self::ReciprocalCoarse3 | Self::ReciprocalCoarse4 => {
                let (normalised, shift) = normalise(operands[0]);
                both(reciprocal_coarse(normalised), shift)
            }
            Self::Horner => {
                let coefficients: [i32; COEFFICIENTS] = std::array::from_fn(|i| operands[i + 1] as i32);
                let (value, derivative) = horner_with_derivative(&coefficients, operands[0] as i32);
                both(value as u32, derivative as u32)
            }
            Self::Azimuth | Self::AzimuthNarrow => azimuth(operands[0] as i32, operands[1] as i32).into(),
        }
    }

    /// The formats of the operands: signed or not, bits, and least and largest value.
    fn formats(self) -> Vec<Format> {
        let coordinate = |bits: u32| Format { low: 1 - (1 << bits), high: (1 << bits) - 1 };
        match self {
            Self::SqrtFloor | Self::SqrtRound | Self::SqrtSequential => vec![Format::unsigned(64)],
            Self::SqrtNarrow => vec![Format::unsigned(23)],
            Self::Divide | Self::DivideSequential => vec![Format::signed(64); 2],
            Self::DivideNarrow => vec![Format::signed(57), Format::signed(33)],
            Self::Reciprocal
            | Self::ReciprocalCoarse1
            | Self::ReciprocalCoarse2
            | Self::ReciprocalCoarse3
            | Self::ReciprocalCoarse4 => vec![Format::unsigned(32)],
            Self::Horner => vec![Format::signed(32); 1 + COEFFICIENTS],
            Self::Azimuth => vec![coordinate(16); 2],
            Self::AzimuthNarrow => vec![coordinate(15); 2],
        }
    }

    /// Places values of the formats in the words of `in_data`.
    fn place(self, values: &[i128]) -> Operands {
        let wide = matches!(
            self,
            Self::SqrtFloor
                | Self::SqrtRound
                | Self::SqrtNarrow
                | Self::SqrtSequential
                | Self::Divide
                | Self::DivideSequential
                | Self::DivideNarrow
        );
        let mut operands = Operands::default();
        for (i, &value) in values.iter().enumerate() {
            if wide {
                operands[2 * i] = value as u32;
                operands[2 * i + 1] = (value >> 32) as u32;
            } else {
                operands[i] = value as u32;
            }
        }
        operands
    }

    /// Edge operands in all combinations, then `count` random ones.
    fn operands(self, count: u64) -> impl Iterator<Item = Operands> {
        let formats = self.formats();
        // All combinations of two operands; of six, too many: edges are mixed at random below
        let edges: Vec<Operands> = match formats.as_slice() {
            [one] => one.edges().into_iter().map(|a| self.place(&[a])).collect(),
            [one, two] => {
                let (a, b) = (one.edges(), two.edges());
                a.iter().flat_map(|&a| b.iter().map(move |&b| self.place(&[a, b]))).collect()
            }
            _ => Vec::new(),
        };
        let every_edge: Vec<Vec<i128>> = formats.iter().map(Format::edges).collect();
        let mut random = ChaCha8Rng::seed_from_u64(self as u64);
        let randoms = (0..count).map(move |_| {
            let values: Vec<i128> = formats
                .iter()
                .zip(&every_edge)
                .map(|(format, edges)| match random.random_range(0..8) {
                    0 => edges[random.random_range(0..edges.len())],
                    1..4 => format.of_any_magnitude(&mut random),
                    _ => random.random_range(format.low..=format.high),
                })
                .collect();
            self.place(&values)
        });
        edges.into_iter().chain(randoms)
    }
}

/// The values of an operand.
#[derive(Clone, Copy)]
struct Format {
    low: i128,
    high: i128,
}

impl Format {
    fn unsigned(bits: u32) -> Self {
        Self { low: 0, high: (1 << bits) - 1 }
    }

    fn signed(bits: u32) -> Self {
        Self { low: -(1 << (bits - 1)), high: (1 << (bits - 1)) - 1 }
    }

    /// Both ends, zero, and the powers of two with their neighbours.
    fn edges(&self) -> Vec<i128> {
        let powers = (0..=64).flat_map(|bit| [-1, 0, 1].map(|add| (1_i128 << bit) + add));
        let both = powers.flat_map(|power| [power, -power]);
        let mut edges: Vec<i128> = both
            .chain([self.low, self.low + 1, self.high - 1, self.high])
            .filter(|v| (self.low..=self.high).contains(v))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// As many small values as large ones.
    fn of_any_magnitude(&self, random: &mut ChaCha8Rng) -> i128 {
        let shift = random.random_range(0..64);
        random.random_range(self.low..=self.high) >> shift
    }
}

/// Writes a file of operands and results for `tb_math.vhd`.
pub fn write_vectors(block: Block, count: u64, path: &Path) -> anyhow::Result<()> {
    let file = File::create(path).with_context(|| format!("cannot create {}", path.display()))?;
    let mut file = BufWriter::new(file);
    // Edge combinations are too many for the slow simulator: every seventeenth
    let edges = block.operands(0).step_by(17);
    let random = block.operands(count).skip(block.operands(0).count());
    for operands in edges.chain(random) {
        for word in operands.iter().rev() {
            write!(file, "{word:08x}")?;
        }
        writeln!(file, " {:016x}", block.twin(&operands))?;
    }
    file.flush().with_context(|| format!("cannot write {}", path.display()))
}

/// Streams operands through a simulation and compares; gives their number.
pub fn compare(block: Block, count: u64, executable: &Path) -> anyhow::Result<u64> {
    let mut simulation = Command::new(executable)
        .args(["1", "32", if block.has_handshake() { "64" } else { "0" }])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start {}", executable.display()))?;
    let (Some(input), Some(output)) = (simulation.stdin.take(), simulation.stdout.take()) else {
        bail!("the simulation has no pipes");
    };
    let writer = std::thread::spawn(move || -> std::io::Result<()> {
        let mut input = BufWriter::with_capacity(1 << 16, input);
        for operands in block.operands(count) {
            for word in operands {
                input.write_all(&word.to_le_bytes())?;
            }
        }
        input.flush()
    });
    let mut output = BufReader::with_capacity(1 << 16, output);
    let mut compared = 0;
    for operands in block.operands(count) {
        let mut found = [0; 8];
        output.read_exact(&mut found).with_context(|| format!("result {compared} is missing"))?;
        let (found, expected) = (u64::from_le_bytes(found), block.twin(&operands));
        ensure!(found == expected, "{operands:08x?}: expected {expected:#018x}, found {found:#018x}");
        compared += 1;
    }
    let rest = output.read_to_end(&mut Vec::new()).context("cannot read the results")?;
    ensure!(rest == 0, "{rest} bytes after the last result");
    let Ok(written) = writer.join() else { bail!("the writer has panicked") };
    written.context("the simulation did not take all operands")?;
    let status = simulation.wait().context("the simulation is lost")?;
    ensure!(status.success(), "the simulation failed: {status}");
    Ok(compared)
}
