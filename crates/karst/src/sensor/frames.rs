//! A sensor's messages to sections.

use std::collections::BTreeMap;

use karst_core::{FrameStatus, NoPoint, Point, Spot};
use karst_link::{FrameEnd, Message, Settings};
use serde::Serialize;

use crate::instrument::{laser_result, method_name, to_f64};
use crate::result::{DetectorCounters, LaserResult, Section};

/// [`LaserResult::status`] of a laser whose message never came.
pub const LOST: &str = "lost on the line";

/// One frame as it came over the line.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorFrame {
    /// Its number.
    pub number: u32,
    /// All of it came.
    pub complete: bool,
    /// Messages of it that did not come, as far as it is known.
    pub lost_messages: u32,
    /// What came. A laser whose message was lost has the status [`LOST`].
    pub section: Section,
}

/// How many frames came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct FrameCounts {
    /// Whole ones.
    pub complete: u32,
    /// Some with lost messages.
    pub incomplete: u32,
    /// Numbers of which nothing came: lost, or dropped by the sensor, whose status counts the latter.
    pub missing: u32,
}

/// A frame that is coming in.
struct Partial {
    number: u32,
    lasers: BTreeMap<u16, Result<Point, NoPoint>>,
    /// Spots by camera, laser and order.
    spots: BTreeMap<(u8, u16), Vec<Spot>>,
}

impl Partial {
    fn new(number: u32) -> Self {
        Self { number, lasers: BTreeMap::new(), spots: BTreeMap::new() }
    }
}

/// Puts frames together, each of its own messages only.
///
/// The first frame is passed over if it is incomplete: nobody knows how much of it had been sent before.
pub struct Assembler {
    settings: Settings,
    partial: Option<Partial>,
    /// Lasers of a frame, as the last whole one said.
    lasers: u16,
    last: Option<u32>,
    counts: FrameCounts,
}

impl Assembler {
    /// For a sensor with these settings.
    pub fn new(settings: Settings) -> Self {
        Self { settings, partial: None, lasers: 0, last: None, counts: FrameCounts::default() }
    }

    /// Frames so far.
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// Takes a message; gives the frames that it ends: its own, or the one before, of which the end was lost.
    pub fn take(&mut self, message: &Message) -> Vec<SensorFrame> {
        match message {
            Message::Laser(laser) => {
                let before = self.go_to(laser.frame);
                if let Some(partial) = &mut self.partial {
                    partial.lasers.insert(laser.laser, laser.result);
                }
                before.into_iter().collect()
            }
            Message::Spot(spot) => {
                let before = self.go_to(spot.frame);
                if let Some(partial) = &mut self.partial {
                    partial.spots.entry((spot.camera, spot.laser)).or_default().push(spot.spot);
                }
                before.into_iter().collect()
            }
            Message::FrameEnd(end) => {
                let before = self.go_to(end.frame);
                before.into_iter().chain(self.close(Some(end))).collect()
            }
            _ => Vec::new(),
        }
    }

    /// Begins the frame of that number if it is another one; gives the one before.
    fn go_to(&mut self, number: u32) -> Option<SensorFrame> {
        if self.partial.as_ref().is_some_and(|partial| partial.number == number) {
            return None;
        }
        let before = self.close(None);
        self.partial = Some(Partial::new(number));
        before
    }

    fn close(&mut self, end: Option<&FrameEnd>) -> Option<SensorFrame> {
        let Partial { number, lasers, spots } = self.partial.take()?;
        if let Some(end) = end {
            self.lasers = end.lasers;
        }
        let expected = lasers.keys().last().map_or(0, |last| last + 1).max(self.lasers);
        let lost_lasers = u32::from(expected) - lasers.len() as u32;
        let found_spots = spots.values().map(Vec::len).sum::<usize>() as u32;
        let lost_spots = end.map_or(0, |end| u32::from(end.spots).saturating_sub(found_spots));
        let lost_messages = lost_lasers + lost_spots + u32::from(end.is_none());
        let complete = lost_messages == 0;

        let last = self.last.replace(number);
        if !complete && last.is_none() {
            return None;
        }
        let skipped = last.map_or(0, |last| number.wrapping_sub(last).wrapping_sub(1));
        // A number that is smaller than the last one's is that of a sensor that has started again
        if skipped < u32::MAX / 2 {
            self.counts.missing = self.counts.missing.saturating_add(skipped);
        }
        if complete {
            self.counts.complete += 1;
        } else {
            self.counts.incomplete += 1;
        }

        // With a spot missing, nobody knows which ones a point was made from
        let all_spots = self.settings.spots && end.is_some() && lost_spots == 0;
        let spots_of = |camera, laser| {
            let spots = spots.get(&(camera, laser)).filter(|_| all_spots);
            spots.cloned().unwrap_or_default()
        };
        let result = |laser: u16| match lasers.get(&laser) {
            Some(result) => {
                let point = result.map(|point| to_f64(&point));
                laser_result(laser.into(), &point, &[spots_of(0, laser), spots_of(1, laser)])
            }
            None => lost(laser.into()),
        };
        let detectors = end.map_or([FrameStatus::default(); 2], |end| end.detectors);
        let section = Section {
            frame: number.to_string(),
            method: method_name(self.settings.method).to_owned(),
            arithmetic: "fixed".to_owned(),
            lasers: (0..expected).map(result).collect(),
            detector: [0, 1].map(|camera| DetectorCounters {
                hits: detectors[usize::from(camera)].hits,
                outside: detectors[usize::from(camera)].outside,
                overflow: detectors[usize::from(camera)].overflow,
                spots: all_spots.then(|| {
                    spots.iter().filter(|((of, _), _)| *of == camera).map(|(_, spots)| spots.len() as u32).sum()
                }),
            }),
            timing: None,
        };
        Some(SensorFrame { number, complete, lost_messages, section })
    }
}

/// What a sensor tells of a section if it is not asked for spots: no single estimates, and no times.
pub fn as_sent(mut section: Section) -> Section {
    section.timing = None;
    for laser in &mut section.lasers {
        laser.spots = [None, None];
        if let Some(point) = &mut laser.point {
            point.estimates_mm = [None; 3];
        }
    }
    for detector in &mut section.detector {
        detector.spots = None;
    }
    section
}

fn lost(laser: usize) -> LaserResult {
    LaserResult { laser, status: LOST.to_owned(), point: None, spots: [None, None], truth: None }
}
