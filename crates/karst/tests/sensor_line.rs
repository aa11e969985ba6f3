//! The host's side of a sensor's line against a simulated sensor: on a clean line, a noisy one, and dead ones.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use image::RgbImage;
use karst::instrument::{Arithmetic, Instrument};
use karst::result::Section;
use karst::sensor::{
    Assembler, ClientError, FrameCounts, LOST, MOST_LASERS, SensorClient, SensorFrame, SimulatedSensor,
};
use karst_core::{FixedRig, Method, RigError};
use karst_link::{Encoder, Hello, LinkCounters, MAX_FRAME, Message, Mode, Settings, TransferError};
use karst_regs::RigWords;
use karst_rig::Rig;
use karst_scene::{Renderer, evaluation_scenes};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const LASERS: usize = 12;

static RIG: LazyLock<FixedRig<LASERS>> = LazyLock::new(|| {
    let rig = Rig::default();
    rig.to_fixed(&rig.water_cameras().unwrap()).unwrap()
});

static PICTURES: LazyLock<Vec<[RgbImage; 2]>> = LazyLock::new(|| {
    let renderer = Renderer::new(&Rig::default()).unwrap();
    let scenes = evaluation_scenes();
    scenes.iter().step_by(scenes.len() / 4).map(|s| renderer.render(&s.scene, s.seed).unwrap().images).collect()
});

/// A sensor whose cameras see the pictures over and over.
fn sensor() -> SimulatedSensor {
    SimulatedSensor::new(LASERS, (0..).map(|i| Ok(PICTURES[i % PICTURES.len()].clone())))
}

/// A line that damages bytes both ways.
struct Noisy<L> {
    line: L,
    /// Chance of a byte to be another one.
    rate: f64,
    rng: ChaCha8Rng,
}

impl<L> Noisy<L> {
    fn new(line: L, rate: f64) -> Self {
        Self { line, rate, rng: ChaCha8Rng::seed_from_u64(11) }
    }

    fn damage(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            if self.rng.random_bool(self.rate) {
                *byte ^= self.rng.random_range(1..=255_u8);
            }
        }
    }
}

impl<L: Read> Read for Noisy<L> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.line.read(buffer)?;
        self.damage(&mut buffer[..count]);
        Ok(count)
    }
}

impl<L: Write> Write for Noisy<L> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let mut damaged = buffer.to_vec();
        self.damage(&mut damaged);
        self.line.write(&damaged)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.line.flush()
    }
}

fn calibrated<L: Read + Write>(line: L, settings: Settings) -> SensorClient<L> {
    let mut client = SensorClient::connect(line).unwrap();
    client.set_settings(&settings).unwrap();
    client.set_calibration(&RIG, |_, _| {}).unwrap();
    client
}

/// What comes until that many frames have been sent, and what was counted.
fn watch<L: Read + Write>(
    client: &mut SensorClient<L>,
    settings: Settings,
    last: u32,
) -> (Vec<SensorFrame>, FrameCounts, LinkCounters) {
    let mut assembler = Assembler::new(settings);
    let mut frames: Vec<SensorFrame> = Vec::new();
    let start = Instant::now();
    while frames.last().is_none_or(|frame| frame.number < last) {
        assert!(start.elapsed() < Duration::from_secs(60), "{:?}", assembler.counts());
        if let Some(message) = client.receive(Duration::from_millis(100)).unwrap() {
            frames.extend(assembler.take(&message));
        }
    }
    (frames, assembler.counts(), client.counters())
}

/// What `karst reconstruct` makes of the pictures of a frame, as far as the sensor tells it.
fn expected(method: Method) -> Vec<Section> {
    let mut instrument = Instrument::new(Rig::default()).unwrap();
    let mut section = |images| {
        let mut section = instrument.section("", images, method, Arithmetic::Fixed).unwrap();
        section.timing = None;
        for laser in &mut section.lasers {
            if let Some(point) = &mut laser.point {
                point.estimates_mm = [None; 3];
            }
        }
        section
    };
    PICTURES.iter().map(&mut section).collect()
}

/// The same without its spots.
fn without_spots(mut section: Section) -> Section {
    section.lasers.iter_mut().for_each(|laser| laser.spots = [None, None]);
    section.detector.iter_mut().for_each(|detector| detector.spots = None);
    section
}

#[test]
fn frames_are_those_of_reconstruct_in_both_modes_and_methods() {
    for (mode, method, spots) in [
        (Mode::Accelerated, Method::Weighted, true),
        (Mode::Software, Method::Weighted, false),
        (Mode::Software, Method::Paper, true),
        (Mode::Accelerated, Method::Paper, false),
    ] {
        let settings = Settings { mode, method, spots, lasers: true, trigger_period_us: 0 };
        let mut client = calibrated(sensor(), settings);
        let expected = expected(method);
        let (frames, counts, link) = watch(&mut client, settings, 4);
        assert_eq!(counts, FrameCounts { complete: 4, ..FrameCounts::default() });
        assert_eq!((link.lost, link.corrupt), (0, 0));
        for frame in frames {
            let same = expected[(frame.number as usize - 1) % PICTURES.len()].clone();
            let same = Section { frame: frame.number.to_string(), ..same };
            assert!(frame.complete);
            assert_eq!(frame.section, if spots { same } else { without_spots(same) });
        }
    }
}

#[test]
fn the_lasers_are_dark_until_they_are_switched_on() {
    let mut client = calibrated(sensor(), Settings::default());
    let (frames, ..) = watch(&mut client, Settings::default(), 1);
    assert!(frames[0].section.lasers.iter().all(|laser| laser.status == "no spot"), "{frames:?}");
    client.set_settings(&Settings { lasers: true, ..Settings::default() }).unwrap();
    let (frames, ..) = watch(&mut client, Settings::default(), 4);
    assert!(frames.last().unwrap().section.lasers.iter().any(|laser| laser.point.is_some()));
}

#[test]
fn the_trigger_gives_the_rate() {
    let mut client = calibrated(sensor(), Settings { trigger_period_us: 200_000, ..Settings::default() });
    let start = Instant::now();
    watch(&mut client, Settings::default(), 5);
    // Four periods, less what the first frame came earlier
    assert!(start.elapsed() > Duration::from_millis(600), "{:?}", start.elapsed());
}

#[test]
fn a_sensor_is_configured_in_spite_of_one_percent_byte_errors() {
    let mut client = SensorClient::connect(Noisy::new(sensor(), 0.01)).unwrap();
    assert_eq!(client.hello().lasers as usize, LASERS);
    assert_eq!(client.calibration().unwrap(), None);
    let mut progress = Vec::new();
    client.set_calibration(&RIG, |there, parts| progress.push((there, parts))).unwrap();
    assert_eq!(progress.last(), Some(&(17, 17)));
    assert!(progress.len() > 17 + 3, "parts went over in one go: {progress:?}");
    let settings = Settings { mode: Mode::Software, spots: true, trigger_period_us: 1_000_000, ..Settings::default() };
    client.set_settings(&settings).unwrap();
    assert_eq!(client.settings().unwrap(), settings);
    let rig = Rig::default();
    let sent: FixedRig<MOST_LASERS> = rig.to_fixed(&rig.water_cameras().unwrap()).unwrap();
    // Value by value as the sensor uses them
    assert_eq!(client.calibration().unwrap().map(|found| RigWords::from(&found)), Some(RigWords::from(&sent)));
    let there = client.status().unwrap().link;
    assert!(client.counters().corrupt > 5 && there.corrupt > 5, "{:?} {there:?}", client.counters());
}

#[test]
fn frames_with_lost_messages_are_counted_and_never_mixed() {
    let expected: Vec<Section> = expected(Method::Weighted).into_iter().map(without_spots).collect();
    for (rate, all_whole) in [(0.01, false), (0.0004, true)] {
        let settings = Settings { lasers: true, ..Settings::default() };
        let mut client = calibrated(Noisy::new(sensor(), rate), settings);
        let (frames, counts, link) = watch(&mut client, settings, 60);
        let last = frames.last().unwrap().number;
        let first = frames[0].number;
        assert_eq!(counts.complete + counts.incomplete, frames.len() as u32);
        // Nothing is known of frames before the first one
        let seen = counts.complete + counts.incomplete + counts.missing;
        assert!((last + 1 - first..=last).contains(&seen), "{counts:?} {first} {last}");
        assert!(counts.incomplete > 5 && link.lost > 5, "{counts:?} {link:?}");
        assert_eq!(counts.complete > 10, all_whole, "{counts:?}");
        let mut points = 0;
        for frame in &frames {
            let right = &expected[(frame.number as usize - 1) % PICTURES.len()];
            assert_eq!(frame.complete, frame.lost_messages == 0);
            let lost = frame.section.lasers.iter().filter(|laser| laser.status == LOST).count();
            assert!(lost as u32 <= frame.lost_messages);
            for laser in frame.section.lasers.iter().filter(|laser| laser.status != LOST) {
                assert_eq!(laser, &right.lasers[laser.laser]);
                points += 1;
            }
            if frame.complete {
                assert_eq!(frame.section.lasers, right.lasers);
            }
        }
        assert!(points > 200, "{points}");
    }
}

#[test]
fn a_refusal_says_why() {
    let mut client = SensorClient::connect(sensor()).unwrap();
    let rig = Rig::default();
    let mut wrong: FixedRig<LASERS> = RIG.clone();
    wrong.calibration.lasers[3].direction_variance = u64::MAX;
    let refused = client.set_calibration(&wrong, |_, _| {}).unwrap_err();
    let reason = TransferError::Rig(RigError::Uncertainty { laser: 3 });
    assert!(matches!(refused, ClientError::Refused(found) if found == reason), "{refused}");
    let mut many: FixedRig<13> = rig.to_fixed(&rig.water_cameras().unwrap()).unwrap();
    let laser = many.calibration.lasers[0];
    many.calibration.lasers.push(laser).unwrap();
    many.detectors.iter_mut().for_each(|detector| detector.azimuths.push(1).unwrap());
    let refused = client.set_calibration(&many, |_, _| {}).unwrap_err();
    assert_eq!(refused.to_string(), "the sensor refused the calibration: 13 lasers, but at most 12 fit");
    assert_eq!(client.status().unwrap().calibration, None);
}

/// A line that gives the same answer to everything.
struct Parrot(Vec<u8>);

impl Read for Parrot {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        std::thread::sleep(Duration::from_millis(1));
        let count = self.0.len().min(buffer.len());
        buffer[..count].copy_from_slice(&self.0[..count]);
        if count == 0 { Err(ErrorKind::TimedOut.into()) } else { Ok(count) }
    }
}

impl Write for Parrot {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        Ok(buffer.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn frame(message: &Message) -> Vec<u8> {
    Encoder::new().encode(message, &mut [0; MAX_FRAME]).unwrap().to_vec()
}

#[test]
fn a_line_without_a_sensor_is_told_from_others_and_soon() {
    let start = Instant::now();
    let error = |line: Vec<u8>| SensorClient::connect(Parrot(line)).err().unwrap();
    assert!(matches!(error(Vec::new()), ClientError::Silent));
    assert!(matches!(error(b"login: ".to_vec()), ClientError::NotASensor(7..)));
    assert!(matches!(error(frame(&Message::Settings(Settings::default()))), ClientError::Deaf));
    assert!(start.elapsed() < Duration::from_secs(25), "{:?}", start.elapsed());
    let old = Hello { oldest_protocol: 0, newest_protocol: 0, program: [0, 0, 9], lasers: 12 };
    let old = error(frame(&Message::Hello(old)));
    assert_eq!(old.to_string(), "the other end speaks protocol 0 to 0, this one 2 to 2: update the older one");
}

/// A line that breaks, or is cut, after some bytes to the sensor.
struct Cut<L> {
    line: L,
    left: usize,
    broken: bool,
}

impl<L: Read> Read for Cut<L> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match (self.left, self.broken) {
            (0, true) => Ok(0),
            (0, false) => Err(ErrorKind::TimedOut.into()),
            _ => self.line.read(buffer),
        }
    }
}

impl<L: Write> Write for Cut<L> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.left = self.left.saturating_sub(buffer.len());
        self.line.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.line.flush()
    }
}

#[test]
fn a_line_that_ends_in_a_transfer_is_an_error_and_soon() {
    for broken in [true, false] {
        let start = Instant::now();
        let mut client = SensorClient::connect(Cut { line: sensor(), left: 1000, broken }).unwrap();
        let error = client.set_calibration(&RIG, |_, _| {}).unwrap_err();
        match broken {
            true => assert!(matches!(error, ClientError::Line(_)), "{error}"),
            false => assert!(matches!(error, ClientError::Gone), "{error}"),
        }
        assert!(start.elapsed() < Duration::from_secs(15), "{:?}", start.elapsed());
    }
}

#[test]
fn every_frame_that_is_sent_is_taken_from_the_line_before_the_next() {
    let mut client = calibrated(sensor(), Settings::default());
    let start = Instant::now();
    let (frames, ..) = watch(&mut client, Settings::default(), 15);
    let numbers: BTreeMap<u32, bool> = frames.iter().map(|frame| (frame.number, frame.complete)).collect();
    assert_eq!(numbers, (1..=15).map(|number| (number, true)).collect());
    assert!(start.elapsed() > Duration::from_millis(400), "{:?}", start.elapsed());
    assert_eq!(client.status().unwrap().dropped_frames, 0);
}
