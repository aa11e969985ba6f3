//! A sensor without hardware, clock by clock: the firmware in the simulated SoC, and cameras that show given pictures.

use std::cell::{Ref, RefCell, RefMut};
use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::rc::Rc;
use std::time::{Duration, Instant};

use image::RgbImage;
use karst_link::{Decoder, Message};
use serde::Serialize;

use super::Clock;
use super::soc::{Byte, CLOCKS_PER_US, Soc};

/// Clocks simulated at once: what a look at the line costs.
const STEP: u64 = 1000;

/// With fewer pixels than this on their way to a camera's input it takes the next picture.
const NEARLY_DONE: u32 = 4 * STEP as u32;

/// The pictures that the cameras take, one pair after the other.
type Pictures = Box<dyn Iterator<Item = io::Result<[RgbImage; 2]>>>;

/// When cameras that run on their own take the next pair of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pace {
    /// When the sensor has sent the frame before: none is dropped.
    #[default]
    Patient,
    /// At once: one pixel per clock, and so many idle clocks after each row.
    FullRate {
        /// The idle clocks.
        blanking: u32,
    },
}

/// What a frame took, in clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct FrameClocks {
    /// Its number.
    pub frame: u32,
    /// From the first pixel of either camera to the last one.
    pub pixels: u64,
    /// From the last pixel until the gateware has made the results ready: in software mode those are the spots.
    pub to_results: u64,
    /// From the last pixel until the first byte of the frame is on the line.
    pub to_first_byte: u64,
    /// From the last pixel until the last byte is.
    pub to_last_byte: u64,
    /// Bytes from the first to the last one: messages are the longer the larger the numbers in them.
    pub bytes: u64,
}

/// A simulated SoC with its firmware as the host sees it: a line to read from and write to, for
/// [`super::SensorClient::connect_by`] with its [`SimulatedSoc::clock`]. Its clones are the same one.
///
/// It starts without a calibration, with the lasers off. When it has told in a status that it has one, its cameras take
/// pictures: at their pace, or at the sensor's trigger. With the lasers off the pictures are dark.
#[derive(Clone)]
pub struct SimulatedSoc(Rc<RefCell<World>>);

struct World {
    soc: Soc,
    clock: Clock,
    pace: Pace,
    pictures: Pictures,
    to_host: VecDeque<u8>,
    spy: Spy,
    /// Rising edges of the trigger that have been seen.
    triggers: u32,
    /// Of each frame whose last row has gone: clocks of its first and last pixel, by camera.
    spans: [Vec<[u64; 2]>; 2],
    /// When results were made ready.
    results: Vec<u64>,
    simulating: Duration,
}

/// Reads what the sensor says, and when it does.
struct Spy {
    decoder: Decoder,
    /// Bytes so far.
    bytes: u64,
    /// When the message that is under way began, and after how many bytes.
    begin: Option<[u64; 2]>,
    /// When the first message of the frame that is under way began, and after how many bytes.
    frame: Option<[u64; 2]>,
    calibrated: bool,
    triggered: bool,
    /// A frame has been sent, or none has been taken yet.
    idle: bool,
    /// The frames that have been sent.
    sent: Vec<Sent>,
}

/// A frame's number, the clocks of its first and its last byte, and how many there are.
#[derive(Clone, Copy)]
struct Sent {
    frame: u32,
    first: u64,
    last: u64,
    bytes: u64,
}

impl Spy {
    fn read(&mut self, Byte { byte, clock }: Byte) {
        let begin = *self.begin.get_or_insert([clock, self.bytes]);
        self.bytes += 1;
        let Some(message) = self.decoder.push(byte) else { return };
        self.begin = None;
        match message {
            Message::Status(status) => self.calibrated = status.calibration.is_some(),
            Message::Settings(settings) => self.triggered = settings.trigger_period_us != 0,
            Message::Laser(_) | Message::Spot(_) => {
                self.frame.get_or_insert(begin);
            }
            Message::FrameEnd(end) => {
                let [first, before] = self.frame.take().unwrap_or(begin);
                self.sent.push(Sent { frame: end.frame, first, last: clock, bytes: self.bytes - before });
                self.idle = true;
            }
            _ => {}
        }
    }
}

impl SimulatedSoc {
    /// Cameras that take the pictures one pair after the other; after the last one they are stuck. A picture that can not
    /// be read breaks the line.
    pub fn new(soc: Soc, pace: Pace, pictures: impl Iterator<Item = io::Result<[RgbImage; 2]>> + 'static) -> Self {
        let spy = Spy {
            decoder: Decoder::new(),
            bytes: 0,
            begin: None,
            frame: None,
            calibrated: false,
            triggered: false,
            idle: true,
            sent: Vec::new(),
        };
        Self(Rc::new(RefCell::new(World {
            soc,
            clock: Clock::of_simulation(),
            pace,
            pictures: Box::new(pictures),
            to_host: VecDeque::new(),
            spy,
            triggers: 0,
            spans: [Vec::new(), Vec::new()],
            results: Vec::new(),
            simulating: Duration::ZERO,
        })))
    }

    /// The time that the sensor lives in.
    pub fn clock(&self) -> Clock {
        self.0.borrow().clock.clone()
    }

    /// What the frames took that have been sent so far. Frames are counted as the sensor does, from its start; one that
    /// had no whole partner, or came before a restart, puts the count out.
    pub fn frames(&self) -> Vec<FrameClocks> {
        let world = self.0.borrow();
        world.spy.sent.iter().filter_map(|&sent| world.clocks_of(sent)).collect()
    }

    /// The simulation itself: to see its pins, and for what else may happen to a SoC.
    pub fn soc(&self) -> Ref<'_, Soc> {
        Ref::map(self.0.borrow(), |world| &world.soc)
    }

    /// The same to change it.
    pub fn soc_mut(&self) -> RefMut<'_, Soc> {
        RefMut::map(self.0.borrow_mut(), |world| &mut world.soc)
    }

    /// Time that this computer has spent on simulating.
    pub fn simulating(&self) -> Duration {
        self.0.borrow().simulating
    }
}

impl World {
    fn clocks_of(&self, sent: Sent) -> Option<FrameClocks> {
        let index = sent.frame.checked_sub(1)? as usize;
        let [a, b] = [self.spans[0].get(index)?, self.spans[1].get(index)?];
        let (first, last) = (a[0].min(b[0]), a[1].max(b[1]));
        let [to_results, to_first_byte, to_last_byte] =
            [*self.results.get(index)?, sent.first, sent.last].map(|clock| clock.checked_sub(last));
        Some(FrameClocks {
            frame: sent.frame,
            pixels: last - first + 1,
            to_results: to_results?,
            to_first_byte: to_first_byte?,
            to_last_byte: to_last_byte?,
            bytes: sent.bytes,
        })
    }

    /// Lets some clocks go by.
    fn step(&mut self) -> io::Result<()> {
        self.expose()?;
        let start = Instant::now();
        let state = *self.soc.step(STEP)?;
        self.simulating += start.elapsed();
        self.clock.set(Duration::from_nanos(state.clock * 1000 / CLOCKS_PER_US));
        for (camera, spans) in state.cameras.iter().zip(&mut self.spans) {
            if camera.frames as usize > spans.len() {
                spans.push(camera.span);
            }
        }
        if state.results as usize > self.results.len() {
            self.results.push(state.last_results);
        }
        for byte in self.soc.received() {
            self.spy.read(byte);
            self.to_host.push_back(byte.byte);
        }
        Ok(())
    }

    /// Has the cameras take a pair of pictures if it is time.
    fn expose(&mut self) -> io::Result<()> {
        let state = self.soc.state();
        let triggers = std::mem::replace(&mut self.triggers, state.triggers);
        let due = match self.pace {
            _ if !self.spy.calibrated => false,
            _ if self.spy.triggered => triggers != self.triggers,
            Pace::Patient => self.spy.idle,
            Pace::FullRate { .. } => state.cameras.iter().all(|camera| camera.pending < NEARLY_DONE),
        };
        if !due {
            return Ok(());
        }
        let Some(images) = self.pictures.next() else { return Ok(()) };
        self.spy.idle = false;
        let blanking = if let Pace::FullRate { blanking } = self.pace { blanking } else { 0 };
        let lasers_on = state.lasers;
        for (camera, mut image) in images?.into_iter().enumerate() {
            if !lasers_on {
                image.fill(0);
            }
            self.soc.frame(camera, image.as_raw(), image.width() as usize, blanking)?;
        }
        Ok(())
    }
}

impl Read for SimulatedSoc {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut world = self.0.borrow_mut();
        if world.to_host.is_empty() {
            world.step()?;
        }
        match world.to_host.read(buffer)? {
            0 => Err(io::ErrorKind::TimedOut.into()),
            count => Ok(count),
        }
    }
}

impl Write for SimulatedSoc {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().soc.send(buffer)?;
        Ok(buffer.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
