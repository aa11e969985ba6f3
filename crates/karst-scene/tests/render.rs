//! What a rendered pair has to satisfy: geometry, photometry, truth and determinism.

use image::Rgb32FImage;
use karst_rig::{Pose, Rig};
use karst_scene::{
    FrameTruth, Lasers, Mesh, Renderer, Scene, SceneError, Sensor, Shape, demo_scene, evaluation_scenes,
    laser_free_scenes, render, straight_path,
};
use nalgebra::{Matrix2, Point3, Vector2, Vector3};
use std::{collections::HashSet, f64::consts::PI, sync::Arc};

/// A scene in which nothing but the spots shines.
fn spots_only(shape: Shape) -> Scene {
    let mut scene = Scene::new(shape);
    scene.walls.contrast = 0.0;
    scene.light.ambient_w_m2 = 0.0;
    scene.light.lamp_w_m2 = 0.0;
    scene.water.backscatter_per_m = 0.0;
    scene.snow_per_m3 = 0.0;
    scene.lasers = Some(Lasers { errors: false, tube_scatter: 0.0, ..Lasers::default() });
    scene
}

/// Sum (DN px) and centroid of G within 40 px of a position.
fn moments(image: &Rgb32FImage, around: [f64; 2]) -> (f64, Vector2<f64>) {
    let around = Vector2::from(around);
    let (mut sum, mut weighted) = (0.0, Vector2::zeros());
    for (x, y, pixel) in image.enumerate_pixels() {
        let position = Vector2::new(f64::from(x), f64::from(y));
        if (position - around).norm() < 40.0 {
            sum += f64::from(pixel[1]);
            weighted += position * f64::from(pixel[1]);
        }
    }
    (sum, weighted / sum)
}

#[test]
fn without_a_tube_spots_are_where_the_plain_camera_projects_them() -> Result<(), SceneError> {
    let rig = Rig { tube: None, ..Rig::default() };
    let scene = spots_only(Shape::HexagonalPool { across_flats_mm: 3000.0 });
    let frame = Renderer::new(&rig)?.render_linear(&scene, 1)?;
    for laser in &frame.truth.lasers {
        let target = laser.target.expect("wall");
        for ((spot, camera), image) in laser.spots.iter().zip(&rig.cameras).zip(&frame.images) {
            let model = camera.air.as_ref().expect("air model");
            let expected = model.project(Point3::from(target.point_mm), 400.0).expect("in the image");
            let spot = spot.expect("in the image");
            assert!((Vector2::from(spot.position_px) - expected).norm() < 1e-9);
            let (_, centroid) = moments(image, spot.position_px);
            assert!((centroid - expected).norm() < 0.01, "{centroid} {expected}");
        }
    }
    Ok(())
}

#[test]
fn centroids_of_noise_free_spots_on_flat_walls_are_true_within_0_01_px() -> Result<(), SceneError> {
    let renderer = Renderer::new(&Rig::default())?;
    for (side_mm, x) in [(1400.0, 200.0), (2000.0, -300.0), (4000.0, 0.0), (7000.0, 0.0)] {
        let mut scene = spots_only(Shape::Square { side_mm });
        scene.instrument = Pose { position_mm: [x, 50.0, 0.0], rotation_deg: [2.0, 1.0, 5.0] };
        let frame = renderer.render_linear(&scene, 1)?;
        for laser in &frame.truth.lasers {
            for (spot, image) in laser.spots.iter().zip(&frame.images) {
                let spot = spot.expect("in the image");
                let (_, centroid) = moments(image, spot.position_px);
                let error = (centroid - Vector2::from(spot.position_px)).norm();
                assert!(error < 0.01, "laser {} of {side_mm} mm: {error} px", laser.laser);
            }
        }
    }
    Ok(())
}

#[test]
fn true_positions_trace_back_to_the_true_points_within_1e_6_mm() -> Result<(), SceneError> {
    let rig = Rig::default();
    let named = demo_scene();
    let frame = render(&rig, &named.scene, named.seed)?;
    for laser in &frame.truth.lasers {
        let point = Point3::from(laser.target.expect("wall").point_mm);
        let along = (point - Point3::from(laser.origin_mm)).cross(&Vector3::from(laser.direction));
        assert!(along.norm() < 1e-9, "off the beam by {} mm", along.norm());
        for (i, spot) in laser.spots.iter().enumerate() {
            let pixel = Vector2::from(spot.expect("in the image").position_px);
            let ray = rig.traced_camera(i).expect("air model").ray(pixel).expect("ray");
            let miss = (point - ray.origin).cross(&ray.direction).norm();
            assert!(miss < 1e-6, "ray misses by {miss} mm");
        }
    }
    Ok(())
}

#[test]
fn light_of_a_spot_follows_the_radiometric_equation_within_1_percent() -> Result<(), SceneError> {
    let rig = Rig::ideal();
    let renderer = Renderer::new(&rig)?;
    let camera = rig.traced_camera(0).expect("air model");
    let tube_mm = 80.0;
    let mut dimmer = f64::INFINITY;
    for radius_mm in [500.0, 1000.0, 2000.0, 3000.0, 4800.0] {
        let scene = spots_only(Shape::RoundTube { radius_mm });
        let frame = renderer.render_linear(&scene, 1)?;
        let spot = frame.truth.lasers[0].spots[0].expect("in the image");
        let (flux, _) = moments(&frame.images[0], spot.position_px);

        // Pixels per area of the wall, from neighbouring points on it.
        let pixel = |y: f64, z: f64| camera.project(Point3::new(radius_mm, y, z)).expect("in the image");
        let jacobian = Matrix2::from_columns(&[pixel(0.5, 0.0) - pixel(-0.5, 0.0), pixel(0.0, 0.5) - pixel(0.0, -0.5)]);
        let pixels_per_m2 = jacobian.determinant().abs() * 1e6;
        let ray = camera.ray(pixel(0.0, 0.0)).expect("ray");
        let path_mm = radius_mm - tube_mm + (Point3::new(radius_mm, 0.0, 0.0) - ray.origin).norm();
        let lasers = scene.lasers.expect("on");
        let radiosity = scene.walls.albedo / PI * lasers.power_mw * 1e-3 * (-0.1e-3 * path_mm).exp();
        let radius_px = (pixel(0.0, 0.0) - Vector2::from(camera.air.centre_px)).norm();
        let vignetting = 1.0 - 0.3 * (radius_px / 360.0).powi(4);
        let expected = scene.sensor.gain * radiosity * pixels_per_m2 * vignetting;
        assert!((flux / expected - 1.0).abs() < 0.01, "{radius_mm} mm: {flux} against {expected} DN px");
        assert!(spot.peak_dn < dimmer);
        dimmer = spot.peak_dn;
    }
    assert!((60.0..=100.0).contains(&dimmer), "peak of {dimmer} DN at 4.8 m");
    Ok(())
}

#[test]
fn a_seed_fixes_every_byte() -> Result<(), SceneError> {
    let renderer = Renderer::new(&Rig::default())?;
    let named = demo_scene();
    let [a, b, c] = [7, 7, 8].map(|seed| renderer.render(&named.scene, seed));
    let (a, b, c) = (a?, b?, c?);
    assert_eq!(a, b);
    assert!(a.images.iter().zip(&c.images).all(|(a, c)| a != c));
    assert_ne!(a.truth.lasers, c.truth.lasers);
    Ok(())
}

#[test]
fn truth_survives_json() -> Result<(), SceneError> {
    let truth = render(&Rig::default(), &demo_scene().scene, 3)?.truth;
    let text = serde_json::to_string(&truth).expect("JSON");
    assert_eq!(serde_json::from_str::<FrameTruth>(&text).expect("JSON"), truth);
    Ok(())
}

#[test]
fn laser_errors_have_the_standard_deviations_of_the_rig_file() -> Result<(), SceneError> {
    let mut rig = Rig::ideal();
    for camera in &mut rig.cameras {
        // The beams do not depend on the image.
        camera.image_size_px = [4, 4];
    }
    let renderer = Renderer::new(&rig)?;
    let mut scene = spots_only(Shape::RoundTube { radius_mm: 1000.0 });
    let (mut shift, mut tilt, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..50 {
        scene.lasers = Some(Lasers::default());
        for (laser, nominal) in renderer.render_linear(&scene, seed)?.truth.lasers.iter().zip(&rig.lasers) {
            let d = nominal.direction();
            let offset = Point3::from(laser.origin_mm) - Point3::from(nominal.origin_mm);
            assert!(offset.dot(&d).abs() < 1e-9, "shifted along the beam");
            shift += offset.norm_squared() / nominal.origin_sigma_mm.powi(2) / 2.0;
            tilt += d.cross(&Vector3::from(laser.direction)).norm_squared()
                / (1e-3 * nominal.direction_sigma_mrad).powi(2)
                / 2.0;
            count += 1.0;
        }
    }
    // 1200 draws each: the mean square scatters by 4 percent.
    assert!((shift / count - 1.0f64).abs() < 0.16, "{}", shift / count);
    assert!((tilt / count - 1.0f64).abs() < 0.16, "{}", tilt / count);

    scene.lasers = Some(Lasers { errors: false, ..Lasers::default() });
    for (laser, nominal) in renderer.render_linear(&scene, 1)?.truth.lasers.iter().zip(&rig.lasers) {
        assert_eq!(laser.origin_mm, nominal.origin_mm);
        assert!((Vector3::from(laser.direction) - nominal.direction()).norm() < 1e-12);
    }
    Ok(())
}

/// A quadrilateral as two triangles.
fn quad(corners: [[f64; 3]; 4]) -> [[Point3<f64>; 3]; 2] {
    let [a, b, c, d] = corners.map(Point3::from);
    [[a, b, c], [a, c, d]]
}

#[test]
fn only_spots_that_can_be_seen_count_as_visible() -> Result<(), SceneError> {
    let renderer = Renderer::new(&Rig::ideal())?;
    let visible = |scene: &Scene| -> Result<Vec<[bool; 2]>, SceneError> {
        let truth = renderer.render_linear(scene, 1)?.truth;
        Ok(truth.lasers.iter().map(|l| l.spots.map(|s| s.is_some_and(|s| s.visible))).collect())
    };
    let pool = spots_only(Shape::HexagonalPool { across_flats_mm: 3000.0 });
    assert_eq!(visible(&pool)?, [[true; 2]; 12]);

    let mut dim = pool.clone();
    dim.lasers = dim.lasers.map(|l| Lasers { power_mw: 0.05, ..l });
    assert_eq!(visible(&dim)?, [[false; 2]; 12]);

    // Nearer than the inner radius of the used ring.
    let near = spots_only(Shape::RoundTube { radius_mm: 200.0 });
    assert_eq!(visible(&near)?, [[false; 2]; 12]);

    // One wall across the x axis, and a plate in front of it that hides the spot from the first camera only.
    let mut triangles =
        quad([[1500.0, -900.0, -900.0], [1500.0, 900.0, -900.0], [1500.0, 900.0, 900.0], [1500.0, -900.0, 900.0]])
            .to_vec();
    triangles.extend(quad([
        [700.0, -100.0, -190.0],
        [700.0, 100.0, -190.0],
        [700.0, 100.0, -80.0],
        [700.0, -100.0, -80.0],
    ]));
    let mesh = spots_only(Shape::Mesh(Arc::new(Mesh::new(triangles).expect("mesh"))));
    let seen = visible(&mesh)?;
    assert_eq!(seen[0], [false, true]);
    assert_eq!(seen[1], [true, true]);
    // Laser 6 meets nothing.
    assert_eq!(renderer.render_linear(&mesh, 1)?.truth.lasers[6].target, None);
    Ok(())
}

#[test]
fn near_spots_saturate_to_white_and_far_ones_do_not() -> Result<(), SceneError> {
    let rig = Rig::ideal();
    for (radius_mm, white) in [(600.0, true), (4800.0, false)] {
        let mut scene = spots_only(Shape::RoundTube { radius_mm });
        scene.sensor.noise = None;
        let frame = render(&rig, &scene, 1)?;
        let spot = frame.truth.lasers[3].spots[1].expect("in the image");
        let [x, y] = spot.position_px.map(|p| p.round() as u32);
        assert_eq!(frame.images[1].get_pixel(x, y).0 == [255; 3], white);
        assert_eq!(spot.saturated, white);
    }
    Ok(())
}

/// Largest 2G-R-B outside and inside of the first camera's inner radius.
fn largest_excess(rig: &Rig, scene: &Scene) -> Result<[f32; 2], SceneError> {
    let frame = Renderer::new(rig)?.render_linear(scene, 1)?;
    let camera = &rig.cameras[0];
    let centre = Vector2::from(camera.air.as_ref().expect("air model").centre_px);
    let mut largest = [0f32; 2];
    for (x, y, pixel) in frame.images[0].enumerate_pixels() {
        let radius = (Vector2::new(f64::from(x), f64::from(y)) - centre).norm();
        let part = &mut largest[usize::from(radius < camera.inner_radius_px)];
        *part = part.max(2.0 * pixel[1] - pixel[0] - pixel[2]);
    }
    Ok(largest)
}

#[test]
fn haze_shows_the_beams_only_when_it_is_thick() -> Result<(), SceneError> {
    let rig = Rig::ideal();
    let mut scene = spots_only(Shape::RoundTube { radius_mm: 2000.0 });
    scene.walls.albedo = 0.0;
    scene.water = Default::default();
    let clear = largest_excess(&rig, &scene)?[0];
    assert!(clear > 0.1 && clear < 35.0, "{clear} DN in default haze");
    scene.water.backscatter_per_m *= 100.0;
    let thick = largest_excess(&rig, &scene)?[0];
    assert!((thick / clear - 100.0).abs() < 5.0 && thick > 70.0, "{thick} DN in thick haze");
    Ok(())
}

#[test]
fn tube_reflections_are_near_the_centre() -> Result<(), SceneError> {
    let rig = Rig::ideal();
    let mut scene = spots_only(Shape::RoundTube { radius_mm: 2000.0 });
    scene.walls.albedo = 0.0;
    scene.lasers = Some(Lasers { errors: false, ..Lasers::default() });
    let [outside, inside] = largest_excess(&rig, &scene)?;
    assert!(inside > 120.0 && outside < 1.0, "{inside} DN inside, {outside} DN outside");
    Ok(())
}

#[test]
fn snow_is_white_except_in_a_beam() -> Result<(), SceneError> {
    let rig = Rig::ideal();
    let mut scene = Scene::new(Shape::RoundTube { radius_mm: 3000.0 });
    scene.lasers = None;
    scene.walls.albedo = 0.0;
    scene.snow_per_m3 = 2000.0;
    let frame = Renderer::new(&rig)?.render_linear(&scene, 1)?;
    let brightest = frame.images[0].pixels().map(|p| p[1]).fold(0.0, f32::max);
    assert!(brightest > 255.0, "no near particle saturates: {brightest} DN");
    // Relative to its brightness a particle is nearly neutral.
    assert!(frame.images[0].pixels().all(|p| 2.0 * p[1] - p[0] - p[2] <= 0.15 * p[1].max(20.0)));

    scene.snow_per_m3 = 1e5;
    scene.light.ambient_w_m2 = 0.0;
    scene.light.lamp_w_m2 = 0.0;
    scene.water.backscatter_per_m = 0.0;
    scene.lasers = Some(Lasers { tube_scatter: 0.0, ..Lasers::default() });
    assert!(largest_excess(&rig, &scene)?[0] > 70.0);
    Ok(())
}

#[test]
fn scenes_without_meaning_are_refused() -> Result<(), SceneError> {
    let rig = Rig::default();
    let renderer = Renderer::new(&rig)?;
    let tube = || Scene::new(Shape::RoundTube { radius_mm: 1000.0 });
    let refused = |change: fn(&mut Scene)| {
        let mut scene = tube();
        change(&mut scene);
        match renderer.render(&scene, 1) {
            Err(SceneError::Parameter { name, .. }) => name,
            other => panic!("{:?}", other.map(|f| f.truth)),
        }
    };
    assert_eq!(refused(|s| s.sensor.gain = f64::NAN), "gain");
    assert_eq!(refused(|s| s.walls.albedo = 1.5), "albedo");
    assert_eq!(refused(|s| s.snow_per_m3 = f64::INFINITY), "snow_per_m3");
    assert_eq!(refused(|s| s.instrument.position_mm[2] = f64::NAN), "instrument");
    assert_eq!(refused(|s| s.shape = Shape::Square { side_mm: -1.0 }), "side_mm");
    assert_eq!(refused(|s| s.sensor.blur_px = 0.0), "blur_px");

    let mut scene = tube();
    scene.instrument.position_mm = [0.0, 1001.0, 0.0];
    assert!(matches!(renderer.render(&scene, 1), Err(SceneError::Outside)));

    let mut broken = rig.clone();
    broken.cameras[1].air = None;
    assert!(matches!(Renderer::new(&broken), Err(SceneError::NoModel(1))));
    let mut broken = rig.clone();
    broken.cameras[0].image_size_px = [0, 768];
    assert!(matches!(Renderer::new(&broken), Err(SceneError::ImageSize { camera: 0, .. })));
    broken.cameras[0].image_size_px = [u32::MAX; 2];
    assert!(matches!(Renderer::new(&broken), Err(SceneError::ImageSize { .. })));
    Ok(())
}

#[test]
fn standard_scenes_cover_the_working_range() -> Result<(), SceneError> {
    let renderer = Renderer::new(&Rig::default())?;
    let scenes = evaluation_scenes();
    let names: HashSet<_> = scenes.iter().map(|s| &s.name).collect();
    assert_eq!(names.len(), scenes.len());
    for kind in ["hexagon", "square", "tube", "gallery"] {
        assert!(scenes.iter().filter(|s| s.kind == kind).count() >= 10);
    }
    let (mut far, mut visible, mut spots) = (0, 0, 0);
    for named in &scenes {
        assert!(named.scene.lasers.is_some_and(|l| l.errors && l.tube_scatter > 0.0));
        for laser in renderer.render_linear(&named.scene, named.seed)?.truth.lasers {
            let range_mm = laser.target.expect("wall").range_mm;
            assert!((300.0..5000.0).contains(&range_mm), "{}: {range_mm} mm", named.name);
            if named.kind == "hexagon" {
                assert!((400.0..2600.0).contains(&range_mm), "{}: {range_mm} mm", named.name);
            }
            far += u32::from((4600.0..=4900.0).contains(&range_mm));
            spots += 2;
            visible += laser.spots.iter().flatten().filter(|s| s.visible).count();
        }
    }
    assert!(far >= 36, "{far} points between 4.6 and 4.9 m");
    assert!(visible * 100 >= spots * 95, "{visible} of {spots} spots visible");

    let laser_free = laser_free_scenes();
    assert!(laser_free.len() >= 8);
    for named in &laser_free {
        assert!(renderer.render_linear(&named.scene, named.seed)?.truth.lasers.is_empty());
    }
    Ok(())
}

#[test]
fn a_path_moves_the_instrument_from_its_start_to_its_end() {
    let pose = |x: f64| Pose { position_mm: [x, 0.0, -x], rotation_deg: [0.0, x / 100.0, 0.0] };
    let scene = Scene::new(Shape::Square { side_mm: 3000.0 });
    let poses: Vec<_> = scene.along(straight_path(pose(0.0), pose(400.0), 5)).map(|s| s.instrument).collect();
    assert_eq!(poses, [0.0, 100.0, 200.0, 300.0, 400.0].map(pose));
    assert_eq!(straight_path(pose(1.0), pose(2.0), 1).collect::<Vec<_>>(), [pose(1.0)]);
    assert_eq!(straight_path(pose(1.0), pose(2.0), 0).count(), 0);
}

#[test]
fn noise_has_the_variance_that_the_sensor_states() -> Result<(), SceneError> {
    let renderer = Renderer::new(&Rig::ideal())?;
    let scene = Scene { lasers: None, snow_per_m3: 0.0, ..Scene::new(Shape::RoundTube { radius_mm: 800.0 }) };
    let (clean, noisy) = (renderer.render_linear(&scene, 1)?, renderer.render(&scene, 1)?);
    let (mut mean, mut chi2, mut count) = (0.0, 0.0, 0.0);
    for (clean, noisy) in clean.images[0].pixels().zip(noisy.images[0].pixels()) {
        let (expected, found) = (f64::from(clean[1]), f64::from(noisy[1]));
        if expected > 20.0 && expected < 230.0 {
            // Quantisation adds a twelfth.
            chi2 += (found - expected).powi(2) / (scene.sensor.variance(expected) + 1.0 / 12.0);
            mean += found - expected;
            count += 1.0;
        }
    }
    assert!(count > 1e5);
    assert!((mean / count).abs() < 0.01, "{} DN", mean / count);
    assert!((chi2 / count - 1.0).abs() < 0.02, "{}", chi2 / count);
    Ok(())
}

#[test]
fn the_response_curve_is_monotone_and_keeps_its_ends() {
    let sensor = Sensor { gamma: 1.8, ..Sensor::default() };
    assert_eq!(sensor.response(0.0), 0.0);
    assert!((sensor.response(255.0) - 255.0).abs() < 1e-9);
    assert!((1..=255).all(|i| sensor.response(f64::from(i)) > sensor.response(f64::from(i - 1))));
    assert_eq!(Sensor::default().response(97.3), 97.3);
}

#[test]
fn ambient_light_of_the_standard_scenes_is_hardly_green() -> Result<(), SceneError> {
    let renderer = Renderer::new(&Rig::default())?;
    let mut scenes = laser_free_scenes();
    scenes.extend(evaluation_scenes().into_iter().step_by(3));
    scenes.push(demo_scene());
    for named in scenes {
        let scene = Scene { lasers: None, ..named.scene };
        for image in renderer.render(&scene, named.seed)?.images {
            let excess = |p: &image::Rgb<u8>| 2 * i32::from(p[1]) - i32::from(p[0]) - i32::from(p[2]);
            let green = image.pixels().filter(|p| excess(p) > 70).count();
            assert!(green < 50, "{}: {green} green pixels", named.name);
        }
    }
    Ok(())
}
