//! `frame_gate.vhd`, with frames enabled and no commit under way.

use super::Frames;
use crate::stream::Beat;

/// The last frame of a camera.
#[derive(Debug, Clone, Copy, Default)]
struct Frame {
    height: u32,
    /// It has not ended.
    is_open: bool,
    is_paired: bool,
    bank: usize,
    /// Complete ones.
    rows: u32,
    /// The beat behind the gate.
    held: Option<Beat>,
}

#[derive(Debug)]
pub struct Gate {
    frames: [Frame; 2],
    pair_bank: usize,
    pairs: u32,
}

impl Gate {
    pub fn new(heights: [u32; 2]) -> Self {
        Self { frames: heights.map(|height| Frame { height, ..Frame::default() }), pair_bank: 1, pairs: 0 }
    }

    /// `m_axis`: with the beat, whether it is void, which none is here: every frame is taken.
    pub fn output(&self) -> [Option<(Beat, bool)>; 2] {
        self.frames.map(|frame| frame.held.map(|beat| (beat, false)))
    }

    /// `s_axis_tready` and `tvalid`.
    pub fn takes(&self, beats: [Option<&Beat>; 2], ready: [bool; 2], room: [bool; 2]) -> [bool; 2] {
        let mut takes = [false; 2];
        for camera in 0..2 {
            let frame = &self.frames[camera];
            let is_free = ready[camera] || frame.held.is_none();
            // Camera 2 starts after camera 1
            let waits = camera == 1 && takes[0] && beats[0].is_some_and(|beat| beat.start);
            takes[camera] = beats[camera].is_some_and(|beat| {
                if beat.start { is_free && room[camera] && self.pairs < 2 && !waits } else { is_free || !frame.is_open }
            });
        }
        takes
    }

    /// Ends a clock. Gives what has started and ended in it.
    pub fn clock(
        &mut self,
        beats: [Option<&Beat>; 2],
        takes: [bool; 2],
        ready: [bool; 2],
        is_pair_done: bool,
    ) -> Frames {
        let before = self.frames;
        let pair_bank = self.pair_bank;
        let starts = [0, 1].map(|camera: usize| takes[camera] && beats[camera].is_some_and(|beat| beat.start));
        let joins = [0, 1].map(|camera: usize| {
            let other = &before[1 - camera];
            other.is_open && !other.is_paired && other.rows < other.height.div_ceil(2)
        });
        let mut told = Frames::default();
        for camera in 0..2 {
            let frame = &mut self.frames[camera];
            let other = 1 - camera;
            let was_open = frame.is_open;
            let beat = beats[camera].filter(|_| takes[camera]);
            let other_joins = starts[other] && joins[other];
            let is_paired = if starts[camera] { joins[camera] } else { before[camera].is_paired || other_joins };
            if ready[camera] || frame.held.is_none() {
                frame.held = beat.copied().filter(|beat| beat.start || was_open);
            }
            if starts[camera] {
                let bank = if joins[camera] { before[other].bank } else { pair_bank ^ 1 };
                told.start[camera] = Some(bank);
                if was_open {
                    told.finish[camera] = Some(before[camera].is_paired);
                }
                frame.is_open = true;
                frame.bank = bank;
                frame.rows = 0;
                if joins[camera] {
                    self.pair_bank = bank;
                    self.pairs += 1;
                }
            }
            if beat.is_some() || other_joins {
                frame.is_paired = is_paired;
            }
            if beat.is_some_and(|beat| beat.last) {
                let is_last = frame.rows + 1 >= frame.height && frame.is_open;
                frame.rows += 1;
                if is_last {
                    frame.is_open = false;
                    told.finish[camera] = Some(if starts[camera] { before[camera].is_paired } else { is_paired });
                }
            }
        }
        self.pairs -= u32::from(is_pair_done);
        told
    }
}
