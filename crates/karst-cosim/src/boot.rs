//! The firmware's start in the simulated SoC.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, ensure};
use karst_cosim::soc::{CLOCKS_PER_US, Soc};
use karst_link::{Decoder, Message};

/// Microseconds in which the firmware has to say hello.
const MOST_US: u64 = 100_000;

/// Runs the firmware until it has said hello and told its status.
pub fn run(executable: &Path, image: &Path) -> anyhow::Result<()> {
    let program = std::fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
    let mut soc = Soc::new(executable, &program)?;
    let mut decoder: Decoder = Decoder::new();
    let (mut hello, mut status) = (false, false);
    let start = Instant::now();
    while !(hello && status) {
        let clock = soc.step(10 * CLOCKS_PER_US)?.clock;
        ensure!(clock < MOST_US * CLOCKS_PER_US, "no hello and status within {MOST_US} us");
        for byte in soc.received() {
            let Some(message) = decoder.push(byte.byte) else { continue };
            println!("{:>8} us  {message:?}", byte.clock / CLOCKS_PER_US);
            match message {
                Message::Hello(_) => hello = true,
                Message::Status(told) => {
                    status = true;
                    ensure!(!told.errors.self_test, "the firmware failed its self-test");
                }
                _ => {}
            }
        }
    }
    let clocks = soc.state().clock;
    println!("{clocks} clocks, {:.2} million per second", clocks as f64 / 1e6 / start.elapsed().as_secs_f64());
    Ok(())
}
