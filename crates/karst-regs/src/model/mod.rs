//! A software model of the IP: `karst-core` behind the registers, for tests without hardware.
//!
//! It behaves as the gateware does, row by row, except that it knows no clock: the cycle counters are zero, a commit takes
//! effect as soon as no frame is under way, and results are ready with the last pixel.

mod decode;
mod registers;

use std::convert::Infallible;

use karst_core::{Calibration, FixedRig, FrameStatus, Method, RowError, Spot, SpotDetector, reconstruct};

use crate::RegisterBus;
pub use registers::{Event, RESULT_WORDS, Registers};

/// Candidate spots per laser.
const SLOTS: usize = 4;

/// What the frames are processed with.
struct Active<const LASERS: usize> {
    // Boxes: for 720 lasers these are too large for a stack
    calibration: Box<Calibration<LASERS>>,
    detectors: [Box<SpotDetector<LASERS, SLOTS>>; 2],
    heights: [u16; 2],
    method: Method,
}

/// A frame of one camera that is under way.
#[derive(Clone, Copy)]
struct Current {
    /// Its pixels are processed.
    taken: bool,
    /// The other camera's frame of the same pair has started as well.
    paired: bool,
    /// Rows so far.
    rows: u16,
    /// Number of the pair.
    pair: u32,
}

/// A frame of one camera that waits for the other camera's.
struct Finished {
    status: FrameStatus,
    spots: Vec<Vec<Spot>>,
}

/// The IP for up to `LASERS` lasers with four candidate spots each.
///
/// Frames of the two cameras are a pair if the second one starts before half the rows of the first one are there: cameras
/// less than half a frame apart find together from any state. A pair is taken or not as a whole, as decided when the
/// first of its frames starts.
pub struct Model<const LASERS: usize> {
    registers: Registers,
    active: Option<Active<LASERS>>,
    current: [Option<Current>; 2],
    finished: [Option<Finished>; 2],
    pairs: u32,
}

impl<const LASERS: usize> Default for Model<LASERS> {
    fn default() -> Self {
        Self {
            registers: Registers::new(LASERS, SLOTS),
            active: None,
            current: [None; 2],
            finished: [None, None],
            pairs: 0,
        }
    }
}

impl<const LASERS: usize> RegisterBus for Model<LASERS> {
    type Error = Infallible;

    fn read32(&mut self, address: u32) -> Result<u32, Infallible> {
        Ok(self.registers.read(address))
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), Infallible> {
        if self.registers.write(address, value) {
            // A frame under way goes on, but not for us
            for current in self.current.iter_mut().flatten() {
                current.taken = false;
            }
            self.finished = [None, None];
            self.tell_in_frame();
        }
        self.try_commit();
        Ok(())
    }
}

impl<const LASERS: usize> Model<LASERS> {
    /// The IP after a reset.
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether the interrupt line is up.
    pub fn interrupt(&self) -> bool {
        self.registers.interrupt()
    }

    /// Whether a frame of `camera` (0 or 1) has started and not ended, taken or not.
    pub fn is_in_frame(&self, camera: usize) -> bool {
        self.current[camera].is_some()
    }

    /// Takes a row of `camera` (0 or 1): R, G, B of each pixel from left to right. `start`: it is the first of a frame.
    pub fn row(&mut self, camera: usize, start: bool, rgb: &[u8]) {
        if start {
            self.end_frame(camera);
            // A commit that waits for the end of the frame before this one comes after its start
            self.start_frame(camera);
            self.try_commit();
        }
        let Some(active) = &mut self.active else { return };
        let Some(current) = &mut self.current[camera] else {
            if self.registers.enabled() {
                self.registers.event(Event::StrayRow(camera));
            }
            return;
        };
        current.rows += 1;
        let is_last = current.rows >= active.heights[camera];
        if current.taken
            && let Err(RowError::Length { expected, found }) = active.detectors[camera].row(rgb)
        {
            let event = if found < expected { Event::ShortRow } else { Event::LongRow };
            self.registers.event(event(camera));
        }
        if is_last {
            self.end_frame(camera);
            self.try_commit();
        }
    }

    fn start_frame(&mut self, camera: usize) {
        let enabled = self.registers.enabled() && self.active.is_some();
        let height = self.active.as_ref().map_or(0, |active| active.heights[1 - camera]);
        let partner =
            self.current[1 - camera].as_mut().filter(|other| !other.paired && other.rows < height.div_ceil(2));
        let (taken, paired, pair) = match partner {
            Some(other) => {
                other.paired = true;
                (other.taken, true, other.pair)
            }
            None => {
                let taken = enabled && !self.registers.committing();
                self.pairs = self.pairs.wrapping_add(taken.into());
                (taken, false, self.pairs)
            }
        };
        self.current[camera] = Some(Current { taken, paired, rows: 0, pair });
        if taken {
            if let Some(active) = &mut self.active {
                active.detectors[camera].start_frame();
            }
        } else if enabled && self.registers.committing() {
            self.registers.event(Event::Skipped);
        }
        self.tell_in_frame();
    }

    fn end_frame(&mut self, camera: usize) {
        let (Some(current), Some(active)) = (self.current[camera].take(), &mut self.active) else { return };
        self.registers.set_in_frame(camera, false);
        if current.taken {
            let detector = &mut active.detectors[camera];
            let status = detector.end_frame();
            if status.truncated {
                self.registers.event(Event::Truncated(camera));
            }
            if status.overflow > 0 {
                self.registers.event(Event::Overflow(camera));
            }
            if current.paired {
                let spots = (0..active.calibration.lasers.len()).map(|laser| detector.spots(laser).to_vec()).collect();
                self.finished[camera] = Some(Finished { status, spots });
            } else {
                self.registers.event(Event::Unpaired);
            }
            if let [Some(_), Some(_)] = self.finished {
                self.give_results(current.pair);
            }
        }
    }

    /// Writes the results of a pair and makes them ready.
    fn give_results(&mut self, pair: u32) {
        let (Some(active), [Some(first), Some(second)]) =
            (&self.active, [self.finished[0].take(), self.finished[1].take()])
        else {
            return;
        };
        let registers = &mut self.registers;
        for (camera, Finished { status, spots }) in [&first, &second].into_iter().enumerate() {
            let records = spots.iter().enumerate().flat_map(|(laser, spots)| spots.iter().map(move |s| (laser, s)));
            let mut count = 0;
            for (laser, spot) in records {
                registers.write_spot(camera, count, decode::spot_words(laser, spot));
                count += 1;
            }
            registers.write_result(1 + camera, decode::camera_words(status, count));
        }
        let lasers = active.calibration.lasers.len();
        for laser in 0..lasers {
            let spots = [first.spots[laser].as_slice(), second.spots[laser].as_slice()];
            let point = reconstruct(&active.calibration, laser, spots, active.method);
            registers.write_result(4 + laser, decode::point_words(&point));
        }
        let mut frame = [0; RESULT_WORDS];
        frame[..3].copy_from_slice(&[pair, registers.commits(), lasers as u32]);
        registers.write_result(0, frame);
        registers.finish_frame();
    }

    /// Has a commit take effect if no frame is under way.
    fn try_commit(&mut self) {
        let under_way = self.current.iter().flatten().any(|current| current.taken);
        if under_way || self.finished.iter().any(Option::is_some) {
            return;
        }
        let was_configured = self.registers.configured();
        let Some(memory) = self.registers.finish_commit() else { return };
        self.active = decode::settings::<LASERS>(memory).and_then(|(words, method)| {
            let FixedRig { calibration, detectors } = words.rig();
            let heights = detectors.each_ref().map(|config| config.height);
            let [first, second] = detectors.map(|config| SpotDetector::new(config).map(Box::new));
            let detectors = [first.ok()?, second.ok()?];
            Some(Active { calibration: Box::new(calibration), detectors, heights, method })
        });
        if !was_configured {
            // Until now no one knew where a frame ends
            self.current = [None; 2];
        }
    }

    fn tell_in_frame(&mut self) {
        for (camera, current) in self.current.iter().enumerate() {
            self.registers.set_in_frame(camera, current.is_some_and(|current| current.taken));
        }
    }
}
