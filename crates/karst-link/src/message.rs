//! The messages.

use heapless::String;
use karst_core::{FrameStatus, Method, NoPoint, Point, Spot};
use serde::{Deserialize, Serialize};

use crate::calibration::{CalibrationPart, CalibrationReply};
use crate::decoder::LinkCounters;
use crate::version::Hello;

/// Everything that goes over the line. New messages are added at the end: an older receiver counts them as unknown.
///
/// The first ones, which go to the sensor, are those of [`Command`] in the same order, so that both have one encoding.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Message {
    /// Both ways: who is there.
    Hello(Hello),
    /// To the sensor: asks for something.
    Request(Request),
    /// Both ways: what the sensor shall do, or does.
    Settings(Settings),
    /// Both ways: a part of the calibration.
    Calibration(CalibrationPart),
    /// From the sensor: how a calibration transfer stands.
    CalibrationReply(CalibrationReply),
    /// From the sensor: a laser's point in a frame, or why there is none.
    Laser(LaserResult),
    /// From the sensor: a spot that a detector found, if the settings ask for spots.
    Spot(LaserSpot),
    /// From the sensor: the frame is complete.
    FrameEnd(FrameEnd),
    /// From the sensor: how it is.
    Status(Status),
    /// From the sensor: text for people.
    Log(Log),
}

/// The messages that go to the sensor: what its decoder looks for. Its encoding is that of [`Message`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// [`Message::Hello`].
    Hello(Hello),
    /// [`Message::Request`].
    Request(Request),
    /// [`Message::Settings`].
    Settings(Settings),
    /// [`Message::Calibration`].
    Calibration(CalibrationPart),
}

/// What can be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Request {
    /// Answered by [`Message::Hello`].
    Hello,
    /// Answered by [`Message::Status`].
    Status,
    /// Answered by [`Message::Settings`].
    Settings,
    /// Answered by all parts of the calibration in use, as [`Message::Calibration`].
    Calibration,
}

/// Where the points are computed. Both give the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mode {
    /// By the reconstructor of the gateware.
    #[default]
    Accelerated,
    /// By the CPU.
    Software,
}

/// What the sensor does. Takes effect at the start of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings {
    /// Where the points are computed.
    pub mode: Mode,
    /// How the estimates become a point.
    pub method: Method,
    /// Whether the spots are sent as well.
    pub spots: bool,
    /// Whether the lasers are on.
    pub lasers: bool,
    /// Time between two exposures, microseconds; zero: the cameras run on their own.
    pub trigger_period_us: u32,
}

/// The result of one laser in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LaserResult {
    /// Number of the frame, rising by one per frame, wrapping.
    pub frame: u32,
    /// Index of the laser.
    pub laser: u16,
    /// The point, or why there is none.
    pub result: Result<Point, NoPoint>,
}

/// A spot in one camera's image. With all spots of a frame, `karst_core::reconstruct` can be repeated elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LaserSpot {
    /// Number of the frame.
    pub frame: u32,
    /// Camera, 0 or 1.
    pub camera: u8,
    /// Index of the laser.
    pub laser: u16,
    /// The spot.
    pub spot: Spot,
}

/// Closes a frame: what of it has been sent before, and what happened to its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameEnd {
    /// Number of the frame.
    pub frame: u32,
    /// Lasers: a receiver with as many [`Message::Laser`] has the whole frame.
    pub lasers: u16,
    /// Spots sent.
    pub spots: u16,
    /// What the two detectors counted.
    pub detectors: [FrameStatus; 2],
}

/// How the sensor is. Counters run since its start and stay at their top value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// Time since the start, ms, wrapping.
    pub uptime_ms: u32,
    /// Frames measured.
    pub frames: u32,
    /// Frames dropped because the one before was not done.
    pub dropped_frames: u32,
    /// Points sent.
    pub points: u32,
    /// What has gone wrong since the last status.
    pub errors: Errors,
    /// The sensor's receiver.
    pub link: LinkCounters,
    /// CRC of the calibration in use; None: there is none, and no points.
    pub calibration: Option<u32>,
}

/// Kinds of trouble, true if it happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Errors {
    /// A frame had fewer rows than the image, or damaged ones.
    pub truncated_frame: bool,
    /// A camera sent no frame, or stopped within one.
    pub stuck_camera: bool,
    /// No spot in a whole frame.
    pub no_spots: bool,
    /// A detector had to drop hits.
    pub detector_overflow: bool,
    /// A calibration was refused.
    pub bad_calibration: bool,
    /// Frames of the link were lost or corrupt.
    pub link: bool,
    /// A register did not answer, or not as it must.
    pub bus: bool,
    /// The watchdog has restarted the sensor.
    pub watchdog: bool,
    /// The self-test at the start failed.
    pub self_test: bool,
}

/// Most bytes of a log text.
pub const MAX_LOG_TEXT: usize = 96;

/// A log text: UTF-8.
pub type LogText = String<MAX_LOG_TEXT>;

/// How much a log text matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LogLevel {
    /// For developers.
    Debug,
    /// For everyone.
    Info,
    /// Something to look after.
    Warning,
    /// Something failed.
    Error,
}

/// A text for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Log {
    /// How much it matters.
    pub level: LogLevel,
    /// What happened.
    pub text: LogText,
}
