//! Processor, bus and serial line of the SoC: from the results to the bytes on the line.

use std::collections::VecDeque;

use karst_link::Mode;

/// Bits of a byte on the line: start, data, stop; and the clocks that the transmitter takes beside them
/// (`uart_transmit.vhd`).
const BITS: u64 = 10;
const CLOCKS: u64 = 1;

/// G_LOG2_DEPTH of `soc.vhd`: bytes that wait for the line.
const BUFFER: usize = 1 << 11;

/// What the processor does in how many clocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Processor {
    /// From the interrupt until the frame's record is read.
    pub serve: u64,
    /// To read the point of a laser.
    pub read: u64,
    /// To read a spot of each camera and make the point of them.
    pub reconstruct: u64,
    /// To encode a laser's message.
    pub encode_laser: u64,
    /// To encode the frame's last message.
    pub encode_end: u64,
    /// To hand a byte to the line.
    pub put: u64,
    /// Bytes of a laser's message: more for larger coordinates.
    pub laser_bytes: u64,
    /// Bytes of the frame's last message.
    pub end_bytes: u64,
}

/// Fitted to runs of the firmware in the simulated SoC with 6 and 12 lasers. `tests/soc/frames.rs` compares: with 12 lasers,
/// and messages as long as they are in that frame, the first and the last byte come within 2 % of the predicted clocks. How
/// the processor's time divides between its tasks is an estimate.
pub const PROCESSOR: Processor = Processor {
    serve: 4_370,
    read: 360,
    reconstruct: 17_840,
    encode_laser: 8_990,
    encode_end: 8_500,
    put: 20,
    laser_bytes: 42,
    end_bytes: 31,
};

/// Clocks after the interrupt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SensorClocks {
    /// The first byte of the frame's messages begins.
    pub first_byte: u64,
    /// The last one begins.
    pub last_byte: u64,
    /// The processor is done with the frame.
    pub done: u64,
    /// The line is busy with it.
    pub line: u64,
}

impl Processor {
    /// A frame with a spot of each laser in both cameras.
    pub fn frame(&self, mode: Mode, lasers: u64, clocks_per_bit: u64) -> SensorClocks {
        let per_laser = match mode {
            Mode::Accelerated => self.read,
            Mode::Software => self.reconstruct,
        };
        let mut now = self.serve + lasers * per_laser;
        let byte = BITS * clocks_per_bit + CLOCKS;
        let messages = (0..lasers).map(|_| (self.encode_laser, self.laser_bytes));
        // When bytes begin that are in the buffer or were
        let mut begins: VecDeque<u64> = VecDeque::new();
        let (mut first_byte, mut last_byte, mut count) = (None, 0, 0);
        for (encode, bytes) in messages.chain([(self.encode_end, self.end_bytes)]) {
            now += encode;
            for _ in 0..bytes {
                now += self.put;
                if begins.len() > BUFFER {
                    now = now.max(begins.pop_front().unwrap_or(0));
                }
                last_byte = if count == 0 { now } else { now.max(last_byte + byte) };
                begins.push_back(last_byte);
                first_byte.get_or_insert(last_byte);
                count += 1;
            }
        }
        SensorClocks { first_byte: first_byte.unwrap_or(now), last_byte, done: now, line: count * byte }
    }
}
