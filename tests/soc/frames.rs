//! Pictures in, points out.

use karst::sensor::soc::CLOCKS_PER_BIT;
use karst::sensor::{FrameClocks, Pace};
use karst_core::Method;
use karst_cycles::{PROCESSOR, Processor};
use karst_link::{Mode, Settings};
use karst_scenarios::{Bench, pictures};

/// Most clocks from the last pixel to the first byte on the line, by mode.
const MOST_TO_FIRST_BYTE: [(Mode, u64); 2] = [(Mode::Accelerated, 20_000), (Mode::Software, 240_000)];

/// The cycle model's clocks from the last pixel to the first and the last byte of a frame with all points, in messages as
/// long as these are: within 2 %.
fn assert_predicted(mode: Mode, lasers: u64, clocks: FrameClocks) {
    let processor = Processor { laser_bytes: (clocks.bytes - PROCESSOR.end_bytes) / lasers, ..PROCESSOR };
    let predicted = processor.frame(mode, lasers, CLOCKS_PER_BIT.into());
    for (measured, after_results) in
        [(clocks.to_first_byte, predicted.first_byte), (clocks.to_last_byte, predicted.last_byte)]
    {
        let predicted = clocks.to_results + after_results;
        assert!(measured.abs_diff(predicted) * 50 <= measured, "{predicted} predicted, {mode:?} {clocks:?}");
    }
}

/// Points of both modes, and methods, against those of `karst reconstruct`. Nothing may be dropped or damaged.
fn compare(count: usize, methods: &[Method]) {
    let frames = pictures(count);
    for &method in methods {
        for (mode, most_clocks) in MOST_TO_FIRST_BYTE {
            let mut bench = Bench::new(Pace::Patient, frames.clone());
            bench.calibrate(Settings { mode, method, lasers: true, ..Settings::default() });
            let (mut points, mut full) = (0, Vec::new());
            for (number, images) in (1..).zip(&frames) {
                let frame = bench.frame();
                assert!(frame.complete);
                assert_eq!(frame.section, bench.expected(number, images, method), "{mode:?}");
                let found = frame.section.lasers.iter().filter(|laser| laser.point.is_some()).count();
                points += found;
                full.push(found == frame.section.lasers.len());
            }
            assert!(points > 8 * count, "{points}");
            let status = bench.status();
            assert_eq!((status.frames, status.points, status.dropped_frames), (count as u32, points as u32, 0));
            assert_eq!(status.errors, Default::default());
            let clocks = bench.soc.frames();
            assert_eq!(clocks.len(), count);
            assert!(full.contains(&true), "no frame with all points to hold the prediction against");
            for (clocks, is_full) in clocks.into_iter().zip(full) {
                println!("{mode:?} {method:?} {clocks:?}");
                assert!(clocks.to_first_byte <= most_clocks, "{mode:?} {clocks:?}");
                if is_full && method == Method::Weighted {
                    assert_predicted(mode, bench.rig().calibration.lasers.len() as u64, clocks);
                }
            }
        }
    }
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn points_of_both_modes_are_those_of_reconstruct_bit_for_bit() {
    compare(1, &[Method::Weighted]);
}

#[test]
#[ignore = "needs the simulated SoC, and long: tests/README.md"]
fn full_points_of_twenty_pictures_are_those_of_reconstruct_bit_for_bit() {
    compare(20, &[Method::Weighted, Method::Paper]);
}
