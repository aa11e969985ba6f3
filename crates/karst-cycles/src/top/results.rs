//! `frame_results.vhd`.

use super::tags::Tag;
use crate::detector::Record;

#[derive(Debug)]
pub struct Results {
    /// Of the pair that is made.
    bank: usize,
    /// By camera and bank: masks of a frame of a pair are complete.
    all_masked: [[bool; 2]; 2],
    started: bool,
    pointed: bool,
    counted: [bool; 2],
    closed: bool,
    is_done: bool,
}

impl Results {
    pub fn new() -> Self {
        Self {
            bank: 0,
            all_masked: [[false; 2]; 2],
            started: false,
            pointed: false,
            counted: [false; 2],
            closed: false,
            is_done: false,
        }
    }

    /// `start` and its bank.
    pub fn start(&self) -> Option<usize> {
        let bank = self.bank;
        (self.all_masked[0][bank] && self.all_masked[1][bank] && !self.started).then_some(bank)
    }

    /// `results_done`.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    fn is_ours(&self, camera: usize, tag: Tag) -> bool {
        tag.bank == self.bank && tag.is_paired && !self.counted[camera]
    }

    /// `s_axis_tready`, of the cameras that have a record.
    pub fn welcomes(&self, records: [Option<Record>; 2], tags: [Tag; 2], is_point: bool) -> [bool; 2] {
        let mut welcomes = [false; 2];
        for camera in 0..2 {
            let is_ours = self.is_ours(camera, tags[camera]);
            let other_goes =
                camera == 1 && welcomes[0] && self.is_ours(0, tags[0]) && records[0] == Some(Record::Frame);
            let waits = records[camera] == Some(Record::Frame) && (is_point || other_goes);
            welcomes[camera] = !tags[camera].is_paired || (is_ours && !waits);
        }
        welcomes
    }

    /// Ends a clock.
    pub fn clock(
        &mut self,
        masked: [bool; 2],
        of_mask: [Tag; 2],
        recorded: [bool; 2],
        of_record: [Tag; 2],
        is_started: bool,
        point: Option<bool>,
    ) {
        let closing = self.pointed && self.counted == [true; 2] && !self.closed && !self.is_done;
        let is_done = self.is_done;
        let ours = [0, 1].map(|camera: usize| self.is_ours(camera, of_record[camera]));
        if let Some(is_last) = point {
            self.pointed = is_last;
        }
        for camera in 0..2 {
            if masked[camera] && of_mask[camera].is_paired {
                self.all_masked[camera][of_mask[camera].bank] = true;
            }
            if recorded[camera] && ours[camera] {
                self.counted[camera] = true;
            }
        }
        if is_started {
            self.started = true;
            self.all_masked[0][self.bank] = false;
            self.all_masked[1][self.bank] = false;
        }
        self.is_done = self.closed;
        self.closed = closing;
        if is_done {
            self.bank ^= 1;
            self.started = false;
            self.pointed = false;
            self.counted = [false; 2];
        }
    }
}
