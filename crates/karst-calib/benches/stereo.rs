//! `cargo bench -p karst-calib --bench stereo`: both cameras and the tube from 20 pairs of pictures under water.

#[path = "../tests/common/boards.rs"]
mod boards;

use std::time::Instant;

use boards::Boards;
use karst_calib::{StereoError, calibrate_stereo};
use karst_rig::Medium;
use karst_rig::Rig;

fn main() -> Result<(), StereoError> {
    let rig = Rig::default();
    let set = boards::boards(Medium::Water, Boards::new(Medium::Water, 20), 3);
    let corners: usize = set.corners.iter().flat_map(|list| &list.views).map(|view| view.corners.len()).sum();
    for degree in [Some(6), None] {
        let mut settings = boards::settings(&rig);
        settings.cameras.iter_mut().for_each(|camera| camera.degree = degree);
        let start = Instant::now();
        let result = calibrate_stereo(std::slice::from_ref(&set), &settings)?;
        let seconds = start.elapsed().as_secs_f64();
        let rms = result.rms_px;
        let degree = degree.map_or_else(|| "choice of degree".to_owned(), |degree| format!("degree {degree}"));
        println!(
            "20 pairs under water, {corners} corners, {degree}: {seconds:.2} s, {rms:.4} px rms (target: at most 10 s)"
        );
    }
    Ok(())
}
