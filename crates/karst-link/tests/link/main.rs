//! Messages over good and bad lines.

mod calibration;
mod line;
mod messages;
