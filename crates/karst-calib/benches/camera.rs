//! `cargo bench -p karst-calib`: the corners of one picture, and a whole camera calibration from those of 20 views.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/common/paint.rs"]
mod paint;

use std::error::Error;
use std::time::Instant;

use karst_calib::{CameraSettings, calibrate_camera, find_corners};
use paint::{BOARD, paint, poses};

/// Searches in the picture.
const REPEATS: u32 = 10;

fn main() -> Result<(), Box<dyn Error>> {
    let picture = paint(&common::truth(), &poses()[0], &BOARD, 2.0);
    let start = Instant::now();
    for _ in 0..REPEATS {
        find_corners(&picture, &BOARD)?;
    }
    let milliseconds = 1e3 * start.elapsed().as_secs_f64() / f64::from(REPEATS);
    println!("corners of a board in a picture of {} x {} px: {milliseconds:.0} ms", picture.width(), picture.height());

    let list = common::corners(&common::truth(), 20, 0.2, 3);
    let settings = CameraSettings { degree: None, tangential: true, ..common::settings() };
    let start = Instant::now();
    calibrate_camera(&list, &settings)?;
    let seconds = start.elapsed().as_secs_f64();
    println!("20 views, choice of degree, tangential terms: {seconds:.2} s (target: at most 10 s)");
    Ok(())
}
