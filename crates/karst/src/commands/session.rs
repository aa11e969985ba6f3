//! A sensor's frames as they come: on a page in the terminal, in lines, or as JSON.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use console::Term;
use karst::instrument::method_name;
use karst::output::terminal::{View, counts_line, error_names, frame_line};
use karst::result::Section;
use karst::sensor::{Assembler, FrameCounts, SensorFrame};
use karst_link::{LinkCounters, Message, Settings, Status};
use serde::Serialize;

use super::line::{Connection, mode_name};
use super::{complain, count, print, print_to_reader};

/// A sensor sends its status every second: after this long without a message it is gone.
const SILENCE: Duration = Duration::from_secs(5);
/// With `--frames`, frames are waited for this long, and two trigger periods.
const FRAME_PATIENCE: Duration = Duration::from_secs(10);
/// The page is drawn at most this often.
const REDRAW: Duration = Duration::from_millis(50);
/// Events on the page.
const EVENTS: usize = 4;

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

/// Gets true with Ctrl-C.
pub fn stop_on_ctrl_c() -> anyhow::Result<Arc<AtomicBool>> {
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

/// What has come so far, and how it is shown.
pub struct Session {
    title: String,
    show: Show,
    keep: bool,
    /// All frames, if they are to be kept.
    sections: Vec<Section>,
    assembler: Assembler,
    frame: Option<SensorFrame>,
    status: Option<Status>,
    events: VecDeque<String>,
    /// The last line of the page.
    note: Option<String>,
    /// When the page was drawn.
    drawn: Instant,
    /// Somebody reads what is printed.
    read: bool,
}

impl Session {
    /// `keep`: all frames.
    pub fn new(connection: &Connection, settings: &Settings, json: bool, keep: bool) -> Self {
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
            note: None,
            drawn: Instant::now(),
            read: true,
        }
    }

    /// Until that many frames have come, nobody reads any more, or it is told to stop.
    pub fn watch(
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
            self.redraw(&connection.client.counters())?;
        }
        Ok(())
    }

    /// Somebody reads what is printed.
    pub fn is_read(&self) -> bool {
        self.read
    }

    /// All frames so far, if they were to be kept.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// How many frames have come.
    pub fn counts(&self) -> FrameCounts {
        self.assembler.counts()
    }

    /// Puts a line at the foot of the page.
    pub fn note(&mut self, note: String) {
        self.note = Some(note);
    }

    /// Takes a message; gives the frames that it ends.
    pub fn take(&mut self, message: &Message) -> Vec<SensorFrame> {
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

    /// Shows a frame, and keeps it if it is to be kept.
    pub fn show(&mut self, frame: SensorFrame, link: &LinkCounters) -> anyhow::Result<()> {
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

    /// Draws the page again if it is time.
    pub fn redraw(&mut self, link: &LinkCounters) -> anyhow::Result<()> {
        if self.drawn.elapsed() >= REDRAW { self.draw(link) } else { Ok(()) }
    }

    fn draw(&mut self, link: &LinkCounters) -> anyhow::Result<()> {
        let Show::Page(screen) = &mut self.show else { return Ok(()) };
        self.drawn = Instant::now();
        let events: Vec<String> = self.events.iter().chain(&self.note).cloned().collect();
        let view = View {
            title: &self.title,
            frame: self.frame.as_ref(),
            counts: self.assembler.counts(),
            link: *link,
            status: self.status.as_ref(),
            events: &events,
        };
        screen.draw(&view).context("cannot write to the terminal")
    }

    /// The last page, and the last words.
    pub fn end(&mut self, link: &LinkCounters) -> anyhow::Result<()> {
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
