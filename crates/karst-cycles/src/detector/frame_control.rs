//! `frame_control.vhd`.

use super::{Item, Placed};
use crate::stream::{Beat, Lanes};
use crate::timing::frame_control::{PAUSE, long_row};

#[derive(Debug)]
pub struct FrameControl {
    pixels_per_clock: u32,
    width: u32,
    height: u32,
    /// The beat at the input, and whether it is void.
    held: Option<(Beat, bool)>,
    in_frame: bool,
    end_pending: bool,
    /// Clocks of the pause that are left.
    pause: u32,
    x: u32,
    y: u32,
    row_open: bool,
    output: Option<Placed<Lanes>>,
}

impl FrameControl {
    pub fn new(pixels_per_clock: u32, width: u32, height: u32) -> Self {
        Self {
            pixels_per_clock,
            width,
            height,
            held: None,
            in_frame: false,
            end_pending: false,
            pause: 0,
            x: 0,
            y: 0,
            row_open: false,
            output: None,
        }
    }

    pub fn output(&self) -> Option<Placed<Lanes>> {
        self.output
    }

    fn can_work(&self, room: bool) -> bool {
        room && self.pause == 0 && !self.end_pending
    }

    /// `s_axis_tready`.
    pub fn is_ready(&self, room: bool) -> bool {
        self.held.is_none_or(|(beat, _)| self.can_work(room) && !(beat.start && self.in_frame))
    }

    pub fn clock(&mut self, beat: Option<&Beat>, is_void: bool, room: bool) {
        let can_work = self.can_work(room);
        let is_ready = self.is_ready(room);
        let ends = self.end_pending && self.pause == 0 && room;
        self.output = None;
        self.pause = self.pause.saturating_sub(1);
        match self.held {
            Some((held, _)) if can_work && held.start && self.in_frame => self.cut(),
            Some((held, is_void)) if can_work && !is_void && (held.start || self.in_frame) => self.take(&held),
            _ => {}
        }
        if ends {
            self.output = Some(Placed { row: self.y as i32, item: Item::End });
            self.end_pending = false;
            self.pause = PAUSE;
            self.y = 0;
        }
        if is_ready {
            self.held = beat.map(|&beat| (beat, is_void));
        }
    }

    fn take(&mut self, beat: &Beat) {
        self.in_frame = true;
        self.row_open = true;
        let (x, is_full) = (self.x, self.x == self.width);
        if !is_full {
            self.output = Some(Placed { row: self.y as i32, item: Item::Part(beat.hits) });
            self.x += self.pixels_per_clock;
        }
        if beat.last {
            self.row_open = false;
            self.x = 0;
            self.y += 1;
            if x < long_row(self.pixels_per_clock) - self.pixels_per_clock {
                self.pause = PAUSE;
            }
            if self.y == self.height {
                self.in_frame = false;
                self.end_pending = true;
            }
        }
    }

    /// A start of frame within a frame.
    fn cut(&mut self) {
        self.in_frame = false;
        self.end_pending = true;
        self.x = 0;
        self.y += u32::from(self.row_open);
        self.row_open = false;
    }
}
