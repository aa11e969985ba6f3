//! A recorded stream of the link: a calibration, then spots.

use heapless::Vec;
use karst_core::{Calibration, Spot};
use karst_link::{CalibrationReceiver, CalibrationReply, Decoder, Message};

/// Lasers of the calibration, at most.
pub const LASERS: usize = 12;

/// Most spots per laser and camera.
const CANDIDATES: usize = 4;

/// The spots of one laser.
pub struct LaserCase<'a> {
    /// The calibration.
    pub calibration: &'a Calibration<LASERS>,
    /// Number of the frame.
    pub frame: u32,
    /// Index of the laser.
    pub laser: u16,
    spots: &'a [Vec<Spot, CANDIDATES>; 2],
}

impl LaserCase<'_> {
    /// The spots of the two cameras.
    pub fn spots(&self) -> [&[Spot]; 2] {
        [&self.spots[0], &self.spots[1]]
    }
}

/// Reads a recorded stream: all parts of a calibration, then frames of the spots of one laser each.
pub struct Recording<'a> {
    bytes: core::slice::Iter<'a, u8>,
    decoder: Decoder,
    receiver: CalibrationReceiver<LASERS>,
    /// The one that was received.
    calibration: Option<Calibration<LASERS>>,
    laser: u16,
    spots: [Vec<Spot, CANDIDATES>; 2],
}

impl<'a> Recording<'a> {
    /// At the start of a recording.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes: bytes.iter(),
            decoder: Decoder::new(),
            receiver: CalibrationReceiver::new(),
            calibration: None,
            laser: 0,
            spots: [Vec::new(), Vec::new()],
        }
    }

    /// The next laser's spots. Parts of the calibration before them go to their receiver; `reply` gets its answers.
    pub fn next_case(&mut self, mut reply: impl FnMut(CalibrationReply)) -> Option<LaserCase<'_>> {
        self.spots.iter_mut().for_each(Vec::clear);
        loop {
            match self.decoder.push(*self.bytes.next()?) {
                Some(Message::Calibration(part)) => {
                    reply(self.receiver.reply(&part));
                    self.calibration = self.receiver.complete().map(|(words, _)| words.rig().calibration);
                }
                Some(Message::Spot(spot)) => {
                    self.laser = spot.laser;
                    if let Some(spots) = self.spots.get_mut(usize::from(spot.camera)) {
                        // Spots beyond the capacity would show as a different result
                        let _ = spots.push(spot.spot);
                    }
                }
                Some(Message::FrameEnd(end)) => {
                    let calibration = self.calibration.as_ref()?;
                    return Some(LaserCase { calibration, frame: end.frame, laser: self.laser, spots: &self.spots });
                }
                _ => {}
            }
        }
    }
}
