//! The simulated SoC: unmodified firmware, pixels and a serial line. Format: `hw-ip/sim/soc_harness.cpp`.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::num::NonZeroU16;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use karst_regs::soc::{DATA_BYTES, PROGRAM_BASE, PROGRAM_BYTES};
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader};

/// Clocks per microsecond of the simulated SoC: the default of soc.vhd.
pub const CLOCKS_PER_US: u64 = 100;

/// Clocks per bit of its serial line: the default of soc.vhd.
pub const CLOCKS_PER_BIT: u32 = 33;

/// Why there is no simulation.
#[derive(Debug, thiserror::Error)]
pub enum SocError {
    /// It does not start.
    #[error("cannot start the simulation {}: {source}", .path.display())]
    Start {
        /// Its program.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It has ended, or does not take commands.
    #[error("the simulation has ended: {0}")]
    Ended(#[from] io::Error),
    /// The firmware is no ELF file for the processor.
    #[error("the firmware is no ELF file for the processor: {0}")]
    NotAProgram(#[from] object::Error),
    /// The firmware is for another memory.
    #[error("the firmware is not for the memory of this SoC")]
    OtherMemory,
}

/// A row of pixels on its way to a camera's input.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    /// R, G, B of each pixel.
    pub rgb: &'a [u8],
    /// tuser on its first beat.
    pub start: bool,
    /// tlast on its last beat.
    pub last: bool,
    /// It is the last one of its frame.
    pub ends_frame: bool,
    /// Idle clocks after it.
    pub idle: u32,
}

/// How a camera's input is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Camera {
    /// Frames of which the last row was taken so far.
    pub frames: u32,
    /// Clocks of the first and of the last beat of the last one.
    pub span: [u64; 2],
    /// Beats that are still to be taken.
    pub pending: u32,
    /// Clocks in which a beat had to wait.
    pub stalled: u64,
}

/// How the SoC is seen from outside.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct State {
    /// Clocks since the first reset.
    pub clock: u64,
    /// The lasers are on.
    pub lasers: bool,
    /// The trigger is high.
    pub trigger: bool,
    /// Rising edges of the trigger so far.
    pub triggers: u32,
    /// Clock of the last one.
    pub last_trigger: u64,
    /// Pairs of frames whose results the IP has made ready so far.
    pub results: u32,
    /// Clock of the last ones.
    pub last_results: u64,
    /// The cameras' inputs.
    pub cameras: [Camera; 2],
    /// Bytes to the sensor that are still to be sent.
    pub unsent: u32,
}

/// A byte from the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Byte {
    /// The byte.
    pub byte: u8,
    /// When its start bit began.
    pub clock: u64,
}

/// A simulation of the SoC.
#[derive(Debug)]
pub struct Soc {
    process: Child,
    input: BufWriter<ChildStdin>,
    output: BufReader<ChildStdout>,
    state: State,
    received: Vec<Byte>,
}

impl Soc {
    /// Starts a simulation (the program that `cargo xtask hw soc` makes) with a program (an ELF file's content).
    pub fn new(executable: &Path, image: &[u8]) -> Result<Self, SocError> {
        let words = words_of(image)?;
        let mut process = Command::new(executable)
            .arg(CLOCKS_PER_BIT.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|source| SocError::Start { path: executable.to_owned(), source })?;
        let (Some(input), Some(output)) = (process.stdin.take(), process.stdout.take()) else {
            return Err(io::Error::from(io::ErrorKind::BrokenPipe).into());
        };
        let (input, output) = (BufWriter::with_capacity(1 << 16, input), BufReader::new(output));
        let mut soc = Self { process, input, output, state: State::default(), received: Vec::new() };
        soc.command(b'L', &[&length(&words).to_le_bytes()])?;
        for word in words {
            soc.put(&word.to_le_bytes())?;
        }
        Ok(soc)
    }

    /// Resets for some clocks. The RAM stays as it is, and so do bytes and rows that are still to be sent.
    pub fn reset(&mut self, clocks: u32) -> io::Result<()> {
        self.command(b'Z', &[&clocks.to_le_bytes()])
    }

    /// Sends bytes to the sensor, after those that are still to be sent.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.command(b'U', &[&length(bytes).to_le_bytes(), bytes])
    }

    /// Sends a row of pixels, after those that are still to be sent.
    pub fn row(&mut self, camera: usize, row: &Row) -> io::Result<()> {
        let flags = u8::from(row.start) | u8::from(row.last) << 1 | u8::from(row.ends_frame) << 2;
        // AXI4-Stream Video: G in the low byte, then B, then R
        let bytes: Vec<u8> = row.rgb.as_chunks().0.iter().flat_map(|&[r, g, b]| [g, b, r]).collect();
        let count = length(&bytes);
        self.command(b'P', &[&[camera as u8, flags], &row.idle.to_le_bytes(), &count.to_le_bytes(), &bytes])
    }

    /// Sends a frame without faults: R, G, B of each pixel, and the idle clocks after each row.
    pub fn frame(&mut self, camera: usize, rgb: &[u8], width: usize, idle: u32) -> io::Result<()> {
        let rows = rgb.chunks(3 * width);
        let last = rows.len().saturating_sub(1);
        rows.enumerate().try_for_each(|(y, rgb)| {
            self.row(camera, &Row { rgb, start: y == 0, last: true, ends_frame: y == last, idle })
        })
    }

    /// Writes the waves of so many clocks from that one on into a file (VCD). Only a simulation that is built for it can.
    pub fn dump_waves(&mut self, file: &Path, from: u64, clocks: u64) -> io::Result<()> {
        // Made here, so that what is wrong with it has a name
        File::create(file).map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", file.display())))?;
        let name = file.as_os_str().as_encoded_bytes();
        self.command(b'T', &[&from.to_le_bytes(), &clocks.to_le_bytes(), &length(name).to_le_bytes(), name])
    }

    /// From here on a microsecond of the SoC has so many clocks, as its time_prescaler would have it: what takes the firmware
    /// seconds is simulated sooner. None: as it was built. The time of the simulation's host goes on as before.
    pub fn set_clocks_per_us(&mut self, clocks: Option<NonZeroU16>) -> io::Result<()> {
        self.command(b'C', &[&clocks.map_or(0, |clocks| u32::from(clocks.get())).to_le_bytes()])
    }

    /// From here on no access of the processor to the IP is answered, until the watchdog's reset.
    pub fn hang_bus(&mut self) -> io::Result<()> {
        self.command(b'H', &[])
    }

    /// Leads an access of the processor to the IP astray, after so many others: to an address where nothing is.
    pub fn fail_access(&mut self, after: u32) -> io::Result<()> {
        self.command(b'E', &[&after.to_le_bytes()])
    }

    /// Lets some clocks go by.
    pub fn step(&mut self, clocks: u64) -> io::Result<&State> {
        self.command(b'R', &[&clocks.to_le_bytes()])?;
        self.input.flush()?;
        let clock = self.number()?;
        let [pins] = self.get()?;
        let (triggers, last_trigger) = (self.number_32()?, self.number()?);
        let (results, last_results) = (self.number_32()?, self.number()?);
        let mut cameras = [Camera::default(); 2];
        for camera in &mut cameras {
            *camera = Camera {
                frames: self.number_32()?,
                span: [self.number()?, self.number()?],
                pending: self.number_32()?,
                stalled: self.number()?,
            };
        }
        let (unsent, count) = (self.number_32()?, self.number_32()?);
        for _ in 0..count {
            let [byte] = self.get()?;
            let clock = self.number()?;
            self.received.push(Byte { byte, clock });
        }
        let (lasers, trigger) = (pins & 1 != 0, pins & 2 != 0);
        self.state = State { clock, lasers, trigger, triggers, last_trigger, results, last_results, cameras, unsent };
        Ok(&self.state)
    }

    /// How it was after the last step.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The bytes that have come from the sensor since the last call.
    pub fn received(&mut self) -> Vec<Byte> {
        std::mem::take(&mut self.received)
    }

    fn command(&mut self, name: u8, parts: &[&[u8]]) -> io::Result<()> {
        self.put(&[name])?;
        parts.iter().try_for_each(|part| self.put(part))
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.input.write_all(bytes)
    }

    fn get<const BYTES: usize>(&mut self) -> io::Result<[u8; BYTES]> {
        let mut bytes = [0; BYTES];
        self.output.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn number(&mut self) -> io::Result<u64> {
        self.get().map(u64::from_le_bytes)
    }

    fn number_32(&mut self) -> io::Result<u32> {
        self.get().map(u32::from_le_bytes)
    }
}

impl Drop for Soc {
    /// Ends the simulation.
    fn drop(&mut self) {
        // It may have ended by itself
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// How many there are. Nothing that is sent is longer than a frame.
fn length<T>(items: &[T]) -> u32 {
    items.len() as u32
}

/// What an ELF file puts into the RAM, in words from its start.
pub fn words_of(image: &[u8]) -> Result<Vec<u32>, SocError> {
    let header = FileHeader32::<object::LittleEndian>::parse(image)?;
    let endian = header.endian()?;
    let mut bytes = Vec::new();
    for segment in header.program_headers(endian, image)? {
        let data = segment.data(endian, image).unwrap_or_default();
        if segment.p_type(endian) != PT_LOAD || data.is_empty() {
            continue;
        }
        let from = segment.p_paddr(endian).checked_sub(PROGRAM_BASE).ok_or(SocError::OtherMemory)? as usize;
        let to = from + data.len();
        if to > (PROGRAM_BYTES + DATA_BYTES) as usize {
            return Err(SocError::OtherMemory);
        }
        if bytes.len() < to {
            bytes.resize(to.next_multiple_of(4), 0);
        }
        bytes[from..to].copy_from_slice(data);
    }
    Ok(bytes.as_chunks().0.iter().map(|&word| u32::from_le_bytes(word)).collect())
}
