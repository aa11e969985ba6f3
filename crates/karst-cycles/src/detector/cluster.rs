//! `cluster.vhd`.

use super::centroid::Words;
use super::run::Pixels;
use super::{Config, Early, Generics, Item, Mask};
use crate::timing::cluster::*;

/// What is kept of a cluster, as far as it decides on clocks.
#[derive(Debug, Clone, Copy, Default)]
struct Slot {
    x_min: i32,
    x_max: i32,
    y_max: i32,
    pixels: u32,
    green: u32,
}

/// The slots of a laser, a bit each: taken; not closed yet; closed with enough pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Flags {
    taken: u8,
    unclosed: u8,
    spots: u8,
}

#[derive(Debug, Clone, Copy)]
enum State {
    /// S_CLEAR, S_LOOK, S_FLAGS, S_MERGE, S_COPY, ...: until S_IDLE. A run is taken in the first clock of that.
    Busy {
        until: u64,
        takes_run: bool,
    },
    Idle,
    /// S_LOOK and S_FLAGS, then S_SCAN, S_WAIT and S_DECIDE for the open clusters, from the lowest slot on.
    Visit {
        scan: u64,
        left: u8,
        row: i32,
    },
    /// S_WALK, from this clock on.
    Walk {
        from: u64,
    },
}

#[derive(Debug)]
pub struct Cluster {
    lasers: u16,
    slots: u8,
    gap: i32,
    min_pixels: u32,
    flags: Vec<Flags>,
    memory: Vec<Slot>,

    clock: u64,
    state: State,
    visit_laser: u16,
    laser: u16,
    all_closed: bool,
    round_closed: bool,
    end_seen: bool,
    takes_run: bool,
    may_copy: bool,
    /// Clocks from which on the units are done with the last step, as `timing::cluster` says.
    drained: u64,
    emptied: u64,
    /// What the words are of that are on their way to the output, and when the last one is there.
    words: Option<(u64, Words)>,
    mask: Option<Mask>,
}

fn lowest(mask: u8) -> u8 {
    mask & mask.wrapping_neg()
}

fn numbers(mask: u8) -> impl Iterator<Item = usize> {
    (0..8).filter(move |slot| mask >> slot & 1 == 1)
}

impl Cluster {
    pub fn new(generics: &Generics, config: &Config) -> Self {
        let (lasers, slots) = (1_usize << generics.laser_bits, 1_usize << generics.slot_bits);
        Self {
            lasers: config.lasers,
            slots: slots as u8,
            gap: config.gap,
            min_pixels: config.min_pixels,
            flags: vec![Flags::default(); lasers],
            memory: vec![Slot::default(); lasers * slots],
            clock: 0,
            state: State::Busy { until: lasers as u64 + 1, takes_run: false },
            visit_laser: 0,
            laser: 0,
            all_closed: false,
            round_closed: false,
            end_seen: false,
            takes_run: false,
            may_copy: true,
            drained: 0,
            emptied: 0,
            words: None,
            mask: None,
        }
    }

    /// `in_ready`.
    pub fn takes_run(&self) -> bool {
        self.takes_run
    }

    pub fn mask(&self) -> Option<Mask> {
        self.mask
    }

    /// `word_valid` and `word_last`.
    pub fn words(&self) -> Option<Words> {
        self.words.filter(|&(clock, _)| clock == self.clock).map(|(_, words)| words)
    }

    /// Words are on their way to centroid.
    fn copies(&self, now: u64) -> bool {
        self.words.is_some_and(|(last, _)| now <= last)
    }

    /// A word enters the units.
    fn step(&mut self, clock: u64) {
        self.drained = clock + DRAINED;
        self.emptied = clock + EMPTIED;
    }

    fn next_visit(&mut self) {
        self.visit_laser = (self.visit_laser + 1) % self.lasers;
    }

    fn is_last(&self, laser: u16) -> bool {
        laser + 1 == self.lasers
    }

    fn slot(&mut self, laser: u16, slot: usize) -> &mut Slot {
        let at = usize::from(laser) * usize::from(self.slots) + slot;
        &mut self.memory[at]
    }

    /// Ends a clock; `row` is that of the run, or of the news.
    pub fn clock(&mut self, run: Option<Item<Pixels>>, row: i32, words_ready: bool) {
        let now = self.clock;
        self.clock += 1;
        self.mask = None;
        let took_run = std::mem::take(&mut self.takes_run);
        // A clock late, as in the gateware
        let may_copy = self.may_copy;
        self.may_copy = words_ready && !self.copies(now);
        match self.state {
            State::Busy { until, takes_run } if self.clock == until => {
                self.takes_run = takes_run;
                self.state = State::Idle;
            }
            State::Busy { .. } => {}
            State::Idle if took_run => {}
            State::Idle => self.idle(run, row, now, may_copy),
            State::Visit { scan, left, row: seen } => {
                let row = if now == scan + ROW { row } else { seen };
                self.state = State::Visit { scan, left, row };
                self.visit(now, scan, left, row);
            }
            State::Walk { from } => self.walk(now - from),
        }
    }

    fn idle(&mut self, run: Option<Item<Pixels>>, row: i32, now: u64, may_copy: bool) {
        match run {
            Some(Item::Part(run)) => self.add(now, &run, row),
            Some(Item::End) if !self.end_seen => {
                self.end_seen = true;
                self.visit_laser = 0;
                self.round_closed = true;
            }
            _ if !may_copy => {}
            _ if !self.all_closed => {
                self.laser = self.visit_laser;
                let left = self.flags[usize::from(self.laser)].unclosed;
                self.state = State::Visit { scan: now + FLAGS + 1, left, row };
            }
            Some(Item::End) => {
                self.step(now + WORDS);
                self.words = Some((now + WORDS + OUTPUT, Words::Frame));
                self.state = State::Walk { from: now + 1 };
            }
            None => {}
        }
    }

    /// A run comes: S_LOOK to S_MERGE.
    fn add(&mut self, now: u64, run: &Pixels, row: i32) {
        self.all_closed = false;
        self.round_closed = false;
        let Flags { taken, unclosed, spots } = self.flags[usize::from(run.laser)];
        let each = ((1_u16 << self.slots) - 1) as u8;
        let mut cluster = Slot { x_min: run.x_min, x_max: run.x_max, y_max: row, pixels: run.pixels, green: run.green };
        let mut near = 0;
        for slot in numbers(unclosed) {
            let other = *self.slot(run.laser, slot);
            let is_near = other.x_min <= run.x_max + self.gap
                && other.x_max >= run.x_min - self.gap
                && other.y_max >= row - self.gap;
            if is_near {
                near |= 1 << slot;
                cluster = cluster.merged(&other);
            }
        }

        let mut at = now + FLAGS + 1;
        if unclosed != 0 {
            at += NEAR_WORDS * u64::from(unclosed.count_ones());
            self.step(at - 1);
            at = self.drained + 1;
        }
        at += DECIDE;
        let mut target = lowest((near | !taken) & each);
        if target == 0 {
            // All slots are taken: that of the fewest pixels makes room
            let pixels = |slot: &usize| self.memory[usize::from(run.laser) * usize::from(self.slots) + slot].pixels;
            target = numbers(each).min_by_key(pixels).map_or(0, |slot| 1 << slot);
            for _ in 0..self.slots {
                at = at.max(self.drained);
                self.step(at);
                at += 1;
            }
            at = self.emptied + 1;
        }
        let clusters = near.count_ones().max(1);
        for _ in 0..WORDS * u64::from(clusters) {
            if clusters > 1 {
                at = at.max(self.drained);
            }
            self.step(at);
            at += 1;
        }

        for slot in numbers(target) {
            *self.slot(run.laser, slot) = cluster;
        }
        self.flags[usize::from(run.laser)] =
            Flags { taken: taken & !near | target, unclosed: unclosed & !near | target, spots: spots & !target };
        self.state = State::Busy { until: at, takes_run: true };
    }

    /// S_LOOK and S_FLAGS, or S_SCAN to S_DECIDE of a cluster.
    fn visit(&mut self, now: u64, scan: u64, left: u8, row: i32) {
        if left == 0 {
            if now + 1 == scan {
                if self.is_last(self.laser) {
                    self.all_closed = self.round_closed;
                    self.round_closed = true;
                }
                self.next_visit();
                self.state = State::Idle;
            }
            return;
        }
        let last_word = scan + VISIT_WORDS - 1;
        if now == last_word {
            self.step(now);
        }
        if now != last_word + DRAINED + DECIDE {
            return;
        }
        let this = lowest(left);
        let number = this.trailing_zeros() as usize;
        let cluster = *self.slot(self.laser, number);
        if !self.end_seen && cluster.y_max >= row - self.gap {
            // It stays open
            let left = left & !this;
            self.state = State::Visit { scan: now + 1, left, row };
            if left == 0 {
                self.next_visit();
                self.round_closed = self.is_last(self.laser);
                self.state = State::Idle;
            }
            return;
        }
        let flags = &mut self.flags[usize::from(self.laser)];
        flags.unclosed &= !this;
        self.state = State::Idle;
        if cluster.green >= self.min_pixels {
            flags.spots |= this;
            self.step(now + WORDS);
            let spot = Early { laser: self.laser, slot: number as u8 };
            self.words = Some((now + WORDS + OUTPUT, Words::Of(spot)));
            self.state = State::Busy { until: now + WORDS + 1, takes_run: false };
        }
    }

    fn walk(&mut self, walked: u64) {
        if let Ok(laser) = u16::try_from(walked)
            && laser < self.lasers
        {
            let flags = std::mem::take(&mut self.flags[usize::from(laser)]);
            self.mask = Some(Mask { laser, slots: flags.spots, last: self.is_last(laser) });
        }
        if walked == u64::from(self.lasers).max(WORDS) {
            // It has gone on in every clock of the walk, and in the one before
            self.visit_laser = ((walked + 2) % u64::from(self.lasers)) as u16;
            self.end_seen = false;
            self.takes_run = true;
            self.state = State::Idle;
        }
    }
}

impl Slot {
    fn merged(&self, other: &Self) -> Self {
        Self {
            x_min: self.x_min.min(other.x_min),
            x_max: self.x_max.max(other.x_max),
            y_max: self.y_max.max(other.y_max),
            pixels: self.pixels + other.pixels,
            green: self.green + other.green,
        }
    }
}
