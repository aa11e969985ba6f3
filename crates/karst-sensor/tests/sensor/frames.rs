//! Frames in, messages out.

use karst_core::Method;
use karst_link::{LaserResult, Message, Mode, Settings};

use crate::bench::*;

fn with_settings(mode: Mode, method: Method, spots: bool) -> Bench {
    let mut bench = Bench::calibrated();
    bench.send(&Message::Settings(Settings { mode, method, spots, lasers: true, ..Settings::default() }));
    bench.poll();
    bench
}

#[test]
fn points_of_both_modes_and_methods_are_those_of_the_crate_bit_for_bit() {
    for (mode, method, spots) in [
        (Mode::Accelerated, Method::Weighted, false),
        (Mode::Software, Method::Weighted, false),
        (Mode::Accelerated, Method::Paper, true),
        (Mode::Software, Method::Paper, true),
    ] {
        let mut bench = with_settings(mode, method, spots);
        let mut points = 0;
        for frame in FRAMES.iter() {
            bench.expose(frame, usize::MAX);
            let messages = bench.poll();
            let [(results, end)] = &frames(&messages)[..] else { panic!("{messages:?}") };
            let found: Vec<_> = results.iter().map(|LaserResult { result, .. }| *result).collect();
            assert_eq!(found, expected(frame, method), "{mode:?} {method:?}");
            assert_eq!(usize::from(end.lasers), results.len());
            let sent_spots = messages.iter().filter(|m| matches!(m, Message::Spot(_))).count();
            assert_eq!((usize::from(end.spots), sent_spots > 0), (sent_spots, spots));
            points += found.iter().filter(|result| result.is_ok()).count();
        }
        assert!(points > 9 * FRAMES.len(), "{points}");
        let status = bench.status();
        assert_eq!((status.frames, status.points, status.dropped_frames), (FRAMES.len() as u32, points as u32, 0));
        assert_eq!(status.errors, Default::default());
    }
}

#[test]
fn modes_are_switched_between_two_frames() {
    let mut bench = with_settings(Mode::Accelerated, Method::Weighted, false);
    for (index, frame) in FRAMES.iter().enumerate() {
        let mode = if index % 2 == 0 { Mode::Software } else { Mode::Accelerated };
        bench.send(&Message::Settings(Settings { mode, ..Settings::default() }));
        bench.expose(frame, usize::MAX);
        let messages = bench.poll();
        let found: Vec<_> = frames(&messages)[0].0.iter().map(|result| result.result).collect();
        assert_eq!(found, expected(frame, Method::Weighted));
    }
}

#[test]
fn on_a_slow_line_frames_are_whole_and_those_left_out_are_counted() {
    let mut bench = with_settings(Mode::Accelerated, Method::Weighted, false);
    let mut said = Vec::new();
    for turn in 0..40 {
        if turn % 4 == 0 {
            bench.expose(&FRAMES[turn / 4 % FRAMES.len()], usize::MAX);
        }
        bench.world.borrow_mut().room = Some(40);
        said.extend(bench.poll());
    }
    bench.world.borrow_mut().room = None;
    // The one under way, the one that is ready, and the one that waits
    for _ in 0..3 {
        said.extend(bench.poll());
    }
    let status = bench.status();
    let whole = frames(&said);
    assert!(status.dropped_frames > 0, "{status:?}");
    assert_eq!(whole.len() as u32 + status.dropped_frames, 10);
    for (results, end) in whole {
        assert!(results.iter().all(|result| result.frame == end.frame));
        let frame = &FRAMES[(end.frame as usize - 1) % FRAMES.len()];
        let found: Vec<_> = results.iter().map(|result| result.result).collect();
        assert_eq!(found, expected(frame, Method::Weighted));
    }
}

#[test]
fn the_cameras_are_triggered_at_the_period_of_the_settings() {
    let mut bench = Bench::calibrated();
    bench.send(&Message::Settings(Settings { trigger_period_us: 33_000, ..Settings::default() }));
    for _ in 0..10_000 {
        bench.poll();
    }
    // One second of steps of 100 microseconds
    let exposures = bench.world.borrow().exposures;
    assert!((30..=31).contains(&exposures), "{exposures}");
}
