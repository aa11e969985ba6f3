#![doc = include_str!("README.md")]

mod bench;

pub use bench::{Bench, Noise, pictures};
