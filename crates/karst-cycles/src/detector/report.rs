//! `spot_report.vhd`.

use super::fifo::Fifo;
use super::{Generics, Mask, Record};

#[derive(Debug)]
pub struct Report {
    /// Spots of each laser that has some, and whether it is the last one.
    queue: Fifo<(u32, bool)>,
    /// Spots of the laser at the head that are fetched.
    fetched_spots: u32,
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
            fetched_spots: 0,
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

    pub fn clock(&mut self, is_spot: bool, is_frame: bool, mask: Option<Mask>, is_taken: bool) {
        let is_idle = !self.is_busy && self.fetched.is_none() && self.output.is_none();
        if is_idle && mask.is_none() && !is_frame {
            return;
        }
        let head = self.queue.first().copied();
        let left = head.map_or(0, |(spots, _)| spots - self.fetched_spots);
        let passes = self.fetched.is_some() && (is_taken || self.output.is_none());
        let stores_frame = self.has_frame && self.spots_given;
        let fetches =
            (passes || self.fetched.is_none()) && (left > 0 || self.frame_stored) && !is_spot && !stores_frame;
        let head_taken = left == 0 || (left == 1 && fetches);
        let stored_before = self.frame_stored;

        if passes {
            self.output = self.fetched;
        } else if is_taken {
            self.output = None;
        }
        if fetches {
            self.fetched = Some(if stored_before { Record::Frame } else { Record::Spot });
            self.fetched_spots += 1;
        } else if passes {
            self.fetched = None;
        }
        if let Some((_, is_last)) = head.filter(|_| head_taken) {
            self.fetched_spots = 0;
            self.spots_given = is_last;
        }
        self.is_busy |= mask.is_some();
        self.has_frame |= is_frame;
        if stores_frame {
            self.has_frame = false;
            self.spots_given = false;
            self.frame_stored = true;
        }
        if stored_before && fetches {
            self.frame_stored = false;
            self.is_busy = false;
            self.fetched_spots = 0;
        }
        let entry = mask.map(|mask| (mask.slots.count_ones(), mask.last));
        self.queue.clock(entry.filter(|&(spots, is_last)| spots > 0 || is_last), head_taken);
    }
}
