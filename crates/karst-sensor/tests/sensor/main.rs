//! The sensor against the software model of the IP: what a host sees on the line.

mod bench;
mod calibration;
mod faults;
mod frames;
