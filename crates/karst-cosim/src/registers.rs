//! Random traffic for the register block, and what its model makes of it. Format: `hw-ip/sim/tb_registers.vhd`.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::Context;
use karst_regs::map;
use karst_regs::model::{Event, RESULT_WORDS, Registers};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Spots per laser of the simulated register block.
const SLOTS: usize = 4;

/// Registers without the free-running counter of clocks, which the model has not.
const CONTROL_REGISTERS: [u32; 14] = [
    map::MAGIC,
    map::VERSION,
    map::MAP_HASH,
    map::CAPACITY,
    map::CONTROL,
    map::COMMAND,
    map::STATUS,
    map::INTERRUPT_STATUS,
    map::INTERRUPT_ENABLE,
    map::FAULT,
    map::FRAMES,
    map::MISSED,
    map::UNPAIRED,
    map::SKIPPED,
];

const CAMERA_REGISTERS: [fn(u32) -> u32; 5] =
    [map::camera_short_rows, map::camera_long_rows, map::camera_truncated, map::camera_stray_rows, map::camera_stalled];

struct Traffic<W> {
    random: ChaCha8Rng,
    model: Registers,
    lasers: usize,
    /// Frames come, not only accesses.
    frames: bool,
    idle: bool,
    out: W,
}

/// Writes `count` random actions and what has to follow from them: accesses and frames, or accesses alone.
pub fn write_vectors(count: u64, lasers: usize, frames: bool, file: &Path) -> anyhow::Result<()> {
    let create = || format!("cannot write {}", file.display());
    let mut traffic = Traffic {
        random: ChaCha8Rng::seed_from_u64(1),
        model: Registers::new(lasers, SLOTS),
        lasers,
        frames,
        idle: true,
        out: BufWriter::new(File::create(file).with_context(create)?),
    };
    for _ in 0..count {
        traffic.action().with_context(create)?;
        writeln!(traffic.out, "T {}", u8::from(traffic.model.interrupt())).with_context(create)?;
        writeln!(traffic.out, "N {}", u8::from(traffic.model.enabled())).with_context(create)?;
    }
    traffic.out.flush().with_context(create)
}

impl<W: Write> Traffic<W> {
    fn action(&mut self) -> std::io::Result<()> {
        match self.random.random_range(0..100) {
            0..30 => self.read(),
            30..50 => self.write_settings(),
            50..57 => self.write_register(),
            57..63 => self.clear(),
            63..98 if !self.frames => self.read(),
            63..68 => self.write_and_read(),
            68..75 => self.event(),
            75..83 => self.result(),
            83..88 => self.spot(),
            88..92 => {
                self.model.finish_frame();
                writeln!(self.out, "D")
            }
            92..95 => {
                let bits = self.random.random_range(0..4_u8);
                self.model.set_in_frame(0, bits & 1 != 0);
                self.model.set_in_frame(1, bits & 2 != 0);
                writeln!(self.out, "F {bits}")
            }
            95..98 => {
                self.idle = self.random.random();
                writeln!(self.out, "I {}", u8::from(self.idle))?;
                self.commit_if_idle()
            }
            _ => {
                let commands = [map::COMMAND_COMMIT, map::COMMAND_ACKNOWLEDGE, map::COMMAND_RESET];
                let command = commands[self.random.random_range(0..3)].mask() | self.random.random_range(0..2);
                self.write(map::COMMAND, command)
            }
        }
    }

    /// An address of any kind: a register, a memory, or nothing.
    fn address(&mut self) -> u32 {
        let records = 4 + self.lasers as u32 + 1;
        let spots = (self.lasers * SLOTS) as u32 + 1;
        match self.random.random_range(0..10) {
            0..4 => self.register(),
            4..6 => self.settings_address(),
            6..8 => map::RESULT_FRAME_PAIR + 4 * self.random.random_range(0..records * RESULT_WORDS as u32),
            8 => {
                let base = map::spots_camera_spot_column(self.random.random_range(0..2), 0);
                base + 4 * self.random.random_range(0..spots * 8)
            }
            _ => 0x80 + 4 * self.random.random_range(0..0xFFE0),
        }
    }

    fn register(&mut self) -> u32 {
        let index = self.random.random_range(0..CONTROL_REGISTERS.len() + 2 * CAMERA_REGISTERS.len());
        let camera = index.wrapping_sub(CONTROL_REGISTERS.len());
        CONTROL_REGISTERS.get(index).copied().unwrap_or_else(|| CAMERA_REGISTERS[camera / 2](camera as u32 % 2))
    }

    /// A few words and those of the detectors are written again and again, others now and then, some beyond the memory.
    fn settings_address(&mut self) -> u32 {
        let word = self.random.random_range(0..16);
        match self.random.random_range(0..6) {
            0 | 1 => map::SETTINGS_INSTRUMENT_LASERS + 4 * word,
            2 => map::settings_camera_detector_size(0) + 4 * word,
            3 => map::settings_camera_detector_size(1) + 4 * word,
            4 => map::settings_laser_azimuth(self.random.random_range(0..self.lasers as u32)),
            _ => map::SETTINGS_INSTRUMENT_LASERS + 4 * self.random.random_range(0..256 + 64 * self.lasers as u32 + 8),
        }
    }

    fn read(&mut self) -> std::io::Result<()> {
        let address = self.address();
        writeln!(self.out, "R {address:05X} {:08X}", self.model.read(address))
    }

    fn write(&mut self, address: u32, value: u32) -> std::io::Result<()> {
        writeln!(self.out, "W {address:05X} {value:08X} F")?;
        self.model.write(address, value);
        self.commit_if_idle()
    }

    fn write_register(&mut self) -> std::io::Result<()> {
        let mut address = self.address();
        if address == map::COMMAND {
            address = map::CONTROL;
        }
        let value = self.random.random();
        self.write(address, value)
    }

    /// Clears all faults and events, and enables some.
    fn clear(&mut self) -> std::io::Result<()> {
        let enabled = self.random.random();
        self.write(map::FAULT, u32::MAX)?;
        self.write(map::INTERRUPT_STATUS, u32::MAX)?;
        self.write(map::INTERRUPT_ENABLE, enabled)
    }

    fn write_settings(&mut self) -> std::io::Result<()> {
        let address = self.settings_address();
        let (value, strobe): (u32, u32) = (self.random.random(), self.random.random_range(0..16));
        writeln!(self.out, "W {address:05X} {value:08X} {strobe:X}")?;
        let mask = (0..4).filter(|byte| strobe >> byte & 1 != 0).map(|byte| 0xFF << (8 * byte)).sum::<u32>();
        self.model.write(address, self.model.read(address) & !mask | value & mask);
        Ok(())
    }

    /// Writes and reads at the same time, of registers that have nothing to do with each other.
    fn write_and_read(&mut self) -> std::io::Result<()> {
        let (written, value) = (self.settings_address(), self.random.random());
        let records = 4 + self.lasers as u32;
        let read = map::RESULT_FRAME_PAIR + 4 * self.random.random_range(0..records * RESULT_WORDS as u32);
        writeln!(self.out, "X {written:05X} {value:08X} {read:05X} {:08X}", self.model.read(read))?;
        self.model.write(written, value);
        Ok(())
    }

    fn event(&mut self) -> std::io::Result<()> {
        let bits: u16 = self.random.random_range(1..1 << 14) & self.random.random::<u16>();
        // So many that counters stop at their highest value, now and then
        let clocks = match self.random.random_range(0..160) {
            0 => 40_000,
            1..80 => 1,
            _ => self.random.random_range(1..100),
        };
        for _ in 0..clocks {
            self.raise(bits);
        }
        writeln!(self.out, "E {bits:04X} {clocks:04X}")
    }

    fn raise(&mut self, bits: u16) {
        let per_camera =
            [Event::ShortRow, Event::LongRow, Event::Truncated, Event::StrayRow, Event::Overflow, Event::Stalled];
        for (i, event) in per_camera.iter().enumerate() {
            for camera in 0..2 {
                if bits >> (2 * i + camera) & 1 != 0 {
                    self.model.event(event(camera));
                }
            }
        }
        for (bit, event) in [(12, Event::Unpaired), (13, Event::Skipped)] {
            if bits >> bit & 1 != 0 {
                self.model.event(event);
            }
        }
    }

    fn result(&mut self) -> std::io::Result<()> {
        let index = self.random.random_range(0..4 + self.lasers);
        let record: [u32; RESULT_WORDS] = std::array::from_fn(|_| self.random.random());
        self.model.write_result(index, record);
        writeln!(self.out, "P {index:03X} {}", hexadecimal(&record))
    }

    fn spot(&mut self) -> std::io::Result<()> {
        let (camera, index) = (self.random.random_range(0..2), self.random.random_range(0..self.lasers * SLOTS));
        let record = std::array::from_fn(|_| self.random.random());
        self.model.write_spot(camera, index, record);
        writeln!(self.out, "S {camera} {index:03X} {}", hexadecimal(&record))
    }

    /// A commit takes effect as soon as no frame is under way: then the blocks have got the settings.
    fn commit_if_idle(&mut self) -> std::io::Result<()> {
        if !self.idle {
            return Ok(());
        }
        let commits = self.model.commits().wrapping_add(1);
        let Some(settings) = self.model.finish_commit() else { return Ok(()) };
        writeln!(self.out, "C {commits:08X}")?;
        for (word, value) in settings.iter().enumerate() {
            if word < 16 || self.random.random_range(0..16) == 0 {
                writeln!(self.out, "L {word:04X} {value:08X}")?;
            }
        }
        let read = |address: u32| settings[((address - map::SETTINGS_INSTRUMENT_LASERS) / 4) as usize];
        for camera in 0..2 {
            writeln!(self.out, "K {camera} {}", detector_bits(read, camera))?;
            let azimuth = [map::SETTINGS_LASER_AZIMUTH_CAMERA_1, map::SETTINGS_LASER_AZIMUTH_CAMERA_2][camera as usize];
            for laser in 0..self.lasers as u32 {
                writeln!(
                    self.out,
                    "A {camera} {laser:X} {:04X}",
                    azimuth.get(read(map::settings_laser_azimuth(laser)))
                )?;
            }
        }
        Ok(())
    }
}

/// The outputs of `detector_settings.vhd` for images of up to 1024 x 1024 px and 16 lasers, in its order, the first one
/// highest: in hexadecimal.
fn detector_bits(read: impl Fn(u32) -> u32, camera: u32) -> String {
    let size = read(map::settings_camera_detector_size(camera));
    let green_min = read(map::settings_camera_detector_green_min(camera));
    let excess_min = read(map::settings_camera_detector_excess_min(camera));
    let weight = read(map::settings_camera_detector_weight(camera));
    let centre = read(map::settings_camera_detector_centre(camera));
    let radius = read(map::settings_camera_detector_radius(camera));
    let cluster = read(map::settings_camera_detector_cluster(camera));
    let sector = read(map::settings_camera_detector_sector(camera));
    let lasers = read(map::SETTINGS_INSTRUMENT_LASERS);
    let outputs = [
        (map::SETTINGS_CAMERA_DETECTOR_SIZE_WIDTH.get(size), 11),
        (map::SETTINGS_CAMERA_DETECTOR_SIZE_HEIGHT.get(size), 11),
        (map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_FIRST.get(green_min), 8),
        (map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SECOND.get(green_min), 8),
        (map::SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_FIRST.get(excess_min), 9),
        (map::SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_SECOND.get(excess_min), 9),
        (map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SATURATION.get(green_min), 8),
        (map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_CLIP.get(green_min), 8),
        (map::SETTINGS_CAMERA_DETECTOR_WEIGHT_CLIPPED_WEIGHT.get(weight), 9),
        (map::SETTINGS_CAMERA_DETECTOR_CENTRE_X.get(centre), 15),
        (map::SETTINGS_CAMERA_DETECTOR_CENTRE_Y.get(centre), 15),
        (map::SETTINGS_CAMERA_DETECTOR_RADIUS_MIRROR.get(radius), 16),
        (map::SETTINGS_CAMERA_DETECTOR_RADIUS_INNER.get(radius), 16),
        (map::SETTINGS_CAMERA_DETECTOR_CLUSTER_GAP.get(cluster), 11),
        (map::SETTINGS_CAMERA_DETECTOR_CLUSTER_MIN_PIXELS.get(cluster), 16),
        (map::SETTINGS_CAMERA_DETECTOR_WEIGHT_CLOCKWISE.get(weight), 1),
        (map::SETTINGS_INSTRUMENT_LASERS_COUNT.get(lasers), 5),
        (map::SETTINGS_CAMERA_DETECTOR_SECTOR_FIRST_EDGE.get(sector), 16),
        (map::SETTINGS_CAMERA_DETECTOR_SECTOR_HALF_WIDTH.get(sector), 16),
        (read(map::settings_camera_detector_noise_floor(camera)), 32),
        (read(map::settings_camera_detector_noise(camera)), 32),
    ];
    let bits: Vec<u8> =
        outputs.iter().flat_map(|&(value, width)| (0..width).rev().map(move |bit| (value >> bit & 1) as u8)).collect();
    bits.chunks(4).map(|digit| format!("{:X}", digit.iter().fold(0, |sum, bit| 2 * sum + bit))).collect()
}

/// The first word in the low bits.
fn hexadecimal(record: &[u32]) -> String {
    record.iter().rev().map(|word| format!("{word:08X}")).collect()
}
