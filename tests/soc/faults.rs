//! What goes wrong is survived, counted and told by the sensor as it is built; nothing wrong is given as a point.

use std::cell::Cell;
use std::num::NonZeroU16;
use std::rc::Rc;
use std::time::Duration;

use image::{Rgb, RgbImage};
use karst::sensor::soc::CLOCKS_PER_US;
use karst::sensor::{ClientError, Pace, SensorFrame};
use karst_core::{Method, RigError};
use karst_link::{CalibrationSender, Message, Settings, TransferError, TransferState};
use karst_scenarios::{Bench, pictures};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Rows of a whole picture.
const ALL: usize = usize::MAX;

/// A frame's time at one pixel per clock, and as much again.
const FRAME: Duration = Duration::from_millis(20);

/// So many seconds of the sensor's time go by in as many hundredths of that, clock for clock: it is to think that a
/// microsecond is one clock.
fn wait_long(bench: &mut Bench, seconds: u32) -> Vec<SensorFrame> {
    let set = |bench: &Bench, clocks| bench.soc.soc_mut().set_clocks_per_us(clocks).expect("a simulation");
    set(bench, NonZeroU16::new(1));
    let frames = bench.wait(Duration::from_secs(seconds.into()) / CLOCKS_PER_US as u32);
    set(bench, None);
    frames
}

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
fn a_stuck_camera_is_told_and_its_half_frame_forgotten() {
    let images = images();
    let mut bench = Bench::calibrated();
    bench.measures_on(&images);
    bench.expose(&images, [ALL, 300]);
    assert!(bench.wait(FRAME).is_empty());
    assert!(wait_long(&mut bench, 2).is_empty());
    assert!(bench.log.iter().any(|text| text.contains("a camera is stuck")), "{:?}", bench.log);
    assert!(bench.told().iter().any(|errors| errors.stuck_camera));
    bench.measures_on(&images);
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn a_sensor_that_hangs_is_restarted_by_the_watchdog() {
    let images = images();
    let mut bench = Bench::calibrated();
    bench.measures_on(&images);
    bench.soc.soc_mut().hang_bus().expect("a simulation");
    bench.expose(&images, [ALL; 2]);
    assert!(wait_long(&mut bench, 3).is_empty());
    assert!(bench.log.iter().any(|text| text.contains("restarted by the watchdog")), "{:?}", bench.log);
    assert!(bench.told().iter().any(|errors| errors.watchdog));
    // As after any start: no calibration, no laser
    assert_eq!(bench.status().calibration, None);
    assert!(!bench.soc.soc().state().lasers);
    bench.calibrate(Settings { lasers: true, ..Settings::default() });
    bench.measures_on(&images);
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn an_access_that_goes_astray_is_told_and_costs_neither_frame_nor_truth() {
    let images = images();
    let mut bench = Bench::calibrated();
    // The first accesses of a frame, some of those that read points
    for (number, right_accesses) in (1..).zip([0, 1, 2, 3, 4, 5, 6, 20, 55, 90]) {
        bench.soc.soc_mut().fail_access(right_accesses).expect("a simulation");
        bench.expose(&images, [ALL; 2]);
        let frame = bench.frame();
        assert_eq!(frame.number, number, "after {right_accesses}");
        let expected = bench.expected(number, &images, Settings::default().method);
        assert_eq!(frame.section, expected, "after {right_accesses}");
        assert!(bench.told().iter().any(|errors| errors.bus), "after {right_accesses}");
        assert_eq!(bench.status().frames, number, "after {right_accesses}");
    }
    // A word that is written, and one that is read back
    for (method, right_accesses) in [(Method::Paper, 100), (Method::Weighted, 1000)] {
        bench.soc.soc_mut().fail_access(right_accesses).expect("a simulation");
        bench.set(Settings { method, lasers: true, ..Settings::default() });
        bench.wait(FRAME);
        assert!(bench.told().iter().any(|errors| errors.bus), "{method:?}");
        bench.measures_on(&images);
    }
}

#[test]
#[ignore = "needs the simulated SoC: tests/README.md"]
fn a_corrupt_calibration_is_refused_and_the_one_before_stays() {
    let images = images();
    let mut bench = Bench::calibrated();
    let crc = bench.status().calibration;
    // Damaged on the way past the CRC of the line: another value under another name
    for mut part in CalibrationSender::new(bench.rig()).parts() {
        part.crc ^= 1;
        part.words[1] ^= 1;
        bench.client.send(&Message::Calibration(part)).expect("a line");
    }
    bench.wait(FRAME);
    let refused = |state: &TransferState| matches!(state, TransferState::Refused(TransferError::Checksum { .. }));
    assert!(bench.transfers.iter().any(refused), "{:?}", bench.transfers);
    assert!(bench.told().iter().any(|errors| errors.bad_calibration));
    bench.measures_on(&images);
    // Whole, but with a value that can not be
    let mut wrong = bench.rig().clone();
    wrong.calibration.lasers[3].direction_variance = u64::MAX;
    let answer = bench.client.set_calibration(&wrong, |_, _| {});
    let reason = TransferError::Rig(RigError::Uncertainty { laser: 3 });
    assert!(matches!(&answer, Err(ClientError::Refused(found)) if *found == reason), "{answer:?}");
    assert!(bench.told().iter().any(|errors| errors.bad_calibration));
    assert_eq!(bench.status().calibration, crc);
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
