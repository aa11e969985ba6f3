//! A calibration in parts.

use core::fmt;

use heapless::Vec;
use karst_core::{Calibration, CameraCalibration, LaserCalibration, ReconstructionSettings};
use serde::{Deserialize, Serialize};

use crate::checksum::checksum_of;

/// A part of a calibration. Each names the calibration it belongs to, so that parts may come in any order, twice, or
/// after those of another calibration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CalibrationPart {
    /// [`calibration_crc`] of the whole calibration.
    pub crc: u32,
    /// Lasers of the calibration. It has three more parts than that.
    pub lasers: u16,
    /// What the part holds.
    pub piece: Piece,
}

/// What a part holds. Parts are numbered: 0 settings, 1 and 2 cameras, 3 and on lasers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Piece {
    /// Acceptance limits.
    Settings(ReconstructionSettings),
    /// A camera.
    Camera {
        /// Camera, 0 or 1.
        index: u8,
        /// Its model.
        camera: CameraCalibration,
    },
    /// A laser.
    Laser {
        /// Index of the laser.
        index: u16,
        /// Its beam.
        laser: LaserCalibration,
    },
}

/// Parts besides the lasers.
const OTHER_PARTS: u16 = 3;

fn piece<const LASERS: usize>(calibration: &Calibration<LASERS>, number: u16) -> Option<Piece> {
    Some(match number {
        0 => Piece::Settings(calibration.settings),
        1 => Piece::Camera { index: 0, camera: calibration.cameras[0].clone() },
        2 => Piece::Camera { index: 1, camera: calibration.cameras[1].clone() },
        _ => {
            let index = number - OTHER_PARTS;
            Piece::Laser { index, laser: *calibration.lasers.get(usize::from(index))? }
        }
    })
}

/// CRC-32 of the encoding of all pieces in the order of their numbers: a calibration's fingerprint.
pub fn calibration_crc<const LASERS: usize>(calibration: &Calibration<LASERS>) -> u32 {
    checksum_of((0..=u16::MAX).map_while(|number| piece(calibration, number)))
}

/// Takes a calibration apart.
#[derive(Debug, Clone)]
pub struct CalibrationSender<'a, const LASERS: usize> {
    calibration: &'a Calibration<LASERS>,
    crc: u32,
}

impl<'a, const LASERS: usize> CalibrationSender<'a, LASERS> {
    /// Prepares to send a calibration.
    pub fn new(calibration: &'a Calibration<LASERS>) -> Self {
        Self { calibration, crc: calibration_crc(calibration) }
    }

    /// [`calibration_crc`] of the calibration.
    pub fn crc(&self) -> u32 {
        self.crc
    }

    /// One part; None beyond the last.
    pub fn part(&self, number: u16) -> Option<CalibrationPart> {
        let piece = piece(self.calibration, number)?;
        Some(CalibrationPart { crc: self.crc, lasers: self.calibration.lasers.len() as u16, piece })
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
    /// A camera or laser that the calibration does not have.
    NoSuchPart,
    /// All parts are there, and their CRC is not the announced one. All have to be sent again.
    Checksum {
        /// The announced CRC.
        expected: u32,
        /// The CRC of the parts.
        found: u32,
    },
}

impl fmt::Display for TransferError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooManyLasers { found, capacity } => write!(f, "{found} lasers, but at most {capacity} fit"),
            Self::NoSuchPart => write!(f, "a part that the calibration does not have"),
            Self::Checksum { expected, found } => write!(f, "checksum {found:08x}, expected {expected:08x}"),
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
    /// The calibration is complete, and its CRC right.
    Complete,
}

/// Puts a calibration together again. The parts of another calibration start from nothing; a calibration in use is
/// somewhere else and stays in use until the new one is complete.
#[derive(Debug, Clone)]
pub struct CalibrationReceiver<const LASERS: usize> {
    calibration: Calibration<LASERS>,
    crc: Option<u32>,
    settings: bool,
    cameras: [bool; 2],
    lasers: [bool; LASERS],
}

impl<const LASERS: usize> Default for CalibrationReceiver<LASERS> {
    fn default() -> Self {
        Self {
            calibration: Calibration::default(),
            crc: None,
            settings: false,
            cameras: [false; 2],
            lasers: [false; LASERS],
        }
    }
}

impl<const LASERS: usize> CalibrationReceiver<LASERS> {
    /// A receiver without any part.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a part.
    pub fn accept(&mut self, part: &CalibrationPart) -> Result<Progress, TransferError> {
        if self.crc != Some(part.crc) || self.calibration.lasers.len() != usize::from(part.lasers) {
            *self = Self::default();
            let too_many = TransferError::TooManyLasers { found: part.lasers, capacity: LASERS as u16 };
            self.calibration.lasers.resize_default(part.lasers.into()).map_err(|_| too_many)?;
            self.crc = Some(part.crc);
        }
        self.place(&part.piece).ok_or(TransferError::NoSuchPart)?;
        if self.missing().next().is_some() {
            return Ok(Progress::Partial);
        }
        let found = calibration_crc(&self.calibration);
        if found != part.crc {
            *self = Self::default();
            return Err(TransferError::Checksum { expected: part.crc, found });
        }
        Ok(Progress::Complete)
    }

    fn place(&mut self, piece: &Piece) -> Option<()> {
        match piece {
            Piece::Settings(settings) => {
                self.calibration.settings = *settings;
                self.settings = true;
            }
            Piece::Camera { index, camera } => {
                self.calibration.cameras.get_mut(usize::from(*index))?.clone_from(camera);
                *self.cameras.get_mut(usize::from(*index))? = true;
            }
            Piece::Laser { index, laser } => {
                *self.calibration.lasers.get_mut(usize::from(*index))? = *laser;
                *self.lasers.get_mut(usize::from(*index))? = true;
            }
        }
        Some(())
    }

    /// The numbers of the parts that are missing of the calibration under way; none without one.
    pub fn missing(&self) -> impl Iterator<Item = u16> {
        let lasers = self.lasers.iter().take(self.calibration.lasers.len());
        let there = [self.settings, self.cameras[0], self.cameras[1]].into_iter().chain(lasers.copied());
        (0..).zip(there).filter(|(_, there)| self.crc.is_some() && !there).map(|(number, _)| number)
    }

    /// The complete calibration.
    pub fn complete(&self) -> Option<&Calibration<LASERS>> {
        (self.crc.is_some() && self.missing().next().is_none()).then_some(&self.calibration)
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
