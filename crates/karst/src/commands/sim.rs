//! `karst sim`: the sensor as it is built, firmware and gateware, clock by clock.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use image::RgbImage;
use karst::input::FramePairs;
use karst::instrument::{Arithmetic, Instrument, method_name};
use karst::output::folder;
use karst::output::terminal::error_names;
use karst::result::Section;
use karst::sensor::soc::Soc;
use karst::sensor::{FrameClocks, FrameCounts, MOST_LASERS, Pace, SimulatedSoc, as_sent};
use karst_link::{LinkCounters, Message, Settings, Status};
use karst_scene::{Renderer, demo_scene};
use serde::Serialize;

use super::checkout::Simulation;
use super::configure::Mode;
use super::line::{Connection, fixed, mode_name};
use super::session::{Session, stop_on_ctrl_c};
use super::{Method, count, files, load_rig, print, print_json, progress, set_up, spinner};

/// A look at the line takes this much of the sensor's time.
const LOOK: Duration = Duration::from_micros(200);
/// A frame is waited for this much of the sensor's time after the one before.
const PATIENCE: Duration = Duration::from_millis(200);

#[derive(Debug, Args)]
#[command(
    override_usage = "karst sim [OPTIONS] [CAMERA1 CAMERA2]",
    after_help = "Examples:
  karst sim
  karst sim --mode software --json
  karst sim --rig survey/rig.toml survey/camera1 survey/camera2 --out result
  karst sim --frames 5 --full-rate
  karst sim --dump-waves start.vcd --waves-clocks 3000

The firmware and the gateware are the ones that would go to a board. In a checkout of the project the tools are fetched and
both are built when they are missing or older than their sources: a few minutes, on Debian.
All points are compared with those of karst reconstruct: exit status 1 if any bit differs."
)]
pub struct Sim {
    /// Picture or folder of numbered pictures of camera 1, PNG or JPEG; without pictures, a rendered gallery
    #[arg(value_name = "CAMERA1", requires = "camera2")]
    camera1: Option<PathBuf>,
    /// Picture or folder of numbered pictures of camera 2
    #[arg(value_name = "CAMERA2")]
    camera2: Option<PathBuf>,
    /// Rig file; the default rig without it
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// How many pictures of the rendered gallery the cameras take
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "camera1",
        value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// Where the points are computed
    #[arg(long, value_enum, default_value = "accelerated")]
    mode: Mode,
    /// How the estimates become a point
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// The cameras do not wait until the sensor has sent a frame: one pixel per clock
    #[arg(long)]
    full_rate: bool,
    /// Idle clocks after each row of a picture
    #[arg(long, value_name = "CLOCKS", default_value_t = 0, requires = "full_rate")]
    blanking: u32,
    /// Folder for the points (PLY, CSV, MCAP)
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// File for the waves of all signals (VCD), as GTKWave and Surfer show them: for this the SoC is built once more
    #[arg(long, value_name = "FILE")]
    dump_waves: Option<PathBuf>,
    /// First clock of the waves, counted from the first reset
    #[arg(long, value_name = "CLOCK", default_value_t = 0, requires = "dump_waves")]
    waves_from: u64,
    /// How many clocks the waves show: about 10 kB each
    #[arg(long, value_name = "CLOCKS", default_value_t = 5000, requires = "dump_waves")]
    waves_clocks: u64,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Output {
    mode: &'static str,
    method: &'static str,
    /// One per frame that the sensor has sent.
    frames: Vec<FrameOutput>,
    /// How many frames came.
    counts: FrameCounts,
    /// Every point of every frame is bit for bit that of `karst reconstruct`.
    equal: bool,
    /// The firmware's counters.
    sensor: Status,
    /// What this end of the line has received.
    link: LinkCounters,
    /// What the firmware said.
    log: Vec<String>,
    /// Clocks of the SoC.
    clocks: u64,
    /// Clocks simulated per second.
    clocks_per_second: f64,
}

#[derive(Serialize)]
struct FrameOutput {
    #[serde(flatten)]
    section: Section,
    /// All messages of the frame came.
    complete: bool,
    /// Every bit is as it has to be.
    equal: bool,
    /// How long it took.
    clocks: Option<FrameClocks>,
}

/// What has to come of the pictures that have been taken, oldest first.
type Expected = Rc<RefCell<VecDeque<Section>>>;

/// The pictures that the cameras take.
type Pictures = Box<dyn Iterator<Item = io::Result<[RgbImage; 2]>>>;

impl Sim {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        if let Some(out) = &self.out {
            folder::prepare(out)?;
        }
        let rig = load_rig(self.rig.as_deref())?;
        let instrument = set_up(rig.clone(), self.rig.as_deref())?;
        let fixed_rig = fixed::<MOST_LASERS>(&rig)?;
        let (total, pictures) = self.pictures(&instrument)?;
        let Simulation { soc, firmware } = Simulation::build(self.dump_waves.is_some())?;
        let stop = stop_on_ctrl_c()?;

        let image = std::fs::read(&firmware).with_context(|| format!("cannot read {}", firmware.display()))?;
        let pace = if self.full_rate { Pace::FullRate { blanking: self.blanking } } else { Pace::Patient };
        let expected = Expected::default();
        let pictures = self.expecting(instrument, pictures, expected.clone());
        let mut soc = Soc::new(&soc, &image)?;
        if let Some(file) = &self.dump_waves {
            soc.dump_waves(file, self.waves_from, self.waves_clocks)?;
        }
        let sensor = SimulatedSoc::new(soc, pace, pictures);

        let bar = spinner("the firmware starts");
        let mut connection = Connection::simulated(&sensor, "simulated SoC".to_owned())?;
        bar.finish_and_clear();
        let most = connection.client.hello().lasers;
        if rig.lasers.len() > usize::from(most) {
            bail!("the rig has {}, the simulated SoC is built for up to {most}", count(rig.lasers.len(), "laser"));
        }
        let settings =
            Settings { mode: self.mode.into(), method: self.method.into(), lasers: true, ..Settings::default() };
        connection.client.set_settings(&settings)?;
        let bar = progress(0, "sending the calibration");
        let sent = connection.client.set_calibration(&fixed_rig, |there, parts| {
            bar.set_length(parts as u64);
            bar.set_position(there as u64);
        });
        bar.finish_and_clear();
        sent?;

        let mut session = Session::new(&connection, &settings, self.json, false);
        let mut run = Run { sensor, connection, expected, frames: Vec::new(), log: Vec::new(), json: self.json };
        let watched = run.watch(&mut session, total, &stop);
        session.end(&run.connection.client.counters())?;
        let sections: Vec<Section> = run.frames.iter().map(|frame| frame.section.clone()).collect();
        if let Some(out) = self.out.as_ref().filter(|_| !sections.is_empty()) {
            files::write_points(out, &sections)?;
        }
        watched?;
        let output = run.finish(&settings, session.counts())?;
        if self.json {
            print_json(&output)?;
        } else {
            output.print()?;
            if let Some(out) = &self.out {
                print(format_args!("points in {}", out.display()))?;
            }
            if let Some(file) = &self.dump_waves {
                print(format_args!("waves in {}", file.display()))?;
            }
        }
        if !output.equal {
            bail!("the points are not those of karst reconstruct");
        }
        Ok(ExitCode::SUCCESS)
    }

    /// How many pairs of pictures there are, and they.
    fn pictures(&self, instrument: &Instrument) -> anyhow::Result<(u32, Pictures)> {
        let rig = instrument.rig();
        if let (Some(camera1), Some(camera2)) = (&self.camera1, &self.camera2) {
            let sizes = rig.cameras.each_ref().map(|camera| camera.image_size_px);
            let pairs = FramePairs::open(camera1, camera2, sizes)?;
            let total = pairs.len() as u32;
            return Ok((total, Box::new(pairs.map(|pair| pair.map(|pair| pair.images).map_err(io::Error::other)))));
        }
        let bar = spinner("rendering what the cameras see");
        let scene = demo_scene();
        let images = Renderer::new(rig)?.render(&scene.scene, scene.seed)?.images;
        bar.finish_and_clear();
        Ok((self.frames, Box::new(std::iter::repeat_n(images, self.frames as usize).map(Ok))))
    }

    /// The pictures, measured here as well when a camera takes them.
    fn expecting(&self, mut instrument: Instrument, pictures: Pictures, expected: Expected) -> Pictures {
        let method = self.method.into();
        Box::new((1_u32..).zip(pictures).map(move |(number, images)| {
            let images = images?;
            let section = instrument.section(&number.to_string(), &images, method, Arithmetic::Fixed);
            expected.borrow_mut().push_back(as_sent(section.map_err(io::Error::other)?));
            Ok(images)
        }))
    }
}

/// A simulation that goes on.
struct Run {
    sensor: SimulatedSoc,
    connection: Connection,
    expected: Expected,
    frames: Vec<FrameOutput>,
    log: Vec<String>,
    /// Nothing is shown before the end.
    json: bool,
}

impl Run {
    /// Until the frame of the last picture has come, nobody reads any more, or it is told to stop.
    fn watch(&mut self, session: &mut Session, total: u32, stop: &AtomicBool) -> anyhow::Result<()> {
        let clock = self.sensor.clock();
        let mut framed = clock.now();
        while session.is_read() && !stop.load(Ordering::Relaxed) {
            let message = self.connection.client.receive(LOOK).with_context(|| self.connection.place.clone())?;
            if let Some(Message::Log(log)) = &message {
                self.log.push(log.text.to_string());
            }
            let link = self.connection.client.counters();
            for frame in message.map(|message| session.take(&message)).unwrap_or_default() {
                framed = clock.now();
                let equal = self.is_right(&frame.section);
                let clocks = self.sensor.frames().last().copied().filter(|clocks| clocks.frame == frame.number);
                let output = FrameOutput { section: frame.section.clone(), complete: frame.complete, equal, clocks };
                self.frames.push(output);
                let done = frame.number >= total;
                if !self.json {
                    session.show(frame, &link)?;
                }
                if done {
                    return Ok(());
                }
            }
            if clock.now().saturating_sub(framed) > PATIENCE {
                bail!("no frame for {PATIENCE:?} of the sensor's time: {:?}", self.connection.client.status()?);
            }
            session.note(self.speed_line());
            session.redraw(&link)?;
        }
        Ok(())
    }

    /// Whether a frame is that of its picture. Pictures before it have been dropped.
    fn is_right(&self, section: &Section) -> bool {
        let mut expected = self.expected.borrow_mut();
        while let Some(first) = expected.pop_front() {
            if first.frame == section.frame {
                return first == *section;
            }
        }
        false
    }

    fn clocks_per_second(&self) -> f64 {
        self.sensor.soc().state().clock as f64 / self.sensor.simulating().as_secs_f64()
    }

    fn speed_line(&self) -> String {
        speed_line(self.sensor.soc().state().clock, self.clocks_per_second())
    }

    fn finish(mut self, settings: &Settings, counts: FrameCounts) -> anyhow::Result<Output> {
        let sensor = self.connection.client.status()?;
        Ok(Output {
            mode: mode_name(settings.mode),
            method: method_name(settings.method),
            equal: self.frames.iter().all(|frame| frame.complete && frame.equal),
            counts,
            sensor,
            link: self.connection.client.counters(),
            clocks: self.sensor.soc().state().clock,
            clocks_per_second: self.clocks_per_second(),
            frames: self.frames,
            log: self.log,
        })
    }
}

fn speed_line(clocks: u64, per_second: f64) -> String {
    format!("simulated: {:.2} million clocks, {:.2} million per second", clocks as f64 / 1e6, per_second / 1e6)
}

impl Output {
    fn print(&self) -> anyhow::Result<()> {
        print("clocks of the SoC, counted from the last pixel but for the pixels")?;
        print("frame     pixels    results  first byte   last byte  points of karst reconstruct")?;
        for FrameOutput { section, equal, complete, clocks } in &self.frames {
            let cells = clocks.map_or_else(
                || format!("{:>10} {:>10} {:>11} {:>11}", "-", "-", "-", "-"),
                |c| format!("{:>10} {:>10} {:>11} {:>11}", c.pixels, c.to_results, c.to_first_byte, c.to_last_byte),
            );
            let verdict = if *equal && *complete { "the same bits" } else { "DIFFERENT" };
            print(format_args!("{:>5} {cells}  {verdict}", section.frame))?;
        }
        let Status { frames, points, dropped_frames, .. } = self.sensor;
        let errors = error_names(&self.sensor.errors);
        let errors = if errors.is_empty() { "no errors".to_owned() } else { format!("errors: {}", errors.join(", ")) };
        let [frames, points] = [(frames, "frame"), (points, "point")].map(|(n, noun)| count(n as usize, noun));
        print(format_args!("firmware: {frames}, {points}, {dropped_frames} dropped, {errors}"))?;
        print(speed_line(self.clocks, self.clocks_per_second))
    }
}
