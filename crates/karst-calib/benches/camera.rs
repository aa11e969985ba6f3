//! `cargo bench -p karst-calib`: a whole camera calibration from the corners of 20 views.

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use karst_calib::{CameraError, CameraSettings, calibrate_camera};

fn main() -> Result<(), CameraError> {
    let list = common::corners(&common::truth(), 20, 0.2, 3);
    let settings = CameraSettings { degree: None, tangential: true, ..common::settings() };
    let start = Instant::now();
    calibrate_camera(&list, &settings)?;
    let seconds = start.elapsed().as_secs_f64();
    println!("20 views, choice of degree, tangential terms: {seconds:.2} s (target: at most 10 s)");
    Ok(())
}
