//! The register block: everything between the bus and the frames. Twin of `hw-ip/rtl/regs/registers.vhd`.

use crate::results::SPOT_WORDS;
use crate::{Field, map};

/// Records of the result memory before the points: the frame and the two cameras.
const RECORDS_BEFORE_POINTS: usize = 4;

/// Words of a record of the result memory.
pub const RESULT_WORDS: usize = 8;

/// What the frames tell the registers, for one clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A row of the camera ended before the width.
    ShortRow(usize),
    /// A row of the camera went on beyond the width.
    LongRow(usize),
    /// A frame of the camera ended before its last row.
    Truncated(usize),
    /// A row of the camera came outside a frame.
    StrayRow(usize),
    /// Hits of the camera were lost.
    Overflow(usize),
    /// A beat of the camera had to wait: counted, no fault.
    Stalled(usize),
    /// A frame of one camera had no partner.
    Unpaired,
    /// A frame was not taken because a commit was under way.
    Skipped,
}

/// What the banks are for: places in `Registers::order`.
const READING: usize = 0;
const WAITING: usize = 1;
const WRITING: usize = 2;

/// Result memories of one frame.
#[derive(Debug, Clone)]
struct Bank {
    results: Vec<[u32; RESULT_WORDS]>,
    spots: [Vec<[u32; SPOT_WORDS]>; 2],
}

/// The registers and memories.
#[derive(Debug, Clone)]
pub struct Registers {
    lasers: usize,
    slots: usize,
    enabled: bool,
    event_flags: u32,
    interrupt_enable: u32,
    fault: u32,
    frames: u32,
    missed: u16,
    unpaired: u16,
    skipped: u16,
    /// Per camera: short rows, long rows, truncated frames, stray rows, stalled beats.
    cameras: [[u16; 5]; 2],
    in_frame: [bool; 2],
    settings: Vec<u32>,
    committing: bool,
    commits: u32,
    banks: [Bank; 3],
    /// The bank that the bus reads, the one for a frame that waits for that, and the one that is written.
    order: [usize; 3],
    /// The first one holds a frame.
    ready: bool,
    /// The second one holds a complete frame as well.
    waits: bool,
}

impl Registers {
    /// Registers of an IP for so many lasers and spots per laser, after a reset.
    pub fn new(lasers: usize, slots: usize) -> Self {
        let bank = Bank {
            results: vec![[0; RESULT_WORDS]; RECORDS_BEFORE_POINTS + lasers],
            spots: [(); 2].map(|()| vec![[0; SPOT_WORDS]; lasers * slots]),
        };
        let first_laser = (map::settings_laser_azimuth(0) - map::SETTINGS_INSTRUMENT_LASERS) as usize;
        let laser = (map::settings_laser_azimuth(1) - map::settings_laser_azimuth(0)) as usize;
        Self {
            lasers,
            slots,
            enabled: false,
            event_flags: 0,
            interrupt_enable: 0,
            fault: 0,
            frames: 0,
            missed: 0,
            unpaired: 0,
            skipped: 0,
            cameras: [[0; 5]; 2],
            in_frame: [false; 2],
            settings: vec![0; (first_laser + laser * lasers) / 4],
            committing: false,
            commits: 0,
            banks: [bank.clone(), bank.clone(), bank],
            order: [0, 1, 2],
            ready: false,
            waits: false,
        }
    }

    /// Reads a register. What is not there reads as zero.
    pub fn read(&self, address: u32) -> u32 {
        let offset = |from: u32| ((address - from) / 4) as usize;
        if address >= map::spots_camera_spot_column(0, 0) {
            self.read_spots(offset(map::spots_camera_spot_column(0, 0)))
        } else if address >= map::RESULT_FRAME_PAIR {
            let word = offset(map::RESULT_FRAME_PAIR);
            let record = self.readable().results.get(word / RESULT_WORDS);
            if self.ready { record.map_or(0, |record| record[word % RESULT_WORDS]) } else { 0 }
        } else if address >= map::SETTINGS_INSTRUMENT_LASERS {
            self.settings.get(offset(map::SETTINGS_INSTRUMENT_LASERS)).copied().unwrap_or(0)
        } else {
            self.read_register(address)
        }
    }

    fn read_spots(&self, word: usize) -> u32 {
        let per_camera = (map::spots_camera_spot_column(1, 0) - map::spots_camera_spot_column(0, 0)) as usize / 4;
        let of_camera = self.readable().spots.get(word / per_camera);
        let record = of_camera.and_then(|spots| spots.get(word % per_camera / SPOT_WORDS));
        if self.ready { record.map_or(0, |record| record[word % SPOT_WORDS]) } else { 0 }
    }

    fn read_register(&self, address: u32) -> u32 {
        match address {
            map::MAGIC => map::MAGIC_VALUE_RESET,
            map::VERSION => {
                map::VERSION_MAJOR.of(map::VERSION_MAJOR_RESET)
                    | map::VERSION_MINOR.of(map::VERSION_MINOR_RESET)
                    | map::VERSION_PATCH.of(map::VERSION_PATCH_RESET)
            }
            map::MAP_HASH => map::MAP_HASH_VALUE_RESET,
            map::CAPACITY => {
                map::CAPACITY_LASERS.of(self.lasers as u32)
                    | map::CAPACITY_SLOTS.of(self.slots as u32)
                    | map::CAPACITY_PIXELS_PER_CLOCK.of(1)
            }
            map::CONTROL => map::CONTROL_ENABLE.of(self.enabled.into()),
            map::STATUS => {
                map::STATUS_COMMITTING.of(self.committing.into())
                    | map::STATUS_READY.of(self.ready.into())
                    | map::STATUS_CONFIGURED.of(self.configured().into())
                    | map::STATUS_FRAME_1.of(self.in_frame[0].into())
                    | map::STATUS_FRAME_2.of(self.in_frame[1].into())
            }
            map::INTERRUPT_STATUS => self.event_flags,
            map::INTERRUPT_ENABLE => self.interrupt_enable,
            map::FAULT => self.fault,
            map::FRAMES => self.frames,
            map::MISSED => self.missed.into(),
            map::UNPAIRED => self.unpaired.into(),
            map::SKIPPED => self.skipped.into(),
            _ => counter_of(address).map_or(0, |(camera, counter)| self.cameras[camera][counter].into()),
        }
    }

    /// Writes a register. What is not there, or not to be written, ignores it. Gives whether it was the command to
    /// reset, which the frames have to follow as well.
    pub fn write(&mut self, address: u32, value: u32) -> bool {
        if address >= map::RESULT_FRAME_PAIR {
            return false;
        }
        if address >= map::SETTINGS_INSTRUMENT_LASERS {
            let word = (address - map::SETTINGS_INSTRUMENT_LASERS) / 4;
            if self.committing {
                self.raise(map::FAULT_REFUSED);
            } else if let Some(word) = self.settings.get_mut(word as usize) {
                *word = value;
            }
            return false;
        }
        match address {
            map::CONTROL => self.enabled = map::CONTROL_ENABLE.is_set(value),
            map::COMMAND => return self.command(value),
            map::INTERRUPT_STATUS => self.event_flags &= !value,
            map::INTERRUPT_ENABLE => {
                let flags = [map::INTERRUPT_ENABLE_READY, map::INTERRUPT_ENABLE_COMMITTED, map::INTERRUPT_ENABLE_FAULT];
                self.interrupt_enable = value & flags.map(Field::mask).into_iter().sum::<u32>();
            }
            map::FAULT => self.fault &= !value,
            map::FRAMES => self.frames = 0,
            map::MISSED => self.missed = 0,
            map::UNPAIRED => self.unpaired = 0,
            map::SKIPPED => self.skipped = 0,
            _ => {
                if let Some((camera, counter)) = counter_of(address) {
                    self.cameras[camera][counter] = 0;
                }
            }
        }
        false
    }

    fn command(&mut self, value: u32) -> bool {
        if map::COMMAND_ACKNOWLEDGE.is_set(value) {
            self.ready = false;
            if self.waits {
                self.waits = false;
                self.order.swap(READING, WAITING);
                self.make_ready();
            }
        }
        self.committing |= map::COMMAND_COMMIT.is_set(value);
        let reset = map::COMMAND_RESET.is_set(value);
        if reset {
            (self.order, self.ready, self.waits) = ([0, 1, 2], false, false);
        }
        reset
    }

    /// Whether frames may be taken.
    pub fn enabled(&self) -> bool {
        self.enabled && self.configured()
    }

    /// Whether a commit is under way.
    pub fn committing(&self) -> bool {
        self.committing
    }

    /// Whether settings have been committed.
    pub fn configured(&self) -> bool {
        self.commits > 0
    }

    /// Number of the settings in use.
    pub fn commits(&self) -> u32 {
        self.commits
    }

    /// Whether the interrupt line is up.
    pub fn interrupt(&self) -> bool {
        self.event_flags & self.interrupt_enable != 0
    }

    /// Tells whether a frame of a camera is being taken.
    pub fn set_in_frame(&mut self, camera: usize, in_frame: bool) {
        self.in_frame[camera] = in_frame;
    }

    /// Something happened.
    pub fn event(&mut self, event: Event) {
        let of = |camera: usize, flags: [Field; 2]| flags[camera];
        match event {
            Event::ShortRow(camera) => {
                self.count(camera, 0);
                self.raise(of(camera, [map::FAULT_SHORT_ROW_1, map::FAULT_SHORT_ROW_2]));
            }
            Event::LongRow(camera) => {
                self.count(camera, 1);
                self.raise(of(camera, [map::FAULT_LONG_ROW_1, map::FAULT_LONG_ROW_2]));
            }
            Event::Truncated(camera) => {
                self.count(camera, 2);
                self.raise(of(camera, [map::FAULT_TRUNCATED_1, map::FAULT_TRUNCATED_2]));
            }
            Event::StrayRow(camera) => {
                self.count(camera, 3);
                self.raise(of(camera, [map::FAULT_STRAY_ROW_1, map::FAULT_STRAY_ROW_2]));
            }
            Event::Overflow(camera) => self.raise(of(camera, [map::FAULT_OVERFLOW_1, map::FAULT_OVERFLOW_2])),
            Event::Stalled(camera) => self.count(camera, 4),
            Event::Unpaired => {
                self.unpaired = self.unpaired.saturating_add(1);
                self.raise(map::FAULT_UNPAIRED);
            }
            Event::Skipped => {
                self.skipped = self.skipped.saturating_add(1);
                self.raise(map::FAULT_SKIPPED);
            }
        }
    }

    fn count(&mut self, camera: usize, counter: usize) {
        let counter = &mut self.cameras[camera][counter];
        *counter = counter.saturating_add(1);
    }

    fn raise(&mut self, fault: Field) {
        self.fault |= fault.mask();
        self.event_flags |= map::INTERRUPT_STATUS_FAULT.mask();
    }

    /// Carries out a commit that is under way: the frames say that none is. Gives the settings.
    pub fn finish_commit(&mut self) -> Option<&[u32]> {
        if !self.committing {
            return None;
        }
        self.committing = false;
        self.commits = self.commits.wrapping_add(1);
        self.event_flags |= map::INTERRUPT_STATUS_COMMITTED.mask();
        Some(&self.settings)
    }

    /// Writes a record of the result memory: 0 is the frame, 1 and 2 are the cameras, from 4 on the points.
    pub fn write_result(&mut self, index: usize, record: [u32; RESULT_WORDS]) {
        self.writable().results[index] = record;
    }

    /// Writes a record of a camera's spot memory.
    pub fn write_spot(&mut self, camera: usize, index: usize, record: [u32; SPOT_WORDS]) {
        self.writable().spots[camera][index] = record;
    }

    fn readable(&self) -> &Bank {
        &self.banks[self.order[READING]]
    }

    fn writable(&mut self) -> &mut Bank {
        &mut self.banks[self.order[WRITING]]
    }

    /// All results of a frame have been written. One that still waits is lost.
    pub fn finish_frame(&mut self) {
        if self.ready {
            self.order.swap(WAITING, WRITING);
            if self.waits {
                self.missed = self.missed.saturating_add(1);
                self.raise(map::FAULT_MISSED);
            }
            self.waits = true;
        } else {
            self.order.swap(READING, WRITING);
            self.make_ready();
        }
    }

    fn make_ready(&mut self) {
        self.ready = true;
        self.frames = self.frames.wrapping_add(1);
        self.event_flags |= map::INTERRUPT_STATUS_READY.mask();
    }
}

/// Camera and counter at an address.
fn counter_of(address: u32) -> Option<(usize, usize)> {
    let counters = [
        map::camera_short_rows,
        map::camera_long_rows,
        map::camera_truncated,
        map::camera_stray_rows,
        map::camera_stalled,
    ];
    (0..2).find_map(|camera| {
        let counter = counters.iter().position(|counter| counter(camera) == address)?;
        Some((camera as usize, counter))
    })
}
