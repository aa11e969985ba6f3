//! A sensor on a bench: model of the IP, a line, pins, rendered frames, and a host.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::rc::Rc;
use std::sync::LazyLock;

use embedded_hal::digital::{ErrorType as PinErrorType, OutputPin};
use embedded_io::{ErrorKind, ErrorType, Read, ReadReady, Write, WriteReady};
use karst_core::{Estimates, FixedRig, Method, NoPoint, Point, SpotDetector, reconstruct};
use karst_link::{CalibrationSender, Decoder, Encoder, FrameEnd, LaserResult, MAX_FRAME, Message, Status};
use karst_regs::RegisterBus;
use karst_regs::model::Model;
use karst_rig::Rig;
use karst_scene::{Frame, Renderer, evaluation_scenes};
use karst_sensor::{Parts, Sensor, Start};

pub const LASERS: usize = 12;

pub static RIG: LazyLock<FixedRig<LASERS>> = LazyLock::new(|| {
    let rig = Rig::default();
    rig.to_fixed(&rig.water_cameras().unwrap()).unwrap()
});

/// Some rendered frames.
pub static FRAMES: LazyLock<Vec<Frame>> = LazyLock::new(|| {
    let renderer = Renderer::new(&Rig::default()).unwrap();
    let scenes = evaluation_scenes();
    scenes.iter().step_by(scenes.len() / 4).map(|s| renderer.render(&s.scene, s.seed).unwrap()).collect()
});

/// What the sensor must give for a frame.
pub fn expected(frame: &Frame, method: Method) -> Vec<Result<Point, NoPoint>> {
    let mut detectors = RIG.detectors.each_ref().map(|config| SpotDetector::<LASERS>::new(config.clone()).unwrap());
    for (detector, image) in detectors.iter_mut().zip(&frame.images) {
        detector.start_frame();
        for row in image.as_raw().chunks(3 * image.width() as usize) {
            detector.row(row).unwrap();
        }
        detector.end_frame();
    }
    let point = |laser| {
        let spots = detectors.each_ref().map(|detector| detector.spots(laser));
        let point = reconstruct(&RIG.calibration, laser, [&spots[0], &spots[1]], method)?;
        Ok(Point { estimates: Estimates::default(), ..point })
    };
    (0..RIG.calibration.lasers.len()).map(point).collect()
}

/// The hardware, as the test sees it.
#[derive(Default)]
pub struct World {
    pub model: Model<LASERS>,
    /// Accesses that still work before the bus fails; None: it does not fail.
    pub bus_fails_after: Option<u32>,
    /// Accesses before the one that fails without saying so, as on a processor that takes no notice; None: none does.
    pub fails_unseen_after: Option<u32>,
    /// What the bus tells of that when it is asked.
    pub has_failed: bool,
    pub to_sensor: VecDeque<u8>,
    pub from_sensor: Vec<u8>,
    /// Bytes the line takes before it is full; None: it never is.
    pub room: Option<usize>,
    pub lasers_on: bool,
    pub exposures: u32,
}

/// A part of the hardware in the sensor's hands.
#[derive(Clone)]
pub struct Hand(Rc<RefCell<World>>);

#[derive(Debug, PartialEq, Eq)]
pub struct BusFault;

impl Hand {
    /// Gives whether the access is carried out.
    fn access(&self) -> Result<bool, BusFault> {
        let world = &mut *self.0.borrow_mut();
        match &mut world.bus_fails_after {
            None => {}
            Some(0) => return Err(BusFault),
            Some(left) => *left -= 1,
        }
        let fails_now = world.fails_unseen_after == Some(0);
        world.has_failed |= fails_now;
        world.fails_unseen_after = world.fails_unseen_after.and_then(|left| left.checked_sub(1));
        Ok(!fails_now)
    }
}

impl RegisterBus for Hand {
    type Error = BusFault;

    fn read32(&mut self, address: u32) -> Result<u32, BusFault> {
        if !self.access()? {
            return Ok(0);
        }
        self.0.borrow_mut().model.read32(address).map_err(|error| match error {})
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), BusFault> {
        if !self.access()? {
            return Ok(());
        }
        self.0.borrow_mut().model.write32(address, value).map_err(|error| match error {})
    }

    fn has_failed(&mut self) -> bool {
        std::mem::take(&mut self.0.borrow_mut().has_failed)
    }
}

impl ErrorType for Hand {
    type Error = ErrorKind;
}

impl ReadReady for Hand {
    fn read_ready(&mut self) -> Result<bool, ErrorKind> {
        Ok(!self.0.borrow().to_sensor.is_empty())
    }
}

impl Read for Hand {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        let queue = &mut self.0.borrow_mut().to_sensor;
        let count = buffer.len().min(queue.len());
        for (to, byte) in buffer.iter_mut().zip(queue.drain(..count)) {
            *to = byte;
        }
        Ok(count)
    }
}

impl WriteReady for Hand {
    fn write_ready(&mut self) -> Result<bool, ErrorKind> {
        Ok(self.0.borrow().room != Some(0))
    }
}

impl Write for Hand {
    fn write(&mut self, buffer: &[u8]) -> Result<usize, ErrorKind> {
        let mut world = self.0.borrow_mut();
        let count = buffer.len().min(world.room.unwrap_or(usize::MAX));
        world.room = world.room.map(|room| room - count);
        world.from_sensor.extend_from_slice(&buffer[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

/// The laser pin and the trigger pin.
pub struct LaserPin(Hand);
pub struct TriggerPin(Hand);

impl PinErrorType for LaserPin {
    type Error = Infallible;
}

impl OutputPin for LaserPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.0.borrow_mut().lasers_on = false;
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.0.borrow_mut().lasers_on = true;
        Ok(())
    }
}

impl PinErrorType for TriggerPin {
    type Error = Infallible;
}

impl OutputPin for TriggerPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.0.borrow_mut().exposures += 1;
        Ok(())
    }
}

pub struct Bench {
    pub sensor: Sensor<Hand, Hand, LaserPin, TriggerPin, LASERS, { 4 * LASERS }>,
    pub world: Rc<RefCell<World>>,
    encoder: Encoder,
    pub decoder: Decoder,
    pub now_us: u64,
}

impl Bench {
    pub fn new(start: Start, world: World) -> Self {
        let world = Rc::new(RefCell::new(world));
        let hand = Hand(world.clone());
        let parts = Parts {
            bus: hand.clone(),
            serial: hand.clone(),
            lasers: LaserPin(hand.clone()),
            trigger: TriggerPin(hand),
        };
        let sensor = Sensor::new(parts, start);
        Self { sensor, world, encoder: Encoder::new(), decoder: Decoder::new(), now_us: 0 }
    }

    /// A sensor with the default rig, waiting for frames.
    pub fn calibrated() -> Self {
        let mut bench = Self::new(Start::default(), World::default());
        bench.poll();
        bench.send_rig(&RIG);
        bench.poll();
        bench
    }

    pub fn bytes_of(&mut self, message: &Message) -> Vec<u8> {
        self.encoder.encode(message, &mut [0; MAX_FRAME]).unwrap().to_vec()
    }

    pub fn send(&mut self, message: &Message) {
        let bytes = self.bytes_of(message);
        self.world.borrow_mut().to_sensor.extend(bytes);
    }

    pub fn send_rig(&mut self, rig: &FixedRig<LASERS>) {
        for part in CalibrationSender::new(rig).parts() {
            self.send(&Message::Calibration(part));
        }
    }

    /// Lets some time go by; gives what the sensor said.
    pub fn wait(&mut self, us: u64) -> Vec<Message> {
        self.now_us += us;
        self.poll()
    }

    pub fn poll(&mut self) -> Vec<Message> {
        self.now_us += 100;
        self.sensor.poll(self.now_us);
        let bytes = std::mem::take(&mut self.world.borrow_mut().from_sensor);
        let mut messages = Vec::new();
        self.decoder.feed(&bytes, |message| messages.push(message));
        messages
    }

    /// The cameras see a frame; of camera 2 only its first rows, if there are fewer.
    pub fn expose(&self, frame: &Frame, rows_of_camera_2: usize) {
        let model = &mut self.world.borrow_mut().model;
        let width = frame.images[0].width() as usize;
        let [first, second] = frame.images.each_ref().map(|image| image.as_raw().chunks(3 * width));
        for (y, (first, second)) in first.zip(second).enumerate() {
            model.row(0, y == 0, first);
            if y < rows_of_camera_2 {
                model.row(1, y == 0, second);
            }
        }
    }

    pub fn status(&mut self) -> Status {
        self.send(&Message::Request(karst_link::Request::Status));
        let messages = self.poll();
        let status = messages.iter().find_map(|m| if let Message::Status(s) = m { Some(*s) } else { None });
        status.expect("a status")
    }
}

/// The frames in what the sensor said: results and end.
pub fn frames(messages: &[Message]) -> Vec<(Vec<LaserResult>, FrameEnd)> {
    let mut results = Vec::new();
    let mut frames = Vec::new();
    for message in messages {
        match message {
            Message::Laser(result) => results.push(*result),
            Message::FrameEnd(end) => frames.push((std::mem::take(&mut results), *end)),
            _ => {}
        }
    }
    frames
}

/// The texts in what the sensor said.
pub fn texts(messages: &[Message]) -> Vec<String> {
    messages.iter().filter_map(|m| if let Message::Log(log) = m { Some(log.text.to_string()) } else { None }).collect()
}
