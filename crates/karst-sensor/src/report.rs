//! What is to be told besides frames.

use karst_link::{CalibrationReply, Errors, Log, LogLevel, LogText, Status};

/// Texts that can wait to be sent.
const LOGS: usize = 4;

/// What waits, in the order of its importance.
#[derive(Default)]
pub(crate) struct Outbox {
    pub hello: bool,
    pub reply: Option<CalibrationReply>,
    pub settings: bool,
    pub status: bool,
    /// The next part of the calibration in use.
    pub part: Option<u16>,
    pub logs: heapless::Deque<(LogLevel, &'static str), LOGS>,
}

impl Outbox {
    /// Puts down a text. If too many wait, the oldest goes: the error flags of the status tell as well.
    pub fn log(&mut self, level: LogLevel, text: &'static str) {
        #[cfg(feature = "defmt")]
        match level {
            LogLevel::Debug => defmt::debug!("{=str}", text),
            LogLevel::Info => defmt::info!("{=str}", text),
            LogLevel::Warning => defmt::warn!("{=str}", text),
            LogLevel::Error => defmt::error!("{=str}", text),
        }
        if self.logs.is_full() {
            self.logs.pop_front();
        }
        let _ = self.logs.push_back((level, text));
    }

    pub fn next_log(&mut self) -> Option<Log> {
        let (level, text) = self.logs.pop_front()?;
        Some(Log { level, text: LogText::try_from(text).unwrap_or_default() })
    }
}

/// What can go wrong again and again.
#[derive(Clone, Copy)]
pub(crate) enum Trouble {
    Bus,
    Pin,
    Link,
    CalibrationRefused,
    CalibrationUnfit,
    Rows,
    Overflow,
    Unpaired,
    Dark,
}

impl Trouble {
    /// The flag and the text that tell of it.
    fn of(self, errors: &mut Errors) -> (&mut bool, &'static str) {
        match self {
            Self::Bus => (&mut errors.bus, "a register does not answer, or not as it must"),
            Self::Pin => (&mut errors.bus, "a pin does not answer"),
            Self::Link => (&mut errors.link, "messages to the sensor were damaged or lost"),
            Self::CalibrationRefused => (&mut errors.bad_calibration, "a calibration was refused"),
            Self::CalibrationUnfit => (&mut errors.bad_calibration, "the IP was not built for this calibration"),
            Self::Rows => (&mut errors.truncated_frame, "rows of a camera are missing, damaged, or too many"),
            Self::Overflow => (&mut errors.detector_overflow, "a detector had to drop hits"),
            Self::Unpaired => (&mut errors.stuck_camera, "a frame of one camera has no partner"),
            Self::Dark => (&mut errors.no_spots, "no laser is visible"),
        }
    }
}

/// How the sensor is, and what is to be told of it.
#[derive(Default)]
pub(crate) struct Report {
    pub status: Status,
    pub outbox: Outbox,
}

impl Report {
    /// Remembers trouble, and tells of it if it was not told since the last status.
    #[inline(never)]
    pub fn trouble(&mut self, trouble: Trouble) {
        let (error, text) = trouble.of(&mut self.status.errors);
        if !core::mem::replace(error, true) {
            self.outbox.log(LogLevel::Warning, text);
        }
    }
}
