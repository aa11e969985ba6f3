//! The firmware in the simulated SoC: what it says on its serial line, and its points of rendered frames against the crate's.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use karst_core::{Estimates, FixedRig, Method, NoPoint, Point, SpotDetector, reconstruct};
use karst_cosim::soc::{Byte, CLOCKS_PER_US, Soc};
use karst_link::{
    CalibrationSender, Decoder, Encoder, FrameEnd, MAX_FRAME, Message, Mode, Request, Settings, Status, TransferState,
};
use karst_rig::Rig;
use karst_scene::{Frame, Renderer, evaluation_scenes};

/// Most lasers of the simulated SoC.
const LASERS: usize = 12;

/// Clocks simulated at once.
const STEP: u64 = 1000;

/// Clocks in which the sensor has to answer: the longest answer is that to a whole frame.
const MOST_CLOCKS: u64 = 10_000_000;

/// A host on the sensor's serial line.
struct Host {
    soc: Soc,
    encoder: Encoder,
    /// Messages sent.
    sent: u32,
    decoder: Decoder,
    /// Bytes that are not decoded yet.
    bytes: Vec<Byte>,
    /// When the message that is under way began.
    begin: Option<u64>,
    /// Time spent on simulation.
    simulating: Duration,
}

/// When the start bits of a message's first and last byte began.
#[derive(Clone, Copy)]
struct Span {
    first: u64,
    last: u64,
}

impl Host {
    fn send(&mut self, message: &Message) -> anyhow::Result<()> {
        self.sent += 1;
        let mut buffer = [0; MAX_FRAME];
        let bytes = self.encoder.encode(message, &mut buffer).map_err(|error| anyhow::anyhow!("{error}"))?;
        self.soc.send(bytes)
    }

    /// Waits until `wanted` makes something of a message.
    fn wait<T>(&mut self, what: &str, mut wanted: impl FnMut(Message, Span) -> Option<T>) -> anyhow::Result<T> {
        let end = self.soc.state().clock + MOST_CLOCKS;
        loop {
            let mut bytes = std::mem::take(&mut self.bytes).into_iter();
            while let Some(Byte { byte, clock }) = bytes.next() {
                let first = *self.begin.get_or_insert(clock);
                let Some(message) = self.decoder.push(byte) else { continue };
                self.begin = None;
                if let Some(found) = wanted(message, Span { first, last: clock }) {
                    self.bytes = bytes.collect();
                    return Ok(found);
                }
            }
            ensure!(self.soc.state().clock < end, "no {what} within {MOST_CLOCKS} clocks");
            let start = Instant::now();
            self.soc.step(STEP)?;
            self.simulating += start.elapsed();
            self.bytes = self.soc.received();
        }
    }

    /// Asks for the status. The sensor tells it unasked as well: the answer is one that knows of the question.
    fn status(&mut self) -> anyhow::Result<Status> {
        self.send(&Message::Request(Request::Status))?;
        let sent = self.sent;
        self.wait("status", |message, _| match message {
            Message::Status(status) if status.link.received == sent => Some(status),
            _ => None,
        })
    }

    /// Sends a frame of both cameras. Gives what the sensor made of it.
    fn frame(&mut self, frame: &Frame) -> anyhow::Result<Reply> {
        for (camera, image) in frame.images.iter().enumerate() {
            self.soc.frame(camera, image.as_raw(), image.width() as usize, 0)?;
        }
        let mut results = Vec::new();
        let mut begin = None;
        let (end, last_byte) = self.wait("end of a frame", |message, span| match message {
            Message::Laser(laser) => {
                begin.get_or_insert(span.first);
                results.push(laser.result);
                None
            }
            Message::FrameEnd(end) => Some((end, span.last)),
            _ => None,
        })?;
        let last_pixel = self.soc.state().cameras.iter().map(|camera| camera.last_row).max().unwrap_or(0);
        let first_byte = begin.context("a frame without lasers")?;
        Ok(Reply { results, end, to_first_byte: first_byte - last_pixel, to_last_byte: last_byte - last_pixel })
    }
}

/// What the sensor made of a frame.
struct Reply {
    results: Vec<Result<Point, NoPoint>>,
    end: FrameEnd,
    /// Clocks from the last pixel to the first byte and to the last one.
    to_first_byte: u64,
    to_last_byte: u64,
}

/// What it has to make of it.
fn expected(rig: &FixedRig<LASERS>, frame: &Frame, method: Method) -> anyhow::Result<Vec<Result<Point, NoPoint>>> {
    let mut spots = Vec::new();
    for (config, image) in rig.detectors.iter().zip(&frame.images) {
        let mut detector = SpotDetector::<LASERS>::new(config.clone()).map_err(|error| anyhow::anyhow!("{error}"))?;
        detector.start_frame();
        for row in image.as_raw().chunks(3 * image.width() as usize) {
            detector.row(row).map_err(|error| anyhow::anyhow!("{error}"))?;
        }
        detector.end_frame();
        spots.push(detector);
    }
    let point = |laser| {
        let [first, second] = [0, 1].map(|camera: usize| spots[camera].spots(laser));
        let point = reconstruct(&rig.calibration, laser, [&first, &second], method)?;
        Ok(Point { estimates: Estimates::default(), ..point })
    };
    Ok((0..rig.calibration.lasers.len()).map(point).collect())
}

/// Starts the firmware, sends it the default rig and some rendered frames, in both modes, and compares every point.
pub fn run(executable: &Path, image: &Path, frames: usize) -> anyhow::Result<()> {
    let program = std::fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
    let rig = Rig::default();
    let cameras = rig.water_cameras().context("the default rig has no water cameras")?;
    let fixed = rig.to_fixed::<LASERS>(&cameras).context("the default rig is not for fixed point")?;
    let renderer = Renderer::new(&rig).context("the default rig can not be rendered")?;
    let scenes = evaluation_scenes();

    let soc = Soc::new(executable, &program)?;
    let mut host = Host {
        soc,
        encoder: Encoder::new(),
        sent: 0,
        decoder: Decoder::new(),
        bytes: Vec::new(),
        begin: None,
        simulating: Duration::ZERO,
    };
    let (hello, clock) =
        host.wait(
            "hello",
            |message, span| {
                if let Message::Hello(hello) = message { Some((hello, span.last)) } else { None }
            },
        )?;
    println!("{} us: hello from program {:?}, {} lasers", clock / CLOCKS_PER_US, hello.program, hello.lasers);
    let status = host.status()?;
    ensure!(status.errors == Default::default(), "errors at the start: {:?}", status.errors);

    for part in CalibrationSender::new(&fixed).parts() {
        host.send(&Message::Calibration(part))?;
    }
    let clock = host.wait("complete calibration", |message, span| match message {
        Message::CalibrationReply(reply) if reply.state == TransferState::Complete => Some(span.last),
        _ => None,
    })?;
    println!("{} us: the calibration is complete", clock / CLOCKS_PER_US);

    let mut points = 0;
    for mode in [Mode::Accelerated, Mode::Software] {
        host.send(&Message::Settings(Settings { mode, lasers: true, ..Settings::default() }))?;
        host.wait("settings", |message, _| if let Message::Settings(_) = message { Some(()) } else { None })?;
        ensure!(host.soc.state().lasers, "the lasers are off");
        for index in 0..frames {
            let scene = &scenes[index * scenes.len() / frames];
            let frame = renderer.render(&scene.scene, scene.seed).context("cannot render")?;
            let reply = host.frame(&frame)?;
            let expected = expected(&fixed, &frame, Method::default())?;
            ensure!(
                reply.results == expected,
                "{mode:?}, {}:\nexpected {expected:?}\nfound    {:?}",
                scene.name,
                reply.results
            );
            ensure!(usize::from(reply.end.lasers) == expected.len(), "the end tells of {} lasers", reply.end.lasers);
            points += expected.iter().filter(|result| result.is_ok()).count() as u32;
            println!(
                "{mode:?}, {}: from the last pixel {} clocks to the first byte, {} to the last",
                scene.name, reply.to_first_byte, reply.to_last_byte
            );
        }
    }
    let status = host.status()?;
    ensure!(
        (status.frames, status.points, status.dropped_frames) == (2 * frames as u32, points, 0)
            && status.errors == Default::default(),
        "{status:?}"
    );
    println!("{} frames, {points} points, every bit equal", 2 * frames);
    let clocks = host.soc.state().clock;
    println!("{clocks} clocks, {:.2} million per second", clocks as f64 / 1e6 / host.simulating.as_secs_f64());
    Ok(())
}
