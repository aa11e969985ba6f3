//! What goes wrong is survived, counted and told; nothing wrong is given as a point.

use karst_core::{Method, RigError};
use karst_link::{CalibrationSender, Errors, Message, Mode, Request, Settings, TransferError, TransferState};
use karst_sensor::Start;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bench::*;

/// After the trouble the next frame is measured as ever.
fn measures_on(bench: &mut Bench) {
    bench.expose(&FRAMES[0], usize::MAX);
    // One frame at a time, if another one waits
    let all: Vec<_> = (0..2).flat_map(|_| frames(&bench.poll())).collect();
    let (results, _) = all.last().expect("a frame");
    let found: Vec<_> = results.iter().map(|result| result.result).collect();
    assert_eq!(found, expected(&FRAMES[0], Method::Weighted));
}

fn only(set: impl Fn(&mut Errors)) -> Errors {
    let mut errors = Errors::default();
    set(&mut errors);
    errors
}

#[test]
fn a_truncated_frame() {
    let mut bench = Bench::calibrated();
    bench.expose(&FRAMES[1], 300);
    // The next frame's start ends the truncated one
    measures_on(&mut bench);
    let status = bench.status();
    assert_eq!(status.errors, only(|e| e.truncated_frame = true));
    assert_eq!(bench.status().errors, Errors::default(), "told once");
}

#[test]
fn a_stuck_camera() {
    let mut bench = Bench::calibrated();
    measures_on(&mut bench);
    bench.expose(&FRAMES[1], 300);
    let texts = texts(&bench.wait(600_000));
    assert!(texts.iter().any(|text| text.contains("stuck")), "{texts:?}");
    // Half a frame of camera 2 is forgotten
    measures_on(&mut bench);
}

#[test]
fn no_camera_at_all() {
    let mut bench = Bench::calibrated();
    let mut said = Vec::new();
    for _ in 0..100 {
        said.extend(bench.wait(100_000));
    }
    let told = texts(&said).iter().filter(|text| text.contains("stuck")).count();
    assert_eq!(told, 1, "once, not every time");
    let stuck = |m: &&Message| matches!(m, Message::Status(status) if status.errors.stuck_camera);
    assert!(said.iter().filter(stuck).count() >= 8, "every status has the flag");
    measures_on(&mut bench);
}

#[test]
fn a_late_calibration_and_a_slow_trigger_are_no_stuck_camera() {
    let mut bench = Bench::new(Start::default(), World::default());
    bench.wait(3_000_000);
    bench.send_rig(&RIG);
    bench.poll();
    assert_eq!(bench.status().errors, Errors::default());
    bench.send(&Message::Settings(Settings { trigger_period_us: 2_000_000, ..Settings::default() }));
    bench.poll();
    bench.wait(1_900_000);
    assert_eq!(bench.status().errors, Errors::default());
    let texts = texts(&bench.wait(1_000_000));
    assert!(texts.iter().any(|text| text.contains("stuck")), "{texts:?}");
}

#[test]
fn no_lasers_visible() {
    let mut bench = Bench::calibrated();
    let mut dark = FRAMES[0].clone();
    dark.images.iter_mut().for_each(|image| image.fill(0));
    bench.expose(&dark, usize::MAX);
    let messages = bench.poll();
    let [(results, _)] = &frames(&messages)[..] else { panic!() };
    assert!(results.iter().all(|result| result.result.is_err()));
    assert_eq!(bench.status().errors, only(|e| e.no_spots = true));
    measures_on(&mut bench);
}

#[test]
fn a_detector_overflow() {
    let mut bench = Bench::calibrated();
    let mut crowded = FRAMES[0].clone();
    for (x, y, pixel) in crowded.images[0].enumerate_pixels_mut() {
        // Dots farther apart than a cluster's gap
        let dot = x % 12 < 3 && y % 12 < 3;
        pixel.0 = if dot { [10, 250, 10] } else { [0; 3] };
    }
    bench.expose(&crowded, usize::MAX);
    bench.poll();
    assert!(bench.status().errors.detector_overflow);
    measures_on(&mut bench);
}

#[test]
fn a_corrupt_calibration() {
    let mut bench = Bench::calibrated();
    let parts: Vec<_> = CalibrationSender::new(&RIG).parts().collect();
    // Damaged on the way past the CRC of the line: another value under the same name
    for mut part in parts.clone() {
        part.crc ^= 1;
        part.words[1] ^= 1;
        bench.send(&Message::Calibration(part));
    }
    let refused = |messages: &[Message], expected: fn(&TransferError) -> bool| {
        messages.iter().any(|message| match message {
            Message::CalibrationReply(reply) => matches!(&reply.state, TransferState::Refused(e) if expected(e)),
            _ => false,
        })
    };
    assert!(refused(&bench.poll(), |error| matches!(error, TransferError::Checksum { .. })));
    // Whole, but with a value that can not be
    let mut wrong = RIG.clone();
    wrong.calibration.lasers[3].direction_variance = u64::MAX;
    bench.send_rig(&wrong);
    let expected = |error: &TransferError| *error == TransferError::Rig(RigError::Uncertainty { laser: 3 });
    assert!(refused(&bench.poll(), expected));
    assert_eq!(bench.status().errors, only(|e| e.bad_calibration = true));
    measures_on(&mut bench);
}

#[test]
fn one_percent_byte_errors_on_the_line() {
    let mut bench = Bench::calibrated();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut damaged = 0;
    for _ in 0..10_000 {
        let mut bytes = bench.bytes_of(&Message::Request(Request::Settings));
        for byte in &mut bytes {
            if rng.random_bool(0.01) {
                *byte ^= rng.random_range(1..=255_u8);
                damaged += 1;
            }
        }
        bench.world.borrow_mut().to_sensor.extend(bytes);
        bench.poll();
    }
    let status = bench.status();
    assert!(damaged > 500 && status.link.corrupt > 300, "{damaged} {:?}", status.link);
    assert!(status.link.received > 8_000, "{:?}", status.link);
    measures_on(&mut bench);
}

#[test]
fn a_bus_error_at_any_access() {
    // How many accesses a frame takes
    let mut bench = Bench::calibrated();
    bench.expose(&FRAMES[0], usize::MAX);
    bench.world.borrow_mut().bus_fails_after = Some(u32::MAX);
    bench.poll();
    let accesses = u32::MAX - bench.world.borrow().bus_fails_after.unwrap();
    assert!(accesses > 100, "{accesses}");
    for fails_after in 0..accesses {
        let mut bench = Bench::calibrated();
        bench.expose(&FRAMES[0], usize::MAX);
        bench.world.borrow_mut().bus_fails_after = Some(fails_after);
        let given = frames(&bench.poll());
        // Whole or not at all
        for (results, _) in given {
            let found: Vec<_> = results.iter().map(|result| result.result).collect();
            assert_eq!(found, expected(&FRAMES[0], Method::Weighted));
        }
        bench.world.borrow_mut().bus_fails_after = None;
        assert!(bench.status().errors.bus, "{fails_after}");
        measures_on(&mut bench);
    }
}

/// Has one access fail without saying so, after as many others as asked for. `act` makes the accesses; gives how many.
fn accesses_of(act: impl Fn(&mut Bench)) -> u32 {
    let mut bench = Bench::calibrated();
    bench.world.borrow_mut().fails_unseen_after = Some(u32::MAX);
    act(&mut bench);
    let left = bench.world.borrow().fails_unseen_after.expect("not as many accesses");
    u32::MAX - left
}

#[test]
fn an_access_that_fails_unseen_while_a_frame_is_read_costs_nothing_but_time() {
    for mode in [Mode::Accelerated, Mode::Software] {
        let settings = Message::Settings(Settings { mode, lasers: true, ..Settings::default() });
        let read = |bench: &mut Bench| {
            bench.send(&settings);
            bench.expose(&FRAMES[0], usize::MAX);
            bench.poll()
        };
        let accesses = accesses_of(|bench| drop(read(bench)));
        assert!(accesses > 100, "{accesses}");
        for fails_after in 0..accesses {
            let mut bench = Bench::calibrated();
            bench.world.borrow_mut().fails_unseen_after = Some(fails_after);
            let mut said = read(&mut bench);
            for _ in 0..3 {
                said.extend(bench.poll());
            }
            let given = frames(&said);
            assert_eq!(given.len(), 1, "{mode:?}, access {fails_after}: {said:?}");
            let found: Vec<_> = given[0].0.iter().map(|result| result.result).collect();
            assert_eq!(found, expected(&FRAMES[0], Method::Weighted), "{mode:?}, access {fails_after}");
            let told = |m: &Message| matches!(m, Message::Log(log) if log.text.contains("register"));
            assert!(said.iter().any(told), "{mode:?}, access {fails_after}");
            assert_eq!(bench.status().errors, only(|e| e.bus = true), "{mode:?}, access {fails_after}");
            measures_on(&mut bench);
        }
    }
}

#[test]
fn an_access_that_fails_unseen_while_a_calibration_is_loaded_is_found() {
    // Another rig than the one in use: the points tell which one is
    let mut other = RIG.clone();
    other.calibration.lasers[0].origin[2] += 1 << 20;
    let load = |bench: &mut Bench| {
        bench.send_rig(&other);
        bench.poll();
    };
    let accesses = accesses_of(load);
    assert!(accesses > 1000, "{accesses}");
    // Every place on some way, and all of the last ones, which put it to use
    for fails_after in (0..accesses).filter(|access| access % 37 == 0 || accesses - access < 40) {
        let mut bench = Bench::calibrated();
        bench.send(&Message::Settings(Settings { mode: Mode::Software, lasers: true, ..Settings::default() }));
        bench.world.borrow_mut().fails_unseen_after = Some(fails_after);
        load(&mut bench);
        bench.poll();
        bench.poll();
        let status = bench.status();
        assert!(status.errors.bus, "access {fails_after}");
        assert_eq!(status.calibration, Some(CalibrationSender::new(&other).crc()), "access {fails_after}");
        bench.expose(&FRAMES[0], usize::MAX);
        let given = frames(&bench.poll());
        let [(results, _)] = &given[..] else { panic!("access {fails_after}: {given:?}") };
        assert!(results[0].result.is_ok() && results[0].result != expected(&FRAMES[0], Method::Weighted)[0]);
    }
}

#[test]
fn no_ip_is_told_and_the_line_works() {
    let mut bench = Bench::new(Start::default(), World { bus_fails_after: Some(0), ..World::default() });
    let texts = texts(&bench.poll());
    assert!(texts.iter().any(|text| text.contains("no IP")), "{texts:?}");
    bench.send_rig(&RIG);
    bench.poll();
    let status = bench.status();
    assert_eq!(status.calibration, None);
}

#[test]
fn a_restart_by_the_watchdog_or_in_mid_frame() {
    let bench = Bench::calibrated();
    // Power is lost with half a frame in the IP, which goes on
    bench.expose(&FRAMES[1], 300);
    let world = std::mem::take(&mut *bench.world.borrow_mut());
    let mut bench = Bench::new(Start { watchdog: true, ..Start::default() }, world);
    let messages = bench.poll();
    assert!(matches!(messages[0], Message::Hello(_)), "{messages:?}");
    let told = |m: &Message| matches!(m, Message::Status(status) if status.errors.watchdog);
    assert!(messages.iter().any(told));
    assert!(frames(&messages).is_empty());
    bench.send_rig(&RIG);
    bench.poll();
    measures_on(&mut bench);
}
