//! Which protocol two ends speak.

use core::fmt;

use serde::{Deserialize, Serialize};

/// The newest protocol this crate speaks.
pub const PROTOCOL: u8 = 2;

/// The oldest protocol this crate speaks.
pub const OLDEST_PROTOCOL: u8 = 2;

/// Who is there: the first message of both ends, repeated until the other end's has come. It stays as it is in every
/// version of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hello {
    /// Oldest protocol spoken.
    pub oldest_protocol: u8,
    /// Newest protocol spoken.
    pub newest_protocol: u8,
    /// Version of the program: major, minor, patch.
    pub program: [u8; 3],
    /// Lasers it can serve.
    pub lasers: u16,
}

/// Two ends without a common protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Incompatible {
    /// Oldest and newest protocol spoken here.
    pub ours: [u8; 2],
    /// Oldest and newest protocol spoken there.
    pub theirs: [u8; 2],
}

impl fmt::Display for Incompatible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([a, b], [c, d]) = (self.ours, self.theirs);
        write!(f, "the other end speaks protocol {c} to {d}, this one {a} to {b}: update the older one")
    }
}

impl core::error::Error for Incompatible {}

impl Hello {
    /// The message of a program that uses this crate.
    pub const fn new(program: [u8; 3], lasers: u16) -> Self {
        Self { oldest_protocol: OLDEST_PROTOCOL, newest_protocol: PROTOCOL, program, lasers }
    }

    /// The protocol to speak with the other end: the newest that both know. Both ends find the same.
    pub fn agree(&self, other: &Self) -> Result<u8, Incompatible> {
        let newest = self.newest_protocol.min(other.newest_protocol);
        if newest < self.oldest_protocol.max(other.oldest_protocol) {
            return Err(Incompatible {
                ours: [self.oldest_protocol, self.newest_protocol],
                theirs: [other.oldest_protocol, other.newest_protocol],
            });
        }
        Ok(newest)
    }
}
