//! The CRC of frames and of calibrations: CRC-32 as in Ethernet and zip files.

use crc::{CRC_32_ISO_HDLC, Crc, Table};

/// Bit by bit, without a table: a kilobyte of memory counts for more than speed on a serial line.
type NoTable = Table<0>;

static CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Bytes of a CRC.
pub(crate) const CRC_BYTES: usize = 4;

pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// The CRC of words, low byte first.
pub(crate) fn checksum_of<'a>(words: impl Iterator<Item = &'a u32>) -> u32 {
    let mut digest = CRC.digest();
    words.for_each(|word| digest.update(&word.to_le_bytes()));
    digest.finalize()
}
