#![doc = include_str!("../README.md")]

mod record;

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use clap::Parser;
use karst_link::{Decoder, Message};

#[derive(Debug, Parser)]
#[command(about = "Holds what the firmware computes against the crates on the PC")]
enum Command {
    /// Write a recording for the self-test
    Record {
        /// The recording
        file: PathBuf,
    },
    /// Compare what a target has sent with the same computation here
    Compare {
        /// What the target was given
        recording: PathBuf,
        /// What it has sent
        results: PathBuf,
    },
}

fn main() -> anyhow::Result<()> {
    match Command::parse() {
        Command::Record { file } => {
            std::fs::write(&file, record::recording()?).with_context(|| format!("cannot write {}", file.display()))
        }
        Command::Compare { recording, results } => compare(&read(&recording)?, &read(&results)?),
    }
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Fewest reconstructions that count as a comparison.
const LEAST_POINTS: usize = 1000;

fn compare(recording: &[u8], results: &[u8]) -> anyhow::Result<()> {
    let mut expected = Vec::new();
    karst_selftest::check(recording, |message| expected.push(message));
    let (mut decoder, mut found) = (Decoder::new(), Vec::new());
    decoder.feed(results, |message| found.push(message));
    for (i, (expected, found)) in expected.iter().zip(&found).enumerate() {
        ensure!(expected == found, "message {i} is\n  {found:?}\nhere it is\n  {expected:?}");
    }
    ensure!(
        expected.len() == found.len(),
        "{} messages, here {}; the link counts {:?}",
        found.len(),
        expected.len(),
        decoder.counters()
    );
    let points = found.iter().filter(|m| matches!(m, Message::Laser(laser) if laser.result.is_ok())).count();
    let spots = found.iter().filter(|m| matches!(m, Message::Spot(_))).count();
    ensure!(points >= LEAST_POINTS && spots > 0, "only {points} points and {spots} spots to compare");
    println!("{} messages are the same, {points} points and {spots} spots among them", found.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use karst_link::Encoder;

    /// What a target sends that computes what the PC does.
    fn sent(recording: &[u8]) -> Vec<Message> {
        let mut messages = Vec::new();
        karst_selftest::check(recording, |message| messages.push(message));
        messages
    }

    fn stream(messages: &[Message]) -> Vec<u8> {
        let mut encoder = Encoder::new();
        messages.iter().flat_map(|m| encoder.encode(m, &mut [0; 256]).unwrap().to_vec()).collect()
    }

    #[test]
    fn the_self_test_covers_points_by_both_methods_reasons_for_none_and_the_detector() {
        let recording = record::recording().unwrap();
        let messages = sent(&recording);
        let lasers: Vec<_> =
            messages.iter().filter_map(|m| if let Message::Laser(l) = m { Some(l) } else { None }).collect();
        let weighted = lasers.iter().filter(|l| l.result.is_ok_and(|p| p.sigma.is_some())).count();
        let paper = lasers.iter().filter(|l| l.result.is_ok_and(|p| p.sigma.is_none())).count();
        let without = lasers.iter().filter(|l| l.result.is_err()).count();
        assert!(weighted >= 1000 && paper >= 1000 && without >= 100, "{weighted} {paper} {without}");
        let spots = messages.iter().filter(|m| matches!(m, Message::Spot(_))).count();
        assert!(spots >= 20, "{spots}");
    }

    #[test]
    fn one_wrong_bit_in_one_result_is_found() {
        let recording = record::recording().unwrap();
        let mut messages = sent(&recording);
        assert!(compare(&recording, &stream(&messages)).is_ok());
        let wrong = messages.iter_mut().rev().find_map(|message| match message {
            Message::Laser(laser) => laser.result.as_mut().ok(),
            _ => None,
        });
        wrong.unwrap().position[2] += karst_core::I18F14::DELTA;
        assert!(compare(&recording, &stream(&messages)).is_err());
        messages.pop();
        assert!(compare(&recording, &stream(&messages)).is_err());
    }
}
