//! A calibration in parts.

use core::fmt;

use heapless::Vec;
use karst_core::{
    Calibration, CameraCalibration, DetectorConfig, FixedRig, I18F14, LaserCalibration, ReconstructionSettings,
    RigError, SpotNoise, Thresholds,
};
use serde::{Deserialize, Serialize};

use crate::checksum::checksum_of;

/// A part of a calibration. "Calibration" on the line is all of a [`FixedRig`]: cameras, lasers, detectors. Each part names the calibration it belongs to, so that parts may come in any order, twice, or
/// after those of another calibration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CalibrationPart {
    /// [`calibration_crc`] of the whole calibration.
    pub crc: u32,
    /// Lasers of the calibration. It has five more parts than that.
    pub lasers: u16,
    /// What the part holds.
    pub piece: Piece,
}

/// What a part holds. Parts are numbered: 0 settings, 1 and 2 cameras, 3 and 4 detectors, 5 and on lasers.
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
    /// A detector.
    Detector {
        /// Camera, 0 or 1.
        index: u8,
        /// Its configuration without the angles of the lasers.
        detector: DetectorConfig<0>,
    },
    /// A laser.
    Laser {
        /// Index of the laser.
        index: u16,
        /// Its beam.
        laser: LaserCalibration,
        /// Its angle in the image of each camera: [`DetectorConfig::azimuths`].
        azimuths: [u16; 2],
    },
}

/// Parts besides the lasers.
const OTHER_PARTS: u16 = 5;

fn piece<const LASERS: usize>(rig: &FixedRig<LASERS>, number: u16) -> Option<Piece> {
    let FixedRig { calibration, detectors } = rig;
    Some(match number {
        0 => Piece::Settings(calibration.settings),
        1 => Piece::Camera { index: 0, camera: calibration.cameras[0].clone() },
        2 => Piece::Camera { index: 1, camera: calibration.cameras[1].clone() },
        3 => Piece::Detector { index: 0, detector: with_azimuths(&detectors[0], Vec::new()) },
        4 => Piece::Detector { index: 1, detector: with_azimuths(&detectors[1], Vec::new()) },
        _ => {
            let index = number - OTHER_PARTS;
            let laser = *calibration.lasers.get(usize::from(index))?;
            let azimuth = |camera: usize| detectors[camera].azimuths.get(usize::from(index)).copied();
            Piece::Laser { index, laser, azimuths: [azimuth(0)?, azimuth(1)?] }
        }
    })
}

/// The configuration with other angles of the lasers.
fn with_azimuths<const FROM: usize, const TO: usize>(
    detector: &DetectorConfig<FROM>,
    azimuths: Vec<u16, TO>,
) -> DetectorConfig<TO> {
    DetectorConfig {
        width: detector.width,
        height: detector.height,
        thresholds: detector.thresholds,
        centre: detector.centre,
        mirror_radius: detector.mirror_radius,
        inner_radius: detector.inner_radius,
        cluster_gap: detector.cluster_gap,
        min_pixels: detector.min_pixels,
        clockwise: detector.clockwise,
        azimuths,
        sector_half_width: detector.sector_half_width,
        noise: detector.noise,
    }
}

/// A rig before its parts have come.
fn no_rig<const LASERS: usize>() -> FixedRig<LASERS> {
    let detector = || DetectorConfig {
        width: 0,
        height: 0,
        thresholds: Thresholds::default(),
        centre: [I18F14::ZERO; 2],
        mirror_radius: 0,
        inner_radius: 0,
        cluster_gap: 0,
        min_pixels: 0,
        clockwise: false,
        azimuths: Vec::new(),
        sector_half_width: 0,
        noise: SpotNoise { floor: 0, noise: 0 },
    };
    FixedRig { calibration: Calibration::default(), detectors: [detector(), detector()] }
}

/// CRC-32 of the encoding of all pieces in the order of their numbers: a calibration's fingerprint.
pub fn calibration_crc<const LASERS: usize>(rig: &FixedRig<LASERS>) -> u32 {
    checksum_of((0..=u16::MAX).map_while(|number| piece(rig, number)))
}

/// Takes a calibration apart.
#[derive(Debug, Clone)]
pub struct CalibrationSender<'a, const LASERS: usize> {
    rig: &'a FixedRig<LASERS>,
    crc: u32,
}

impl<'a, const LASERS: usize> CalibrationSender<'a, LASERS> {
    /// Prepares to send a calibration.
    pub fn new(rig: &'a FixedRig<LASERS>) -> Self {
        Self { rig, crc: calibration_crc(rig) }
    }

    /// The same with a [`calibration_crc`] that is known already.
    pub fn with_crc(rig: &'a FixedRig<LASERS>, crc: u32) -> Self {
        Self { rig, crc }
    }

    /// [`calibration_crc`] of the calibration.
    pub fn crc(&self) -> u32 {
        self.crc
    }

    /// One part; None beyond the last.
    pub fn part(&self, number: u16) -> Option<CalibrationPart> {
        let piece = piece(self.rig, number)?;
        Some(CalibrationPart { crc: self.crc, lasers: self.rig.calibration.lasers.len() as u16, piece })
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
    rig: FixedRig<LASERS>,
    crc: Option<u32>,
    /// Which parts besides the lasers are there.
    others: [bool; OTHER_PARTS as usize],
    lasers: [bool; LASERS],
}

impl<const LASERS: usize> Default for CalibrationReceiver<LASERS> {
    fn default() -> Self {
        Self { rig: no_rig(), crc: None, others: [false; OTHER_PARTS as usize], lasers: [false; LASERS] }
    }
}

impl<const LASERS: usize> CalibrationReceiver<LASERS> {
    /// A receiver without any part.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a part.
    pub fn accept(&mut self, part: &CalibrationPart) -> Result<Progress, TransferError> {
        if self.crc != Some(part.crc) || self.rig.calibration.lasers.len() != usize::from(part.lasers) {
            *self = Self::default();
            let too_many = TransferError::TooManyLasers { found: part.lasers, capacity: LASERS as u16 };
            self.rig.calibration.lasers.resize_default(part.lasers.into()).map_err(|_| too_many)?;
            self.make_room(part.lasers);
            self.crc = Some(part.crc);
        }
        self.place(&part.piece).ok_or(TransferError::NoSuchPart)?;
        if self.missing().next().is_some() {
            return Ok(Progress::Partial);
        }
        let found = calibration_crc(&self.rig);
        let checked = if found == part.crc {
            self.rig.check().map_err(TransferError::Rig)
        } else {
            Err(TransferError::Checksum { expected: part.crc, found })
        };
        if checked.is_err() {
            *self = Self::default();
        }
        checked.map(|()| Progress::Complete)
    }

    fn make_room(&mut self, lasers: u16) {
        for detector in &mut self.rig.detectors {
            // As many as the calibration has room for
            let _ = detector.azimuths.resize_default(lasers.into());
        }
    }

    fn place(&mut self, piece: &Piece) -> Option<()> {
        let FixedRig { calibration, detectors } = &mut self.rig;
        match piece {
            Piece::Settings(settings) => {
                calibration.settings = *settings;
                self.others[0] = true;
            }
            Piece::Camera { index, camera } => {
                let index = usize::from(*index);
                calibration.cameras.get_mut(index)?.clone_from(camera);
                *self.others.get_mut(1 + index)? = true;
            }
            Piece::Detector { index, detector } => {
                let index = usize::from(*index);
                let place = detectors.get_mut(index)?;
                *place = with_azimuths(detector, core::mem::take(&mut place.azimuths));
                *self.others.get_mut(3 + index)? = true;
            }
            Piece::Laser { index, laser, azimuths } => {
                let index = usize::from(*index);
                *calibration.lasers.get_mut(index)? = *laser;
                for (detector, &azimuth) in detectors.iter_mut().zip(azimuths) {
                    *detector.azimuths.get_mut(index)? = azimuth;
                }
                *self.lasers.get_mut(index)? = true;
            }
        }
        Some(())
    }

    /// The numbers of the parts that are missing of the calibration under way; none without one.
    pub fn missing(&self) -> impl Iterator<Item = u16> {
        let lasers = self.lasers.iter().take(self.rig.calibration.lasers.len());
        let there = self.others.iter().chain(lasers);
        (0..).zip(there).filter(|(_, there)| self.crc.is_some() && !**there).map(|(number, _)| number)
    }

    /// The complete calibration.
    pub fn complete(&self) -> Option<&FixedRig<LASERS>> {
        (self.crc.is_some() && self.missing().next().is_none()).then_some(&self.rig)
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
