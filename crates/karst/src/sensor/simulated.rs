//! A sensor without hardware: what its firmware does, with the software model of the IP, cameras that show given
//! pictures, and a line that never damages anything.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::io;
use std::rc::Rc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use embedded_hal::digital::{ErrorType as PinErrorType, OutputPin};
use embedded_io::{ErrorKind, ErrorType, Read, ReadReady, Write, WriteReady};
use image::RgbImage;
use karst_regs::RegisterBus;
use karst_regs::model::Model;
use karst_sensor::{Parts, Sensor, Start};

use super::client::MOST_LASERS;

/// Time between two pictures of cameras that run on their own, microseconds.
const FRAME_PERIOD_US: u64 = 33_333;

/// The sensor looks this often whether there is something to do.
const TICK: Duration = Duration::from_millis(2);

/// Lasers that the small build has room for.
const FEW_LASERS: usize = 12;

/// The pictures that the cameras take, one pair after the other.
type Pictures = Box<dyn Iterator<Item = io::Result<[RgbImage; 2]>>>;

/// The IP with its capacity hidden.
trait Ip: RegisterBus<Error = Infallible> {
    fn row(&mut self, camera: usize, start: bool, rgb: &[u8]);
}

impl<const LASERS: usize> Ip for Model<LASERS> {
    fn row(&mut self, camera: usize, start: bool, rgb: &[u8]) {
        Self::row(self, camera, start, rgb);
    }
}

/// The hardware around the firmware.
struct World {
    ip: Box<dyn Ip>,
    to_sensor: VecDeque<u8>,
    from_sensor: VecDeque<u8>,
    lasers_on: bool,
    triggered: bool,
}

/// A part of the hardware in the firmware's hands.
#[derive(Clone)]
struct Hand(Rc<RefCell<World>>);

impl RegisterBus for Hand {
    type Error = Infallible;

    fn read32(&mut self, address: u32) -> Result<u32, Infallible> {
        self.0.borrow_mut().ip.read32(address)
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), Infallible> {
        self.0.borrow_mut().ip.write32(address, value)
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
        Ok(take(&mut self.0.borrow_mut().to_sensor, buffer))
    }
}

impl WriteReady for Hand {
    fn write_ready(&mut self) -> Result<bool, ErrorKind> {
        Ok(true)
    }
}

impl Write for Hand {
    fn write(&mut self, buffer: &[u8]) -> Result<usize, ErrorKind> {
        self.0.borrow_mut().from_sensor.extend(buffer);
        Ok(buffer.len())
    }

    fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

fn take(queue: &mut VecDeque<u8>, buffer: &mut [u8]) -> usize {
    let count = buffer.len().min(queue.len());
    for (to, byte) in buffer.iter_mut().zip(queue.drain(..count)) {
        *to = byte;
    }
    count
}

struct LaserPin(Hand);

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

struct TriggerPin(Hand);

impl PinErrorType for TriggerPin {
    type Error = Infallible;
}

impl OutputPin for TriggerPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.0.borrow_mut().triggered = true;
        Ok(())
    }
}

/// The firmware with its capacity hidden.
trait Firmware {
    fn poll(&mut self, now_us: u64);
    fn is_calibrated(&self) -> bool;
    fn is_triggered(&self) -> bool;
}

impl<const LASERS: usize, const SPOTS: usize> Firmware for Sensor<Hand, Hand, LaserPin, TriggerPin, LASERS, SPOTS> {
    fn poll(&mut self, now_us: u64) {
        Self::poll(self, now_us);
    }

    fn is_calibrated(&self) -> bool {
        self.status().calibration.is_some()
    }

    fn is_triggered(&self) -> bool {
        self.settings().trigger_period_us != 0
    }
}

/// A simulated sensor as the host sees it: a line to read from and write to, for [`super::SensorClient`].
///
/// It starts without a calibration, with the lasers off. Once calibrated its cameras take pictures: 30 pairs per second,
/// or at the sensor's trigger. A pair is not taken before all of the last frame has been read from the line, so none is
/// dropped. With the lasers off the pictures are dark.
pub struct SimulatedSensor {
    firmware: Box<dyn Firmware>,
    world: Rc<RefCell<World>>,
    pictures: Pictures,
    start: Instant,
    next_picture_us: u64,
}

impl SimulatedSensor {
    /// A sensor built for 12 lasers, or for 720 if there are more. Its cameras take the pictures one pair after the
    /// other; after the last one they are stuck. A picture that can not be read breaks the line.
    pub fn new(lasers: usize, pictures: impl Iterator<Item = io::Result<[RgbImage; 2]>> + 'static) -> Self {
        let (world, firmware) = if lasers <= FEW_LASERS {
            build::<FEW_LASERS, { 4 * FEW_LASERS }>()
        } else {
            build::<MOST_LASERS, { 4 * MOST_LASERS }>()
        };
        Self { firmware, world, pictures: Box::new(pictures), start: Instant::now(), next_picture_us: 0 }
    }

    /// Has the cameras take a pair of pictures if it is time.
    fn expose(&mut self, now_us: u64) -> io::Result<()> {
        if !self.firmware.is_calibrated() {
            return Ok(());
        }
        let triggered = std::mem::take(&mut self.world.borrow_mut().triggered);
        let due = if self.firmware.is_triggered() { triggered } else { now_us >= self.next_picture_us };
        if !due {
            return Ok(());
        }
        self.next_picture_us = now_us + FRAME_PERIOD_US;
        let Some(images) = self.pictures.next() else { return Ok(()) };
        let images = images?;
        let mut world = self.world.borrow_mut();
        let lasers_on = world.lasers_on;
        let rows = images.iter().map(RgbImage::height).max().unwrap_or(0);
        for y in 0..rows as usize {
            for (camera, image) in images.iter().enumerate() {
                let width = 3 * image.width() as usize;
                let Some(row) = image.as_raw().get(y * width..(y + 1) * width) else { continue };
                if lasers_on {
                    world.ip.row(camera, y == 0, row);
                } else {
                    world.ip.row(camera, y == 0, &vec![0; width]);
                }
            }
        }
        Ok(())
    }
}

fn build<const LASERS: usize, const SPOTS: usize>() -> (Rc<RefCell<World>>, Box<dyn Firmware>) {
    let world = Rc::new(RefCell::new(World {
        ip: Box::new(Model::<LASERS>::new()),
        to_sensor: VecDeque::new(),
        from_sensor: VecDeque::new(),
        lasers_on: false,
        triggered: false,
    }));
    let hand = Hand(world.clone());
    let parts =
        Parts { bus: hand.clone(), serial: hand.clone(), lasers: LaserPin(hand.clone()), trigger: TriggerPin(hand) };
    let start = Start { watchdog: false, program: super::program_version() };
    let sensor = Sensor::<_, _, _, _, LASERS, SPOTS>::new(parts, start);
    (world, Box::new(sensor))
}

impl io::Read for SimulatedSensor {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.world.borrow().from_sensor.is_empty() {
            let now_us = self.start.elapsed().as_micros() as u64;
            self.expose(now_us)?;
            self.firmware.poll(now_us);
        }
        match take(&mut self.world.borrow_mut().from_sensor, buffer) {
            0 => {
                sleep(TICK);
                Err(io::ErrorKind::TimedOut.into())
            }
            count => Ok(count),
        }
    }
}

impl io::Write for SimulatedSensor {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.world.borrow_mut().to_sensor.extend(buffer);
        Ok(buffer.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
