//! A frame's results, taken out of the IP.

use heapless::Vec;
use karst_core::{Estimates, FrameStatus, Method, NoPoint, Point, Spot, reconstruct};
use karst_link::{FrameEnd, LaserResult, LaserSpot, Message};
use karst_regs::{CameraFrame, Frame, ReadError, RegisterBus, RigWords, SpotRecord};

/// Most spots of a laser in one camera.
const CANDIDATES: usize = 4;

/// All results of one frame of up to `LASERS` lasers with `SPOTS` spots per camera. It is filled where it is: there is no
/// room for two.
pub(crate) struct Snapshot<const LASERS: usize, const SPOTS: usize> {
    number: u32,
    lasers: Vec<Result<Point, NoPoint>, LASERS>,
    spots: [Vec<SpotRecord, SPOTS>; 2],
    detectors: [FrameStatus; 2],
    /// The messages that have been given; None: there is no frame, or all of it has been given.
    given: Option<u32>,
    with_spots: bool,
}

impl<const LASERS: usize, const SPOTS: usize> Snapshot<LASERS, SPOTS> {
    /// No frame.
    pub const NONE: Self = Self {
        number: 0,
        lasers: Vec::new(),
        spots: [const { Vec::new() }; 2],
        detectors: [NO_PIXELS; 2],
        given: None,
        with_spots: false,
    };

    /// Whether there is a frame with something still to be given.
    pub fn is_there(&self) -> bool {
        self.given.is_some()
    }

    /// The frame that is there, or was the last one.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// What has been read is the frame of that number.
    pub fn give(&mut self, number: u32) {
        self.number = number;
        self.given = Some(0);
    }

    /// Reads the spots, and with `points` the points.
    pub fn read<B: RegisterBus>(
        &mut self,
        frame: &mut Frame<'_, B>,
        points: bool,
        with_spots: bool,
    ) -> Result<(), ReadError<B::Error>> {
        self.given = None;
        self.detectors = frame.cameras.each_ref().map(detector);
        self.with_spots = with_spots;
        self.lasers.clear();
        self.spots.iter_mut().for_each(Vec::clear);
        if points {
            for laser in 0..frame.lasers.min(LASERS as u32) as u16 {
                let point = frame.point(laser)?;
                // There are no more than fit
                let _ = self.lasers.push(point);
            }
        }
        if with_spots || !points {
            for (camera, spots) in self.spots.iter_mut().enumerate() {
                for index in 0..frame.cameras[camera].spots.min(SPOTS as u32) {
                    let spot = frame.spot(camera, index)?;
                    let _ = spots.push(spot);
                }
            }
        }
        Ok(())
    }

    /// Makes the points from the spots.
    pub fn reconstruct(&mut self, words: &RigWords<LASERS>, method: Method) {
        let mut rest: [&[SpotRecord]; 2] = [&self.spots[0], &self.spots[1]];
        for laser in 0..words.lasers() {
            let Some(calibration) = words.of_laser(laser) else { return };
            let spots = rest.each_mut().map(|rest| {
                // Spots come in the order of their lasers
                let mut candidates = Vec::<Spot, CANDIDATES>::new();
                while let Some((first, others)) = rest.split_first()
                    && first.laser == laser
                {
                    let _ = candidates.push(first.into());
                    *rest = others;
                }
                candidates
            });
            let result = reconstruct(&calibration, 0, [&spots[0], &spots[1]], method);
            // The gateware does not give the single estimates, so they are not sent
            let result = result.map(|point| Point { laser, estimates: Estimates::default(), ..point });
            let _ = self.lasers.push(result);
        }
    }

    /// How many points there are.
    pub fn points(&self) -> u32 {
        self.lasers.iter().filter(|result| result.is_ok()).count() as u32
    }

    /// What the detectors counted.
    pub fn detectors(&self) -> &[FrameStatus; 2] {
        &self.detectors
    }

    /// The next message of the frame: spots, points, end. None: all have been given.
    pub fn next(&mut self) -> Option<Message> {
        let frame = self.number;
        let mut index = self.given? as usize;
        self.given = self.given.map(|given| given + 1);
        if self.with_spots {
            for (camera, spots) in (0..).zip(&self.spots) {
                if let Some(record) = spots.get(index) {
                    return Some(Message::Spot(LaserSpot { frame, camera, laser: record.laser, spot: record.into() }));
                }
                index -= spots.len();
            }
        }
        if let Some(&result) = self.lasers.get(index) {
            return Some(Message::Laser(LaserResult { frame, laser: index as u16, result }));
        }
        let spots = if self.with_spots { self.spots.iter().map(|spots| spots.len()).sum::<usize>() as u16 } else { 0 };
        let end = FrameEnd { frame, lasers: self.lasers.len() as u16, spots, detectors: self.detectors };
        self.given = None;
        Some(Message::FrameEnd(end))
    }
}

const NO_PIXELS: FrameStatus =
    FrameStatus { rows: 0, hits: 0, outside: 0, overflow: 0, damaged_rows: 0, excess_rows: 0, truncated: false };

fn detector(camera: &CameraFrame) -> FrameStatus {
    FrameStatus {
        rows: camera.rows,
        hits: camera.hits,
        outside: camera.outside,
        overflow: camera.overflow,
        damaged_rows: camera.damaged_rows,
        // Rows beyond the frame belong to none: the IP counts them as stray
        excess_rows: 0,
        truncated: camera.truncated,
    }
}
