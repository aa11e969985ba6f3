//! Questions to a sensor and its answers, over a line that damages and loses messages.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::time::Duration;

use karst_core::FixedRig;
use karst_link::{
    CalibrationReceiver, CalibrationSender, Decoder, Encoder, Hello, Incompatible, LinkCounters, MAX_FRAME, Message,
    Request, Settings, Status, TransferError, TransferState,
};

use super::Clock;

/// Most lasers of a calibration that can be sent and read back.
pub const MOST_LASERS: usize = 720;

/// An answer is waited for this long, then the question is sent again.
const PATIENCE: Duration = Duration::from_millis(200);
/// So many questions without an answer are given up: with 1 % wrong bytes every other status is damaged.
const TRIES: usize = 25;
/// After this long without a part, or a reply to one, no more are on their way.
const QUIET: Duration = Duration::from_millis(150);
/// So many rounds of a transfer without a new part are given up: with 1 % wrong bytes most of the long parts are damaged.
const ROUNDS: usize = 100;
/// A complete calibration is in use after this long: a frame that is under way ends first.
const TAKES_EFFECT: Duration = Duration::from_secs(5);

/// Why a sensor can not be spoken with, or does not do what it is asked to.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The line is gone, or takes no bytes.
    #[error("the line to the sensor broke: {0}")]
    Line(#[from] io::Error),
    /// Not a byte came.
    #[error("nothing answers: is the sensor on, and is this its line?")]
    Silent,
    /// Bytes came, but no message.
    #[error("{0} bytes came, but no message of a sensor: another baud rate, or another device?")]
    NotASensor(usize),
    /// Messages came, but no answer.
    #[error("a sensor sends, but does not answer: is the line to it connected?")]
    Deaf,
    /// No common protocol.
    #[error(transparent)]
    Incompatible(#[from] Incompatible),
    /// The sensor no longer answers.
    #[error("the sensor no longer answers")]
    Gone,
    /// The sensor answers nothing to a question.
    #[error("the sensor does not answer the request for its {0}")]
    NoAnswer(&'static str),
    /// The sensor answers, but parts of the calibration do not get through.
    #[error("{0} parts of the calibration do not get through: the line damages too much")]
    Noise(usize),
    /// The sensor does not take the calibration.
    #[error("the sensor refused the calibration: {0}")]
    Refused(TransferError),
    /// The sensor has the calibration, but something keeps it from using it.
    #[error("the sensor took the calibration, but does not use it")]
    NotInUse,
    /// The sensor runs with other settings than those sent.
    #[error("the sensor does not take the settings: sent {sent:?}, found {found:?}")]
    Settings {
        /// The settings sent.
        sent: Settings,
        /// The settings in use.
        found: Settings,
    },
    /// The parts that were read back make no calibration.
    #[error("the calibration read back from the sensor is not whole: {0}")]
    ReadBack(TransferError),
}

/// The host's end of a sensor's line.
///
/// Reading from the line must give what is there, or after a short while [`ErrorKind::TimedOut`] or
/// [`ErrorKind::WouldBlock`]; no bytes at all mean that it has ended. A silent sensor is
/// given up after a few seconds. Messages that come while an answer is waited for are kept for [`Self::receive`].
#[derive(Debug)]
pub struct SensorClient<L> {
    line: L,
    clock: Clock,
    encoder: Encoder,
    decoder: Decoder,
    /// Bytes received, good or bad.
    bytes: usize,
    /// Messages that came while an answer was waited for.
    kept: VecDeque<Message>,
    /// Messages just decoded.
    fresh: VecDeque<Message>,
    hello: Hello,
    protocol: u8,
}

impl<L: Read + Write> SensorClient<L> {
    /// Finds the sensor on the line and the protocol to speak with it.
    pub fn connect(line: L) -> Result<Self, ClientError> {
        Self::connect_by(line, Clock::of_computer())
    }

    /// The same with the time of that clock.
    pub fn connect_by(line: L, clock: Clock) -> Result<Self, ClientError> {
        let ours = Hello::new(super::program_version(), MOST_LASERS as u16);
        let mut client = Self {
            line,
            clock,
            encoder: Encoder::new(),
            decoder: Decoder::new(),
            bytes: 0,
            kept: VecDeque::new(),
            fresh: VecDeque::new(),
            hello: ours,
            protocol: 0,
        };
        let Some(hello) = client.say_hello()? else {
            return Err(match (client.bytes, client.counters().received) {
                (0, _) => ClientError::Silent,
                (bytes, 0) => ClientError::NotASensor(bytes),
                _ => ClientError::Deaf,
            });
        };
        client.protocol = ours.agree(&hello)?;
        client.hello = hello;
        Ok(client)
    }

    /// What the sensor said of itself.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// The protocol spoken.
    pub fn protocol(&self) -> u8 {
        self.protocol
    }

    /// What this end of the line has received.
    pub fn counters(&self) -> LinkCounters {
        self.decoder.counters()
    }

    /// Sends a message. What is answered comes by [`Self::receive`].
    pub fn send(&mut self, message: &Message) -> Result<(), ClientError> {
        let mut buffer = [0; MAX_FRAME];
        let frame = self.encoder.encode(message, &mut buffer).map_err(io::Error::other)?;
        Ok(self.line.write_all(frame)?)
    }

    /// The next message; None: none came in that time.
    pub fn receive(&mut self, within: Duration) -> Result<Option<Message>, ClientError> {
        match self.kept.pop_front() {
            Some(message) => Ok(Some(message)),
            None => self.next_fresh(self.clock.now() + within),
        }
    }

    /// How the sensor is.
    pub fn status(&mut self) -> Result<Status, ClientError> {
        let status = self.ask(&Message::Request(Request::Status), |message| match message {
            Message::Status(status) => Some(*status),
            _ => None,
        })?;
        // Those kept are older
        self.kept.retain(|message| !matches!(message, Message::Status(_)));
        status.ok_or(ClientError::NoAnswer("status"))
    }

    /// The settings in use.
    pub fn settings(&mut self) -> Result<Settings, ClientError> {
        let settings = self.ask(&Message::Request(Request::Settings), |message| match message {
            Message::Settings(settings) => Some(*settings),
            _ => None,
        })?;
        settings.ok_or(ClientError::NoAnswer("settings"))
    }

    /// Sends settings until the sensor says that it has them.
    pub fn set_settings(&mut self, settings: &Settings) -> Result<(), ClientError> {
        let mut other = None;
        let taken = self.ask(&Message::Settings(*settings), |message| match message {
            Message::Settings(found) if found == settings => Some(()),
            Message::Settings(found) => {
                other = Some(*found);
                None
            }
            _ => None,
        })?;
        match (taken, other) {
            (Some(()), _) => Ok(()),
            (None, Some(found)) => Err(ClientError::Settings { sent: *settings, found }),
            (None, None) => Err(ClientError::NoAnswer("settings")),
        }
    }

    /// Sends a calibration, again and again what is missing of it, until the sensor uses it. `progress` hears how many
    /// parts are there and how many there are.
    pub fn set_calibration<const LASERS: usize>(
        &mut self,
        rig: &FixedRig<LASERS>,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<(), ClientError> {
        let sender = CalibrationSender::new(rig);
        let parts: Vec<_> = sender.parts().collect();
        let mut missing: Vec<u16> = (0..parts.len() as u16).collect();
        let mut idle_rounds = 0;
        loop {
            let first_round = missing.len() == parts.len();
            for (sent, part) in missing.iter().filter_map(|&number| parts.get(usize::from(number))).enumerate() {
                self.send(&Message::Calibration(part.clone()))?;
                if first_round {
                    progress(sent, parts.len());
                }
            }
            match self.last_reply(sender.crc())? {
                Some(TransferState::Complete) => break,
                Some(TransferState::Refused(TransferError::Checksum { .. })) => {
                    missing = (0..parts.len() as u16).collect();
                    idle_rounds += 1;
                }
                Some(TransferState::Refused(error)) => return Err(ClientError::Refused(error)),
                Some(TransferState::Missing(list)) => {
                    idle_rounds = if missing[..] == list[..] { idle_rounds + 1 } else { 0 };
                    missing = list.to_vec();
                    // The list names the first ones only
                    let there = if list.is_full() { list[0].into() } else { parts.len() - list.len() };
                    progress(there, parts.len());
                }
                // Parts or their replies were lost, or the sensor is
                None => {
                    self.say_hello()?.ok_or(ClientError::Gone)?;
                    idle_rounds += 1;
                }
            }
            if idle_rounds == ROUNDS {
                return Err(ClientError::Noise(missing.len()));
            }
        }
        progress(parts.len(), parts.len());
        let until = self.clock.now() + TAKES_EFFECT;
        while self.status()?.calibration != Some(sender.crc()) {
            if self.clock.now() >= until {
                return Err(ClientError::NotInUse);
            }
        }
        Ok(())
    }

    /// The calibration in use; None: the sensor has none.
    pub fn calibration(&mut self) -> Result<Option<FixedRig<MOST_LASERS>>, ClientError> {
        let Some(crc) = self.status()?.calibration else { return Ok(None) };
        let mut receiver = CalibrationReceiver::<MOST_LASERS>::new();
        let mut idle_rounds = 0;
        while idle_rounds < ROUNDS {
            self.send(&Message::Request(Request::Calibration))?;
            let mut idle = true;
            let mut until = self.clock.now() + PATIENCE;
            while let Some(message) = self.next_fresh(until)? {
                match message {
                    Message::Calibration(part) if part.crc == crc => {
                        let before = receiver.missing().count();
                        receiver.accept(&part).map_err(ClientError::ReadBack)?;
                        idle &= receiver.missing().count() == before;
                        until = self.clock.now() + QUIET;
                        if let Some((words, _)) = receiver.complete() {
                            return Ok(Some(words.rig()));
                        }
                    }
                    Message::Calibration(_) => {}
                    other => self.kept.push_back(other),
                }
            }
            idle_rounds = if idle { idle_rounds + 1 } else { 0 };
            if idle {
                // Only if the sensor is still there, and has not got another one
                if self.status()?.calibration != Some(crc) {
                    break;
                }
            }
        }
        Err(ClientError::NoAnswer("calibration"))
    }

    /// What is answered to a hello.
    fn say_hello(&mut self) -> Result<Option<Hello>, ClientError> {
        let ours = Hello::new(super::program_version(), MOST_LASERS as u16);
        self.ask(&Message::Hello(ours), |message| match message {
            Message::Hello(hello) => Some(*hello),
            _ => None,
        })
    }

    /// The sensor's last word on a transfer.
    fn last_reply(&mut self, crc: u32) -> Result<Option<TransferState>, ClientError> {
        let mut last = None;
        let mut until = self.clock.now() + PATIENCE;
        while let Some(message) = self.next_fresh(until)? {
            match message {
                Message::CalibrationReply(reply) if reply.crc == crc => {
                    let over = !matches!(reply.state, TransferState::Missing(_));
                    last = Some(reply.state);
                    if over {
                        break;
                    }
                    until = self.clock.now() + QUIET;
                }
                Message::CalibrationReply(_) => {}
                other => self.kept.push_back(other),
            }
        }
        Ok(last)
    }

    /// Sends a question until its answer comes. None: it does not.
    fn ask<T>(
        &mut self,
        question: &Message,
        mut answer: impl FnMut(&Message) -> Option<T>,
    ) -> Result<Option<T>, ClientError> {
        for _ in 0..TRIES {
            self.send(question)?;
            let until = self.clock.now() + PATIENCE;
            while let Some(message) = self.next_fresh(until)? {
                if let Some(answer) = answer(&message) {
                    return Ok(Some(answer));
                }
                self.kept.push_back(message);
            }
        }
        Ok(None)
    }

    fn next_fresh(&mut self, until: Duration) -> Result<Option<Message>, ClientError> {
        loop {
            if let Some(message) = self.fresh.pop_front() {
                return Ok(Some(message));
            }
            if self.clock.now() >= until {
                return Ok(None);
            }
            let mut chunk = [0; 256];
            match self.line.read(&mut chunk) {
                Ok(0) => return Err(io::Error::from(ErrorKind::UnexpectedEof).into()),
                Ok(count) => {
                    self.bytes += count;
                    self.decoder.feed(&chunk[..count], |message| self.fresh.push_back(message));
                }
                Err(error)
                    if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                }
                Err(error) => return Err(error.into()),
            }
        }
    }
}
