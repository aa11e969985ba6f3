//! Messages to frames.

use core::fmt;

use crate::checksum::{CRC_BYTES, checksum};
use crate::message::Message;

/// Longest frame, bytes, with both delimiters. Every message fits.
pub const MAX_FRAME: usize = 256;

/// Sequence number, message and CRC of the longest frame: less two delimiters and the one or two bytes that COBS adds.
pub(crate) const MAX_CONTENT: usize = MAX_FRAME - 4;

/// The buffer does not hold the frame: [`MAX_FRAME`] bytes always do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BufferTooSmall;

impl fmt::Display for BufferTooSmall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the buffer does not hold the frame")
    }
}

impl core::error::Error for BufferTooSmall {}

/// Turns messages into frames and numbers them.
#[derive(Debug, Clone, Default)]
pub struct Encoder {
    sequence: u16,
}

impl Encoder {
    /// Starts with sequence number 0.
    pub fn new() -> Self {
        Self::default()
    }

    /// Writes the frame of a message into a buffer and gives its part of it.
    pub fn encode<'a>(&mut self, message: &Message, buffer: &'a mut [u8]) -> Result<&'a [u8], BufferTooSmall> {
        let mut content = [0; MAX_CONTENT];
        let length = postcard::to_slice(&(self.sequence, message), &mut content).map_err(|_| BufferTooSmall)?.len();
        let (body, rest) = content.split_at_mut(length);
        *rest.first_chunk_mut::<CRC_BYTES>().ok_or(BufferTooSmall)? = checksum(body).to_le_bytes();
        let content = content.get(..length + CRC_BYTES).ok_or(BufferTooSmall)?;

        // A delimiter on either side: damage to the frame before cannot reach into this one
        let (begin, rest) = buffer.split_first_mut().ok_or(BufferTooSmall)?;
        let encoded = cobs::try_encode(content, rest).map_err(|_| BufferTooSmall)?;
        *begin = DELIMITER;
        *rest.get_mut(encoded).ok_or(BufferTooSmall)? = DELIMITER;
        self.sequence = self.sequence.wrapping_add(1);
        buffer.get(..encoded + 2).ok_or(BufferTooSmall)
    }
}

/// The byte between frames, which COBS keeps out of them.
pub(crate) const DELIMITER: u8 = 0;
