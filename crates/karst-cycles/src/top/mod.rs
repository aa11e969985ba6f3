//! The whole IP, clock by clock.

mod gate;
mod reconstructor;
mod results;
mod tags;

use karst_core::DetectorConfig;

use crate::detector::{Detector, Generics, Mask, Record};
use crate::stream::Beat;
use crate::timing::registers::INTERRUPT;
use gate::Gate;
use reconstructor::Reconstructor;
use results::Results;
use tags::Tags;

/// How a `karst_top` was built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopGenerics {
    /// Its detectors.
    pub detector: Generics,
    /// G_BITS_PER_STAGE: bits of divisions per clock, 1 to 4.
    pub bits_per_stage: u64,
}

impl Default for TopGenerics {
    fn default() -> Self {
        Self { detector: Generics::default(), bits_per_stage: 3 }
    }
}

/// What of the settings decides on the reconstructor's clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reconstruction {
    /// The paper's method instead of the weighted one.
    pub paper: bool,
    /// One camera alone may give a point.
    pub single_camera: bool,
}

/// What the gate knows of a frame that starts or ends.
#[derive(Debug, Clone, Copy, Default)]
struct Frames {
    start: [Option<usize>; 2],
    /// The bank of the frame that ends, and whether it has a partner.
    finish: [Option<bool>; 2],
}

/// The IP with its settings in use, and frames enabled. What it says in a clock is there before [`Top::clock`] ends it.
#[derive(Debug)]
pub struct Top {
    gate: Gate,
    tags: [Tags; 2],
    detectors: [Detector; 2],
    /// The bank of a spot of camera 2 that comes a clock later.
    later: Option<usize>,
    reconstructor: Reconstructor,
    results: Results,
    interrupts: [bool; INTERRUPT as usize],
}

impl Top {
    /// An IP at the end of its reset.
    pub fn new<const LASERS: usize>(
        generics: &TopGenerics,
        configs: [&DetectorConfig<LASERS>; 2],
        reconstruction: Reconstruction,
    ) -> Self {
        let lasers = configs[0].azimuths.len();
        Self {
            gate: Gate::new(configs.map(|config| config.height.into())),
            tags: [Tags::new(), Tags::new()],
            detectors: configs.map(|config| Detector::new(&generics.detector, config)),
            later: None,
            reconstructor: Reconstructor::new(generics, lasers, reconstruction),
            results: Results::new(),
            interrupts: [false; INTERRUPT as usize],
        }
    }

    /// Whether beats that are there in this clock are taken.
    pub fn takes(&self, beats: [Option<&Beat>; 2]) -> [bool; 2] {
        self.gate.takes(beats, self.detectors_ready(), self.room())
    }

    fn detectors_ready(&self) -> [bool; 2] {
        self.detectors.each_ref().map(Detector::is_ready)
    }

    fn room(&self) -> [bool; 2] {
        self.tags.each_ref().map(Tags::has_room)
    }

    /// A point comes in this clock; true: the frame's last one.
    pub fn point(&self) -> Option<bool> {
        self.reconstructor.point()
    }

    /// The interrupt tells of results, if those before are acknowledged.
    pub fn is_interrupt(&self) -> bool {
        self.interrupts[INTERRUPT as usize - 1]
    }

    /// Ends a clock in which the cameras have offered these beats.
    pub fn clock(&mut self, beats: [Option<&Beat>; 2]) {
        let detectors_ready = self.detectors_ready();
        let takes = self.gate.takes(beats, detectors_ready, self.room());
        let early = self.detectors.each_ref().map(|detector| detector.early().is_some());
        let masks: [Option<Mask>; 2] = self.detectors.each_ref().map(Detector::mask);
        let masked = masks.map(|mask| mask.is_some_and(|mask| mask.last));
        let records: [Option<Record>; 2] = self.detectors.each_ref().map(Detector::record);
        let of_record = self.tags.each_ref().map(Tags::of_records);
        let of_mask = self.tags.each_ref().map(Tags::of_masks);
        let welcome = self.results.welcomes(records, of_record, self.point().is_some());
        let recorded = [0, 1].map(|camera: usize| welcome[camera] && records[camera] == Some(Record::Frame));
        let start = self.results.start();
        let is_done = self.results.is_done();

        let spot = if early[0] { Some(of_mask[0].bank) } else { self.later };
        if early[1] {
            self.later = Some(of_mask[1].bank);
        } else if !early[0] {
            self.later = None;
        }

        let is_started = start.is_some() && self.reconstructor.is_ready();
        let point = self.point();
        self.results.clock(masked, of_mask, recorded, of_record, is_started, point);
        self.reconstructor.clock(spot, masks, of_mask.map(|tag| tag.bank), start.filter(|_| is_started));

        self.interrupts.rotate_right(1);
        self.interrupts[0] = is_done;

        let gated = self.gate.output();
        for (camera, detector) in self.detectors.iter_mut().enumerate() {
            let (beat, is_void) = gated[camera].map_or((None, false), |(beat, is_void)| (Some(beat), is_void));
            detector.clock(beat.as_ref(), is_void, welcome[camera]);
        }
        let frames = self.gate.clock(beats, takes, detectors_ready, is_done);
        for (camera, tags) in self.tags.iter_mut().enumerate() {
            tags.clock(frames.start[camera], frames.finish[camera], masked[camera], recorded[camera]);
        }
    }
}
