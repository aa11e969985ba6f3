//! Bytes to messages.

use core::marker::PhantomData;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::checksum::{CRC_BYTES, checksum};
use crate::encoder::{DELIMITER, MAX_FRAME};
use crate::message::{Command, Message};
use crate::sequence::{Arrival, Sequence};

/// What a decoder has seen. Counters stay at their top value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LinkCounters {
    /// Messages received.
    pub received: u32,
    /// Sequence numbers that never came, those of corrupt frames among them.
    pub lost: u32,
    /// Frames with damage: no COBS, or a wrong CRC.
    pub corrupt: u32,
    /// Frames longer than [`MAX_FRAME`]: two or more whose delimiters were lost, or no frames at all.
    pub oversize: u32,
    /// Messages that came after later ones. They are received, and no longer lost.
    pub reordered: u32,
    /// Frames that came again. They are dropped.
    pub duplicate: u32,
    /// Intact frames that hold no message of this protocol.
    pub unknown: u32,
    /// Sequence numbers that started again without a Hello.
    pub restarts: u32,
}

impl LinkCounters {
    const ZERO: Self =
        Self { received: 0, lost: 0, corrupt: 0, oversize: 0, reordered: 0, duplicate: 0, unknown: 0, restarts: 0 };
}

/// What a decoder finds: [`Message`], or on the sensor [`Command`], which takes less memory.
pub trait Incoming: DeserializeOwned + private::Sealed {}

impl Incoming for Message {}
impl Incoming for Command {}

mod private {
    use crate::message::{Command, Message};

    pub trait Sealed {
        /// Whether the numbering starts again with it.
        fn is_hello(&self) -> bool;
    }

    impl Sealed for Message {
        fn is_hello(&self) -> bool {
            matches!(self, Self::Hello(_))
        }
    }

    impl Sealed for Command {
        fn is_hello(&self) -> bool {
            matches!(self, Self::Hello(_))
        }
    }
}

/// Finds the messages in a stream of bytes.
///
/// All memory is in the value itself: [`MAX_FRAME`] bytes and some counters, less than 384 bytes.
///
/// * A frame ends at a delimiter (0). After any damage the next delimiter makes it whole again.
/// * Corrupt, oversize, unknown and duplicate frames are counted and dropped.
/// * Sequence numbers tell lost and late messages, over the last 64. A Hello starts the numbering again: what was lost
///   just before it is not counted.
#[derive(Debug, Clone)]
pub struct Decoder<M = Message> {
    buffer: [u8; MAX_FRAME],
    /// Bytes since the last delimiter; those beyond the buffer are not kept.
    length: usize,
    sequence: Sequence,
    counters: LinkCounters,
    messages: PhantomData<M>,
}

impl<M: Incoming> Default for Decoder<M> {
    fn default() -> Self {
        Self::new()
    }
}

impl<M: Incoming> Decoder<M> {
    /// A decoder at the start of a stream, or in the middle of one.
    pub const fn new() -> Self {
        Self {
            buffer: [0; MAX_FRAME],
            length: 0,
            sequence: Sequence::NONE,
            counters: LinkCounters::ZERO,
            messages: PhantomData,
        }
    }

    /// What has been seen so far.
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// Takes one byte; gives the message that it completes.
    pub fn push(&mut self, byte: u8) -> Option<M> {
        if byte != DELIMITER {
            if let Some(next) = self.buffer.get_mut(self.length) {
                *next = byte;
            }
            self.length = self.length.saturating_add(1);
            return None;
        }
        match core::mem::take(&mut self.length) {
            // Between the delimiters that end a frame and begin the next one
            0 => None,
            length => self.frame(length),
        }
    }

    /// Takes bytes and hands on the messages that they complete.
    pub fn feed(&mut self, bytes: &[u8], mut received: impl FnMut(M)) {
        for &byte in bytes {
            if let Some(message) = self.push(byte) {
                received(message);
            }
        }
    }

    fn frame(&mut self, length: usize) -> Option<M> {
        let counters = &mut self.counters;
        let Some(frame) = self.buffer.get_mut(..length) else {
            count(&mut counters.oversize);
            return None;
        };
        let Some(content) = intact(frame) else {
            count(&mut counters.corrupt);
            return None;
        };
        let Ok(((number, message), [])) = postcard::take_from_bytes::<(u16, M)>(content) else {
            count(&mut counters.unknown);
            return None;
        };
        if message.is_hello() {
            self.sequence.restart(number);
        } else {
            match self.sequence.arrival(number) {
                Arrival::New { missing } => counters.lost = counters.lost.saturating_add(missing.into()),
                Arrival::Late => {
                    counters.lost = counters.lost.saturating_sub(1);
                    count(&mut counters.reordered);
                }
                Arrival::Duplicate => {
                    count(&mut counters.duplicate);
                    return None;
                }
                Arrival::Restart => count(&mut counters.restarts),
            }
        }
        count(&mut counters.received);
        Some(message)
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

/// The content of a frame, without its CRC, if that is right.
fn intact(frame: &mut [u8]) -> Option<&[u8]> {
    let length = cobs::decode_in_place(frame).ok()?;
    let (content, crc) = frame.get(..length)?.split_last_chunk::<CRC_BYTES>()?;
    (checksum(content) == u32::from_le_bytes(*crc)).then_some(content)
}
