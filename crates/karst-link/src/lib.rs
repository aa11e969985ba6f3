#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

mod calibration;
mod checksum;
mod decoder;
mod encoder;
mod message;
mod sequence;
mod version;

pub use calibration::{
    CalibrationPart, CalibrationReceiver, CalibrationReply, CalibrationSender, MAX_MISSING, Progress, TransferError,
    TransferState, calibration_crc,
};
pub use decoder::{Decoder, Incoming, LinkCounters};
pub use encoder::{BufferTooSmall, Encoder, MAX_FRAME};
pub use message::{
    Command, Errors, FrameEnd, LaserResult, LaserSpot, Log, LogLevel, LogText, MAX_LOG_TEXT, Message, Mode, Request,
    Settings, Status,
};
pub use version::{Hello, Incompatible, OLDEST_PROTOCOL, PROTOCOL};
