//! Calibration of the default rig's cameras, and of its tube, from corners computed with it.

#[path = "common/boards.rs"]
mod boards;

use boards::{NOISE_PX, boards, settings};
use karst_calib::{Medium, calibrate_stereo};
use karst_rig::Rig;

#[test]
fn explore() {
    let rig = Rig::default();
    for (what, sets) in [
        ("air", vec![boards(&rig, Medium::Air, 20, [300.0, 1200.0], NOISE_PX, 1)]),
        ("water", vec![boards(&rig, Medium::Water, 20, [350.0, 1600.0], NOISE_PX, 1)]),
        (
            "both",
            vec![
                boards(&rig, Medium::Air, 10, [300.0, 1200.0], NOISE_PX, 1),
                boards(&rig, Medium::Water, 20, [350.0, 1600.0], NOISE_PX, 2),
            ],
        ),
    ] {
        let start = std::time::Instant::now();
        let result = calibrate_stereo(&sets, &settings(&rig));
        println!("=== {what}: {:.2} s", start.elapsed().as_secs_f64());
        match result {
            Err(error) => println!("{error}"),
            Ok(result) => {
                println!(
                    "rms {} inl {} holdout {:?} baseline {} +- {}",
                    result.rms_px,
                    result.rms_inliers_px,
                    result.holdout_rms_px,
                    result.baseline_mm,
                    result.baseline_sigma_mm
                );
                println!("pairs {} rejected {:?} tube {:?}", result.pairs.len(), result.rejected_pairs, result.tube);
                println!(
                    "views {:?}",
                    result.cameras.each_ref().map(|c| (c.views.len(), c.rejected_views.clone(), c.outliers.len()))
                );
                for p in &result.parameters {
                    print!("{} {:.2e}; ", p.name, p.sigma);
                }
                println!("\n{:?}", result.warnings);
            }
        }
    }
}
