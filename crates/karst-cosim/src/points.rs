//! The reconstructor: random instruments and spots, and what `karst_core::reconstruct` makes of them. Commands and
//! results are those of `hw-ip/sim/reconstructor_harness.cpp`.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc::sync_channel;

use anyhow::{Context, anyhow, bail, ensure};
use karst_core::{
    Bounds, Calibration, CameraCalibration, Cluster, I18F14, LaserCalibration, MAX_COEFFICIENTS, Method, NoPoint,
    Point, ReconstructionSettings, Spot, reconstruct,
};
use karst_rig::{Rig, TracedCamera};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Lasers of the random instruments.
const LASERS: usize = 12;

/// Most lasers: the generic G_LASERS.
const MOST_LASERS: usize = 720;

/// Slots of a laser in a camera: 2 to the generic G_SLOT_BITS.
const SLOTS: usize = 4;

/// Words of a command and of a result of the harness.
type CommandWords = [u32; 12];
type ResultWords = [u32; 12];

/// Words of a point in a result.
const POINT_WORDS: usize = 7;

/// The spots of one laser in the two cameras.
type LaserSpots = [Vec<Spot>; 2];

/// An instrument with its settings, and what its cameras see in some frames: the spots of the first lasers each.
struct Batch {
    calibration: Calibration<MOST_LASERS>,
    method: Method,
    frames: Vec<Vec<LaserSpots>>,
}

/// What the gateware has to answer.
struct Expected {
    point: [u32; POINT_WORDS],
    /// Of the frame's last laser.
    last: bool,
    outcome: Outcome,
    method: Method,
    /// Pairs of the frame's lasers up to this one.
    pairs: u32,
}

/// Kinds of answers: none of them may be missing in a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    TwoCameras,
    OneCamera,
    Average,
    None(NoPoint),
}

const OUTCOMES: [Outcome; 8] = [
    Outcome::TwoCameras,
    Outcome::OneCamera,
    Outcome::Average,
    Outcome::None(NoPoint::NoSpot),
    Outcome::None(NoPoint::OneCamera),
    Outcome::None(NoPoint::NoIntersection),
    Outcome::None(NoPoint::OutOfRange),
    Outcome::None(NoPoint::Inconsistent),
];

/// Pairs that the gateware tries for a laser.
fn pairs(settings: &ReconstructionSettings, method: Method, [first, second]: [usize; 2]) -> u32 {
    let pairs = match method {
        Method::Paper => first.min(1) * second.min(1) + first.min(1) + second.min(1),
        Method::Weighted if settings.single_camera => first * second + first + second,
        Method::Weighted => first * second,
    };
    pairs.max(1) as u32
}

/// The formulas of `reconstructor.vhd`. `bits_per_stage` is the generic G_BITS_PER_STAGE.
struct Clocks {
    bits_per_stage: u32,
}

impl Clocks {
    fn stages(&self, bits: u32) -> u32 {
        bits.div_ceil(self.bits_per_stage)
    }

    /// From the start of a frame to a point, if `pairs` pairs have to be tried for it and all lasers before it.
    fn to_point(&self, method: Method, pairs: u32) -> u32 {
        // Of one reciprocal after another
        let (one, two) = (self.stages(17), 2 * self.stages(17));
        match method {
            // The place across comes from the last of three, or from the last of two and what follows the crossing
            Method::Weighted => 21 + pairs + one + (30 + one).max(23 + two),
            Method::Paper => 49 + pairs + two + 35_u32.div_ceil(2 * self.bits_per_stage),
        }
    }

    /// From a frame's last spot to the first clock at which a start counts.
    fn to_ray(&self) -> u32 {
        29 + 3 * MAX_COEFFICIENTS as u32 + self.stages(17) + 33_u32.div_ceil(self.bits_per_stage.min(2))
    }

    /// From a frame's last mask to the first clock at which a start counts.
    fn to_farthest(method: Method) -> u32 {
        match method {
            Method::Weighted => 1,
            Method::Paper => 4,
        }
    }
}

impl Expected {
    /// The points of a frame.
    fn of_frame(batch: &Batch, frame: &[LaserSpots]) -> Vec<Self> {
        let mut pairs_so_far = 0;
        let points = frame.iter().enumerate().map(|(laser, [first, second])| {
            let result = reconstruct(&batch.calibration, laser, [first, second], batch.method);
            pairs_so_far += pairs(&batch.calibration.settings, batch.method, [first.len(), second.len()]);
            Self {
                point: point_words(laser, &result),
                last: laser + 1 == frame.len(),
                outcome: outcome(&result),
                method: batch.method,
                pairs: pairs_so_far,
            }
        });
        points.collect()
    }

    fn of_batch(batch: &Batch) -> Vec<Self> {
        batch.frames.iter().flat_map(|frame| Self::of_frame(batch, frame)).collect()
    }
}

fn outcome(result: &Result<Point, NoPoint>) -> Outcome {
    match result {
        Err(reason) => Outcome::None(*reason),
        Ok(Point { sigma: None, .. }) => Outcome::Average,
        Ok(Point { spots: [Some(_), Some(_)], .. }) => Outcome::TwoCameras,
        Ok(_) => Outcome::OneCamera,
    }
}

/// The stream of points, see `hw-ip/doc/reconstructor.md`.
fn point_words(laser: usize, result: &Result<Point, NoPoint>) -> [u32; POINT_WORDS] {
    let reason = match result {
        Ok(_) => 0,
        Err(NoPoint::NoLaser) => unreachable!("every laser is in the calibration"),
        Err(NoPoint::NoSpot) => 1,
        Err(NoPoint::OneCamera) => 2,
        Err(NoPoint::NoIntersection) => 3,
        Err(NoPoint::OutOfRange) => 4,
        Err(NoPoint::Inconsistent) => 5,
    };
    let mut words = [0; POINT_WORDS];
    words[6] = laser as u32 | reason << 10;
    if let Ok(point) = result {
        let bits = |value: I18F14| value.to_bits() as u32;
        words[..3].copy_from_slice(&point.position.map(bits));
        words[3] = bits(point.along);
        words[4] = point.sigma.map_or(0, bits);
        words[5] = point.chi2.map_or(0, bits);
        for (camera, spot) in point.spots.into_iter().enumerate() {
            if let Some(spot) = spot {
                words[6] |= 1 << (13 + camera) | u32::from(spot) << (15 + 3 * camera);
            }
        }
    }
    words
}

/// Commands that load an instrument.
fn load(batch: &Batch) -> Vec<CommandWords> {
    let mut commands = Vec::new();
    let mut write = |table: u32, entry: usize, words: &[u32]| {
        commands.extend(words.iter().enumerate().map(|(word, &value)| {
            let mut command = [0; 12];
            command[1..5].copy_from_slice(&[table, entry as u32, word as u32, value]);
            command
        }));
    };
    let calibration = &batch.calibration;
    for (number, camera) in calibration.cameras.iter().enumerate() {
        write(0, number, &camera_words(camera));
    }
    for (number, laser) in calibration.lasers.iter().enumerate() {
        for (camera, frame) in laser.cameras.iter().enumerate() {
            let words: Vec<u32> =
                frame.rotation.as_flattened().iter().chain(&frame.viewpoint).map(|&w| w as u32).collect();
            write(1, 2 * number + camera, &words);
        }
        let words: Vec<u32> = laser.origin.iter().chain(laser.axes.as_flattened()).map(|&w| w as u32).collect();
        write(2, number, &words);
        let halves = |wide: u64| [wide as u32, (wide >> 32) as u32];
        write(3, number, [halves(laser.origin_variance), halves(laser.direction_variance)].as_flattened());
    }
    let settings = &calibration.settings;
    let [least, most] = settings.range.map(|range| range.to_bits() as u32);
    let mut command = [0; 12];
    command[..3].copy_from_slice(&[1, u32::from(batch.method == Method::Paper), settings.single_camera.into()]);
    command[3..6].copy_from_slice(&[least, most, settings.chi2_max.to_bits() as u32]);
    commands.push(command);
    commands
}

/// A command without inputs.
fn plain(kind: u32, argument: u32) -> CommandWords {
    let mut command = [0; 12];
    command[..2].copy_from_slice(&[kind, argument]);
    command
}

fn wait() -> CommandWords {
    plain(3, 0)
}

fn reset() -> CommandWords {
    plain(4, 0)
}

fn pause(clocks: u32) -> CommandWords {
    plain(5, clocks)
}

fn start(bank: u32, lasers: usize, dropped: bool) -> CommandWords {
    plain(2, 1 << 16 | bank << 17 | (lasers as u32) << 18 | u32::from(dropped) << 29)
}

/// Commands that load an instrument and show it its frames. Now and then a frame in between is cut off by a reset.
fn commands(batch: &Batch, rng: &mut ChaCha8Rng) -> Vec<CommandWords> {
    let mut commands = load(batch);
    let mut bank = rng.random_range(0..2);
    for frame in &batch.frames {
        if rng.random_ratio(1, 16) {
            commands.push(wait());
            let mut lost = frame_commands(frame, bank, rng);
            lost.truncate(rng.random_range(0..=lost.len()));
            commands.extend(lost);
            if rng.random() {
                commands.push(start(bank, frame.len(), true));
            }
            commands.extend([pause(rng.random_range(0..150)), reset()]);
        }
        commands.extend(frame_commands(frame, bank, rng));
        if rng.random() {
            commands.push(pause(rng.random_range(0..150)));
        }
        commands.push(start(bank, frame.len(), false));
        bank ^= 1;
    }
    commands.push(wait());
    commands
}

/// Spots and masks of one camera in one frame: the spots in any order in any slots, some of them after others that they
/// displace, some in slots that the masks do not have.
fn camera_commands(frame: &[LaserSpots], camera: usize, bank: u32, rng: &mut ChaCha8Rng) -> Vec<CommandWords> {
    let (mut spots, mut masks) = (Vec::new(), Vec::new());
    for (laser, of) in frame.iter().enumerate() {
        let mut slots: Vec<usize> = (0..SLOTS).collect();
        slots.shuffle(rng);
        let (taken, free) = slots.split_at_mut(of[camera].len());
        taken.sort_unstable();
        spots.extend(of[camera].iter().zip(&*taken).map(|(spot, &slot)| (laser, slot, *spot)));
        if let (Some(&slot), true) = (free.first(), rng.random_ratio(1, 8)) {
            spots.push((laser, slot, any_spot(rng)));
        }
        let mut command = plain(2, 0);
        command[2] = 1 << camera | bank << (2 + camera) | (laser as u32) << (4 + 10 * camera);
        command[3] = taken.iter().map(|&slot| 1 << (slot + 8 * camera)).sum();
        masks.push(command);
    }
    spots.shuffle(rng);
    let mut commands: Vec<CommandWords> = Vec::new();
    for (laser, slot, spot) in spots {
        if rng.random_ratio(1, 8) {
            let displaced = spot_command(laser, camera, slot, bank, &any_spot(rng));
            commands.insert(rng.random_range(0..=commands.len()), displaced);
        }
        commands.push(spot_command(laser, camera, slot, bank, &spot));
    }
    commands.extend(masks);
    commands
}

/// Spots and masks of both cameras, in any order against each other.
fn frame_commands(frame: &[LaserSpots], bank: u32, rng: &mut ChaCha8Rng) -> Vec<CommandWords> {
    let cameras = [0, 1].map(|camera| camera_commands(frame, camera, bank, rng));
    let mut rest = [cameras[0].as_slice(), &cameras[1]];
    let mut commands = Vec::new();
    while rest.iter().any(|commands| !commands.is_empty()) {
        let camera = usize::from(rest[0].is_empty() || (!rest[1].is_empty() && rng.random()));
        if let Some((command, others)) = rest[camera].split_first() {
            commands.push(*command);
            rest[camera] = others;
            // The other camera's mask at the same clock
            if let (Some((other, others)), true) = (rest[1 - camera].split_first(), rng.random())
                && other[1] == 0
            {
                if let Some(last) = commands.last_mut() {
                    last.iter_mut().zip(other).skip(2).for_each(|(word, other)| *word |= other);
                }
                rest[1 - camera] = others;
            }
        }
    }
    commands
}

fn camera_words(camera: &CameraCalibration) -> Vec<u32> {
    let mut words: Vec<i32> = camera.centre.map(I18F14::to_bits).to_vec();
    words.extend(camera.inverse_affine);
    words.extend(camera.decentring);
    for coefficients in [&camera.polynomial, &camera.axial] {
        words.extend((0..MAX_COEFFICIENTS).map(|i| coefficients.get(i).copied().unwrap_or(0)));
    }
    words.into_iter().map(|word| word as u32).collect()
}

/// A spot, see `hw-ip/doc/reconstructor.md`.
fn spot_command(laser: usize, camera: usize, slot: usize, bank: u32, spot: &Spot) -> CommandWords {
    let Spot { position, variance, cluster } = spot;
    let Cluster { pixels, bounds, .. } = cluster;
    let both = |low: u16, high: u16| u32::from(low) | u32::from(high) << 16;
    let mut words = plain(2, 1 | bank << 1 | (camera as u32) << 2 | (slot as u32) << 3 | (laser as u32) << 6);
    words[4] = position[0].to_bits() as u32;
    words[5] = position[1].to_bits() as u32;
    words[6] = *variance;
    words[7] = *pixels;
    words[9] = both(bounds.x_min, bounds.x_max);
    words[10] = both(bounds.y_min, bounds.y_max);
    words[11] = u32::from(cluster.r_max()) | (laser as u32) << 16;
    words
}

/// Makes batches: instruments that exist, and calibrations at the ends of their formats.
struct Generator {
    rng: ChaCha8Rng,
    instruments: Vec<Instrument>,
}

struct Instrument {
    rig: Rig,
    traced: [TracedCamera; 2],
    calibration: Calibration<MOST_LASERS>,
}

impl Instrument {
    fn new(rig: Rig) -> anyhow::Result<Self> {
        let cameras = rig.water_cameras()?;
        let calibration = rig.to_fixed(&cameras)?.calibration;
        let traced = |index| rig.traced_camera(index).ok_or_else(|| anyhow!("camera {index} has no tube"));
        Ok(Self { traced: [traced(0)?, traced(1)?], calibration, rig })
    }

    /// Where the cameras see the spot of a laser at a distance, mm, and offsets from the beam, mm.
    fn project(&self, laser: usize, in_beam: [f64; 3]) -> [Option<[f64; 2]>; 2] {
        let beam = &self.rig.lasers[laser];
        let point = Point3::from(Vector3::from(beam.origin_mm) + beam.frame().transpose() * Vector3::from(in_beam));
        [0, 1].map(|camera| self.traced[camera].project(point).map(|pixel| [pixel.x, pixel.y]))
    }
}

impl Generator {
    fn new(seed: u64) -> anyhow::Result<Self> {
        let instruments = vec![Instrument::new(Rig::default())?, Instrument::new(Rig::ideal())?];
        Ok(Self { rng: ChaCha8Rng::seed_from_u64(seed), instruments })
    }

    /// A batch of frames of a real instrument, of fewer with a calibration at the ends of its formats.
    fn batch(&mut self, frames: usize) -> Batch {
        let method = if self.rng.random_ratio(3, 4) { Method::Weighted } else { Method::Paper };
        if self.rng.random_ratio(1, 3) {
            let calibration = self.extreme_calibration();
            let frames = (0..frames.div_ceil(4))
                .map(|_| {
                    let lasers = self.rng.random_range(1..=LASERS);
                    (0..lasers).map(|_| self.extreme_spots()).collect()
                })
                .collect();
            return Batch { calibration, method, frames };
        }
        let instrument = self.rng.random_range(0..self.instruments.len());
        let calibration = self.settings(self.instruments[instrument].calibration.clone());
        let frames = (0..frames)
            .map(|_| {
                let lasers = self.rng.random_range(1..=LASERS);
                (0..lasers).map(|laser| self.real_spots(instrument, laser)).collect()
            })
            .collect();
        Batch { calibration, method, frames }
    }

    /// A frame of the default rig, its twelve lasers over and over, with the same number of spots in both cameras.
    fn frame(&mut self, method: Method, lasers: usize, spots: usize) -> Batch {
        let mut calibration = self.instruments[0].calibration.clone();
        calibration.lasers = (0..lasers).map(|laser| calibration.lasers[laser % LASERS]).collect();
        let frame = (0..lasers)
            .map(|laser| {
                let mut seen = [Vec::new(), Vec::new()];
                for spot in 0..spots {
                    let along = 1000.0 + 0.5 * laser as f64 + 1000.0 * spot as f64;
                    let pixels = self.instruments[0].project(laser % LASERS, [along, 0.0, 0.0]);
                    for (spots, pixel) in seen.iter_mut().zip(pixels) {
                        spots.extend(pixel.map(|[x, y]| self.bright_spot([x, y])));
                    }
                }
                seen
            })
            .collect();
        Batch { calibration, method, frames: vec![frame] }
    }

    /// A spot at a position, px, with a small variance.
    fn bright_spot(&mut self, pixel: [f64; 2]) -> Spot {
        let [x, y] = pixel.map(|p| p.clamp(0.0, 2047.0) as u16);
        let bounds = Bounds { x_min: x, x_max: x + 1, y_min: y, y_max: y + 1 };
        Spot { variance: 2416, ..spot(&mut self.rng, pixel.map(I18F14::saturating_from_num), bounds) }
    }

    /// Other limits and other laser uncertainties.
    fn settings(&mut self, mut calibration: Calibration<MOST_LASERS>) -> Calibration<MOST_LASERS> {
        let rng = &mut self.rng;
        let settings = &mut calibration.settings;
        settings.single_camera = rng.random();
        match rng.random_range(0..4) {
            0 => settings.range = [I18F14::ZERO, I18F14::MAX],
            1 => settings.range = [I18F14::from_num(800), I18F14::from_num(2000)],
            _ => {}
        }
        match rng.random_range(0..4) {
            0 => settings.chi2_max = I18F14::MAX,
            1 => settings.chi2_max = I18F14::ONE,
            _ => {}
        }
        match rng.random_range(0..6) {
            0 => calibration.lasers.iter_mut().for_each(|laser| laser.origin_variance = 0),
            1 => calibration
                .lasers
                .iter_mut()
                .for_each(|laser| (laser.origin_variance, laser.direction_variance) = (0, 0)),
            2 => calibration.lasers.iter_mut().for_each(|laser| laser.origin_variance = 1024 << 32),
            _ => {}
        }
        calibration
    }

    fn real_spots(&mut self, instrument: usize, laser: usize) -> LaserSpots {
        let mut spots = [Vec::new(), Vec::new()];
        // One place in the beam mostly, up to four; some of them are seen by one camera only, or by none
        let places = match self.rng.random_range(0..16) {
            0 => 0,
            1..12 => 1,
            _ => self.rng.random_range(2..=SLOTS),
        };
        for _ in 0..places {
            let rng = &mut self.rng;
            let along = 200.0 * 30.0_f64.powf(rng.random());
            let spread = if rng.random_ratio(1, 16) { 0.5 } else { 4e-3 };
            let mut offset = || (rng.random::<f64>() - 0.5) * (2.0 + spread * along);
            let in_beam = [along, offset(), offset()];
            let seen = self.instruments[instrument].project(laser, in_beam);
            for (camera, pixel) in seen.into_iter().enumerate() {
                let spot = match (pixel, self.rng.random_range(0..32)) {
                    (_, 0) => continue,
                    (_, 1) => any_spot(&mut self.rng),
                    (Some(pixel), _) => self.spot_near(pixel),
                    (None, _) => continue,
                };
                spots[camera].push(spot);
            }
        }
        spots
    }

    /// A spot within a noise of a position, px.
    fn spot_near(&mut self, pixel: [f64; 2]) -> Spot {
        let rng = &mut self.rng;
        let noise = if rng.random_ratio(1, 8) { 4.0 } else { 0.1 };
        let position = pixel.map(|p| I18F14::saturating_from_num(p + noise * (rng.random::<f64>() - 0.5)));
        let bound = |p: f64, add: f64| (p + add).clamp(0.0, 2047.0) as u16;
        let (left, right) = (rng.random_range(0.0..4.0), rng.random_range(0.0..4.0));
        let bounds = Bounds {
            x_min: bound(pixel[0], -left),
            x_max: bound(pixel[0], right),
            y_min: bound(pixel[1], -right),
            y_max: bound(pixel[1], left),
        };
        spot(&mut self.rng, position, bounds)
    }

    fn extreme_spots(&mut self) -> LaserSpots {
        [0, 1].map(|_| {
            let count = if self.rng.random_ratio(3, 4) { 1 } else { self.rng.random_range(0..=SLOTS) };
            (0..count).map(|_| any_spot(&mut self.rng)).collect()
        })
    }

    /// Any values that the formats hold, around rotations.
    fn extreme_calibration(&mut self) -> Calibration<MOST_LASERS> {
        let rng = &mut self.rng;
        let mut calibration = Calibration::default();
        for camera in &mut calibration.cameras {
            camera.centre = [any(rng, 25), any(rng, 25)].map(I18F14::from_bits);
            camera.inverse_affine = [(1 << 30) + any(rng, 29), any(rng, 28), any(rng, 28), (1 << 30) + any(rng, 29)];
            camera.decentring = [any(rng, 30), any(rng, 30)];
            camera.polynomial = (0..MAX_COEFFICIENTS).map(|_| any(rng, 31)).collect();
            camera.axial = (0..rng.random_range(0..=MAX_COEFFICIENTS)).map(|_| any(rng, 31)).collect();
        }
        calibration.lasers = (0..LASERS)
            .map(|_| {
                let mut laser = LaserCalibration {
                    origin: [any(rng, 31), any(rng, 31), any(rng, 31)],
                    axes: rotation(rng),
                    origin_variance: u64::from(any(rng, 31).unsigned_abs()) << rng.random_range(0..11),
                    // (20 mrad)^2
                    direction_variance: rng.random_range(0..=7_036_874_418),
                    ..LaserCalibration::default()
                };
                for frame in &mut laser.cameras {
                    frame.rotation = rotation(rng);
                    frame.viewpoint = [any(rng, 31), any(rng, 31), any(rng, 31)];
                }
                laser
            })
            .collect();
        calibration.settings = ReconstructionSettings {
            range: [I18F14::ZERO, I18F14::MAX],
            chi2_max: if rng.random() { I18F14::MAX } else { I18F14::from_bits(any(rng, 31).abs()) },
            single_camera: rng.random(),
        };
        calibration
    }
}

/// A spot anywhere, also far outside the image.
fn any_spot(rng: &mut ChaCha8Rng) -> Spot {
    let position = [any(rng, 31), any(rng, 31)].map(I18F14::from_bits);
    let mut bound = || rng.random::<u16>() >> rng.random_range(0..16);
    let bounds = Bounds { x_min: bound(), x_max: bound(), y_min: bound(), y_max: bound() };
    spot(rng, position, bounds)
}

/// A spot with any variance and radius.
fn spot(rng: &mut ChaCha8Rng, position: [I18F14; 2], bounds: Bounds) -> Spot {
    let variance = match rng.random_range(0..8) {
        0 => rng.random_range(0..4),
        1 => 1 << 24,
        2 => rng.random(),
        _ => any(rng, 24).unsigned_abs(),
    };
    // Equal radii occur
    let r_max = rng.random_range(0..8) * 1000;
    let cluster = Cluster {
        pixels: 9,
        green: 9,
        saturated: 0,
        weight: 900,
        weight_x: 0,
        weight_y: 0,
        bounds,
        radius_squared: r_max * r_max,
    };
    Spot { position, variance, cluster }
}

/// A value of up to `bits` bits and a sign, small ones as likely as large ones.
fn any(rng: &mut ChaCha8Rng, bits: u32) -> i32 {
    let limit = (1_i64 << rng.random_range(0..=bits)) - 1;
    rng.random_range(-limit..=limit) as i32
}

/// A random rotation in Q2.30; or one near to that of an instrument, whose camera looks across the beam.
fn rotation(rng: &mut ChaCha8Rng) -> [[i32; 3]; 3] {
    let limit = if rng.random() { 0.1 } else { 3.0 };
    let mut angle = || rng.random_range(-limit..=limit);
    let matrix: Matrix3<f64> = Rotation3::new(Vector3::new(angle(), angle(), angle())).into_inner();
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (matrix[(i, j)] * f64::from(1 << 30)).round() as i32))
}

/// Writes files of commands and points for `tb_reconstructor.vhd`.
pub fn write_vectors(count: u64, commands_path: &Path, points_path: &Path) -> anyhow::Result<()> {
    let create = |path: &Path| {
        let file = File::create(path).with_context(|| format!("cannot create {}", path.display()))?;
        anyhow::Ok(BufWriter::new(file))
    };
    let (mut command_file, mut point_file) = (create(commands_path)?, create(points_path)?);
    let mut generator = Generator::new(2)?;
    let mut written = 0;
    while written < count {
        let batch = generator.batch(BENCH_BATCH);
        for command in commands(&batch, &mut generator.rng) {
            writeln!(command_file, "{}", command.map(|word| format!("{word:08x}")).concat())?;
        }
        for Expected { point, last, .. } in Expected::of_batch(&batch) {
            let words: String = point.map(|word| format!("{word:08x}")).into_iter().rev().collect();
            writeln!(point_file, "{} {words}", u8::from(last))?;
            written += 1;
        }
    }
    command_file.flush().context("cannot write the commands")?;
    point_file.flush().context("cannot write the points")
}

/// Frames of one batch for the slow VHDL bench.
const BENCH_BATCH: usize = 6;

/// Frames of one batch.
const BATCH: usize = 60;

impl Expected {
    /// Compares the point and the clock it came at.
    fn check(&self, found: &ResultWords, clocks: &Clocks) -> anyhow::Result<()> {
        let [_, _, _, _, _, _, _, last, start, spot, mask, clock] = *found;
        ensure!(found[..POINT_WORDS] == self.point, "expected {:08x?}, found {found:08x?}", self.point);
        ensure!((last == 1) == self.last, "the end of the frame is not where it belongs");
        let counts = start.max(spot + clocks.to_ray()).max(mask + Clocks::to_farthest(self.method));
        let (expected, found) = (clocks.to_point(self.method, self.pairs), clock - counts);
        ensure!(found == expected, "expected a latency of {expected}, found {found}");
        Ok(())
    }
}

/// Streams spots through a simulated reconstructor and compares points and latencies; says what it has seen.
pub fn compare(count: u64, bits_per_stage: u32, executable: &Path) -> anyhow::Result<String> {
    let mut generator = Generator::new(1)?;
    let mut compared = 0;
    let mut seen = [0_u64; OUTCOMES.len()];
    let batches = move || {
        (compared < count).then(|| {
            let batch = generator.batch(BATCH);
            let expected = Expected::of_batch(&batch);
            compared += expected.len() as u64;
            (commands(&batch, &mut generator.rng), expected)
        })
    };
    let clocks = Clocks { bits_per_stage };
    // A third of the clocks hold the inputs back
    run(executable, 85, batches, |expected, found| {
        let index = OUTCOMES.iter().position(|&outcome| outcome == expected.outcome).context("no such outcome")?;
        seen[index] += 1;
        expected.check(found, &clocks)
    })?;
    for (outcome, count) in OUTCOMES.iter().zip(seen) {
        ensure!(count > 0, "none of the results is {outcome:?}: too few to show anything");
    }
    let counts: Vec<String> =
        OUTCOMES.iter().zip(seen).map(|(outcome, count)| format!("{outcome:?} {count}")).collect();
    Ok(format!("{} lasers, every bit and every latency equal: {}", seen.iter().sum::<u64>(), counts.join(", ")))
}

/// Clocks of a frame.
pub struct FrameClocks {
    /// What was measured.
    pub name: String,
    /// From the start to the last point.
    pub after_start: u32,
}

/// Most clocks from the start of 12 lasers to their last point by the weighted method, from 3 bits per stage on.
const MOST_CLOCKS_12: u32 = 75;

/// Most clocks from the start of 720 lasers to their last point.
const MOST_CLOCKS_720: u32 = 8000;

/// Shows whole frames to a simulated reconstructor, compares their points, and measures: 12 and 720 lasers with a spot
/// per camera by both methods, 720 with two; 12 with spots until the start.
pub fn measure(bits_per_stage: u32, executable: &Path) -> anyhow::Result<Vec<FrameClocks>> {
    let frames = [
        (Method::Weighted, LASERS, 1, false),
        (Method::Paper, LASERS, 1, false),
        (Method::Weighted, LASERS, 1, true),
        (Method::Weighted, MOST_LASERS, 1, false),
        (Method::Paper, MOST_LASERS, 1, false),
        (Method::Weighted, MOST_LASERS, 2, false),
    ];
    frames
        .into_iter()
        .map(|(method, lasers, spots, late)| {
            let mut generator = Generator::new(3)?;
            let batch = generator.frame(method, lasers, spots);
            let expected = Expected::of_batch(&batch);
            ensure!(expected.iter().all(|e| !matches!(e.outcome, Outcome::None(_))), "every laser has a point");
            let mut commands = load(&batch);
            commands.extend(frame_commands(&batch.frames[0], 0, &mut generator.rng));
            if late {
                // The last spot comes again
                commands.extend(commands.iter().rfind(|command| command[0] == 2 && command[1] & 1 == 1).copied());
            } else {
                commands.push(pause(200));
            }
            commands.push(start(0, lasers, false));
            let mut batches = [(commands, expected)].into_iter();
            let mut after_start = 0;
            let clocks = Clocks { bits_per_stage };
            run(
                executable,
                0,
                move || batches.next(),
                |expected, found| {
                    let [.., start, _, _, clock] = *found;
                    after_start = clock - start;
                    expected.check(found, &clocks)
                },
            )?;
            let quick = method == Method::Weighted && lasers == LASERS && !late && bits_per_stage >= 3;
            let most = if quick { MOST_CLOCKS_12 } else { MOST_CLOCKS_720 };
            ensure!(after_start <= most, "{after_start} clocks for {lasers} lasers, expected at most {most}");
            let when = if late { ", the last spot with the start" } else { "" };
            let method = format!("{method:?}").to_lowercase();
            let name = format!("{method}, {lasers} lasers, {spots} per camera{when}");
            Ok(FrameClocks { name, after_start })
        })
        .collect()
}

/// Runs a simulation with batches of commands and expected results.
fn run(
    executable: &Path,
    stalls: u32,
    mut batches: impl FnMut() -> Option<(Vec<CommandWords>, Vec<Expected>)> + Send + 'static,
    mut check: impl FnMut(&Expected, &ResultWords) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut simulation = Command::new(executable)
        .args(["1", &stalls.to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start {}", executable.display()))?;
    let (Some(input), Some(output)) = (simulation.stdin.take(), simulation.stdout.take()) else {
        bail!("the simulation has no pipes");
    };
    let (sender, receiver) = sync_channel::<Vec<Expected>>(16);
    let writer = std::thread::spawn(move || -> std::io::Result<()> {
        let mut input = BufWriter::with_capacity(1 << 16, input);
        while let Some((commands, expected)) = batches() {
            if sender.send(expected).is_err() {
                return Ok(());
            }
            for word in commands.as_flattened() {
                input.write_all(&word.to_le_bytes())?;
            }
        }
        input.flush()
    });
    let mut output = BufReader::with_capacity(1 << 16, output);
    for (number, expected) in receiver.iter().flatten().enumerate() {
        let mut found = ResultWords::default();
        for word in &mut found {
            let mut bytes = [0; 4];
            output.read_exact(&mut bytes).with_context(|| format!("result {number} is missing"))?;
            *word = u32::from_le_bytes(bytes);
        }
        check(&expected, &found).with_context(|| format!("result {number}"))?;
    }
    let rest = output.read_to_end(&mut Vec::new()).context("cannot read the results")?;
    ensure!(rest == 0, "{rest} bytes after the last result");
    let Ok(written) = writer.join() else { bail!("the writer has panicked") };
    written.context("the simulation did not take all commands")?;
    let status = simulation.wait().context("the simulation is lost")?;
    ensure!(status.success(), "the simulation failed: {status}");
    Ok(())
}
