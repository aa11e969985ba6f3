//! The whole IP: the driver of `karst-regs` and two cameras on the simulated `karst_top`, and next to it the software model
//! (`karst_regs::model::Model`). Commands are those of `hw-ip/sim/top_harness.cpp`.

use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, anyhow, ensure};
use karst_core::{
    Calibration, CameraCalibration, DetectorConfig, I18F14, LaserCalibration, LaserFrame, Method,
    ReconstructionSettings, SpotNoise, Thresholds,
};
use karst_cycles::{Beat, Generics, Pixels, Reconstruction, Top, TopGenerics};
use karst_regs::model::Model;
use karst_regs::{Karst, RegisterBus, Settings, map};
use karst_rig::Rig;
use karst_scene::{Renderer, evaluation_scenes};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::detector::{Limits, Row, random_config, random_picture, rows_of, spoil};

/// Most lasers of the IP in the random sessions.
const LASERS: usize = 12;

/// Clocks after which nothing is under way any more in an IP for few lasers: pixels, hits in full buffers at some 20 clocks
/// each, results, a commit.
const TO_DRAIN: u32 = 20_000;

/// Bits of an event: the camera in the lowest one.
const START: u8 = 2;
const LAST: u8 = 4;
const POINTS: u8 = 8;
const INTERRUPT: u8 = 16;

/// A row on its way to the IP.
struct Sent {
    row: Row,
    /// The model has got it.
    is_done: bool,
}

/// The simulated IP and the model side by side.
struct Bench<const LASERS: usize> {
    process: Child,
    input: BufWriter<ChildStdin>,
    output: BufReader<ChildStdout>,
    pixels_per_clock: usize,
    model: Box<Model<LASERS>>,
    rows: [VecDeque<Sent>; 2],
    /// Clocks of the last start of a frame, of the start and the end of the last frame that has ended; of the last points
    /// and the last interrupt.
    first_pixel: [u64; 2],
    began: [u64; 2],
    ended: [u64; 2],
    points: u64,
    interrupt: u64,
    clock: u64,
    /// All events: kind and clock.
    events: Vec<(u8, u64)>,
}

impl<const LASERS: usize> RegisterBus for Bench<LASERS> {
    type Error = anyhow::Error;

    fn read32(&mut self, address: u32) -> anyhow::Result<u32> {
        self.command(b'R', &address.to_le_bytes())
    }

    fn write32(&mut self, address: u32, value: u32) -> anyhow::Result<()> {
        self.command(b'W', &[address.to_le_bytes(), value.to_le_bytes()].concat())?;
        let Ok(()) = self.model.write32(address, value);
        Ok(())
    }
}

impl<const LASERS: usize> Bench<LASERS> {
    fn new(executable: &Path, pixels_per_clock: usize) -> anyhow::Result<Self> {
        let mut process = Command::new(executable)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {}", executable.display()))?;
        let input = process.stdin.take().context("the simulation has no input")?;
        let output = process.stdout.take().context("the simulation has no output")?;
        Ok(Self {
            process,
            input: BufWriter::with_capacity(1 << 16, input),
            output: BufReader::new(output),
            pixels_per_clock,
            model: Box::default(),
            rows: Default::default(),
            first_pixel: [0; 2],
            began: [0; 2],
            ended: [0; 2],
            points: 0,
            interrupt: 0,
            clock: 0,
            events: Vec::new(),
        })
    }

    /// Carries out a command; the model follows what the cameras have sent meanwhile.
    fn command(&mut self, command: u8, arguments: &[u8]) -> anyhow::Result<u32> {
        self.input.write_all(&[command])?;
        self.input.write_all(arguments)?;
        self.input.flush()?;
        let mut bytes = [0; 16];
        self.output.read_exact(&mut bytes).context("the simulation has ended")?;
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        self.clock = u64::from(word(8)) << 32 | u64::from(word(4));
        for _ in 0..word(12) {
            let mut event = [0; 9];
            self.output.read_exact(&mut event)?;
            let [kind, clock @ ..] = event;
            self.event(kind, u64::from_le_bytes(clock))?;
        }
        Ok(word(0))
    }

    fn event(&mut self, kind: u8, clock: u64) -> anyhow::Result<()> {
        self.events.push((kind, clock));
        let camera = usize::from(kind & 1);
        match kind & !1 {
            START => {
                self.first_pixel[camera] = clock;
                // The row before it was cut
                let is_cut = self.rows[camera].front().is_some_and(|sent| sent.is_done || !sent.row.start);
                if is_cut
                    && let Some(mut cut) = self.rows[camera].pop_front()
                    && !cut.is_done
                    // Outside a frame a row is told by its end
                    && self.model.is_in_frame(camera)
                {
                    // Cut after all its pixels a row is long. One pixel more makes it so; one of fewer beats stays short
                    cut.row.rgb.extend([0; 3]);
                    self.model.row(camera, false, &cut.row.rgb);
                }
                let first = self.rows[camera].front_mut().context("a frame starts that was not sent")?;
                self.model.row(camera, true, &first.row.rgb);
                first.is_done = true;
            }
            LAST => {
                let was_in_frame = self.model.is_in_frame(camera);
                let sent = self.rows[camera].pop_front().context("a row ends that was not sent")?;
                if !sent.is_done {
                    self.model.row(camera, false, &sent.row.rgb);
                }
                if was_in_frame && !self.model.is_in_frame(camera) {
                    self.began[camera] = self.first_pixel[camera];
                    self.ended[camera] = clock;
                }
            }
            POINTS => self.points = clock,
            INTERRUPT => self.interrupt = clock,
            _ => return Err(anyhow!("unknown event {kind}")),
        }
        Ok(())
    }

    /// Sends rows after those before; idle clocks come before the first beats of the first rows.
    fn send(&mut self, camera: usize, rows: Vec<Row>, idle: &[u16]) -> anyhow::Result<()> {
        let mut beats = Vec::new();
        let mut count = 0_u32;
        for (row, idle) in rows.iter().zip(idle.iter().chain(std::iter::repeat(&0))) {
            let mut idle = *idle;
            let last = row.rgb.len() / (3 * self.pixels_per_clock) - 1;
            for (i, beat) in row.rgb.chunks_exact(3 * self.pixels_per_clock).enumerate() {
                beats.extend(idle.to_le_bytes());
                beats.push(u8::from(row.start && i == 0) | u8::from(row.last && i == last) << 1);
                // AXI4-Stream Video: G in the low byte, then B, then R
                beats.extend(beat.as_chunks().0.iter().flat_map(|&[r, g, b]| [g, b, r]));
                (count, idle) = (count + 1, 0);
            }
        }
        self.rows[camera].extend(rows.into_iter().map(|row| Sent { row, is_done: false }));
        let mut arguments = vec![camera as u8];
        arguments.extend(count.to_le_bytes());
        arguments.extend(beats);
        self.command(b'Q', &arguments).map(drop)
    }

    /// So many frames more may start.
    fn allow_starts(&mut self, camera: usize, count: u32) -> anyhow::Result<()> {
        self.command(b'C', &[&[camera as u8][..], &count.to_le_bytes()].concat()).map(drop)
    }

    /// How often beats and bus channels are held back, of 256 clocks.
    fn stall(&mut self, input: u32, bus: u32) -> anyhow::Result<()> {
        self.command(b'S', &[input.to_le_bytes(), bus.to_le_bytes()].concat()).map(drop)
    }

    /// Goes on until so many beats are taken. Gives how many are left.
    fn run(&mut self, beats: u32, clocks: u32) -> anyhow::Result<u32> {
        self.command(b'G', &[beats.to_le_bytes(), clocks.to_le_bytes()].concat())
    }

    fn hold(&mut self, mask: u8) -> anyhow::Result<()> {
        self.command(b'H', &[mask]).map(drop)
    }

    /// Lets the cameras pause, and waits until nothing is under way but the frames themselves.
    fn drain(&mut self) -> anyhow::Result<()> {
        self.hold(3)?;
        self.run(0, TO_DRAIN).map(drop)
    }

    /// Reads a word and compares.
    fn compare_word(&mut self, address: u32, mask: u32) -> anyhow::Result<()> {
        let found = self.read32(address)? & mask;
        let Ok(expected) = self.model.read32(address);
        let expected = expected & mask;
        ensure!(
            found == expected,
            "clock {}, address {address:05x}: expected {expected:08x}, found {found:08x}",
            self.clock
        );
        Ok(())
    }

    /// Compares the registers and the results.
    fn compare(&mut self) -> anyhow::Result<()> {
        let capacity = !map::CAPACITY_PIXELS_PER_CLOCK.mask();
        self.compare_word(map::CAPACITY, capacity)?;
        let registers = [map::MAGIC, map::VERSION, map::MAP_HASH, map::CONTROL, map::STATUS, map::INTERRUPT_STATUS];
        let more = [map::INTERRUPT_ENABLE, map::FAULT, map::FRAMES, map::MISSED, map::UNPAIRED, map::SKIPPED];
        let of_camera = [map::camera_short_rows, map::camera_long_rows, map::camera_truncated, map::camera_stray_rows];
        let of_cameras = of_camera.iter().flat_map(|counter| [counter(0), counter(1)]);
        for address in registers.into_iter().chain(more).chain(of_cameras) {
            self.compare_word(address, u32::MAX)?;
        }
        self.compare_results()
    }

    /// Compares the results: everything but the counts of clocks.
    fn compare_results(&mut self) -> anyhow::Result<()> {
        let words = |first: u32, count: u32| (first..).step_by(4).take(count as usize);
        let records = words(map::RESULT_FRAME_PAIR, 3)
            .chain((0..2).flat_map(|camera| words(map::result_camera_hits(camera), 8)))
            .chain((0..LASERS as u32).flat_map(|laser| words(map::result_point_status(laser), 8)));
        for address in records {
            self.compare_word(address, u32::MAX)?;
        }
        for camera in 0..2 {
            // What is left of other frames behind them depends on when those were forgotten
            let Ok(spots) = self.model.read32(map::result_camera_spots(camera));
            for spot in 0..spots {
                for address in words(map::spots_camera_spot_column(camera, spot), 8) {
                    self.compare_word(address, u32::MAX)?;
                }
            }
        }
        Ok(())
    }

    /// Points in the results.
    fn points_ready(&mut self) -> u64 {
        let is_point = |laser: u32| {
            let Ok(status) = self.model.read32(map::result_point_status(laser));
            status != 0 && map::RESULT_POINT_STATUS_OUTCOME.get(status) == 0
        };
        (0..LASERS as u32).map(is_point).filter(|&is| is).count() as u64
    }

    fn is_committing(&mut self) -> bool {
        let Ok(status) = self.model.read32(map::STATUS);
        map::STATUS_COMMITTING.is_set(status)
    }

    /// Whether a camera has sent a part of the first row of a frame.
    fn is_within_first_row(&self) -> bool {
        self.rows.iter().any(|rows| rows.front().is_some_and(|sent| sent.is_done))
    }

    /// Whether such a row has no end.
    fn is_cut(&self) -> bool {
        self.rows.iter().any(|rows| rows.front().is_some_and(|sent| sent.is_done && !sent.row.last))
    }

    fn load(&mut self, instrument: &Instrument<LASERS>) -> anyhow::Result<()> {
        let mut karst = Karst::probe(&mut *self).map_err(|error| anyhow!("{error}"))?;
        karst.load(&instrument.settings()).map_err(|error| anyhow!("{error}"))
    }

    /// Ends the simulation.
    fn finish(self) -> anyhow::Result<()> {
        let Self { mut process, input, .. } = self;
        drop(input);
        let status = process.wait().context("the simulation is lost")?;
        ensure!(status.success(), "the simulation failed: {status}");
        Ok(())
    }
}

/// Everything that is loaded into the IP.
struct Instrument<const LASERS: usize> {
    calibration: Calibration<LASERS>,
    detectors: [DetectorConfig<LASERS>; 2],
    method: Method,
}

/// Place and size of the small instrument's image.
const WIDTH: u16 = 128;
const HEIGHT: u16 = 96;
const CENTRE: [f64; 2] = [64.0, 48.0];
/// Component of every ray along the camera's axis, px.
const FORWARD: f64 = 40.0;
/// How much larger the ideal image is: the instrument is smaller than a real one, which has no rays near the axis.
const SCALE: f64 = 1.75;

impl<const LASERS: usize> Instrument<LASERS> {
    fn settings(&self) -> Settings<'_, LASERS> {
        Settings { calibration: &self.calibration, detectors: self.detectors.each_ref(), method: self.method }
    }

    /// Two cameras that look at each other, `half_baseline` mm from the plane of the lasers.
    fn facing(size: [u16; 2], centre: [f64; 2], [forward, scale]: [f64; 2], lasers: usize, half_baseline: f64) -> Self {
        let detector = |clockwise| DetectorConfig {
            width: size[0],
            height: size[1],
            thresholds: Thresholds::default(),
            centre: centre.map(I18F14::from_num),
            mirror_radius: (centre[1] * 16.0) as u16,
            inner_radius: 16,
            cluster_gap: 3,
            min_pixels: 1,
            clockwise,
            azimuths: (0..lasers).map(|laser| (laser * 65536 / lasers) as u16).collect(),
            sector_half_width: (65536 / lasers / 2) as u16,
            noise: SpotNoise { floor: 2416, noise: 83443 },
        };
        let camera = CameraCalibration {
            centre: centre.map(I18F14::from_num),
            inverse_affine: [(scale * f64::from(1 << 30)) as i32, 0, 0, (scale * f64::from(1 << 30)) as i32],
            decentring: [0, 0],
            polynomial: [(forward / 512.0 * f64::from(1 << 26)) as i32].into_iter().collect(),
            axial: [12_345, -6_789].into_iter().collect(),
        };
        let calibration = Calibration {
            cameras: [camera.clone(), camera],
            lasers: (0..lasers).map(|laser| laser_calibration(laser, lasers, half_baseline)).collect(),
            settings: ReconstructionSettings {
                range: [I18F14::from_num(100), I18F14::from_num(4000)],
                chi2_max: I18F14::from_num(30),
                single_camera: true,
            },
        };
        Self { calibration, detectors: [detector(false), detector(true)], method: Method::Weighted }
    }
}

fn laser_calibration(laser: usize, lasers: usize, half_baseline: f64) -> LaserCalibration {
    let (sin, cos) = (laser as f64 / lasers as f64 * TAU).sin_cos();
    // Rows along, up, across in the rig frame
    let axes = [[cos, sin, 0.0], [0.0, 0.0, 1.0], [sin, -cos, 0.0]];
    let q30 = |v: f64| (v * f64::from(1 << 30)) as i32;
    let q20 = |v: f64| (v * f64::from(1 << 20)) as i32;
    let frame = |z: f64, signs: [f64; 3]| LaserFrame {
        rotation: axes.map(|row| [0, 1, 2].map(|i| q30(row[i] * signs[i]))),
        viewpoint: [0.0, z, 0.0].map(q20),
    };
    LaserCalibration {
        origin: [0, 1 << 10, -5],
        axes: axes.map(|row| row.map(q30)),
        origin_variance: (3 << 32) + 77,
        direction_variance: (1 << 32) + 99,
        cameras: [frame(-half_baseline, [1.0; 3]), frame(half_baseline, [1.0, -1.0, -1.0])],
    }
}

/// The picture of a camera of the small instrument: so many spots per laser as there are radii, px.
fn spots_picture(camera: usize, radii: &[Vec<f64>]) -> Vec<u8> {
    let mut rgb = vec![0; 3 * usize::from(WIDTH) * usize::from(HEIGHT)];
    for (laser, of_laser) in radii.iter().enumerate() {
        let (sin, cos) = (laser as f64 / radii.len() as f64 * TAU).sin_cos();
        let sin = if camera == 0 { sin } else { -sin };
        for &radius in of_laser {
            let [x, y] = [CENTRE[0] + cos * radius, CENTRE[1] + sin * radius].map(|v| v.round() as usize);
            for row in y - 1..=y + 1 {
                for column in x - 1..=x + 1 {
                    let at = 3 * (row * usize::from(WIDTH) + column);
                    rgb[at..at + 3].copy_from_slice(&[20, 150 + radius as u8, 30]);
                }
            }
        }
    }
    rgb
}

/// Random frames, commands and settings, all at any time.
struct Session {
    random: ChaCha8Rng,
    bench: Bench<LASERS>,
    /// What both cameras see next: spots per laser.
    radii: Vec<Vec<f64>>,
    /// Frames of the camera that are sent and have not started.
    frames: [u32; 2],
    started: u64,
    /// A commit has been commanded, and may be under way.
    is_settling: bool,
    /// Points that were compared.
    points: u64,
}

impl Session {
    fn new(executable: &Path, pixels_per_clock: usize, seed: u64) -> anyhow::Result<Self> {
        let bench = Bench::new(executable, pixels_per_clock)?;
        let random = ChaCha8Rng::seed_from_u64(seed);
        let mut session =
            Self { random, bench, radii: Vec::new(), frames: [0; 2], started: 0, is_settling: false, points: 0 };
        session.look_elsewhere();
        Ok(session)
    }

    fn look_elsewhere(&mut self) {
        let random = &mut self.random;
        let one = |random: &mut ChaCha8Rng| random.random_range(35.0..46.0);
        self.radii = (0..LASERS)
            .map(|_| match random.random_range(0..8) {
                0 => Vec::new(),
                1 => vec![one(random), one(random)],
                _ => vec![one(random)],
            })
            .collect();
    }

    fn instrument(&mut self) -> Instrument<LASERS> {
        let random = &mut self.random;
        let half_baseline = random.random_range(150.0..300.0);
        let lasers = if random.random() { LASERS } else { random.random_range(1..=LASERS) };
        let mut instrument = Instrument::facing([WIDTH, HEIGHT], CENTRE, [FORWARD, SCALE], lasers, half_baseline);
        instrument.method = if random.random_range(0..4) == 0 { Method::Paper } else { Method::Weighted };
        instrument.calibration.settings.single_camera = random.random();
        for detector in &mut instrument.detectors {
            detector.min_pixels = random.random_range(0..12);
        }
        if random.random_range(0..3) == 0 {
            let limits = Limits { lasers: LASERS as u32, width: WIDTH };
            for detector in &mut instrument.detectors {
                *detector = loop {
                    let config = random_config::<LASERS>(&limits, random);
                    // Lower ones may end before the model knows that their first row has
                    if config.azimuths.len() == lasers && config.height >= 4 {
                        break config;
                    }
                };
            }
        }
        instrument
    }

    /// Makes a frame for a camera.
    fn send_frame(&mut self, camera: usize) -> anyhow::Result<()> {
        let rgb = match self.random.random_range(0..6) {
            0 => random_picture(WIDTH.into(), HEIGHT.into(), &mut self.random),
            _ => spots_picture(camera, &self.radii),
        };
        let mut rows = rows_of(&rgb, WIDTH.into());
        if self.random.random_range(0..3) == 0 {
            spoil(&mut rows, WIDTH.into(), &mut self.random);
        }
        self.frames[camera] += 1;
        let idle = self.random.random_range(0..100);
        self.bench.send(camera, rows, &[idle])
    }

    /// Starts a frame of a camera if the one before it has been sent.
    fn start(&mut self, camera: usize) -> anyhow::Result<()> {
        if self.frames[camera] == 0 {
            self.send_frame(camera)?;
        }
        // A row without an end stays until the next frame starts
        let next = self.bench.rows[camera].iter().find(|sent| sent.row.last || !sent.is_done && sent.row.start);
        if next.is_none_or(|sent| sent.is_done || !sent.row.start) {
            return Ok(());
        }
        // A commit takes its time, but not in the model: a frame starts well before or after that
        if self.is_settling {
            self.bench.drain()?;
            self.is_settling = self.bench.is_committing();
        }
        self.bench.hold(2 >> camera)?;
        let before = self.bench.first_pixel[camera];
        let was_committing = self.bench.is_committing();
        self.bench.allow_starts(camera, 1)?;
        for _ in 0..TO_DRAIN {
            self.bench.run(1, TO_DRAIN)?;
            if self.bench.first_pixel[camera] != before {
                self.frames[camera] -= 1;
                self.started += 1;
                // The frame has cut the one that a commit waited for: see advance
                if was_committing && !self.bench.is_committing() {
                    self.bench.drain()?;
                }
                return Ok(());
            }
        }
        Err(anyhow!("a frame of camera {camera} does not start"))
    }

    /// Sends so many beats. Gives how many are left.
    fn advance(&mut self, beats: u32) -> anyhow::Result<u32> {
        self.bench.hold(0)?;
        if !self.bench.is_committing() {
            return self.bench.run(beats, u32::MAX);
        }
        // When the commit takes effect the cameras pause: other heights hold for the next row in the model already
        let mut left = 0;
        for _ in 0..beats {
            left = self.bench.run(1, TO_DRAIN)?;
            if !self.bench.is_committing() {
                self.bench.drain()?;
                break;
            }
        }
        Ok(left)
    }

    fn act(&mut self) -> anyhow::Result<()> {
        match self.random.random_range(0..100) {
            0..40 => {
                let beats = self.random.random_range(1..6000) / self.bench.pixels_per_clock as u32;
                self.advance(beats + 1).map(drop)
            }
            40..55 => {
                let camera = self.random.random_range(0..2);
                self.start(camera)
            }
            55..70 => {
                let camera = self.random.random_range(0..2);
                self.start(camera)?;
                self.start(1 - camera)
            }
            70..74 => {
                self.look_elsewhere();
                Ok(())
            }
            74..77 => {
                let most = [0, 0, 40, 200][self.random.random_range(0..4)];
                self.bench.stall(most, most)
            }
            _ => {
                // The model takes the first row of a frame as a whole
                while self.bench.is_within_first_row() {
                    if self.advance(10)? == 0 || self.bench.is_cut() {
                        return Ok(());
                    }
                }
                self.bench.drain()?;
                self.software()?;
                self.bench.drain()?;
                self.bench.compare().with_context(|| format!("after {} frames", self.started))?;
                self.points += self.bench.points_ready();
                Ok(())
            }
        }
    }

    /// Something that software does while the cameras pause, somewhere in a frame.
    fn software(&mut self) -> anyhow::Result<()> {
        let bench = &mut self.bench;
        match self.random.random_range(0..20) {
            0..5 => bench.write32(map::COMMAND, map::COMMAND_ACKNOWLEDGE.mask()),
            9..11 => {
                if bench.is_committing() {
                    return Ok(());
                }
                let instrument = self.instrument();
                self.bench.load(&instrument)?;
                self.is_settling = true;
                self.bench.write32(map::COMMAND, map::COMMAND_COMMIT.mask())
            }
            11 => bench.write32(map::CONTROL, 0),
            12..16 => bench.write32(map::CONTROL, map::CONTROL_ENABLE.mask()),
            16 => bench.write32(map::COMMAND, map::COMMAND_RESET.mask()),
            17 => {
                let address = map::settings_camera_detector_noise(self.random.random_range(0..2));
                bench.write32(address, self.random.random())
            }
            18 => {
                bench.write32(map::INTERRUPT_STATUS, self.random.random())?;
                bench.write32(map::INTERRUPT_ENABLE, self.random.random_range(0..8))?;
                bench.write32(map::FAULT, self.random.random())
            }
            _ => {
                let counters = [map::FRAMES, map::UNPAIRED, map::SKIPPED, map::camera_stray_rows(0)];
                bench.write32(counters[self.random.random_range(0..counters.len())], 0)
            }
        }
    }
}

/// Clocks of frames without stalls.
#[derive(Clone, Copy, Default)]
pub struct Clocks {
    /// From the last pixel of the later camera to the last point.
    pub points_after_last_pixel: u64,
    /// From the last pixel of the later camera to the interrupt.
    pub results_after_last_pixel: u64,
    /// From the first pixel to the interrupt.
    pub frame: u64,
}

impl Clocks {
    fn max(self, other: Self) -> Self {
        Self {
            points_after_last_pixel: self.points_after_last_pixel.max(other.points_after_last_pixel),
            results_after_last_pixel: self.results_after_last_pixel.max(other.results_after_last_pixel),
            frame: self.frame.max(other.frame),
        }
    }
}

impl<const LASERS: usize> Bench<LASERS> {
    /// Loads an instrument and lets frames in, without stalls.
    fn set_up(&mut self, instrument: &Instrument<LASERS>) -> anyhow::Result<()> {
        self.load(instrument)?;
        self.write32(map::COMMAND, map::COMMAND_COMMIT.mask())?;
        // The words of the settings, and some
        self.run(0, 100 * LASERS as u32 + TO_DRAIN)?;
        self.write32(map::INTERRUPT_ENABLE, map::INTERRUPT_ENABLE_READY.mask())?;
        self.write32(map::CONTROL, map::CONTROL_ENABLE.mask())
    }

    /// Waits for results while the cameras go on, compares and acknowledges them.
    fn take_results(&mut self, clocks: u32) -> anyhow::Result<Clocks> {
        self.command(b'I', &clocks.to_le_bytes())?;
        let last_pixel = self.ended.iter().copied().max().unwrap_or(0);
        let since = |clock: u64, before: u64| clock.checked_sub(before).context("results without a frame");
        let clocks = Clocks {
            points_after_last_pixel: since(self.points, last_pixel)?,
            results_after_last_pixel: since(self.interrupt, last_pixel)?,
            frame: since(self.interrupt, self.began.iter().copied().min().unwrap_or(0))?,
        };
        self.compare_results()?;
        self.write32(map::INTERRUPT_STATUS, map::INTERRUPT_STATUS_READY.mask())?;
        self.write32(map::COMMAND, map::COMMAND_ACKNOWLEDGE.mask())?;
        Ok(clocks)
    }
}

/// A camera of the bench for the cycle model.
struct Camera<'a> {
    rows: &'a [Row],
    /// Idle clocks before the first beats of the first rows.
    idle: &'a [u16],
    /// The first clock in which it may offer something.
    from: u64,
}

/// Clocks of the reset before a simulation.
const RESET_CLOCKS: u64 = 4;

/// What happens when on an IP that has been idle since its reset, as the cycle model says.
fn predicted<const LASERS: usize>(
    pixels_per_clock: usize,
    instrument: &Instrument<LASERS>,
    cameras: [Camera; 2],
    end: u64,
) -> anyhow::Result<Vec<(u8, u64)>> {
    let generics = Generics { pixels_per_clock: pixels_per_clock as u32, ..Generics::for_lasers(LASERS) };
    let generics = TopGenerics { detector: generics, ..TopGenerics::default() };
    let reconstruction = Reconstruction {
        paper: instrument.method == Method::Paper,
        single_camera: instrument.calibration.settings.single_camera,
    };
    let mut top = Top::new(&generics, instrument.detectors.each_ref(), reconstruction);
    let mut streams = Vec::new();
    for (config, camera) in instrument.detectors.iter().zip(&cameras) {
        let pixels = camera.rows.iter().map(|row| Pixels { rgb: &row.rgb, start: row.start, last: row.last });
        let rows = karst_cycles::rows_of(config, pixels).map_err(|error| anyhow!("{error}"))?;
        let beats = |(row, &idle): (&karst_cycles::Row, &u16)| {
            let idle = std::iter::once(idle).chain(std::iter::repeat(0));
            row.beats(pixels_per_clock as u32).zip(idle).collect::<Vec<_>>()
        };
        let idle = camera.idle.iter().chain(std::iter::repeat(&0));
        let beats: Vec<_> = rows.iter().zip(idle).flat_map(beats).collect();
        streams.push(beats.into_iter().peekable());
    }
    let mut waited = [0; 2];
    let mut events = Vec::new();
    for clock in RESET_CLOCKS..=end {
        let mut beats = [None; 2];
        for (camera, stream) in streams.iter_mut().enumerate() {
            if let Some(&(beat, idle)) = stream.peek().filter(|_| clock >= cameras[camera].from) {
                beats[camera] = (waited[camera] == idle).then_some(beat);
                waited[camera] = idle.min(waited[camera] + 1);
            }
        }
        let offered = beats.each_ref().map(Option::as_ref);
        let taken = top.takes(offered);
        for kind in [START, LAST] {
            let is_told = |beat: &Beat| if kind == START { beat.start } else { beat.last };
            for camera in 0..2 {
                if taken[camera] && offered[camera].is_some_and(is_told) {
                    events.push((kind | camera as u8, clock));
                }
            }
        }
        if top.point() == Some(true) {
            events.push((POINTS, clock));
        }
        if top.is_interrupt() {
            events.push((INTERRUPT, clock));
        }
        top.clock(offered);
        for (camera, stream) in streams.iter_mut().enumerate().filter(|&(camera, _)| taken[camera]) {
            stream.next();
            waited[camera] = 0;
        }
    }
    Ok(events)
}

/// Holds the cycle model against the events of a bench. Software that does not acknowledge in time gets one interrupt.
fn compare_clocks<const LASERS: usize>(
    bench: &Bench<LASERS>,
    instrument: &Instrument<LASERS>,
    cameras: [Camera; 2],
    is_acknowledged: bool,
) -> anyhow::Result<()> {
    let predicted = predicted(bench.pixels_per_clock, instrument, cameras, bench.clock)?;
    let wanted = |events: &[(u8, u64)]| {
        let mut interrupts = 0;
        let mut is_wanted = |&&(kind, _): &&(u8, u64)| {
            interrupts += u32::from(kind == INTERRUPT);
            is_acknowledged || kind != INTERRUPT || interrupts == 1
        };
        events.iter().filter(|event| is_wanted(event)).copied().collect::<Vec<_>>()
    };
    let (predicted, found) = (wanted(&predicted), wanted(&bench.events));
    let at = predicted.iter().zip(&found).take_while(|(predicted, found)| predicted == found).count();
    let some = |events: &[(u8, u64)]| events[at..(at + 4).min(events.len())].to_vec();
    ensure!(
        at == predicted.len() && at == found.len(),
        "cycle model: event {at} of {} and {}: predicted {:?}, found {:?}",
        predicted.len(),
        found.len(),
        some(&predicted),
        some(&found)
    );
    Ok(())
}

/// Random frames of small instruments, some damaged, with the cameras in step or not: holds the clock of every row, of
/// the last point and of the first interrupt against the cycle model. Gives the number of frames.
pub fn compare_random_clocks(executables: &[(usize, &Path)], runs: u64) -> anyhow::Result<u64> {
    let mut count = 0;
    for (seed, &(pixels_per_clock, executable)) in (1..).zip(executables) {
        let mut session = Session::new(executable, pixels_per_clock, seed)?;
        for run in 0..runs {
            // A bench of its own: the model starts with the reset
            session.bench = Bench::new(executable, pixels_per_clock)?;
            count +=
                session.random_clocks().with_context(|| format!("{pixels_per_clock} pixels per clock, run {run}"))?;
        }
    }
    Ok(count)
}

impl Session {
    fn random_clocks(&mut self) -> anyhow::Result<u64> {
        let instrument = self.instrument();
        self.bench.set_up(&instrument)?;
        let random = &mut self.random;
        let frames = random.random_range(1..5);
        let most_idle = [1, 30, 300][random.random_range(0..3)];
        let mut streams = [Vec::new(), Vec::new()];
        let mut idle = [Vec::new(), Vec::new()];
        for frame in 0..frames {
            self.look_elsewhere();
            for camera in 0..2 {
                let random = &mut self.random;
                let config = &instrument.detectors[camera];
                let (width, height) = (usize::from(config.width), usize::from(config.height));
                let rgb = match random.random_range(0..3) {
                    0 => random_picture(width, height, random),
                    _ if (config.width, config.height) == (WIDTH, HEIGHT) => spots_picture(camera, &self.radii),
                    _ => random_picture(width, height, random),
                };
                let mut rows = rows_of(&rgb, width);
                if frame + 1 < frames && random.random_range(0..4) == 0 {
                    spoil(&mut rows, width, random);
                }
                let between_frames = [1, 100, 8000][random.random_range(0..3)];
                let most = |row: usize| if row == 0 { between_frames } else { most_idle };
                idle[camera].extend((0..rows.len()).map(|row| random.random_range(0..most(row))));
                streams[camera].extend(rows);
            }
        }
        for camera in 0..2 {
            self.bench.send(camera, streams[camera].clone(), &idle[camera])?;
            self.bench.allow_starts(camera, frames)?;
        }
        let from = self.bench.clock;
        while self.bench.run(u32::MAX, u32::MAX)? > 0 {}
        self.bench.run(0, 2 * TO_DRAIN)?;
        let camera = |camera: usize| Camera { rows: &streams[camera], idle: &idle[camera], from };
        compare_clocks(&self.bench, &instrument, [camera(0), camera(1)], false)
            .with_context(|| format!("{:?}", instrument.detectors))?;
        Ok(u64::from(2 * frames))
    }
}

/// Frames of both cameras, one after the other without a pause, camera 2 `offset` beats after camera 1; results are read
/// meanwhile.
fn stream<const LASERS: usize>(
    executable: &Path,
    pixels_per_clock: usize,
    instrument: &Instrument<LASERS>,
    frames: &[[Vec<u8>; 2]],
    offset: u32,
) -> anyhow::Result<Clocks> {
    let mut bench = Bench::<LASERS>::new(executable, pixels_per_clock)?;
    bench.set_up(instrument)?;
    let mut streams = [Vec::new(), Vec::new()];
    for frame in frames {
        for (camera, rgb) in frame.iter().enumerate() {
            let rows = rows_of(rgb, instrument.detectors[camera].width.into());
            streams[camera].extend(rows.clone());
            bench.send(camera, rows, &[])?;
            bench.allow_starts(camera, 1)?;
        }
    }
    let first = bench.clock;
    if offset > 0 {
        bench.hold(2)?;
        bench.run(offset, u32::MAX)?;
        bench.hold(0)?;
    }
    let second = bench.clock;
    let mut clocks = Clocks::default();
    // Half a frame, a frame, and some
    let config = &instrument.detectors[0];
    let most = 2 * u32::from(config.width) * u32::from(config.height);
    for number in 0..frames.len() {
        let found = bench.take_results(most).with_context(|| format!("frame {number}"))?;
        clocks = clocks.max(found);
    }
    bench.drain()?;
    bench.compare()?;
    ensure!(bench.read32(map::FRAMES)? == frames.len() as u32, "frames are lost");
    let camera = |camera: usize, from| Camera { rows: &streams[camera], idle: &[], from };
    compare_clocks(&bench, instrument, [camera(0, first), camera(1, second)], true)?;
    bench.finish()?;
    Ok(clocks)
}

/// Rendered frames of the default rig at full rate, on simulations with their pixels per clock: with the cameras in step
/// and half a frame apart. Gives the clocks of the ones in step.
pub fn compare_rendered(executables: &[(usize, &Path)], frames: usize) -> anyhow::Result<Vec<Clocks>> {
    let rig = Rig::default();
    let cameras = rig.water_cameras().context("the default rig has no water cameras")?;
    let fixed = rig.to_fixed::<LASERS>(&cameras).context("the default rig is not for fixed point")?;
    let instrument =
        Instrument { calibration: fixed.calibration, detectors: fixed.detectors, method: Method::Weighted };
    let renderer = Renderer::new(&rig).context("the default rig can not be rendered")?;
    let scenes = evaluation_scenes();
    let mut pictures = Vec::new();
    for number in 0..frames {
        let scene = &scenes[number * scenes.len() / frames % scenes.len()];
        let frame = renderer.render(&scene.scene, scene.seed).context("cannot render")?;
        pictures.push(frame.images.map(|image| image.into_raw()));
    }
    let mut all = Vec::new();
    for &(pixels_per_clock, executable) in executables {
        let context = || format!("{pixels_per_clock} pixels per clock");
        all.push(stream(executable, pixels_per_clock, &instrument, &pictures, 0).with_context(context)?);
        if frames > 1 {
            let config = &instrument.detectors[0];
            let row = u32::from(config.width) / pixels_per_clock as u32;
            let offset = u32::from(config.height / 2 - 2) * row;
            stream(executable, pixels_per_clock, &instrument, &pictures, offset).with_context(context)?;
        }
    }
    Ok(all)
}

/// A frame with a spot of each of 720 lasers in both cameras.
pub fn compare_720_lasers(executable: &Path) -> anyhow::Result<Clocks> {
    const MOST: usize = 720;
    let (size, centre, radius) = ([1024, 768], [512.0, 384.0], 330.0);
    let mut instrument = Instrument::<MOST>::facing(size, centre, [150.0, 1.0], MOST, 250.0);
    for detector in &mut instrument.detectors {
        detector.sector_half_width = 45;
    }
    let pictures = [1.0, -1.0].map(|sign| {
        let mut rgb = vec![0; 3 * usize::from(size[0]) * usize::from(size[1])];
        for laser in 0..MOST {
            let (sin, cos) = (laser as f64 / MOST as f64 * TAU).sin_cos();
            let [x, y] = [centre[0] + cos * radius, centre[1] + sign * sin * radius].map(|v| v.round() as usize);
            let at = 3 * (y * usize::from(size[0]) + x);
            rgb[at..at + 3].copy_from_slice(&[20, 200, 30]);
        }
        rgb
    });
    stream(executable, 1, &instrument, &[pictures], 0)
}

/// Random sessions on simulations with `executables` and their pixels per clock: frames of any kind, damaged and without a
/// partner, and everything software may do, with every register compared whenever the cameras pause. Gives the number of
/// frames.
pub fn compare_random(executables: &[(usize, &Path)], frames: u64) -> anyhow::Result<u64> {
    let mut count = 0;
    for (seed, &(pixels_per_clock, executable)) in (1..).zip(executables) {
        let mut session = Session::new(executable, pixels_per_clock, seed)?;
        session.bench.write32(map::CONTROL, map::CONTROL_ENABLE.mask())?;
        while session.started < frames {
            session.act().with_context(|| format!("{pixels_per_clock} pixels per clock"))?;
        }
        ensure!(session.points > 0, "no points in {frames} frames");
        count += session.started;
        session.bench.finish()?;
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_small_instrument_gives_points() {
        let instrument = Instrument::<LASERS>::facing([WIDTH, HEIGHT], CENTRE, [FORWARD, SCALE], LASERS, 250.0);
        let mut model = Model::<LASERS>::new();
        let mut karst = Karst::probe(&mut model).unwrap();
        karst.load(&instrument.settings()).unwrap();
        karst.commit().unwrap();
        karst.set_enabled(true).unwrap();
        let radii: Vec<Vec<f64>> = (0..LASERS).map(|laser| vec![38.0 + 0.5 * laser as f64]).collect();
        let pictures = [0, 1].map(|camera| rows_of(&spots_picture(camera, &radii), WIDTH.into()));
        for y in 0..usize::from(HEIGHT) {
            for (camera, rows) in pictures.iter().enumerate() {
                model.row(camera, y == 0, &rows[y].rgb);
            }
        }
        let outcome =
            |laser| map::RESULT_POINT_STATUS_OUTCOME.get(model.read32(map::result_point_status(laser)).unwrap());
        assert_eq!((0..LASERS as u32).map(outcome).collect::<Vec<_>>(), [0; LASERS]);
    }
}
