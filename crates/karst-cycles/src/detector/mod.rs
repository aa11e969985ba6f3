//! The detector, clock by clock: what is in its registers, as far as it says when something happens.

mod centroid;
mod cluster;
mod fifo;
mod frame_control;
mod report;
mod run;

use std::collections::VecDeque;

use karst_core::DetectorConfig;

use crate::stream::{Beat, Hit, Lanes};
use crate::timing::{self, detector::*};
use centroid::Centroid;
use cluster::Cluster;
use fifo::Fifo;
use frame_control::FrameControl;
use report::Report;
use run::Run;

/// How a detector was built: the generics of `detector.vhd`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Generics {
    /// G_PPC: pixels per clock.
    pub pixels_per_clock: u32,
    /// G_X_BITS: the widest image has 2 to the power of this columns.
    pub x_bits: u32,
    /// G_LASER_BITS: most lasers, 2 to the power of this.
    pub laser_bits: u32,
    /// G_SLOT_BITS: most candidates per laser, 2 to the power of this.
    pub slot_bits: u32,
}

impl Generics {
    /// The smallest detector of one pixel per clock for so many lasers, and images of 1024 columns.
    pub fn for_lasers(lasers: usize) -> Self {
        Self { laser_bits: lasers.next_power_of_two().trailing_zeros(), ..Self::default() }
    }
}

impl Default for Generics {
    fn default() -> Self {
        Self { pixels_per_clock: 1, x_bits: 10, laser_bits: 4, slot_bits: 2 }
    }
}

/// What of a detector's configuration decides on its clocks.
#[derive(Debug, Clone, Copy)]
struct Config {
    width: u32,
    height: u32,
    lasers: u16,
    gap: i32,
    min_pixels: u32,
}

/// A slot of a laser whose record is there before the frame ends (`early_*`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Early {
    /// The laser.
    pub laser: u16,
    /// Its slot.
    pub slot: u8,
}

/// Slots of a laser at the end of the frame (`mask_*`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mask {
    /// The laser.
    pub laser: u16,
    /// Its slots that hold a spot, a bit each.
    pub slots: u8,
    /// It is the last laser.
    pub last: bool,
}

/// A record of the result stream (`m_axis_*`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record {
    /// Of a spot.
    Spot,
    /// The frame's, which ends it.
    Frame,
}

/// What goes from one block to the next: something of the frame, or its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Item<T> {
    Part(T),
    End,
}

/// A beat with its row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Placed<T> {
    row: i32,
    item: Item<T>,
}

/// Delays by a fixed number of clocks.
#[derive(Debug)]
struct Delay<T>(VecDeque<Option<T>>);

impl<T> Delay<T> {
    fn new(clocks: usize) -> Self {
        Self((0..clocks).map(|_| None).collect())
    }

    fn clock(&mut self, value: Option<T>) -> Option<T> {
        self.0.push_back(value);
        self.0.pop_front().flatten()
    }
}

/// A hit and whether it continues the run of the one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Joined {
    hit: Hit,
    joins: bool,
}

/// The detector of one camera. What it says in a clock is there before [`Detector::clock`] ends it.
#[derive(Debug)]
pub struct Detector {
    control: FrameControl,
    segment: Delay<Placed<Lanes>>,
    segmented: Option<Placed<Lanes>>,
    beats: Fifo<Placed<Lanes>>,
    /// The beat whose hits are given, and how many are already.
    beat: Option<Placed<Lanes>>,
    given: usize,
    /// The last hit and its row, unless the frame has ended.
    hit_before: Option<(i32, Hit)>,
    sector: Delay<Placed<Joined>>,
    sectored: Option<Placed<Joined>>,
    hits: Fifo<Placed<Joined>>,
    news: News,
    run: Run,
    cluster: Cluster,
    centroid: Centroid,
    report: Report,
}

/// The news for run that hits above a row have all come.
#[derive(Debug, Default)]
struct News {
    quiet: u32,
    current_row: i32,
    quiet_row: i32,
    row: Option<i32>,
}

impl News {
    fn clock(&mut self, beat_row: Option<i32>, is_busy: bool, is_taken: bool) {
        if is_taken {
            self.row = None;
        }
        let quiet = self.quiet;
        self.quiet = (quiet + 1) % (1 << QUIET_BITS);
        if is_busy {
            self.quiet = 0;
            self.quiet_row = self.current_row;
        } else if quiet == (1 << QUIET_BITS) - 1 {
            self.row = Some(self.quiet_row);
            self.quiet_row = self.current_row;
        }
        if let Some(row) = beat_row {
            self.current_row = row;
        }
    }
}

impl Detector {
    /// A detector at the end of its reset.
    pub fn new<const LASERS: usize>(generics: &Generics, config: &DetectorConfig<LASERS>) -> Self {
        let config = Config {
            width: config.width.into(),
            height: config.height.into(),
            lasers: config.azimuths.len() as u16,
            gap: config.cluster_gap.min(2047).into(),
            min_pixels: config.min_pixels.into(),
        };
        Self {
            control: FrameControl::new(generics.pixels_per_clock, config.width, config.height),
            segment: Delay::new(timing::segment::LATENCY - 1),
            segmented: None,
            beats: Fifo::new(BUFFER_DEPTH, BEAT_MARGIN),
            beat: None,
            given: 0,
            hit_before: None,
            sector: Delay::new(timing::serialize::OUTPUT + timing::sector::LATENCY - 1),
            sectored: None,
            hits: Fifo::new(BUFFER_DEPTH, HIT_MARGIN),
            news: News::default(),
            run: Run::new(),
            cluster: Cluster::new(generics, &config),
            centroid: Centroid::new(generics.x_bits),
            report: Report::new(generics),
        }
    }

    /// Whether a beat that is there in this clock is taken (`s_axis_tready`).
    pub fn is_ready(&self) -> bool {
        self.control.is_ready(self.beats.has_room())
    }

    /// The record in this clock, which stays until it is taken.
    pub fn record(&self) -> Option<Record> {
        self.report.record()
    }

    /// The early record in this clock.
    pub fn early(&self) -> Option<Early> {
        self.centroid.early()
    }

    /// The slots in this clock.
    pub fn mask(&self) -> Option<Mask> {
        self.cluster.mask()
    }

    /// Ends a clock: with what the camera has offered in it, and whether a record was welcome. `is_void`: the beat starts
    /// no frame, but ends the one before it.
    pub fn clock(&mut self, beat: Option<&Beat>, is_void: bool, is_record_taken: bool) {
        // What the blocks say in this clock
        let (beat_room, hit_room) = (self.beats.has_room(), self.hits.has_room());
        let (first_beat, first_hit) = (self.beats.first().copied(), self.hits.first().copied());
        let takes_hit = self.run.takes_hit();
        let takes_row = self.run.takes_row(self.news.row);
        let words_ready = self.centroid.is_ready() && self.report.is_ready();
        let run_taken = self.cluster.takes_run();
        let beat_out = self.control.output();
        let hit = if hit_room { self.serialize() } else { None };
        let takes_beat = self.beat.is_none();

        // From the last block to the first one: each takes what the one before it says in this clock
        self.report.clock(self.centroid.is_frame(), self.cluster.mask(), is_record_taken);
        self.centroid.clock(self.cluster.words());
        self.cluster.clock(self.run.output(), self.run.row(), words_ready);
        self.run.clock(first_hit, self.news.row, run_taken);
        let is_busy = first_beat.is_some() || first_hit.is_some() || !takes_hit;
        self.news.clock(beat_out.map(|beat| beat.row), is_busy, takes_row);
        self.hits.clock(self.sectored, takes_hit);
        self.sectored = self.sector.clock(hit);
        if takes_beat {
            self.beat = first_beat;
        }
        self.beats.clock(self.segmented, takes_beat);
        let has_hits = |beat: &Placed<Lanes>| match &beat.item {
            Item::Part(lanes) => !lanes.as_slice().is_empty(),
            Item::End => true,
        };
        self.segmented = self.segment.clock(beat_out.filter(has_hits));
        self.control.clock(beat, is_void, beat_room);
    }

    /// The next hit of the beat, or the end of the frame. With the last one the beat is gone.
    fn serialize(&mut self) -> Option<Placed<Joined>> {
        let Placed { row, item } = self.beat.as_ref()?;
        let row = *row;
        let lanes = match item {
            Item::Part(lanes) => lanes.as_slice(),
            Item::End => &[],
        };
        let hit = lanes.get(self.given).copied();
        self.given += 1;
        if self.given >= lanes.len() {
            self.given = 0;
            self.beat = None;
        }
        let Some(hit) = hit else {
            self.hit_before = None;
            return Some(Placed { row, item: Item::End });
        };
        let continues = |before: Hit| before.accepted && before.laser == hit.laser && before.x + 1 == hit.x;
        let joins = self.hit_before.is_some_and(|(row_before, before)| row_before == row && continues(before));
        self.hit_before = Some((row, hit));
        Some(Placed { row, item: Item::Part(Joined { hit, joins }) })
    }
}
