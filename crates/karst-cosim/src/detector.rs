//! Frames for the simulated detector, and what `karst-core` makes of them. Formats: `hw-ip/sim/detector_harness.cpp` and
//! `hw-ip/rtl/detector/detector.vhd`.

use std::collections::{HashMap, VecDeque};
use std::io::{BufWriter, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail, ensure};
use karst_core::{DetectorConfig, FrameStatus, I18F14, Spot, SpotDetector, SpotNoise, Thresholds};
use karst_cycles::{Generics, Pixels};
use karst_rig::Rig;
use karst_scene::{Renderer, evaluation_scenes};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Candidates per laser of the simulated detectors.
const SLOTS: usize = 4;

/// A row as it comes over the stream.
#[derive(Clone)]
pub struct Row {
    /// R, G, B of each pixel.
    pub rgb: Vec<u8>,
    /// tuser on its first beat.
    pub start: bool,
    /// tlast on its last beat.
    pub last: bool,
}

/// How the stream is held up: of 256 clocks, and idle clocks after a row.
#[derive(Clone, Copy)]
struct Stalls {
    input: u32,
    output: u32,
    blanking: u32,
}

const NO_STALLS: Stalls = Stalls { input: 0, output: 0, blanking: 0 };

/// `Record::last` of the counts of events, of the slots of a laser, and, plus its slot, of an early record.
const COUNTS: u64 = 2;
const MASK: u64 = 3;
const EARLY: u64 = 16;

/// Clocks of the reset before a simulation.
const RESET_CLOCKS: u64 = 4;

/// The generics of the largest detector, and of the others.
const LARGE: Generics = Generics { pixels_per_clock: 4, x_bits: 11, laser_bits: 10, slot_bits: 2 };

fn small(pixels_per_clock: usize) -> Generics {
    Generics { pixels_per_clock: pixels_per_clock as u32, ..Generics::default() }
}

/// Fewest clocks from one early record to the next.
const EARLY_DISTANCE: u64 = 8;

/// A record of the result stream, or what else the simulation tells.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Record {
    data: [u8; 32],
    last: u64,
}

/// With the clocks of the record and of the last beat before it.
#[derive(Clone, Copy)]
struct Timed {
    record: Record,
    clock: u64,
    last_beat: u64,
}

/// Clocks from a frame's last pixel to its results, the worst of all frames.
#[derive(Clone, Copy, Default, Debug)]
pub struct Latency {
    /// To the slots of the last laser.
    pub last_mask: u64,
    /// To the last spot.
    pub last_spot: u64,
    /// To the frame's record.
    pub frame: u64,
}

fn spot_record(laser: usize, spot: &Spot) -> Record {
    let mut data = Vec::with_capacity(32);
    for axis in spot.position {
        data.extend(axis.to_bits().to_le_bytes());
    }
    let c = &spot.cluster;
    for word in [spot.variance, c.pixels, c.saturated] {
        data.extend(word.to_le_bytes());
    }
    let b = &c.bounds;
    for half in [b.x_min, b.x_max, b.y_min, b.y_max, c.r_max(), laser as u16] {
        data.extend(half.to_le_bytes());
    }
    Record { data: std::array::from_fn(|i| data[i]), last: 0 }
}

fn frame_record(status: &FrameStatus) -> Record {
    let mut data = vec![0; 12];
    for word in [status.hits, status.outside, status.overflow, 0] {
        data.extend(word.to_le_bytes());
    }
    for half in [status.rows, status.damaged_rows] {
        data.extend(half.to_le_bytes());
    }
    Record { data: std::array::from_fn(|i| data[i]), last: 1 }
}

/// What the detector has to give for a stream.
fn expected<const LASERS: usize>(config: &DetectorConfig<LASERS>, rows: &[Row]) -> anyhow::Result<Vec<Record>> {
    let mut detector = SpotDetector::<LASERS, SLOTS>::new(config.clone())
        .map_err(|error| anyhow::anyhow!("the configuration is refused: {error}"))?;
    let full = 3 * usize::from(config.width);
    let (mut records, mut in_frame, mut rows_taken) = (Vec::new(), false, 0);
    let [mut short, mut long, mut truncated, mut stray] = [0_u64; 4];
    let mut end = |detector: &mut SpotDetector<LASERS, SLOTS>| {
        let status = detector.end_frame();
        for laser in 0..config.azimuths.len() {
            records.extend(detector.spots(laser).iter().map(|spot| spot_record(laser, spot)));
        }
        records.push(frame_record(&status));
        truncated += u64::from(status.truncated);
    };
    for row in rows {
        if row.start {
            if in_frame {
                end(&mut detector);
            }
            detector.start_frame();
            (in_frame, rows_taken) = (true, 0);
        }
        if !in_frame {
            stray += u64::from(row.last);
            continue;
        }
        // A wrong length is what is tested: it shows in the status
        let _ = detector.row(&row.rgb);
        rows_taken += 1;
        short += u64::from(row.rgb.len() < full);
        long += u64::from(row.rgb.len() > full);
        if row.last && rows_taken == config.height {
            end(&mut detector);
            in_frame = false;
        }
    }
    let mut counts = [0; 32];
    for (bytes, count) in counts.as_chunks_mut::<8>().0.iter_mut().zip([short, long, truncated, stray]) {
        *bytes = count.to_le_bytes();
    }
    records.push(Record { data: counts, last: COUNTS });
    Ok(records)
}

fn config_words<const LASERS: usize>(config: &DetectorConfig<LASERS>) -> Vec<u32> {
    let t = &config.thresholds;
    let lasers = config.azimuths.len() as u32;
    let [centre_x, centre_y] = config.centre.map(|c| ((c.to_bits() + (1 << 9)) >> 10) as u32);
    let first_edge = config.azimuths[0].wrapping_sub(((1 << 15) / lasers) as u16);
    let mut words = vec![
        config.width.into(),
        config.height.into(),
        t.green_min[0].into(),
        t.green_min[1].into(),
        t.excess_min[0].into(),
        t.excess_min[1].into(),
        t.saturation_min.into(),
        t.clip_min.into(),
        t.clipped_weight.into(),
        centre_x,
        centre_y,
        config.mirror_radius.into(),
        config.inner_radius.into(),
        config.cluster_gap.min(2047).into(),
        config.min_pixels.into(),
        config.clockwise.into(),
        lasers,
        first_edge.into(),
        config.sector_half_width.into(),
        config.noise.floor,
        config.noise.noise,
    ];
    words.extend(config.azimuths.iter().map(|&azimuth| u32::from(azimuth)));
    words
}

/// Sends a stream of so many frames through a simulation.
fn simulate<const LASERS: usize>(
    executable: &Path,
    pixels_per_clock: usize,
    config: &DetectorConfig<LASERS>,
    rows: &[Row],
    stalls: Stalls,
    frames: u32,
) -> anyhow::Result<Vec<Timed>> {
    let mut simulation = Command::new(executable)
        .args([1, stalls.input, stalls.output, stalls.blanking, frames].map(|argument| argument.to_string()))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start {}", executable.display()))?;
    let (Some(input), Some(mut output)) = (simulation.stdin.take(), simulation.stdout.take()) else {
        bail!("the simulation has no pipes");
    };
    let mut bytes = Vec::new();
    std::thread::scope(|scope| -> anyhow::Result<()> {
        let writer = scope.spawn(|| -> std::io::Result<()> {
            let mut input = BufWriter::with_capacity(1 << 16, input);
            for word in config_words(config) {
                input.write_all(&word.to_le_bytes())?;
            }
            for row in rows {
                let beats = row.rgb.len() / (3 * pixels_per_clock);
                for (i, beat) in row.rgb.chunks_exact(3 * pixels_per_clock).enumerate() {
                    let flags = u8::from(row.start && i == 0) | u8::from(row.last && i + 1 == beats) << 1;
                    input.write_all(&[flags])?;
                    // AXI4-Stream Video: G in the low byte, then B, then R
                    for &[r, g, b] in beat.as_chunks().0 {
                        input.write_all(&[g, b, r])?;
                    }
                }
            }
            input.flush()
        });
        output.read_to_end(&mut bytes).context("cannot read the results")?;
        let Ok(written) = writer.join() else { bail!("the writer has panicked") };
        written.context("the simulation did not take all beats")
    })?;
    let status = simulation.wait().context("the simulation is lost")?;
    ensure!(status.success(), "the simulation failed: {status}");
    let (records, rest) = bytes.as_chunks::<56>();
    ensure!(rest.is_empty(), "the last record is incomplete");
    let timed = |record: &[u8; 56]| {
        let word = |from: usize| u64::from_le_bytes(std::array::from_fn(|i| record[from + i]));
        let mut data: [u8; 32] = std::array::from_fn(|i| record[i]);
        if word(32) == 1 {
            // A frame has no position
            data[..12].fill(0);
        }
        Timed { record: Record { data, last: word(32) }, clock: word(40), last_beat: word(48) }
    };
    Ok(records.iter().map(timed).collect())
}

/// Checks what comes beside the result stream: early records come some clocks apart and before the slots of their frame,
/// the slots laser by laser; and the result stream has exactly the last early record of each of these slots, in order.
fn check_early(found: &[Timed], lasers: usize) -> anyhow::Result<()> {
    let mut early = HashMap::new();
    let mut last_early = None;
    let mut masks = 0;
    // What the result stream has to give: it may start before the last laser's slots come
    let mut frames: VecDeque<VecDeque<[u8; 32]>> = VecDeque::new();
    for timed in found {
        let Record { data, last } = timed.record;
        let word = |i: usize| u64::from_le_bytes(std::array::from_fn(|byte| data[8 * i + byte]));
        match last {
            0 => {
                let due = frames.front_mut().and_then(VecDeque::pop_front);
                ensure!(due == Some(data), "the result stream has\n{data:02x?} in place of\n{due:02x?}");
            }
            1 => {
                let rest = frames.pop_front();
                ensure!(rest.is_some_and(|rest| rest.is_empty()), "the result stream ends too early");
            }
            COUNTS => {}
            MASK => {
                let (laser, slots) = (word(0), word(1));
                ensure!(laser == masks, "the slots of laser {laser} come in place of those of laser {masks}");
                if laser == 0 {
                    frames.push_back(VecDeque::new());
                }
                masks += 1;
                for slot in (0..SLOTS as u64).filter(|slot| slots >> slot & 1 == 1) {
                    let record = early.get(&(laser, slot)).copied();
                    let record = record.with_context(|| format!("laser {laser}: slot {slot} has no early record"))?;
                    frames.back_mut().context("there is no frame")?.push_back(record);
                }
                ensure!((word(2) == 1) == (masks == lasers as u64), "mask_last is wrong at laser {laser}");
                if word(2) == 1 {
                    early.clear();
                    masks = 0;
                }
            }
            _ => {
                ensure!(masks == 0, "an early record comes between the slots");
                let distance = last_early.replace(timed.clock).map_or(u64::MAX, |before| timed.clock - before);
                ensure!(distance >= EARLY_DISTANCE, "{distance} clocks between two early records");
                early.insert((word(3) >> 48, last - EARLY), data);
            }
        }
    }
    ensure!(frames.is_empty() && early.is_empty() && masks == 0, "a frame has no end");
    Ok(())
}

/// The camera and the receiver of the simulation: what they do in each clock.
struct Sides {
    state: u64,
    stalls: Stalls,
    offers: bool,
    blanking: u64,
}

impl Sides {
    /// As `detector_harness.cpp` with seed 1.
    fn new(stalls: Stalls) -> Self {
        Self { state: 3, stalls, offers: false, blanking: 0 }
    }

    fn random_bits(&mut self) -> u64 {
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        self.state >> 8
    }

    fn stalls(&mut self, of_256: u32) -> bool {
        self.random_bits() & 255 < u64::from(of_256)
    }

    /// A clock begins: whether the beat that is next is there, and whether a record is welcome.
    fn begin(&mut self, is_pending: bool) -> (bool, bool) {
        if self.blanking > 0 {
            self.blanking -= 1;
        } else {
            self.offers = is_pending && (self.offers || !self.stalls(self.stalls.input));
        }
        let is_welcome = !self.stalls(self.stalls.output);
        (self.offers, is_welcome)
    }

    /// The beat is taken.
    fn taken(&mut self, is_last: bool) {
        self.offers = false;
        if is_last && self.stalls.blanking > 0 {
            self.blanking = self.random_bits() % u64::from(self.stalls.blanking);
        }
    }
}

/// What comes when: the kind of a record as in [`Record::last`], its clock and that of the last beat before it.
type Event = (u64, u64, u64);

/// When the cycle model says that records come, up to some clock.
fn predicted<const LASERS: usize>(
    generics: &Generics,
    config: &DetectorConfig<LASERS>,
    rows: &[Row],
    stalls: Stalls,
    end: u64,
) -> anyhow::Result<Vec<Event>> {
    let pixels = rows.iter().map(|row| Pixels { rgb: &row.rgb, start: row.start, last: row.last });
    let rows = karst_cycles::rows_of(config, pixels).map_err(|error| anyhow::anyhow!("{error}"))?;
    let mut beats = rows.iter().flat_map(|row| row.beats(generics.pixels_per_clock)).peekable();
    let mut detector = karst_cycles::Detector::new(generics, config);
    // Before the first beat the azimuths are written
    let lasers = config.azimuths.len() as u64;
    (0..lasers).for_each(|_| detector.clock(None, false, false));
    let mut sides = Sides::new(stalls);
    let (mut events, mut last_beat) = (Vec::new(), 0);
    for clock in RESET_CLOCKS + lasers..=end {
        let (offers, is_welcome) = sides.begin(beats.peek().is_some());
        let mut tell = |kind| events.push((kind, clock, last_beat));
        if let Some(record) = detector.record().filter(|_| is_welcome) {
            tell(u64::from(record == karst_cycles::Record::Frame));
        }
        if let Some(early) = detector.early() {
            tell(EARLY + u64::from(early.slot));
        }
        if detector.mask().is_some() {
            tell(MASK);
        }
        let is_taken = offers && detector.is_ready();
        detector.clock(beats.peek().filter(|_| offers), false, is_welcome);
        if is_taken {
            last_beat = clock;
            sides.taken(beats.next().is_some_and(|beat| beat.last));
        }
    }
    Ok(events)
}

/// Holds the cycle model against the clocks of a simulation.
fn compare_clocks<const LASERS: usize>(
    generics: &Generics,
    config: &DetectorConfig<LASERS>,
    rows: &[Row],
    stalls: Stalls,
    found: &[Timed],
) -> anyhow::Result<()> {
    let found: Vec<Event> = found
        .iter()
        .filter(|timed| timed.record.last != COUNTS)
        .map(|timed| (timed.record.last, timed.clock, timed.last_beat))
        .collect();
    let end = found.last().map_or(0, |&(_, clock, _)| clock);
    let predicted = predicted(generics, config, rows, stalls, end)?;
    let differs = predicted.iter().zip(&found).position(|(predicted, found)| predicted != found);
    ensure!(
        differs.is_none() && predicted.len() == found.len(),
        "cycle model: of (kind, clock, last beat) number {differs:?} of {} and {}: predicted {:?}, found {:?}",
        predicted.len(),
        found.len(),
        differs.map(|i| &predicted[i..(i + 4).min(predicted.len())]),
        differs.map(|i| &found[i..(i + 4).min(found.len())])
    );
    Ok(())
}

/// Simulates a stream and compares; gives the latency.
fn compare<const LASERS: usize>(
    executable: &Path,
    generics: &Generics,
    config: &DetectorConfig<LASERS>,
    rows: &[Row],
    stalls: Stalls,
) -> anyhow::Result<Latency> {
    let expected = expected(config, rows)?;
    let frames = expected.iter().filter(|record| record.last == 1).count() as u32;
    let all = simulate(executable, generics.pixels_per_clock as usize, config, rows, stalls, frames)?;
    check_early(&all, config.azimuths.len())?;
    let found: Vec<_> = all.iter().filter(|timed| timed.record.last <= COUNTS).collect();
    for (i, expected) in expected.iter().enumerate() {
        let found = found.get(i).with_context(|| format!("record {i} of {} is missing", expected.last))?;
        ensure!(found.record == *expected, "record {i}:\nexpected {expected:02x?}\nfound    {:02x?}", found.record);
    }
    ensure!(found.len() == expected.len(), "{} records too many", found.len() - expected.len());
    compare_clocks(generics, config, rows, stalls, &all)?;
    let mut latency = Latency::default();
    for timed in &all {
        let clocks = timed.clock - timed.last_beat;
        match timed.record.last {
            MASK => latency.last_mask = latency.last_mask.max(clocks),
            0 => latency.last_spot = latency.last_spot.max(clocks),
            1 => latency.frame = latency.frame.max(clocks),
            _ => {}
        }
    }
    Ok(latency)
}

/// A frame without faults.
pub fn rows_of(rgb: &[u8], width: usize) -> Vec<Row> {
    let row = |(y, rgb): (usize, &[u8])| Row { rgb: rgb.to_vec(), start: y == 0, last: true };
    rgb.chunks_exact(3 * width).enumerate().map(row).collect()
}

/// Limits of a simulated detector that the random frames reach.
pub struct Limits {
    pub lasers: u32,
    pub width: u16,
}

/// Any configuration that the crate takes.
pub fn random_config<const LASERS: usize>(limits: &Limits, random: &mut ChaCha8Rng) -> DetectorConfig<LASERS> {
    loop {
        let lasers = random.random_range(1..=limits.lasers);
        let (width, height) = (8 * random.random_range(1..=limits.width / 8), random.random_range(1..=48_u16));
        let sector = 65536 / lasers;
        let first = random.random_range(0..65536);
        let jitter = (sector / 8) as i32;
        let azimuth = |i, random: &mut ChaCha8Rng| (first + i * sector) as i32 + random.random_range(-jitter..=jitter);
        let azimuths = (0..lasers).map(|i| azimuth(i, random) as u16).collect();
        let usual = random.random_range(0..4) > 0;
        let thresholds = if usual {
            Thresholds::default()
        } else {
            Thresholds {
                green_min: random.random(),
                excess_min: [random.random_range(0..=510), random.random_range(0..=510)],
                saturation_min: random.random(),
                clip_min: random.random(),
                clipped_weight: random.random_range(0..512),
            }
        };
        let config = DetectorConfig {
            width,
            height,
            thresholds,
            centre: [width, height].map(|size| I18F14::from_bits(random.random_range(0..=i32::from(size) << 14))),
            mirror_radius: random.random_range(64..6000),
            inner_radius: random.random_range(0..64),
            cluster_gap: random.random_range(0..6),
            min_pixels: random.random_range(0..6),
            clockwise: random.random(),
            azimuths,
            sector_half_width: random.random_range(sector / 4..=sector) as u16,
            noise: SpotNoise { floor: random.random_range(1..1 << 24), noise: random.random() },
        };
        if SpotDetector::<LASERS, SLOTS>::new(config.clone()).is_ok() {
            return config;
        }
    }
}

/// A picture of one of the kinds that matter.
pub fn random_picture(width: usize, height: usize, random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut rgb = vec![0; 3 * width * height];
    let kind = random.random_range(0..7);
    let base: [u8; 3] = match kind {
        // All green, and light rock
        1 => [20, 200, 30],
        2 => [40, 90, 50],
        _ => [0; 3],
    };
    for pixel in rgb.as_chunks_mut::<3>().0 {
        *pixel = match kind {
            // Dense: any colour
            3 => random.random(),
            // A green hit in every other pixel
            4 if random.random() => [10, random.random_range(100..=255), 20],
            _ => base.map(|channel| channel.saturating_add(random.random_range(0..8))),
        };
    }
    if kind != 0 {
        // Spots with a saturated core, across any border
        for _ in 0..random.random_range(0..12) {
            let (cx, cy) = (random.random_range(0..width) as i32, random.random_range(0..height) as i32);
            let radius = random.random_range(1..7_i32);
            for y in (cy - radius).max(0)..(cy + radius).min(height as i32) {
                for x in (cx - radius).max(0)..(cx + radius).min(width as i32) {
                    let at = 3 * (y as usize * width + x as usize);
                    let r2 = (x - cx).pow(2) + (y - cy).pow(2);
                    let colour: [u8; 3] = match r2 {
                        0..4 => [255; 3],
                        4..9 => [60, 255, 90],
                        _ if r2 <= radius * radius => [25, random.random_range(120..250), 40],
                        _ => continue,
                    };
                    rgb[at..at + 3].copy_from_slice(&colour);
                }
            }
        }
    }
    rgb
}

/// Now and then spoils a frame: rows too short or too long, missing or too many, cut by the next start.
pub fn spoil(rows: &mut Vec<Row>, width: usize, random: &mut ChaCha8Rng) {
    // Whole beats of every simulation
    let pixels = |random: &mut ChaCha8Rng, most: usize| 8 * random.random_range(1..=most.max(1));
    match random.random_range(0..8) {
        0 if width > 8 => {
            let (row, length) = (random.random_range(0..rows.len()), pixels(random, width / 8 - 1));
            rows[row].rgb.truncate(3 * length);
        }
        1 => {
            let (row, more) = (random.random_range(0..rows.len()), pixels(random, 10));
            rows[row].rgb.extend((0..3 * more).map(|_| random.random::<u8>()));
        }
        2 => rows.truncate(random.random_range(1..=rows.len())),
        3 => {
            for _ in 0..random.random_range(1..4) {
                rows.push(Row { rgb: vec![0; 3 * width], start: false, last: true });
            }
        }
        4 if width > 8 => {
            rows.truncate(random.random_range(1..=rows.len()));
            let length = pixels(random, width / 8 - 1);
            if let Some(row) = rows.last_mut() {
                row.rgb.truncate(3 * length);
                row.last = false;
            }
        }
        _ => {}
    }
}

/// Random small frames of up to 16 lasers and 320 px through each simulation: `executables` in the order 1, 2, 4, 8 pixels
/// per clock. Gives the number of frames.
pub fn compare_random(executables: &[impl AsRef<Path>], frames: u64) -> anyhow::Result<u64> {
    let simulations: Vec<_> = executables.iter().enumerate().map(|(i, path)| (small(1 << i), path.as_ref())).collect();
    random_frames::<16>(&simulations, &Limits { lasers: 16, width: 320 }, frames)
}

/// Random frames of up to 720 lasers and 2048 px through the simulation of the largest detector, 4 pixels per clock. Gives
/// the number of frames.
pub fn compare_large(executable: &Path, frames: u64) -> anyhow::Result<u64> {
    random_frames::<720>(&[(LARGE, executable)], &Limits { lasers: 720, width: 2048 }, frames)
}

/// Random frames, some per configuration, through simulations with their generics.
fn random_frames<const LASERS: usize>(
    simulations: &[(Generics, &Path)],
    limits: &Limits,
    frames: u64,
) -> anyhow::Result<u64> {
    const FRAMES_PER_CONFIG: u64 = 3;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for run in 0..frames.div_ceil(FRAMES_PER_CONFIG) {
        let config = random_config::<LASERS>(limits, &mut random);
        let (width, height) = (usize::from(config.width), usize::from(config.height));
        let mut rows = Vec::new();
        // What comes before the first start of frame belongs to none
        if random.random() {
            rows.push(Row { rgb: vec![200; 3 * width], start: false, last: true });
        }
        for i in 1..=FRAMES_PER_CONFIG {
            let mut frame = rows_of(&random_picture(width, height, &mut random), width);
            // The last one ends: what comes after a cut one tells that it is cut
            if i < FRAMES_PER_CONFIG {
                spoil(&mut frame, width, &mut random);
            }
            rows.append(&mut frame);
        }
        let stalls = match run % 3 {
            0 => NO_STALLS,
            1 => Stalls { input: 64, output: 128, blanking: 40 },
            _ => Stalls { input: 8, output: 250, blanking: 0 },
        };
        for (generics, executable) in simulations {
            compare(executable, generics, &config, &rows, stalls)
                .with_context(|| format!("{generics:?}, run {run}: {config:?}"))?;
        }
    }
    Ok(frames.div_ceil(FRAMES_PER_CONFIG) * FRAMES_PER_CONFIG)
}

/// Rendered frames of the default rig, both cameras, through each simulation. Gives the latencies without stalls.
pub fn compare_rendered(executables: &[impl AsRef<Path>], frames: usize) -> anyhow::Result<Vec<Latency>> {
    let rig = Rig::default();
    let cameras = rig.water_cameras().context("the default rig has no water cameras")?;
    let fixed = rig.to_fixed::<16>(&cameras).context("the default rig is not for fixed point")?;
    let renderer = Renderer::new(&rig).context("the default rig can not be rendered")?;
    let mut latencies = vec![Latency::default(); executables.len()];
    // Spread over the kinds of scenes; two images each
    let scenes = evaluation_scenes();
    let pairs = frames.div_ceil(2);
    for pair in 0..pairs {
        let scene = &scenes[pair * scenes.len() / pairs % scenes.len()];
        let frame = renderer.render(&scene.scene, scene.seed).context("cannot render")?;
        for (camera, image) in frame.images.iter().enumerate().take(frames - 2 * pair) {
            let config = &fixed.detectors[camera];
            let rows = rows_of(image.as_raw(), image.width() as usize);
            for (i, executable) in executables.iter().enumerate() {
                let context = || format!("{} pixels per clock, {} camera {camera}", 1 << i, scene.name);
                let found =
                    compare(executable.as_ref(), &small(1 << i), config, &rows, NO_STALLS).with_context(context)?;
                let latency = &mut latencies[i];
                latency.last_mask = latency.last_mask.max(found.last_mask);
                latency.last_spot = latency.last_spot.max(found.last_spot);
                latency.frame = latency.frame.max(found.frame);
                if pair == 0 {
                    let stalls = Stalls { input: 32, output: 200, blanking: 100 };
                    compare(executable.as_ref(), &small(1 << i), config, &rows, stalls).with_context(context)?;
                }
            }
        }
    }
    Ok(latencies)
}

/// A frame with one spot per laser, 720 of them, through the simulation of the largest detector. Gives the latency.
pub fn compare_720_lasers(executable: &Path) -> anyhow::Result<Latency> {
    const LASERS: usize = 720;
    let (width, height, radius) = (1024_u16, 768_u16, 330.0_f64);
    let centre = [512.0, 384.0];
    let azimuth = |laser: usize| (laser * 65536 / LASERS) as u16;
    let config: DetectorConfig<LASERS> = DetectorConfig {
        width,
        height,
        thresholds: Thresholds::default(),
        centre: centre.map(I18F14::from_num),
        mirror_radius: 360 * 16,
        inner_radius: 16 * 16,
        cluster_gap: 3,
        min_pixels: 1,
        clockwise: false,
        azimuths: (0..LASERS).map(azimuth).collect(),
        sector_half_width: 45,
        noise: SpotNoise { floor: 2416, noise: 83443 },
    };
    let mut rgb = vec![0; 3 * usize::from(width) * usize::from(height)];
    for laser in 0..LASERS {
        let angle = laser as f64 / LASERS as f64 * std::f64::consts::TAU;
        let [x, y] = [angle.cos(), angle.sin()].map(|direction| radius * direction);
        let at = 3 * ((centre[1] + y).round() as usize * usize::from(width) + (centre[0] + x).round() as usize);
        rgb[at..at + 3].copy_from_slice(&[20, 200, 30]);
    }
    let rows = rows_of(&rgb, width.into());
    let found = expected(&config, &rows)?.iter().filter(|record| record.last == 0).count();
    ensure!(found == LASERS, "{found} spots instead of {LASERS}");
    compare(executable, &LARGE, &config, &rows, NO_STALLS)
}
