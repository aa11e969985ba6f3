#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

mod costs;
mod frame;
mod kernels;
mod recording;

use karst_core::{Method, reconstruct};
use karst_link::{LaserResult, Message};

pub use costs::costs;
pub use frame::{Scene, new_detector};
pub use recording::{LASERS, LaserCase, Recording};

/// Both methods, in the order in which [`check`] sends their results.
const METHODS: [Method; 2] = [Method::Weighted, Method::Paper];

/// Runs everything once and sends the results.
pub fn check(recording: &[u8], mut send: impl FnMut(Message)) {
    let mut recording = Recording::new(recording);
    while let Some(case) = recording.next_case(|reply| send(Message::CalibrationReply(reply))) {
        for method in METHODS {
            let result = reconstruct(case.calibration, case.laser.into(), case.spots(), method);
            send(Message::Laser(LaserResult { frame: case.frame, laser: case.laser, result }));
        }
    }
    kernels::check(|log| send(Message::Log(log)));
    frame::check(send);
}
