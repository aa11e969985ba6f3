//! The driver.

use core::fmt;

use karst_core::{Method, NoPoint, Point};

use crate::results::{POINT_WORDS, SPOT_WORDS, point_from_words};
use crate::settings::lasers_fit;
use crate::{CameraFrame, Events, Faults, RegisterBus, RigWords, Settings, SettingsError, SpotRecord, map};

/// Why there is no IP this driver can use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ProbeError<E> {
    /// An access failed.
    Bus(E),
    /// Something else is at this address.
    Magic {
        /// Value of the magic register.
        found: u32,
    },
    /// The IP has another register map than this driver.
    Map {
        /// Version of the IP: major, minor, patch.
        version: [u8; 3],
        /// Its map hash.
        found: u32,
    },
}

impl<E: fmt::Display> fmt::Display for ProbeError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "no access to the registers: {error}"),
            Self::Magic { found } => write!(f, "no karst IP there: found {found:#010x}"),
            Self::Map { version: [major, minor, patch], found } => {
                let expected = map::MAP_HASH_VALUE_RESET;
                write!(f, "IP {major}.{minor}.{patch} has register map {found:#010x}, expected {expected:#010x}")
            }
        }
    }
}

impl<E: fmt::Debug + fmt::Display> core::error::Error for ProbeError<E> {}

/// Why settings were not loaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LoadError<E> {
    /// An access failed.
    Bus(E),
    /// The IP cannot work with them.
    Settings(SettingsError),
    /// A commit is under way: the settings memory cannot be written.
    Committing,
    /// The memory does not hold what was written.
    Verify {
        /// Address of the word.
        address: u32,
        /// Value written.
        written: u32,
        /// Value read back.
        found: u32,
    },
}

impl<E: fmt::Display> fmt::Display for LoadError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "no access to the settings: {error}"),
            Self::Settings(error) => error.fmt(f),
            Self::Committing => write!(f, "a commit is under way"),
            Self::Verify { address, written, found } => {
                write!(f, "settings word {address:#07x} is {found:#010x} after writing {written:#010x}")
            }
        }
    }
}

impl<E: fmt::Debug + fmt::Display> core::error::Error for LoadError<E> {}

/// Why a result was not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ReadError<E> {
    /// An access failed.
    Bus(E),
    /// The frame has no such record.
    Index {
        /// Index asked for.
        found: u32,
        /// Records there are.
        count: u32,
    },
    /// The record is none that the IP writes.
    Record {
        /// Its first word.
        status: u32,
    },
}

impl<E: fmt::Display> fmt::Display for ReadError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "no access to the results: {error}"),
            Self::Index { found, count } => write!(f, "record {found} of {count}"),
            Self::Record { status } => write!(f, "a record with unknown status {status:#010x}"),
        }
    }
}

impl<E: fmt::Debug + fmt::Display> core::error::Error for ReadError<E> {}

impl<E> From<E> for ReadError<E> {
    fn from(error: E) -> Self {
        Self::Bus(error)
    }
}

/// What the IP was built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Capacity {
    /// Most lasers.
    pub lasers: u16,
    /// Most spots per laser and camera.
    pub slots: u8,
    /// Pixels per clock.
    pub pixels_per_clock: u8,
}

/// What is going on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// A commit is under way.
    pub committing: bool,
    /// A frame's results can be read.
    pub ready: bool,
    /// Settings have been committed since the reset.
    pub configured: bool,
    /// A frame of camera 0, of camera 1 is being taken.
    pub in_frame: [bool; 2],
}

/// How often things happened. All but `frames` stay at 65535.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Frames whose results were made ready, wraps around.
    pub frames: u32,
    /// Frames whose results were overwritten before they could be read.
    pub missed: u16,
    /// Frames of one camera without a partner.
    pub unpaired: u16,
    /// Frames that were not taken because a commit was under way.
    pub skipped: u16,
    /// Rows that ended before the width, per camera.
    pub short_rows: [u16; 2],
    /// Rows that went on beyond the width, per camera.
    pub long_rows: [u16; 2],
    /// Frames that ended before their last row, per camera.
    pub truncated: [u16; 2],
    /// Rows outside a frame, per camera.
    pub stray_rows: [u16; 2],
    /// Beats that had to wait for the detector's buffers, per camera.
    pub stalled: [u16; 2],
}

/// A word of a rig, with the method if it belongs there.
fn with_method(address: u32, word: u32, method: Method) -> u32 {
    let paper = map::SETTINGS_INSTRUMENT_LASERS_PAPER;
    match address {
        map::SETTINGS_INSTRUMENT_LASERS => word & !paper.mask() | paper.of((method == Method::Paper).into()),
        _ => word,
    }
}

/// The IP behind a bus.
#[derive(Debug)]
pub struct Karst<B> {
    bus: B,
    capacity: Capacity,
}

impl<B: RegisterBus> Karst<B> {
    /// Finds the IP and makes sure that it has the register map this driver was made for.
    pub fn probe(mut bus: B) -> Result<Self, ProbeError<B::Error>> {
        let mut read = |address| bus.read32(address).map_err(ProbeError::Bus);
        let magic = read(map::MAGIC)?;
        if magic != map::MAGIC_VALUE_RESET {
            return Err(ProbeError::Magic { found: magic });
        }
        let version = read(map::VERSION)?;
        let hash = read(map::MAP_HASH)?;
        if hash != map::MAP_HASH_VALUE_RESET {
            let version = [map::VERSION_MAJOR, map::VERSION_MINOR, map::VERSION_PATCH].map(|f| f.get(version) as u8);
            return Err(ProbeError::Map { version, found: hash });
        }
        let capacity = read(map::CAPACITY)?;
        let capacity = Capacity {
            lasers: map::CAPACITY_LASERS.get(capacity) as u16,
            slots: map::CAPACITY_SLOTS.get(capacity) as u8,
            pixels_per_clock: map::CAPACITY_PIXELS_PER_CLOCK.get(capacity) as u8,
        };
        Ok(Self { bus, capacity })
    }

    /// What the IP was built for.
    pub fn capacity(&self) -> Capacity {
        self.capacity
    }

    /// The bus.
    pub fn bus(&mut self) -> &mut B {
        &mut self.bus
    }

    /// Writes settings to the settings memory and reads them back. They take effect with [`Karst::commit`].
    pub fn load<const LASERS: usize>(&mut self, settings: &Settings<'_, LASERS>) -> Result<(), LoadError<B::Error>> {
        settings.check(self.capacity.lasers).map_err(LoadError::Settings)?;
        self.load_words(&RigWords::new(settings.calibration, settings.detectors), settings.method)
    }

    /// As [`Karst::load`], of a rig that [`RigWords::check`] has found to be one.
    pub fn load_words<const LASERS: usize>(
        &mut self,
        words: &RigWords<LASERS>,
        method: Method,
    ) -> Result<(), LoadError<B::Error>> {
        let capacity = self.capacity;
        let fitting = lasers_fit(words.lasers().into(), capacity.lasers).and_then(|()| {
            let width = |camera| words.width(camera);
            let odd = |camera: &usize| !width(*camera).is_multiple_of(capacity.pixels_per_clock.max(1).into());
            let odd = (0..2).find(odd);
            odd.map_or(Ok(()), |camera| Err(SettingsError::Width { camera, found: width(camera) }))
        });
        fitting.map_err(LoadError::Settings)?;
        if self.status().map_err(LoadError::Bus)?.committing {
            return Err(LoadError::Committing);
        }
        for read_back in [false, true] {
            for (number, block) in (0..).zip(words.blocks()) {
                for (address, &word) in (RigWords::<LASERS>::address(number)..).step_by(4).zip(block) {
                    let word = with_method(address, word, method);
                    if !read_back {
                        self.bus.write32(address, word).map_err(LoadError::Bus)?;
                        continue;
                    }
                    let found = self.bus.read32(address).map_err(LoadError::Bus)?;
                    if found != word {
                        return Err(LoadError::Verify { address, written: word, found });
                    }
                }
            }
        }
        Ok(())
    }

    /// Has the settings memory take effect, all of it at once, as soon as no frame is under way: then
    /// [`Status::committing`] falls and [`Events::committed`] is set.
    pub fn commit(&mut self) -> Result<(), B::Error> {
        self.bus.write32(map::COMMAND, map::COMMAND_COMMIT.mask())
    }

    /// What is going on.
    pub fn status(&mut self) -> Result<Status, B::Error> {
        let status = self.bus.read32(map::STATUS)?;
        Ok(Status {
            committing: map::STATUS_COMMITTING.is_set(status),
            ready: map::STATUS_READY.is_set(status),
            configured: map::STATUS_CONFIGURED.is_set(status),
            in_frame: [map::STATUS_FRAME_1, map::STATUS_FRAME_2].map(|frame| frame.is_set(status)),
        })
    }

    /// Starts or stops to take frames, at the start of a pair of frames. None are taken before the first commit.
    pub fn set_enabled(&mut self, enabled: bool) -> Result<(), B::Error> {
        self.bus.write32(map::CONTROL, map::CONTROL_ENABLE.of(enabled.into()))
    }

    /// Forgets frames that are under way and results that were not acknowledged. Settings stay. The way out when a
    /// camera has stopped within a frame.
    pub fn reset(&mut self) -> Result<(), B::Error> {
        self.bus.write32(map::COMMAND, map::COMMAND_RESET.mask())
    }

    /// Chooses the events that raise the interrupt.
    pub fn set_interrupts(&mut self, events: Events) -> Result<(), B::Error> {
        self.bus.write32(map::INTERRUPT_ENABLE, events.bits())
    }

    /// Reads and clears the events.
    pub fn take_events(&mut self) -> Result<Events, B::Error> {
        self.take(map::INTERRUPT_STATUS).map(Events::from_bits)
    }

    /// Reads and clears the faults.
    pub fn take_faults(&mut self) -> Result<Faults, B::Error> {
        self.take(map::FAULT).map(Faults::from_bits)
    }

    /// Clears exactly what was read: what comes in between stays.
    fn take(&mut self, address: u32) -> Result<u32, B::Error> {
        let found = self.bus.read32(address)?;
        self.bus.write32(address, found)?;
        Ok(found)
    }

    /// Clocks since the reset, wraps around.
    pub fn cycles(&mut self) -> Result<u32, B::Error> {
        self.bus.read32(map::CYCLES)
    }

    /// The counters.
    pub fn counters(&mut self) -> Result<Counters, B::Error> {
        let mut count = |address| self.bus.read32(address).map(|word| word as u16);
        let mut both = |address: fn(u32) -> u32| Ok([count(address(0))?, count(address(1))?]);
        Ok(Counters {
            short_rows: both(map::camera_short_rows)?,
            long_rows: both(map::camera_long_rows)?,
            truncated: both(map::camera_truncated)?,
            stray_rows: both(map::camera_stray_rows)?,
            stalled: both(map::camera_stalled)?,
            missed: count(map::MISSED)?,
            unpaired: count(map::UNPAIRED)?,
            skipped: count(map::SKIPPED)?,
            frames: self.bus.read32(map::FRAMES)?,
        })
    }

    /// Sets all counters to zero.
    pub fn clear_counters(&mut self) -> Result<(), B::Error> {
        for address in [map::FRAMES, map::MISSED, map::UNPAIRED, map::SKIPPED] {
            self.bus.write32(address, 0)?;
        }
        for camera in 0..2 {
            for address in [
                map::camera_short_rows(camera),
                map::camera_long_rows(camera),
                map::camera_truncated(camera),
                map::camera_stray_rows(camera),
                map::camera_stalled(camera),
            ] {
                self.bus.write32(address, 0)?;
            }
        }
        Ok(())
    }

    /// The frame whose results are ready, if there is one. It stays as it is until [`Frame::acknowledge`].
    pub fn frame(&mut self) -> Result<Option<Frame<'_, B>>, B::Error> {
        if !self.status()?.ready {
            return Ok(None);
        }
        let camera = |bus: &mut B, camera| -> Result<CameraFrame, B::Error> {
            let rows = bus.read32(map::result_camera_rows(camera))?;
            Ok(CameraFrame {
                hits: bus.read32(map::result_camera_hits(camera))?,
                outside: bus.read32(map::result_camera_outside(camera))?,
                overflow: bus.read32(map::result_camera_overflow(camera))?,
                rows: map::RESULT_CAMERA_ROWS_TAKEN.get(rows) as u16,
                damaged_rows: map::RESULT_CAMERA_ROWS_DAMAGED.get(rows) as u16,
                truncated: map::RESULT_CAMERA_ROWS_TRUNCATED.is_set(rows),
                spots: bus.read32(map::result_camera_spots(camera))?,
            })
        };
        let bus = &mut self.bus;
        Ok(Some(Frame {
            pair: bus.read32(map::RESULT_FRAME_PAIR)?,
            settings: bus.read32(map::RESULT_FRAME_SETTINGS)?,
            lasers: bus.read32(map::RESULT_FRAME_LASERS)?,
            receive_cycles: bus.read32(map::RESULT_FRAME_RECEIVE_CYCLES)?,
            latency_cycles: bus.read32(map::RESULT_FRAME_LATENCY_CYCLES)?,
            cameras: [camera(bus, 0)?, camera(bus, 1)?],
            bus,
        }))
    }
}

/// The results of one frame pair.
#[derive(Debug)]
pub struct Frame<'a, B> {
    /// Number of the pair: counts the pairs taken since the reset, from 1.
    pub pair: u32,
    /// Number of the settings it was measured with: commits since the reset.
    pub settings: u32,
    /// How many lasers have a result.
    pub lasers: u32,
    /// Clocks from the first pixel of either camera to the last pixel of the later one.
    pub receive_cycles: u32,
    /// Clocks from the last pixel of the later camera to the results.
    pub latency_cycles: u32,
    /// What happened to the pixels.
    pub cameras: [CameraFrame; 2],
    bus: &'a mut B,
}

impl<B: RegisterBus> Frame<'_, B> {
    /// The point of a laser, or why there is none. Its [`karst_core::Estimates`] are empty: the IP does not give them.
    pub fn point(&mut self, laser: u16) -> Result<Result<Point, NoPoint>, ReadError<B::Error>> {
        let index = u32::from(laser);
        if index >= self.lasers {
            return Err(ReadError::Index { found: index, count: self.lasers });
        }
        let mut words = [0; POINT_WORDS];
        for (address, word) in (map::result_point_status(index)..).step_by(4).zip(&mut words) {
            *word = self.bus.read32(address)?;
        }
        point_from_words(laser, &words).ok_or(ReadError::Record { status: words[0] })
    }

    /// A spot of `camera` (0 or 1), in the order of the lasers.
    pub fn spot(&mut self, camera: usize, index: u32) -> Result<SpotRecord, ReadError<B::Error>> {
        let count = self.cameras[camera].spots;
        if index >= count {
            return Err(ReadError::Index { found: index, count });
        }
        let mut words = [0; SPOT_WORDS];
        for (address, word) in (map::spots_camera_spot_column(camera as u32, index)..).step_by(4).zip(&mut words) {
            *word = self.bus.read32(address)?;
        }
        Ok(SpotRecord::from_words(&words))
    }

    /// Whether something that has been read is not what it seems: [`RegisterBus::has_failed`].
    pub fn has_failed(&mut self) -> bool {
        self.bus.has_failed()
    }

    /// Gives the memory back: the next frame's results can become ready.
    pub fn acknowledge(self) -> Result<(), B::Error> {
        self.bus.write32(map::COMMAND, map::COMMAND_ACKNOWLEDGE.mask())
    }
}
