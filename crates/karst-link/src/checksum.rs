//! The CRC of frames and of calibrations: CRC-32 as in Ethernet and zip files.

use crc::{CRC_32_ISO_HDLC, Crc, Digest, Table};
use postcard::ser_flavors::Flavor;
use serde::Serialize;

/// Bit by bit, without a table: a kilobyte of memory counts for more than speed on a serial line.
type NoTable = Table<0>;

static CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Bytes of a CRC.
pub(crate) const CRC_BYTES: usize = 4;

pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// The CRC of the encoding of a sequence of values.
pub(crate) fn checksum_of(values: impl Iterator<Item = impl Serialize>) -> u32 {
    let mut digest = CRC.digest();
    for value in values {
        // The sink takes every byte, and derived serialisation of these types has no other way to fail
        if let Ok(next) = postcard::serialize_with_flavor(&value, Sink(digest.clone())) {
            digest = next;
        }
    }
    digest.finalize()
}

/// Takes encoded bytes into a CRC.
struct Sink(Digest<'static, u32, NoTable>);

impl Flavor for Sink {
    type Output = Digest<'static, u32, NoTable>;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.0.update(&[byte]);
        Ok(())
    }

    fn finalize(self) -> postcard::Result<Self::Output> {
        Ok(self.0)
    }
}
