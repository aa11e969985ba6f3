//! A calibration in parts.

use core::fmt;

use heapless::Vec;
use karst_core::{FixedRig, RigError};
use karst_regs::{MAX_BLOCK_WORDS, OTHER_BLOCKS, RigWords};
use serde::{Deserialize, Serialize};

use crate::checksum::checksum_of;

/// A part of a calibration. "Calibration" on the line is all of a [`FixedRig`]: cameras, lasers, detectors, as words of
/// the IP's settings memory. Each part names the calibration it belongs to, so that parts may come in any order, twice,
/// or after those of another calibration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CalibrationPart {
    /// [`calibration_crc`] of the whole calibration.
    pub crc: u32,
    /// Lasers of the calibration. It has five more parts than that.
    pub lasers: u16,
    /// Number of the part, which is that of a block of [`RigWords`]: 0 limits, 1 and 2 cameras, 3 and 4 detectors, 5
    /// and on lasers.
    pub number: u16,
    /// The words of the block.
    pub words: Vec<u32, MAX_BLOCK_WORDS>,
}

impl CalibrationPart {
    /// A part of the calibration with this [`calibration_crc`]; None beyond the last.
    pub fn new<const LASERS: usize>(words: &RigWords<LASERS>, crc: u32, number: u16) -> Option<Self> {
        let block = Vec::from_slice(words.block(number)?).ok()?;
        Some(Self { crc, lasers: words.lasers(), number, words: block })
    }
}

/// CRC-32 of all words, low byte first, in the order of the parts: a calibration's fingerprint.
pub fn calibration_crc<const LASERS: usize>(words: &RigWords<LASERS>) -> u32 {
    checksum_of(words.blocks().flatten())
}

/// Takes a calibration apart.
#[derive(Debug, Clone)]
pub struct CalibrationSender<const LASERS: usize> {
    words: RigWords<LASERS>,
    crc: u32,
}

impl<const LASERS: usize> CalibrationSender<LASERS> {
    /// Prepares to send a calibration.
    pub fn new(rig: &FixedRig<LASERS>) -> Self {
        let words = RigWords::from(rig);
        let crc = calibration_crc(&words);
        Self { words, crc }
    }

    /// [`calibration_crc`] of the calibration.
    pub fn crc(&self) -> u32 {
        self.crc
    }

    /// One part; None beyond the last.
    pub fn part(&self, number: u16) -> Option<CalibrationPart> {
        CalibrationPart::new(&self.words, self.crc, number)
    }

    /// All parts in order.
    pub fn parts(&self) -> impl Iterator<Item = CalibrationPart> {
        (0..=u16::MAX).map_while(|number| self.part(number))
    }
}

/// Why a part, or the calibration it completes, is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TransferError {
    /// The calibration has more lasers than the receiver can serve.
    TooManyLasers {
        /// Lasers of the calibration.
        found: u16,
        /// Lasers the receiver can serve.
        capacity: u16,
    },
    /// A part that the calibration does not have, or not with so many words.
    NoSuchPart,
    /// All parts are there, and their CRC is not the announced one. All have to be sent again.
    Checksum {
        /// The announced CRC.
        expected: u32,
        /// The CRC of the parts.
        found: u32,
    },
    /// All parts came as they were sent, but a value is out of its range.
    Rig(RigError),
}

impl fmt::Display for TransferError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooManyLasers { found, capacity } => write!(f, "{found} lasers, but at most {capacity} fit"),
            Self::NoSuchPart => write!(f, "a part that the calibration does not have"),
            Self::Checksum { expected, found } => write!(f, "checksum {found:08x}, expected {expected:08x}"),
            Self::Rig(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for TransferError {}

/// Most missing parts that a reply lists.
pub const MAX_MISSING: usize = 16;

/// The receiver's answer to a part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CalibrationReply {
    /// The calibration: [`CalibrationPart::crc`].
    pub crc: u32,
    /// How its transfer stands.
    pub state: TransferState,
}

/// How a transfer stands.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TransferState {
    /// The numbers of the first missing parts: to be sent next.
    Missing(Vec<u16, MAX_MISSING>),
    /// Complete, and checked.
    Complete,
    /// Refused.
    Refused(TransferError),
}

/// What a part has led to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// Parts are missing still.
    Partial,
    /// The calibration is complete, its CRC right, and every value in its range.
    Complete,
}

/// Puts a calibration together again. The parts of another calibration start from nothing; a calibration in use is
/// somewhere else and stays in use until the new one is complete.
#[derive(Debug, Clone)]
pub struct CalibrationReceiver<const LASERS: usize> {
    words: RigWords<LASERS>,
    crc: Option<u32>,
    /// Which parts besides the lasers are there.
    others: [bool; OTHER_BLOCKS as usize],
    lasers: [bool; LASERS],
}

impl<const LASERS: usize> Default for CalibrationReceiver<LASERS> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const LASERS: usize> CalibrationReceiver<LASERS> {
    /// A receiver without any part.
    pub const fn new() -> Self {
        Self { words: RigWords::EMPTY, crc: None, others: [false; OTHER_BLOCKS as usize], lasers: [false; LASERS] }
    }

    /// Forgets all parts, and has room for those of a calibration with so many lasers.
    fn clear(&mut self, lasers: u16) {
        self.words.clear(lasers);
        self.crc = None;
        self.others.fill(false);
        self.lasers.fill(false);
    }

    /// Forgets all parts.
    pub fn reset(&mut self) {
        self.clear(0);
    }

    /// Takes a part.
    pub fn accept(&mut self, part: &CalibrationPart) -> Result<Progress, TransferError> {
        if self.crc != Some(part.crc) || self.words.lasers() != part.lasers {
            self.clear(part.lasers);
            if self.words.lasers() != part.lasers {
                return Err(TransferError::TooManyLasers { found: part.lasers, capacity: LASERS as u16 });
            }
            self.crc = Some(part.crc);
        }
        self.place(part).ok_or(TransferError::NoSuchPart)?;
        if self.missing().next().is_some() {
            return Ok(Progress::Partial);
        }
        let found = calibration_crc(&self.words);
        let checked = if found == part.crc {
            self.words.check().map_err(TransferError::Rig)
        } else {
            Err(TransferError::Checksum { expected: part.crc, found })
        };
        if checked.is_err() {
            self.reset();
        }
        checked.map(|()| Progress::Complete)
    }

    fn place(&mut self, part: &CalibrationPart) -> Option<()> {
        let block = self.words.block_mut(part.number)?;
        if block.len() != part.words.len() {
            return None;
        }
        block.iter_mut().zip(&part.words).for_each(|(to, word)| *to = *word);
        *self.others.iter_mut().chain(&mut self.lasers).nth(part.number.into())? = true;
        Some(())
    }

    /// The numbers of the parts that are missing of the calibration under way; none without one.
    pub fn missing(&self) -> impl Iterator<Item = u16> {
        let lasers = self.lasers.iter().take(self.words.lasers().into());
        let there = self.others.iter().chain(lasers);
        (0..).zip(there).filter(|(_, there)| self.crc.is_some() && !**there).map(|(number, _)| number)
    }

    /// The complete calibration and its [`calibration_crc`].
    pub fn complete(&self) -> Option<(&RigWords<LASERS>, u32)> {
        let crc = self.crc?;
        self.missing().next().is_none().then_some((&self.words, crc))
    }

    /// [`Self::accept`], with the answer for the sender.
    pub fn reply(&mut self, part: &CalibrationPart) -> CalibrationReply {
        let state = match self.accept(part) {
            Ok(Progress::Partial) => TransferState::Missing(self.missing().take(MAX_MISSING).collect()),
            Ok(Progress::Complete) => TransferState::Complete,
            Err(error) => TransferState::Refused(error),
        };
        CalibrationReply { crc: part.crc, state }
    }
}
