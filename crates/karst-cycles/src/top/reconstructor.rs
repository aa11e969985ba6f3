//! `reconstructor.vhd`: when points come.

use std::collections::VecDeque;

use super::{Reconstruction, TopGenerics};
use crate::detector::Mask;
use crate::timing::reconstructor::{line, point, settling};

#[derive(Debug)]
pub struct Reconstructor {
    settings: Reconstruction,
    lasers: usize,
    settling: u64,
    line: u64,
    point: u64,
    clock: u64,
    /// By bank: spots of each laser in each camera; the first clock in which all rays are there and all is settled.
    spots: [Vec<[u64; 2]>; 2],
    complete: [u64; 2],
    /// The bank whose start is given.
    walks: Option<usize>,
    /// The first clock in which the next start may be given.
    ready: u64,
    /// Clocks of points that are on their way.
    points: VecDeque<u64>,
}

impl Reconstructor {
    pub fn new(generics: &TopGenerics, lasers: usize, settings: Reconstruction) -> Self {
        Self {
            settings,
            lasers,
            settling: settling(generics.detector.slot_bits),
            line: line(generics.bits_per_stage),
            point: point(generics.bits_per_stage, settings.paper),
            clock: 0,
            spots: [vec![[0; 2]; lasers], vec![[0; 2]; lasers]],
            complete: [0; 2],
            walks: None,
            ready: 0,
            points: VecDeque::new(),
        }
    }

    /// `ready`.
    pub fn is_ready(&self) -> bool {
        self.walks.is_none() && self.clock >= self.ready
    }

    /// A point is there; true: the last one of the frame.
    pub fn point(&self) -> Option<bool> {
        (self.points.front() == Some(&self.clock)).then_some(self.points.len() == 1)
    }

    /// Pairs of a laser.
    fn pairs(&self, [first, second]: [u64; 2]) -> u64 {
        let Reconstruction { paper, single_camera } = self.settings;
        let pairs = match (paper, single_camera) {
            (true, _) if first > 0 && second > 0 => 3,
            (true, _) => 1,
            (false, true) => first * second + first + second,
            (false, false) => first * second,
        };
        pairs.max(1)
    }

    /// Ends a clock: with the bank of a spot, masks and their banks, and the bank to walk.
    pub fn clock(
        &mut self,
        spot: Option<usize>,
        masks: [Option<Mask>; 2],
        mask_banks: [usize; 2],
        start: Option<usize>,
    ) {
        let now = self.clock;
        self.clock += 1;
        if self.points.front() == Some(&now) {
            self.points.pop_front();
        }
        if let Some(bank) = self.walks.filter(|&bank| now >= self.complete[bank]) {
            self.walks = None;
            let mut last_pair = now;
            for laser in 0..self.lasers {
                last_pair += self.pairs(self.spots[bank][laser]);
                self.points.push_back(last_pair + self.point);
            }
            self.ready = last_pair + 1;
        }
        if let Some(bank) = spot {
            self.complete[bank] = self.complete[bank].max(now + self.line);
        }
        for (camera, mask) in masks.into_iter().enumerate() {
            let Some(mask) = mask else { continue };
            let bank = mask_banks[camera];
            self.spots[bank][usize::from(mask.laser)][camera] = mask.slots.count_ones().into();
            if self.settings.paper {
                self.complete[bank] = self.complete[bank].max(now + self.settling + 1);
            }
        }
        // The first pair comes two clocks later
        self.walks = start.or(self.walks);
    }
}
