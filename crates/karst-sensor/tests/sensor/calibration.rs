//! Calibrations and settings over the line.

use karst_core::{FixedRig, I18F14, Method};
use karst_link::{CalibrationReceiver, CalibrationSender, Message, Mode, Request, Settings, TransferState};
use karst_regs::RigWords;
use karst_sensor::Start;

use crate::bench::*;

/// A rig with another working range.
fn other() -> FixedRig<LASERS> {
    let mut other = RIG.clone();
    other.calibration.settings.range[1] = I18F14::from_num(1000);
    other
}

#[test]
fn without_a_calibration_there_are_no_points() {
    let mut bench = Bench::new(Start::default(), World::default());
    bench.poll();
    bench.expose(&FRAMES[0], usize::MAX);
    assert!(frames(&bench.poll()).is_empty());
    assert_eq!(bench.status().calibration, None);
    bench.send_rig(&RIG);
    bench.poll();
    assert_eq!(bench.status().calibration, Some(CalibrationSender::new(&RIG).crc()));
}

#[test]
fn the_lasers_are_off_until_the_settings_say_on() {
    let mut bench = Bench::new(Start::default(), World { lasers_on: true, ..World::default() });
    assert!(!bench.world.borrow().lasers_on);
    for lasers in [true, false] {
        bench.send(&Message::Settings(Settings { lasers, ..Settings::default() }));
        bench.poll();
        assert_eq!(bench.world.borrow().lasers_on, lasers);
    }
}

#[test]
fn the_calibration_and_the_settings_in_use_are_read_back() {
    let mut bench = Bench::calibrated();
    let settings = Settings { mode: Mode::Software, spots: true, ..Settings::default() };
    bench.send(&Message::Settings(settings));
    assert!(bench.poll().contains(&Message::Settings(settings)));
    bench.send(&Message::Request(Request::Calibration));
    let mut receiver = CalibrationReceiver::<LASERS>::new();
    for message in bench.poll() {
        if let Message::Calibration(part) = message {
            receiver.accept(&part).unwrap();
        }
    }
    assert_eq!(receiver.complete().map(|(words, _)| words), Some(&RigWords::from(&*RIG)));
}

#[test]
fn a_new_calibration_takes_effect_between_two_frames() {
    for mode in [Mode::Accelerated, Mode::Software] {
        let mut bench = Bench::calibrated();
        bench.send(&Message::Settings(Settings { mode, ..Settings::default() }));
        bench.poll();
        // A frame is under way: half of it belongs to no other calibration
        let half = FRAMES[0].images[0].height() as usize / 2;
        let rows = |bench: &Bench, from: usize, to: usize| {
            let model = &mut bench.world.borrow_mut().model;
            for y in from..to {
                for camera in 0..2 {
                    let image = &FRAMES[0].images[camera];
                    let width = 3 * image.width() as usize;
                    model.row(camera, y == 0, &image.as_raw()[y * width..(y + 1) * width]);
                }
            }
        };
        rows(&bench, 0, half);
        bench.send_rig(&other());
        let messages = bench.poll();
        assert!(
            messages.iter().any(|m| matches!(m, Message::CalibrationReply(r) if r.state == TransferState::Complete))
        );
        rows(&bench, half, 2 * half);
        let before: Vec<_> = frames(&bench.poll()).iter().flat_map(|(results, _)| results.clone()).collect();
        match mode {
            Mode::Accelerated => {
                let found: Vec<_> = before.iter().map(|result| result.result).collect();
                assert_eq!(found, expected(&FRAMES[0], Method::Weighted));
            }
            // What it was measured with is gone
            Mode::Software => assert_eq!((before.len(), bench.status().dropped_frames), (0, 1)),
        }
        bench.expose(&FRAMES[0], usize::MAX);
        let after = frames(&bench.poll());
        let [(results, _)] = &after[..] else { panic!("{after:?}") };
        let points = results.iter().filter_map(|result| result.result.ok());
        assert!(points.clone().count() < 12);
        assert!(points.into_iter().all(|point| point.along <= I18F14::from_num(1000)));
    }
}

#[test]
fn a_transfer_that_stops_leaves_the_calibration_in_use() {
    let mut bench = Bench::calibrated();
    for part in CalibrationSender::new(&other()).parts().take(9) {
        bench.send(&Message::Calibration(part));
    }
    bench.poll();
    bench.wait(60_000_000);
    bench.expose(&FRAMES[1], usize::MAX);
    let found: Vec<_> = frames(&bench.poll())[0].0.iter().map(|result| result.result).collect();
    assert_eq!(found, expected(&FRAMES[1], Method::Weighted));
}
