//! Rigs other than the default one through the whole command line: rendered, measured, compared with the truth.

mod cli_common;

use cli_common::{Folder, mean_range_error_percent, points};
use image::RgbImage;
use karst_rig::{Laser, Rig, fit_compact};

/// Renders a pair with a rig and measures it.
fn measured(folder: &Folder, rig: &Rig, render: &str) -> serde_json::Value {
    folder.write("my.toml", rig.to_toml());
    folder.run("rig check my.toml").done();
    folder.run(&format!("render --rig my.toml --out out --snow 0 {render}")).done();
    let measure = "reconstruct --rig out/rig.toml out/camera1 out/camera2 --truth out/truth --json";
    folder.run(measure).done().json()["sections"][0].clone()
}

#[test]
fn seven_hundred_and_twenty_lasers_go_through_every_command() {
    let mut rig = Rig::ideal();
    let laser = Laser { origin_sigma_mm: 0.1, direction_sigma_mrad: 0.2, ..rig.lasers[0] };
    rig.lasers = (0..720).map(|i| Laser { azimuth_deg: 0.5 * f64::from(i), ..laser }).collect();
    rig.detector.sector_half_width_deg = 0.25;
    let folder = Folder::new();
    let section = measured(&folder, &rig, "--shape tube --size 4000");
    // Neighbouring spots are 2 px apart here: some flow into the next sector and are refused, none becomes a wrong point.
    let found = points(&section);
    assert_eq!(found.len(), 720);
    assert!(found.iter().flatten().count() >= 150, "{}", found.iter().flatten().count());
    assert!(mean_range_error_percent([&section]) < 0.25);
    assert_eq!(folder.run("configure --simulated --rig my.toml --json").done().json()["is_rig"], true);
    let frame = folder.run("monitor --simulated --rig out/rig.toml out/camera1 out/camera2 --json").done().json();
    assert_eq!(points(&frame), found);
}

#[test]
fn cameras_may_have_pictures_of_different_sizes() {
    let mut rig = Rig::ideal();
    rig.cameras[1].image_size_px = [1280, 800];
    let section = measured(&Folder::new(), &rig, "--shape hexagon");
    assert_eq!(points(&section).iter().flatten().count(), 12);
    assert!(mean_range_error_percent([&section]) < 0.25);
}

#[test]
fn a_compact_model_in_the_water_works_and_is_biased() {
    let folder = Folder::new();
    let mut rig = Rig::ideal();
    measured(&folder, &rig, "--shape tube --size 4000");
    for index in 0..2 {
        let camera = &rig.cameras[index];
        let radii = [camera.inner_radius_px, camera.mirror_radius_px];
        let (model, _) = fit_compact(&rig.traced_camera(index).unwrap(), radii, 700.0).unwrap();
        rig.cameras[index].water = Some(model);
    }
    rig.reconstruction.chi2_max = 10_000.0;
    folder.write("compact.toml", rig.to_toml());
    assert!(folder.run("rig show compact.toml").done().stdout.contains("camera 1: compact in water"));
    let measure = "reconstruct --rig compact.toml out/camera1 out/camera2 --truth out/truth --json";
    let section = folder.run(measure).done().json()["sections"][0].clone();
    assert_eq!(points(&section).iter().flatten().count(), 12);
    let error = mean_range_error_percent([&section]);
    assert!((1.0..4.0).contains(&error), "{error} %");
}

#[test]
fn one_camera_gives_points_only_where_the_rig_file_allows_it() {
    let folder = Folder::new();
    let mut rig = Rig::ideal();
    measured(&folder, &rig, "--shape hexagon");
    RgbImage::new(1024, 768).save(folder.path("dark.png")).unwrap();
    let measure = |rig: &str| {
        let arguments =
            format!("reconstruct --rig {rig} out/camera1/0001.png dark.png --truth out/truth/0001.json --json");
        folder.run(&arguments).done().json()["sections"][0].clone()
    };
    let section = measure("my.toml");
    assert!(points(&section).iter().all(Option::is_none));
    assert_eq!(section["lasers"][0]["status"], "spot in one camera only");

    rig.reconstruction.single_camera = true;
    folder.write("single.toml", rig.to_toml());
    let section = measure("single.toml");
    assert_eq!(points(&section).iter().flatten().count(), 12);
    // The laser's uncertainty is the point's
    assert!(section["lasers"][0]["point"]["sigma_mm"].as_f64().unwrap() > 5.0);
    assert!(mean_range_error_percent([&section]) < 4.0);
}
