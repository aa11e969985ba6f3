//! `karst monitor`: what a sensor measures, live.

use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Args;
use clap::error::ErrorKind;
use console::Term;
use image::RgbImage;
use karst::input::FramePairs;
use karst::instrument::method_name;
use karst::output::folder;
use karst::output::terminal::{View, counts_line, error_names, frame_line};
use karst::result::Section;
use karst::sensor::{Assembler, FrameCounts, MOST_LASERS, SensorFrame, SimulatedSensor};
use karst_link::{LinkCounters, Message, Settings, Status};
use karst_rig::Rig;
use karst_scene::{Renderer, demo_scene};
use serde::Serialize;

use super::line::{BAUD, Connection, fixed, mode_name};
use super::{complain, count, files, load_rig, print, print_to_reader, spinner};

/// A sensor sends its status every second: after this long without a message it is gone.
const SILENCE: Duration = Duration::from_secs(5);
/// With `--frames`, frames are waited for this long, and two trigger periods.
const FRAME_PATIENCE: Duration = Duration::from_secs(10);
/// The page is drawn at most this often.
const REDRAW: Duration = Duration::from_millis(50);
/// Events on the page.
const EVENTS: usize = 4;

#[derive(Debug, Args)]
#[command(
    override_usage = "karst monitor [OPTIONS] <PORT>\n       karst monitor [OPTIONS] --simulated [CAMERA1 CAMERA2]",
    after_help = "Examples:
  karst monitor --simulated
  karst monitor --simulated --rig survey/rig.toml survey/camera1 survey/camera2 --out result
  karst monitor --simulated --frames 3 --json
  karst monitor /dev/ttyUSB0 --out survey

The simulated sensor is the sensor's own program on a software model of its hardware; its cameras see a rendered gallery
over and over, or the pictures once. A real sensor needs its calibration first: karst configure.
Ctrl-C ends it; --out is written then. Without a terminal there is one line per frame."
)]
pub struct Monitor {
    /// Serial port of the sensor, such as /dev/ttyUSB0 or COM3; with --simulated the pictures of camera 1
    #[arg(value_name = "PORT|CAMERA1", required_unless_present = "simulated")]
    port: Option<PathBuf>,
    /// With --simulated: the pictures of camera 2
    #[arg(value_name = "CAMERA2", requires = "simulated")]
    camera2: Option<PathBuf>,
    /// Bits per second on the serial line
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
    /// A simulated sensor in this program: no hardware is needed
    #[arg(long)]
    simulated: bool,
    /// Rig file of the simulated sensor; the default rig without it
    #[arg(long, value_name = "FILE", requires = "simulated")]
    rig: Option<PathBuf>,
    /// End after this many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Folder for the points (PLY, CSV, MCAP)
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON object per frame, each in a line
    #[arg(long)]
    json: bool,
}

/// A line of `--json`: the section, and how well it came over.
#[derive(Serialize)]
struct FrameOutput<'a> {
    #[serde(flatten)]
    section: &'a Section,
    /// All messages of the frame came.
    complete: bool,
    /// Messages of the frame that did not come.
    lost_messages: u32,
    /// Frames so far.
    frames: FrameCounts,
    /// What this end of the line has received so far.
    link: LinkCounters,
    /// The sensor's last status.
    sensor: Option<Status>,
}

impl Monitor {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        if let Some(out) = &self.out {
            folder::prepare(out)?;
        }
        let Source { mut connection, settings, pictures } = self.connect()?;
        let stop = stop_on_ctrl_c()?;
        let mut session = Session::new(&connection, &settings, self.json, self.out.is_some());
        let watched = session.watch(&mut connection, self.frames.or(pictures), &settings, &stop);
        // What has been measured is kept, whatever ended it
        session.end(&connection.client.counters())?;
        if let Some(out) = self.out.as_ref().filter(|_| !session.sections.is_empty()) {
            files::write_points(out, &session.sections)?;
            if !self.json {
                print(format_args!("points in {}", out.display()))?;
            }
        }
        watched.map(|()| ExitCode::SUCCESS)
    }

    fn connect(&self) -> anyhow::Result<Source> {
        match (self.simulated, &self.port, &self.camera2) {
            (false, Some(port), _) => {
                let mut connection = Connection::open(&port.to_string_lossy(), self.baud)?;
                let settings = connection.client.settings()?;
                if connection.client.status()?.calibration.is_none() {
                    bail!(
                        "{}: the sensor has no calibration and measures nothing: send it with karst configure",
                        connection.place
                    );
                }
                Ok(Source { connection, settings, pictures: None })
            }
            (true, Some(camera1), Some(camera2)) => {
                let rig = load_rig(self.rig.as_deref())?;
                let sizes = rig.cameras.each_ref().map(|camera| camera.image_size_px);
                let pairs = FramePairs::open(camera1, camera2, sizes)?;
                let frames = pairs.len() as u32;
                let pictures = pairs.map(|pair| pair.map(|pair| pair.images).map_err(io::Error::other));
                Ok(Source { pictures: Some(frames), ..simulate(&rig, pictures)? })
            }
            (true, None, _) => {
                let rig = load_rig(self.rig.as_deref())?;
                let scene = demo_scene();
                let bar = spinner("rendering what the cameras see");
                let images = Renderer::new(&rig)?.render(&scene.scene, scene.seed)?.images;
                bar.finish_and_clear();
                simulate(&rig, std::iter::repeat_with(move || Ok(images.clone())))
            }
            (true, Some(_), None) => {
                let message = "--simulated takes the pictures of both cameras or none, and no port\n";
                clap::Error::raw(ErrorKind::MissingRequiredArgument, message).exit()
            }
            // The parser sees to it
            (false, None, _) => bail!("expected a serial port, or --simulated"),
        }
    }
}

/// A sensor that measures.
struct Source {
    connection: Connection,
    settings: Settings,
    /// How many pairs of pictures it will see, if that is known.
    pictures: Option<u32>,
}

/// A simulated sensor with its calibration, lasers on.
fn simulate(rig: &Rig, pictures: impl Iterator<Item = io::Result<[RgbImage; 2]>> + 'static) -> anyhow::Result<Source> {
    let fixed = fixed::<MOST_LASERS>(rig)?;
    let sensor = SimulatedSensor::new(rig.lasers.len(), pictures);
    let mut connection = Connection::new(Box::new(sensor), "simulated sensor".to_owned())?;
    let settings = Settings { lasers: true, ..Settings::default() };
    connection.client.set_settings(&settings)?;
    connection.client.set_calibration(&fixed, |_, _| {})?;
    Ok(Source { connection, settings, pictures: None })
}

fn stop_on_ctrl_c() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).context("cannot wait for Ctrl-C")?;
    Ok(stop)
}

/// How a frame is shown.
enum Show {
    Page(Screen),
    Line,
    Json,
}

struct Session {
    title: String,
    show: Show,
    keep: bool,
    /// All frames, if they are to be kept.
    sections: Vec<Section>,
    assembler: Assembler,
    frame: Option<SensorFrame>,
    status: Option<Status>,
    events: VecDeque<String>,
    /// When the page was drawn.
    drawn: Instant,
    /// Somebody reads what is printed.
    read: bool,
}

impl Session {
    fn new(connection: &Connection, settings: &Settings, json: bool, keep: bool) -> Self {
        let terminal = Term::buffered_stdout();
        let show = match (json, terminal.is_term()) {
            (true, _) => Show::Json,
            (false, true) => Show::Page(Screen { terminal, lines: 0 }),
            (false, false) => Show::Line,
        };
        let lasers = if settings.lasers { "on" } else { "OFF" };
        let [major, minor, patch] = connection.client.hello().program;
        Self {
            title: format!(
                "{}, version {major}.{minor}.{patch}, protocol {}: {}, {}, lasers {lasers}",
                connection.place,
                connection.client.protocol(),
                mode_name(settings.mode),
                method_name(settings.method),
            ),
            show,
            keep,
            sections: Vec::new(),
            assembler: Assembler::new(*settings),
            frame: None,
            status: None,
            events: VecDeque::new(),
            drawn: Instant::now(),
            read: true,
        }
    }

    /// Until that many frames have come, nobody reads any more, or it is told to stop.
    fn watch(
        &mut self,
        connection: &mut Connection,
        frames: Option<u32>,
        settings: &Settings,
        stop: &AtomicBool,
    ) -> anyhow::Result<()> {
        let patience = FRAME_PATIENCE + 2 * Duration::from_micros(settings.trigger_period_us.into());
        let (mut heard, mut framed) = (Instant::now(), Instant::now());
        let mut left = frames;
        while self.read && left != Some(0) && !stop.load(Ordering::Relaxed) {
            match connection.client.receive(REDRAW).with_context(|| connection.place.clone())? {
                Some(message) => {
                    heard = Instant::now();
                    for frame in self.take(&message) {
                        if left == Some(0) {
                            break;
                        }
                        left = left.map(|left| left - 1);
                        framed = Instant::now();
                        self.show(frame, &connection.client.counters())?;
                    }
                    if matches!(message, Message::Status(status) if status.calibration.is_none()) {
                        bail!("{}: the sensor has started again, without a calibration", connection.place);
                    }
                }
                None if heard.elapsed() > SILENCE => {
                    bail!("{}: the sensor has fallen silent: no message for {SILENCE:?}", connection.place)
                }
                None => {}
            }
            if left.is_some() && framed.elapsed() > patience {
                let errors = self.status.map(|status| error_names(&status.errors)).unwrap_or_default().join(", ");
                let errors = if errors.is_empty() { String::new() } else { format!(": {errors}") };
                bail!("{}: no frame for {patience:?}{errors}", connection.place);
            }
            if self.drawn.elapsed() >= REDRAW {
                self.draw(&connection.client.counters())?;
            }
        }
        Ok(())
    }

    fn take(&mut self, message: &Message) -> Vec<SensorFrame> {
        match message {
            Message::Status(status) => self.status = Some(*status),
            Message::Log(log) => self.tell(format!("sensor says: {}", log.text)),
            _ => {}
        }
        self.assembler.take(message)
    }

    fn tell(&mut self, event: String) {
        if !matches!(self.show, Show::Page(_)) {
            complain(&event);
        }
        self.events.push_back(event);
        if self.events.len() > EVENTS {
            self.events.pop_front();
        }
    }

    fn show(&mut self, frame: SensorFrame, link: &LinkCounters) -> anyhow::Result<()> {
        match self.show {
            Show::Page(_) => {}
            Show::Line => self.read &= print_to_reader(frame_line(&frame))?,
            Show::Json => {
                let output = FrameOutput {
                    section: &frame.section,
                    complete: frame.complete,
                    lost_messages: frame.lost_messages,
                    frames: self.assembler.counts(),
                    link: *link,
                    sensor: self.status,
                };
                self.read &= print_to_reader(serde_json::to_string(&output)?)?;
            }
        }
        if self.keep {
            self.sections.push(frame.section.clone());
        }
        self.frame = Some(frame);
        Ok(())
    }

    fn draw(&mut self, link: &LinkCounters) -> anyhow::Result<()> {
        let Show::Page(screen) = &mut self.show else { return Ok(()) };
        self.drawn = Instant::now();
        let events = self.events.make_contiguous();
        let view = View {
            title: &self.title,
            frame: self.frame.as_ref(),
            counts: self.assembler.counts(),
            link: *link,
            status: self.status.as_ref(),
            events,
        };
        screen.draw(&view).context("cannot write to the terminal")
    }

    /// The last page, and the last words.
    fn end(&mut self, link: &LinkCounters) -> anyhow::Result<()> {
        self.draw(link)?;
        let counts = self.assembler.counts();
        match &self.show {
            Show::Json => Ok(()),
            Show::Page(_) | Show::Line => {
                let frames = count((counts.complete + counts.incomplete) as usize, "frame");
                print(format_args!("{frames}: {}", counts_line(&counts)))
            }
        }
    }
}

/// A page that is drawn again and again in its place.
struct Screen {
    terminal: Term,
    /// Lines of the page that is there.
    lines: usize,
}

impl Screen {
    fn draw(&mut self, view: &View<'_>) -> io::Result<()> {
        let (rows, columns) = self.terminal.size();
        let page = view.page(columns.into(), usize::from(rows).saturating_sub(1));
        self.terminal.move_cursor_up(self.lines)?;
        for line in &page {
            self.terminal.clear_line()?;
            self.terminal.write_line(line)?;
        }
        self.terminal.clear_to_end_of_screen()?;
        self.lines = page.len();
        self.terminal.flush()
    }
}
