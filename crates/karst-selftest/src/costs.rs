//! What each step costs in instructions.

use core::hint::black_box;

use karst_core::{BeamRay, Method, reconstruct};
use karst_link::{Decoder, Encoder, LaserResult, MAX_FRAME, Message};
use karst_math::{azimuth, div_round, horner_with_derivative, hypot, sqrt_round};

use crate::frame::{Scene, new_detector};
use crate::kernels::Random;
use crate::recording::{LASERS, Recording};

/// Operands per kernel.
const OPERANDS: u32 = 256;

/// Counts instructions on a recording, whose first twelve frames are the spots of twelve lasers, one per camera.
/// `instructions` reads a counter; `report` gets the name of a step and the most instructions it took.
pub fn costs(recording: &[u8], instructions: impl Fn() -> u32, mut report: impl FnMut(&str, u32)) {
    let read = || {
        let start = instructions();
        instructions().wrapping_sub(start)
    };
    let overhead = read();
    let count = |mut step: &mut dyn FnMut()| {
        let start = instructions();
        black_box(&mut step)();
        instructions().wrapping_sub(start).saturating_sub(overhead)
    };
    // What the call of an empty step takes is no step's own
    let call = count(&mut || {});
    let count = |step: &mut dyn FnMut()| count(step) - call;

    let mut kernel = |name: &str, kernel: &dyn Fn(&mut Random) -> u32| {
        let mut random = Random::new();
        report(name, (0..OPERANDS).map(|_| kernel(&mut random)).max().unwrap_or(0));
    };
    kernel("sqrt_round", &|random| {
        let n = random.u64();
        count(&mut || _ = black_box(sqrt_round(n)))
    });
    kernel("hypot", &|random| {
        let (x, y) = (random.i32(), random.i32());
        count(&mut || _ = black_box(hypot(x, y)))
    });
    kernel("div_round", &|random| {
        let (n, d) = (random.i64(), random.i64());
        count(&mut || _ = black_box(div_round(n, d)))
    });
    kernel("horner_with_derivative of 5 coefficients", &|random| {
        let coefficients: [i32; 5] = core::array::from_fn(|_| random.i32());
        let s = random.i32();
        count(&mut || _ = black_box(horner_with_derivative(&coefficients, s)))
    });
    kernel("azimuth", &|random| {
        let (x, y) = (random.i32(), random.i32());
        count(&mut || _ = black_box(azimuth(x, y)))
    });

    let (mut ray, mut weighted, mut paper) = (0, 0, 0);
    let (mut weighted_section, mut paper_section) = (0, 0);
    let (mut encode, mut decode) = (0, 0);
    let mut recording = Recording::new(recording);
    while let Some(case) = recording.next_case(|_| {}) {
        let ([[a], [_]], Some(beam)) = (case.spots(), case.calibration.lasers.get(usize::from(case.laser))) else {
            continue;
        };
        let camera = &case.calibration.cameras[0];
        let beam_ray = || BeamRay::of_position(camera, &beam.cameras[0], &a.position);
        ray = count(&mut || _ = black_box(beam_ray())).max(ray);
        let point = |method| {
            count(&mut || _ = black_box(reconstruct(case.calibration, case.laser.into(), case.spots(), method)))
        };
        let (by_weights, by_paper) = (point(Method::Weighted), point(Method::Paper));
        (weighted, paper) = (by_weights.max(weighted), by_paper.max(paper));
        if case.frame < LASERS as u32 {
            weighted_section += by_weights;
            paper_section += by_paper;
        }

        let result = reconstruct(case.calibration, case.laser.into(), case.spots(), Method::Weighted);
        let message = Message::Laser(LaserResult { frame: case.frame, laser: case.laser, result });
        let (mut encoder, mut buffer) = (Encoder::new(), [0; MAX_FRAME]);
        encode = count(&mut || _ = black_box(encoder.encode(&message, &mut buffer))).max(encode);
        let Ok(frame) = encoder.encode(&message, &mut buffer) else { continue };
        let mut decoder = Decoder::<Message>::new();
        decode = count(&mut || decoder.feed(frame, |message| _ = black_box(message))).max(decode);
    }
    report("ray from pixel to beam frame", ray);
    report("point of one laser, weighted", weighted);
    report("point of one laser, paper", paper);
    report("24 rays and 12 points, weighted", weighted_section);
    report("24 rays and 12 points, paper", paper_section);
    report("encode a point", encode);
    report("decode a point", decode);

    let Some(mut detector) = new_detector() else { return };
    detector.start_frame();
    let dark = [0; 3 * 192];
    let mut row = |row: &[u8]| count(&mut || _ = black_box(detector.row(row)));
    // The first row is one of those that are sampled for the background
    report("detector, dark row of 192 px, sampled", row(&dark));
    report("detector, dark row of 192 px", row(&dark));
    detector.start_frame();
    let mut scene = Scene::new();
    let frame = (0..scene.rows()).map(|y| {
        let row = scene.row(y);
        count(&mut || _ = black_box(detector.row(row)))
    });
    report("detector, made-up frame of 192 x 144 px", frame.sum());
}
