//! What goes wrong is survived, counted and told by the sensor as it is built; nothing wrong is given as a point.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use image::{Rgb, RgbImage};
use karst::sensor::{Pace, SensorFrame};
use karst_link::Settings;
use karst_scenarios::{Bench, pictures};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Rows of a whole picture.
const ALL: usize = usize::MAX;

/// A frame's time at one pixel per clock, and as much again.
const FRAME: Duration = Duration::from_millis(20);

fn images() -> [RgbImage; 2] {
    let [images] = pictures(1).try_into().expect("one pair");
    images
}

fn points(frame: &SensorFrame) -> usize {
    frame.section.lasers.iter().filter(|laser| laser.point.is_some()).count()
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn a_truncated_frame_is_told_and_gives_no_points() {
    let images = images();
    let mut bench = Bench::calibrated();
    bench.expose(&images, [300, 300]);
    // The next frame's start ends the truncated one
    bench.measures_on(&images);
    assert!(bench.told().iter().any(|errors| errors.truncated_frame));
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn half_a_frame_of_one_camera_is_never_paired_with_the_next_one() {
    let images = images();
    let mut bench = Bench::calibrated();
    bench.expose(&images, [ALL, 300]);
    assert!(bench.wait(FRAME).is_empty());
    bench.measures_on(&images);
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn dark_pictures_give_reasons_instead_of_points() {
    let images = images();
    let mut bench = Bench::calibrated();
    bench.expose(&images.each_ref().map(|image| RgbImage::new(image.width(), image.height())), [ALL; 2]);
    let frame = bench.frame();
    assert!(frame.complete && points(&frame) == 0, "{frame:?}");
    assert!(bench.told().iter().any(|errors| errors.no_spots));
    bench.measures_on(&images);
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn an_overflow_of_the_detector_is_told() {
    let images = images();
    let mut bench = Bench::calibrated();
    let mut crowded = images.clone();
    for (x, y, pixel) in crowded[0].enumerate_pixels_mut() {
        // Dots farther apart than a cluster's gap
        let dot = x % 12 < 3 && y % 12 < 3;
        *pixel = if dot { Rgb([10, 250, 10]) } else { Rgb([0; 3]) };
    }
    bench.expose(&crowded, [ALL; 2]);
    bench.frame();
    assert!(bench.told().iter().any(|errors| errors.detector_overflow));
    bench.measures_on(&images);
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn a_restart_in_mid_frame_forgets_the_frame() {
    let images = images();
    let mut bench = Bench::calibrated();
    bench.expose(&images, [300, 300]);
    assert!(bench.wait(FRAME).is_empty());
    bench.soc.soc_mut().reset(10).expect("a simulation");
    // It has no calibration, and so it gives nothing
    assert!(bench.wait(FRAME).is_empty());
    bench.calibrate(Settings { lasers: true, ..Settings::default() });
    bench.measures_on(&images);
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn noise_on_the_line_costs_messages_and_never_truth() {
    let pairs = vec![images(); 3];
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    // A calibration gets through as well, in seconds of the sensor's time: that is for faster simulations
    let is_noisy = Rc::new(Cell::new(false));
    let noisy = is_noisy.clone();
    let noise = move |bytes: &mut [u8]| {
        for byte in bytes {
            if noisy.get() && rng.random_bool(0.01) {
                *byte ^= rng.random_range(1..=255_u8);
            }
        }
    };
    let mut bench = Bench::with_noise(Pace::Patient, pairs.clone(), Some(Box::new(noise)));
    bench.calibrate(Settings { lasers: true, ..Settings::default() });
    is_noisy.set(true);
    let frames = bench.wait(2 * FRAME);
    assert!(!frames.is_empty());
    for frame in frames {
        let expected = bench.expected(frame.number, &pairs[0], Settings::default().method);
        for (found, expected) in frame.section.lasers.iter().zip(&expected.lasers) {
            assert!(found.point.is_none() || found.point == expected.point, "{found:?} instead of {expected:?}");
        }
    }
    let link = bench.client.counters();
    assert!(link.corrupt > 0, "{link:?}");
}
