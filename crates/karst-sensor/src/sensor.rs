//! The sensor: everything it does, in small steps.

use core::fmt;

use embedded_hal::digital::{OutputPin, PinState};
use embedded_io::{Read, ReadReady, Write, WriteReady};
use karst_core::FrameStatus;
use karst_link::{
    CalibrationPart, CalibrationReceiver, Command, Decoder, Encoder, Errors, Hello, Log, LogLevel, MAX_FRAME, Message,
    Mode, Request, Settings, Status, TransferState,
};
use karst_regs::{Events, Faults, Karst, LoadError, ReadError, RegisterBus, RigWords};

use crate::frame::Snapshot;
use crate::outbox::Outbox;
use crate::self_test;
use crate::trigger::Trigger;

/// A status goes out this often, microseconds.
const STATUS_PERIOD_US: u64 = 1_000_000;

/// Without a frame for this long after it is due, microseconds, a camera is stuck.
const FRAME_TIMEOUT_US: u64 = 500_000;

/// Bytes taken from the line at once.
const CHUNK: usize = 32;

/// The hardware of a sensor.
#[derive(Debug)]
pub struct Parts<B, S, L, T> {
    /// Registers of the IP.
    pub bus: B,
    /// Serial line.
    pub serial: S,
    /// Switches the lasers: high is on.
    pub lasers: L,
    /// Triggers the cameras: a pulse per exposure.
    pub trigger: T,
}

/// How the sensor came to start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Start {
    /// The watchdog has reset it.
    pub watchdog: bool,
    /// Version of the program: major, minor, patch.
    pub program: [u8; 3],
}

/// A calibration in use.
struct Active<const LASERS: usize> {
    words: RigWords<LASERS>,
    crc: u32,
    /// The number of its commit in the IP.
    commit: u32,
    method: karst_core::Method,
}

/// A sensor with up to `LASERS` lasers and `SPOTS` spots per camera and frame: four per laser.
pub struct Sensor<B: RegisterBus, S, L, T, const LASERS: usize, const SPOTS: usize> {
    ip: Option<Karst<B>>,
    serial: S,
    lasers: L,
    trigger: Trigger<T>,
    program: [u8; 3],

    decoder: Decoder<Command>,
    encoder: Encoder,
    buffer: [u8; MAX_FRAME],
    /// What of the buffer is still to be sent.
    unsent: (usize, usize),
    outbox: Outbox,

    receiver: CalibrationReceiver<LASERS>,
    active: Option<Active<LASERS>>,
    /// The received calibration, or other settings, are to be loaded.
    to_load: bool,
    commits: u32,
    settings: Settings,
    frame: Option<Snapshot<LASERS, SPOTS>>,
    /// The frame has been sent: the next one may be waiting in the IP without an interrupt.
    frame_sent: bool,
    /// Frames dropped by the IP, and frames dropped here.
    missed: u32,
    unusable: u32,

    status: Status,
    next_status_us: u64,
    last_frame_us: u64,
    stuck: bool,
}

impl<B, S, L, T, const LASERS: usize, const SPOTS: usize> Sensor<B, S, L, T, LASERS, SPOTS>
where
    B: RegisterBus,
    S: Read + ReadReady + Write + WriteReady,
    L: OutputPin,
    T: OutputPin,
{
    const FOUR_SPOTS_PER_LASER: () = assert!(SPOTS == 4 * LASERS);

    /// Tests the parts and gets ready. A part that fails is told over the line.
    pub fn new(parts: Parts<B, S, L, T>, start: Start) -> Self {
        let () = Self::FOUR_SPOTS_PER_LASER;
        let mut sensor = Self {
            ip: Karst::probe(parts.bus).ok(),
            serial: parts.serial,
            lasers: parts.lasers,
            trigger: Trigger::new(parts.trigger),
            program: start.program,
            decoder: Decoder::new(),
            encoder: Encoder::new(),
            buffer: [0; MAX_FRAME],
            unsent: (0, 0),
            outbox: Outbox { hello: true, ..Outbox::default() },
            receiver: CalibrationReceiver::new(),
            active: None,
            to_load: false,
            commits: 0,
            settings: Settings::default(),
            frame: None,
            frame_sent: false,
            missed: 0,
            unusable: 0,
            status: Status::default(),
            next_status_us: 0,
            last_frame_us: 0,
            stuck: false,
        };
        if start.watchdog {
            sensor.status.errors.watchdog = true;
            sensor.outbox.log(LogLevel::Error, "restarted by the watchdog");
        }
        sensor.self_test();
        // A sensor that has just started shines no laser
        sensor.switch_lasers();
        sensor
    }

    fn self_test(&mut self) {
        let mut failed = |outbox: &mut Outbox, text| {
            self.status.errors.self_test = true;
            outbox.log(LogLevel::Error, text);
        };
        if !self_test::kernels_are_right() {
            failed(&mut self.outbox, "self-test: the arithmetic is wrong");
        }
        let Some(ip) = &mut self.ip else {
            return failed(&mut self.outbox, "self-test: no IP with the register map of this program");
        };
        let tested = ip
            .set_enabled(false)
            .and_then(|()| ip.reset())
            .and_then(|()| ip.clear_counters())
            .and_then(|()| self_test::memory_holds(ip));
        match tested {
            Ok(true) => {}
            Ok(false) => failed(&mut self.outbox, "self-test: the settings memory does not hold"),
            Err(_) => failed(&mut self.outbox, "self-test: no access to the registers"),
        }
        // From here on an interrupt wakes the caller
        let _ = ip.set_interrupts(Events::ALL);
    }

    /// Does what can be done now; `now_us` is the time since the start, microseconds. To be called after every interrupt,
    /// and when [`Sensor::wake_us`] has come. Gives whether there is more to do at once.
    pub fn poll(&mut self, now_us: u64) -> bool {
        self.status.uptime_ms = (now_us / 1000) as u32;
        self.receive(now_us);
        self.load(now_us);
        self.serve_ip(now_us);
        if self.trigger.poll(now_us).is_err() {
            self.trouble(|errors| &mut errors.bus, "a pin does not answer");
        }
        if now_us >= self.next_status_us {
            self.next_status_us = now_us + STATUS_PERIOD_US;
            self.outbox.status = true;
        }
        let unsent = self.send();
        core::mem::take(&mut self.frame_sent) || unsent
    }

    /// When [`Sensor::poll`] has something to do even without an interrupt, microseconds since the start.
    pub fn wake_us(&self) -> u64 {
        self.trigger.wake_us().map_or(self.next_status_us, |wake| wake.min(self.next_status_us))
    }

    /// How it is.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Remembers trouble, and tells of it if it was not told since the last status.
    fn trouble(&mut self, error: impl Fn(&mut Errors) -> &mut bool, text: &'static str) {
        if !core::mem::replace(error(&mut self.status.errors), true) {
            self.outbox.log(LogLevel::Warning, text);
        }
    }

    fn bus_trouble(&mut self) {
        self.trouble(|errors| &mut errors.bus, "a register does not answer, or not as it must");
    }

    fn receive(&mut self, now_us: u64) {
        let before = self.decoder.counters();
        while self.serial.read_ready().is_ok_and(|ready| ready) {
            let mut chunk = [0; CHUNK];
            let Ok(count) = self.serial.read(&mut chunk) else { break };
            if count == 0 {
                break;
            }
            for &byte in chunk.iter().take(count) {
                if let Some(command) = self.decoder.push(byte) {
                    self.obey(command, now_us);
                }
            }
        }
        let after = self.decoder.counters();
        let bad = |counters: karst_link::LinkCounters| (counters.corrupt, counters.oversize, counters.lost);
        if bad(before) != bad(after) {
            self.trouble(|errors| &mut errors.link, "messages to the sensor were damaged or lost");
        }
        self.status.link = after;
    }

    fn obey(&mut self, command: Command, now_us: u64) {
        match command {
            Command::Hello(_) | Command::Request(Request::Hello) => self.outbox.hello = true,
            Command::Request(Request::Status) => self.outbox.status = true,
            Command::Request(Request::Settings) => self.outbox.settings = true,
            Command::Request(Request::Calibration) => self.outbox.part = self.active.as_ref().map(|_| 0),
            Command::Settings(settings) => {
                self.to_load |= settings.method != self.settings.method && self.active.is_some();
                self.settings = settings;
                self.trigger.set_period(settings.trigger_period_us, now_us);
                self.switch_lasers();
                self.outbox.settings = true;
            }
            Command::Calibration(part) => {
                let reply = self.receiver.reply(&part);
                match reply.state {
                    TransferState::Complete => self.to_load = true,
                    TransferState::Missing(_) => {}
                    TransferState::Refused(_) => {
                        self.trouble(|errors| &mut errors.bad_calibration, "a calibration was refused");
                    }
                }
                self.outbox.reply = Some(reply);
            }
        }
    }

    fn switch_lasers(&mut self) {
        let state = PinState::from(self.settings.lasers);
        if self.lasers.set_state(state).is_err() {
            self.trouble(|errors| &mut errors.bus, "a pin does not answer");
        }
    }

    /// Hands a new calibration, or the one in use with another method, to the IP.
    fn load(&mut self, now_us: u64) {
        let Some(ip) = self.ip.as_mut().filter(|_| self.to_load) else { return };
        let in_use = self.active.as_ref().map(|active| (&active.words, active.crc));
        let Some((words, crc)) = self.receiver.complete().or(in_use) else {
            self.to_load = false;
            return;
        };
        let method = self.settings.method;
        let committed = ip.load_words(words, method).and_then(|()| ip.commit().map_err(LoadError::Bus));
        let enabled = committed.and_then(|()| ip.set_enabled(true).map_err(LoadError::Bus));
        match enabled {
            Ok(()) => {
                self.to_load = false;
                // From here on frames are waited for
                self.last_frame_us = now_us;
                self.commits += 1;
                self.status.calibration = Some(crc);
                self.active = Some(Active { words: words.clone(), crc, commit: self.commits, method });
            }
            // Tried again with the next call
            Err(LoadError::Committing) => {}
            Err(LoadError::Bus(_) | LoadError::Verify { .. }) => self.bus_trouble(),
            Err(LoadError::Settings(_)) => {
                self.to_load = false;
                self.receiver.reset();
                self.trouble(|errors| &mut errors.bad_calibration, "the IP was not built for this calibration");
            }
        }
    }

    fn serve_ip(&mut self, now_us: u64) {
        let Some(active) = &self.active else { return };
        let Some(ip) = &mut self.ip else { return };
        let mut look = || {
            ip.take_events()?;
            let faults = ip.take_faults()?;
            let missed = if faults.missed() { ip.counters()?.missed.into() } else { self.missed };
            Ok::<_, B::Error>((faults, missed))
        };
        let Ok((faults, missed)) = look() else { return self.bus_trouble() };
        self.missed = missed;
        let mut fresh = false;
        // While a frame is being sent the IP keeps the next one, or the one that replaces it
        if self.frame.is_none() {
            match take_frame(ip, active, &self.settings) {
                Ok(Taken::Nothing) => {}
                Ok(Taken::Frame(snapshot)) => {
                    fresh = true;
                    self.frame = Some(snapshot);
                }
                Ok(Taken::OfOtherSettings) => {
                    fresh = true;
                    self.unusable = self.unusable.saturating_add(1);
                }
                Err(_) => self.bus_trouble(),
            }
        }
        self.status.dropped_frames = self.missed.saturating_add(self.unusable);
        self.note_faults(faults);
        if fresh {
            self.last_frame_us = now_us;
            self.stuck = false;
            self.note_frame();
        } else if now_us.saturating_sub(self.last_frame_us) > self.frame_timeout_us() && self.frame.is_none() {
            self.unstick(now_us);
        }
    }

    fn frame_timeout_us(&self) -> u64 {
        FRAME_TIMEOUT_US + u64::from(self.settings.trigger_period_us)
    }

    fn note_faults(&mut self, faults: Faults) {
        for camera in 0..2 {
            if faults.truncated(camera)
                || faults.short_row(camera)
                || faults.long_row(camera)
                || faults.stray_row(camera)
            {
                self.trouble(
                    |errors| &mut errors.truncated_frame,
                    "rows of a camera are missing, damaged, or too many",
                );
            }
            if faults.overflow(camera) {
                self.trouble(|errors| &mut errors.detector_overflow, "a detector had to drop hits");
            }
        }
        if faults.unpaired() {
            self.trouble(|errors| &mut errors.stuck_camera, "a frame of one camera has no partner");
        }
    }

    fn note_frame(&mut self) {
        let Some(frame) = &self.frame else { return };
        self.status.frames = self.status.frames.wrapping_add(1);
        self.status.points = self.status.points.wrapping_add(frame.points());
        let dark = frame.detectors().iter().all(|detector: &FrameStatus| detector.hits == detector.outside);
        if dark {
            self.trouble(|errors| &mut errors.no_spots, "no laser is visible");
        }
    }

    /// A camera has stopped, perhaps within a frame: the IP forgets what it has of it.
    fn unstick(&mut self, now_us: u64) {
        self.last_frame_us = now_us;
        self.status.errors.stuck_camera = true;
        if !core::mem::replace(&mut self.stuck, true) {
            self.outbox.log(LogLevel::Error, "no frame: a camera is stuck");
        }
        if self.ip.as_mut().is_some_and(|ip| ip.reset().is_err()) {
            self.bus_trouble();
        }
    }

    /// Sends until the line takes no more. Gives whether something is left.
    fn send(&mut self) -> bool {
        loop {
            let (from, to) = self.unsent;
            if from == to {
                let Some(message) = self.next_message() else { return false };
                let length = self.encoder.encode(&message, &mut self.buffer).map_or(0, <[u8]>::len);
                self.unsent = (0, length);
                continue;
            }
            if !self.serial.write_ready().is_ok_and(|ready| ready) {
                return true;
            }
            let rest = self.buffer.get(from..to).unwrap_or_default();
            match self.serial.write(rest) {
                Ok(count) => self.unsent.0 = (from + count).min(to),
                // The line is gone: what was under way is lost, the receiver sees that
                Err(_) => self.unsent = (0, 0),
            }
        }
    }

    fn next_message(&mut self) -> Option<Message> {
        let outbox = &mut self.outbox;
        if core::mem::take(&mut outbox.hello) {
            return Some(Message::Hello(Hello::new(self.program, LASERS as u16)));
        }
        if let Some(reply) = outbox.reply.take() {
            return Some(Message::CalibrationReply(reply));
        }
        if core::mem::take(&mut outbox.settings) {
            return Some(Message::Settings(self.settings));
        }
        if core::mem::take(&mut outbox.status) {
            let status = self.status;
            self.status.errors = Errors::default();
            return Some(Message::Status(status));
        }
        if let Some(Log { level, text }) = outbox.next_log() {
            return Some(Message::Log(Log { level, text }));
        }
        if let (Some(number), Some(active)) = (outbox.part, &self.active) {
            let part = CalibrationPart::new(&active.words, active.crc, number);
            outbox.part = part.is_some().then_some(number + 1);
            if let Some(part) = part {
                return Some(Message::Calibration(part));
            }
        }
        let message = self.frame.as_mut()?.next();
        if message.is_none() {
            self.frame = None;
            self.frame_sent = true;
        }
        message
    }
}

/// What was in the result memory.
enum Taken<const LASERS: usize, const SPOTS: usize> {
    Nothing,
    Frame(Snapshot<LASERS, SPOTS>),
    /// A frame that can not be reconstructed here: it was measured with settings that are no longer there.
    OfOtherSettings,
}

fn take_frame<B: RegisterBus, const LASERS: usize, const SPOTS: usize>(
    ip: &mut Karst<B>,
    active: &Active<LASERS>,
    settings: &Settings,
) -> Result<Taken<LASERS, SPOTS>, ReadError<B::Error>> {
    let Some(mut frame) = ip.frame()? else { return Ok(Taken::Nothing) };
    let accelerated = settings.mode == Mode::Accelerated;
    if !accelerated && frame.settings != active.commit {
        frame.acknowledge()?;
        return Ok(Taken::OfOtherSettings);
    }
    let snapshot = Snapshot::read(&mut frame, accelerated, settings.spots);
    // Also one that could not be read makes room for the next
    frame.acknowledge()?;
    let mut snapshot = snapshot?;
    if !accelerated {
        snapshot.reconstruct(&active.words, active.method);
    }
    Ok(Taken::Frame(snapshot))
}

impl<B: RegisterBus, S, L, T, const LASERS: usize, const SPOTS: usize> fmt::Debug
    for Sensor<B, S, L, T, LASERS, SPOTS>
{
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sensor").field("settings", &self.settings).field("status", &self.status).finish_non_exhaustive()
    }
}
