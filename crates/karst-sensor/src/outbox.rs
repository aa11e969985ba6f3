//! What is to be sent besides frames.

use karst_link::{CalibrationReply, Log, LogLevel, LogText};

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
