//! Three ways to a camera in the water, from corners computed with the default rig.

#[path = "common/boards.rs"]
mod boards;

use boards::{boards, settings};
use karst_calib::{Medium, calibrate_stereo, compare_refraction};
use karst_rig::Rig;

#[test]
fn explore() {
    let rig = Rig::default();
    let set = boards(&rig, Medium::Water, 20, 1);
    let truth = rig.traced_camera(0).unwrap();
    let start = std::time::Instant::now();
    let settings = karst_calib::CameraSettings { image_size_px: [1024, 768], degree: Some(5), tangential: true };
    let result = compare_refraction(&truth, &truth, &set.corners[0], &settings, [250.0, 6000.0]).unwrap();
    println!("{:.2} s", start.elapsed().as_secs_f64());
    for way in [&result.traced, &result.axial, &result.compact] {
        println!(
            "{:?}\n  rms {} {:?}\n  bias {:?}",
            way.model,
            way.rms_px,
            way.holdout_rms_px,
            way.bias_pct.map(|b| (b.unwrap() * 100.0).round() / 100.0)
        );
    }
}
