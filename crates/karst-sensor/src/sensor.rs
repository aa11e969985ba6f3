//! The sensor: everything it does, in small steps.

use core::fmt;

use embedded_hal::digital::{OutputPin, PinState};
use embedded_io::{Read, ReadReady, Write, WriteReady};
use karst_core::FrameStatus;
use karst_link::{
    CalibrationPart, CalibrationReceiver, Command, Decoder, Encoder, Errors, Hello, Log, LogLevel, MAX_FRAME, Message,
    Mode, Request, Settings, Status, TransferState,
};
use karst_regs::{Faults, Karst, LoadError, ReadError, RegisterBus, RigWords};

use crate::frame::Snapshot;
use crate::report::{Report, Trouble};
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
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Start {
    /// The watchdog has reset it.
    pub watchdog: bool,
    /// Version of the program: major, minor, patch.
    pub program: [u8; 3],
}

/// How the calibration in use is used.
struct Active {
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

    receiver: CalibrationReceiver<LASERS>,
    /// The calibration in use, if `active` says that there is one.
    in_use: RigWords<LASERS>,
    active: Option<Active>,
    /// The received calibration, or other settings, are to be loaded.
    to_load: bool,
    commits: u32,
    settings: Settings,
    frame: Snapshot<LASERS, SPOTS>,
    /// Something may be waiting without an interrupt: a frame has been sent, and the IP has the next one, or an access to
    /// the IP failed.
    look_again: bool,
    /// Frames dropped by the IP, and frames dropped here.
    missed: u32,
    unusable: u32,

    report: Report,
    /// Time of the start and of the milliseconds since then that the status tells.
    uptime_us: u64,
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
    // Ends with the value, and is no part of its caller: then the value is made where it is to be, without a copy
    #[inline(never)]
    pub fn new(parts: Parts<B, S, L, T>, start: Start) -> Self {
        let () = Self::FOUR_SPOTS_PER_LASER;
        let mut report = Report::default();
        report.outbox.hello = true;
        if start.watchdog {
            report.status.errors.watchdog = true;
            report.outbox.log(LogLevel::Error, "restarted by the watchdog");
        }
        let mut ip = Karst::probe(parts.bus).ok();
        self_test::run(ip.as_mut(), &mut report);
        // A sensor that has just started shines no laser
        let mut lasers = parts.lasers;
        if lasers.set_low().is_err() {
            report.trouble(Trouble::Pin);
        }
        Self {
            ip,
            serial: parts.serial,
            lasers,
            trigger: Trigger::new(parts.trigger),
            program: start.program,
            decoder: const { Decoder::new() },
            encoder: Encoder::new(),
            buffer: [0; MAX_FRAME],
            unsent: (0, 0),
            receiver: const { CalibrationReceiver::new() },
            in_use: RigWords::EMPTY,
            active: None,
            to_load: false,
            commits: 0,
            settings: Settings::default(),
            frame: Snapshot::NONE,
            look_again: false,
            missed: 0,
            unusable: 0,
            report,
            uptime_us: 0,
            next_status_us: 0,
            last_frame_us: 0,
            stuck: false,
        }
    }

    /// Does what can be done now; `now_us` is the time since the start, microseconds. To be called after every interrupt,
    /// and when [`Sensor::wake_us`] has come. Gives whether there is more to do at once.
    pub fn poll(&mut self, now_us: u64) -> bool {
        self.tell_time(now_us);
        self.receive(now_us);
        self.load(now_us);
        self.serve_ip(now_us);
        if self.trigger.poll(now_us).is_err() {
            self.report.trouble(Trouble::Pin);
        }
        if now_us >= self.next_status_us {
            self.next_status_us = now_us + STATUS_PERIOD_US;
            self.report.outbox.status = true;
        }
        let unsent = self.send();
        core::mem::take(&mut self.look_again) || unsent
    }

    /// Brings the uptime up to date, with divisions of 32 bits.
    fn tell_time(&mut self, now_us: u64) {
        let passed_us = now_us.saturating_sub(self.uptime_us).min(u32::MAX.into()) as u32;
        self.report.status.uptime_ms = self.report.status.uptime_ms.wrapping_add(passed_us / 1000);
        self.uptime_us += u64::from(passed_us - passed_us % 1000);
    }

    /// When [`Sensor::poll`] has something to do even without an interrupt, microseconds since the start.
    pub fn wake_us(&self) -> u64 {
        self.trigger.wake_us().map_or(self.next_status_us, |wake| wake.min(self.next_status_us))
    }

    /// How it is.
    pub fn status(&self) -> &Status {
        &self.report.status
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    #[inline(never)]
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
            self.report.trouble(Trouble::Link);
        }
        self.report.status.link = after;
    }

    #[inline(never)]
    fn obey(&mut self, command: Command, now_us: u64) {
        match command {
            Command::Hello(_) | Command::Request(Request::Hello) => self.report.outbox.hello = true,
            Command::Request(Request::Status) => self.report.outbox.status = true,
            Command::Request(Request::Settings) => self.report.outbox.settings = true,
            Command::Request(Request::Calibration) => self.report.outbox.part = self.active.as_ref().map(|_| 0),
            Command::Settings(settings) => {
                self.to_load |= settings.method != self.settings.method && self.active.is_some();
                self.settings = settings;
                self.trigger.set_period(settings.trigger_period_us, now_us);
                self.switch_lasers();
                self.report.outbox.settings = true;
            }
            Command::Calibration(part) => {
                let reply = self.receiver.reply(&part);
                match reply.state {
                    TransferState::Complete => self.to_load = true,
                    TransferState::Missing(_) => {}
                    TransferState::Refused(_) => {
                        self.report.trouble(Trouble::CalibrationRefused);
                    }
                }
                self.report.outbox.reply = Some(reply);
            }
        }
    }

    fn switch_lasers(&mut self) {
        let state = PinState::from(self.settings.lasers);
        if self.lasers.set_state(state).is_err() {
            self.report.trouble(Trouble::Pin);
        }
    }

    /// Hands a new calibration, or the one in use with another method, to the IP.
    #[inline(never)]
    fn load(&mut self, now_us: u64) {
        let Some(ip) = self.ip.as_mut().filter(|_| self.to_load) else { return };
        let in_use = self.active.as_ref().map(|active| (&self.in_use, active.crc));
        let received = self.receiver.complete();
        let Some((words, crc)) = received.or(in_use) else {
            self.to_load = false;
            return;
        };
        let method = self.settings.method;
        let committed = ip.load_words(words, method).and_then(|()| {
            let whole = !ip.bus().has_failed();
            if whole {
                ip.commit().map_err(LoadError::Bus)?;
            }
            Ok(whole && !ip.bus().has_failed())
        });
        if matches!(committed, Ok(true)) {
            self.commits += 1;
        }
        let enabled = committed.and_then(|committed| {
            ip.set_enabled(true).map_err(LoadError::Bus)?;
            Ok(committed && !ip.bus().has_failed())
        });
        match enabled {
            Ok(true) => {
                self.to_load = false;
                // From here on frames are waited for
                self.last_frame_us = now_us;
                self.report.status.calibration = Some(crc);
                self.active = Some(Active { crc, commit: self.commits, method });
                if let Some((words, _)) = received {
                    self.in_use.copy_from(words);
                }
            }
            // Tried again with the next call
            Err(LoadError::Committing) => {}
            Ok(false) | Err(LoadError::Bus(_) | LoadError::Verify { .. }) => self.bus_failed(),
            Err(LoadError::Settings(_)) => {
                self.to_load = false;
                self.receiver.reset();
                self.report.trouble(Trouble::CalibrationUnfit);
            }
        }
    }

    #[inline(never)]
    fn serve_ip(&mut self, now_us: u64) {
        let Some(active) = &self.active else { return };
        let Some(ip) = &mut self.ip else { return };
        let mut look = || {
            ip.take_events()?;
            let faults = ip.take_faults()?;
            let missed = if faults.missed() { ip.counters()?.missed.into() } else { self.missed };
            Ok::<_, B::Error>((faults, missed, ip.bus().has_failed()))
        };
        let Ok((faults, missed, false)) = look() else { return self.bus_failed() };
        self.missed = missed;
        let mut fresh = false;
        // While a frame is being sent the IP keeps the next one, or the one that replaces it
        if !self.frame.is_there() {
            match take_frame(ip, active, &self.in_use, &self.settings, &mut self.frame) {
                Ok(Taken::Nothing) => {}
                Ok(Taken::Frame) => fresh = true,
                Ok(Taken::OfOtherSettings) => {
                    fresh = true;
                    self.unusable = self.unusable.saturating_add(1);
                }
                Ok(Taken::Unsure) | Err(_) => self.bus_failed(),
            }
        }
        self.report.status.dropped_frames = self.missed.saturating_add(self.unusable);
        self.note_faults(faults);
        if fresh {
            self.last_frame_us = now_us;
            self.stuck = false;
            self.note_frame();
        } else if now_us.saturating_sub(self.last_frame_us) > self.frame_timeout_us() && !self.frame.is_there() {
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
                self.report.trouble(Trouble::Rows);
            }
            if faults.overflow(camera) {
                self.report.trouble(Trouble::Overflow);
            }
        }
        if faults.unpaired() {
            self.report.trouble(Trouble::Unpaired);
        }
    }

    fn note_frame(&mut self) {
        let frame = &self.frame;
        if !frame.is_there() {
            return;
        }
        self.report.status.frames = self.report.status.frames.wrapping_add(1);
        self.report.status.points = self.report.status.points.wrapping_add(frame.points());
        let dark = frame.detectors().iter().all(|detector: &FrameStatus| detector.hits == detector.outside);
        if dark {
            self.report.trouble(Trouble::Dark);
        }
    }

    /// A camera has stopped, perhaps within a frame: the IP forgets what it has of it.
    fn unstick(&mut self, now_us: u64) {
        self.last_frame_us = now_us;
        self.report.status.errors.stuck_camera = true;
        if !core::mem::replace(&mut self.stuck, true) {
            self.report.outbox.log(LogLevel::Error, "no frame: a camera is stuck");
        }
        if self.ip.as_mut().is_some_and(|ip| ip.reset().is_err() || ip.bus().has_failed()) {
            self.bus_failed();
        }
    }

    /// What was to be done is tried again with the next call.
    fn bus_failed(&mut self) {
        self.report.trouble(Trouble::Bus);
        self.look_again = true;
    }

    /// Sends until the line takes no more. Gives whether something is left.
    #[inline(never)]
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
        let outbox = &mut self.report.outbox;
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
            let status = self.report.status;
            self.report.status.errors = Errors::default();
            return Some(Message::Status(status));
        }
        if let Some(Log { level, text }) = outbox.next_log() {
            return Some(Message::Log(Log { level, text }));
        }
        if let (Some(number), Some(active)) = (outbox.part, &self.active) {
            let part = CalibrationPart::new(&self.in_use, active.crc, number);
            outbox.part = part.is_some().then_some(number + 1);
            if let Some(part) = part {
                return Some(Message::Calibration(part));
            }
        }
        let was_there = self.frame.is_there();
        let message = self.frame.next();
        self.look_again |= was_there && !self.frame.is_there();
        message
    }
}

/// What was in the result memory.
enum Taken {
    Nothing,
    Frame,
    /// A frame that can not be reconstructed here: it was measured with settings that are no longer there.
    OfOtherSettings,
    /// What was read is not what it seems: the bus failed.
    Unsure,
}

fn take_frame<B: RegisterBus, const LASERS: usize, const SPOTS: usize>(
    ip: &mut Karst<B>,
    active: &Active,
    words: &RigWords<LASERS>,
    settings: &Settings,
    snapshot: &mut Snapshot<LASERS, SPOTS>,
) -> Result<Taken, ReadError<B::Error>> {
    let Some(mut frame) = ip.frame()? else {
        return Ok(if ip.bus().has_failed() { Taken::Unsure } else { Taken::Nothing });
    };
    if frame.has_failed() {
        return Ok(Taken::Unsure);
    }
    let number = frame.pair;
    if number == snapshot.number() {
        // It has been given: only its acknowledgement did not get through
        frame.acknowledge()?;
        return Ok(Taken::Nothing);
    }
    let accelerated = settings.mode == Mode::Accelerated;
    if !accelerated && frame.settings != active.commit {
        frame.acknowledge()?;
        return Ok(Taken::OfOtherSettings);
    }
    let read = snapshot.read(&mut frame, accelerated, settings.spots);
    // What the bus failed to give stays, and is read again
    if frame.has_failed() {
        return Ok(Taken::Unsure);
    }
    if !matches!(read, Err(ReadError::Bus(_))) {
        // Also one that could not be understood makes room for the next
        frame.acknowledge()?;
    }
    read?;
    if !accelerated {
        snapshot.reconstruct(words, active.method);
    }
    snapshot.give(number);
    Ok(Taken::Frame)
}

impl<B: RegisterBus, S, L, T, const LASERS: usize, const SPOTS: usize> fmt::Debug
    for Sensor<B, S, L, T, LASERS, SPOTS>
{
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sensor")
            .field("settings", &self.settings)
            .field("status", &self.report.status)
            .finish_non_exhaustive()
    }
}
