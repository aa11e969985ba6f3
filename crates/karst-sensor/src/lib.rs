#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

mod frame;
mod report;
mod self_test;
mod sensor;
mod trigger;

pub use sensor::{Parts, Sensor, Start};

#[cfg(test)]
extern crate std;
