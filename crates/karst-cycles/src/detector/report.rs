//! `spot_report.vhd`.

use super::fifo::Fifo;
use super::{Generics, Mask, Record};

#[derive(Debug)]
pub struct Report {
    /// Spots of each laser that has some, and whether it is the last one.
    queue: Fifo<(u32, bool)>,
    /// Spots of this laser that are not fetched.
    spots_left: u32,
    /// This laser is the last one.
    is_last: bool,
    fetched: Option<Record>,
    output: Option<Record>,
    is_busy: bool,
    has_frame: bool,
    spots_given: bool,
    frame_stored: bool,
}

impl Report {
    pub fn new(generics: &Generics) -> Self {
        Self {
            queue: Fifo::new(1 << generics.laser_bits, 0),
            spots_left: 0,
            is_last: false,
            fetched: None,
            output: None,
            is_busy: false,
            has_frame: false,
            spots_given: false,
            frame_stored: false,
        }
    }

    /// `ready`.
    pub fn is_ready(&self) -> bool {
        !self.is_busy
    }

    /// `m_axis`.
    pub fn record(&self) -> Option<Record> {
        self.output
    }

    pub fn clock(&mut self, is_frame: bool, mask: Option<Mask>, is_taken: bool) {
        let is_idle = !self.is_busy && self.fetched.is_none() && self.output.is_none();
        if is_idle && mask.is_none() && !is_frame {
            return;
        }
        let passes = self.fetched.is_some() && (is_taken || self.output.is_none());
        let fetches = (passes || self.fetched.is_none()) && (self.spots_left > 0 || self.frame_stored);
        let takes_laser = self.spots_left == 0;
        let stores_frame = self.has_frame && self.spots_given;
        let frame_stored = self.frame_stored;

        if passes {
            self.output = self.fetched;
        } else if is_taken {
            self.output = None;
        }
        if fetches {
            self.fetched = Some(if frame_stored { Record::Frame } else { Record::Spot });
            self.spots_left = self.spots_left.saturating_sub(1);
        } else if passes {
            self.fetched = None;
        }
        if takes_laser {
            self.spots_given |= self.is_last;
            (self.spots_left, self.is_last) = self.queue.first().copied().unwrap_or_default();
        }
        self.is_busy |= mask.is_some();
        self.has_frame |= is_frame;
        if stores_frame {
            self.has_frame = false;
            self.spots_given = false;
            self.frame_stored = true;
        }
        if frame_stored && fetches {
            self.frame_stored = false;
            self.is_busy = false;
        }
        let entry = mask.map(|mask| (mask.slots.count_ones(), mask.last));
        self.queue.clock(entry.filter(|&(spots, is_last)| spots > 0 || is_last), takes_laser);
    }
}
