//! A rendered calibration board: true corners, colours, exposure, what it hides, and the poses it is shown in.

use image::RgbImage;
use karst_rig::Medium;
use karst_rig::{Board, Pose, Rig};
use karst_scene::{BoardTruth, CornerTruth, FrameTruth, PlacedBoard, Renderer, Scene, SceneError, Shape};
use nalgebra::{Matrix6, Point3, Vector2, Vector3, Vector6};

const BOARD: Board = Board { columns: 9, rows: 6, square_mm: 60.0 };
const MEDIA: [Medium; 2] = [Medium::Air, Medium::Water];

fn renderer(medium: Medium) -> Result<Renderer, SceneError> {
    Renderer::new(&medium.rig(&Rig::default()))
}

/// A board 700 mm in front of the lasers of azimuth 0, upright.
fn upright() -> PlacedBoard {
    // Its x, y and z axes along -y, -z and x of the rig.
    PlacedBoard::new(BOARD, Pose { position_mm: [700.0, 240.0, 150.0], rotation_deg: [-90.0, 0.0, -90.0] })
}

fn truth(frame: FrameTruth) -> BoardTruth {
    frame.board.expect("a board")
}

/// The saddle of G nearest to a position: a quadratic with Gaussian weights around the last estimate, repeated.
fn saddle(image: &RgbImage, near: Vector2<f64>) -> Option<Vector2<f64>> {
    const SIGMA_PX: f64 = 1.0;
    let mut at = near;
    for _ in 0..10 {
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        let [x0, y0] = [at.x, at.y].map(|p| p.round() as i64);
        for (x, y) in (x0 - 5..=x0 + 5).flat_map(|x| (y0 - 5..=y0 + 5).map(move |y| (x, y))) {
            let [u, v] = [x as f64 - at.x, y as f64 - at.y];
            let terms = Vector6::new(1.0, u, v, u * u, u * v, v * v);
            let weight = (-(u * u + v * v) / (2.0 * SIGMA_PX * SIGMA_PX)).exp();
            let grey = f64::from(image.get_pixel_checked(x as u32, y as u32)?[1]);
            normal += weight * terms * terms.transpose();
            right += weight * grey * terms;
        }
        let c = normal.try_inverse()? * right;
        let determinant = 4.0 * c[3] * c[5] - c[4] * c[4];
        // A saddle curves up in one direction and down in another.
        if determinant >= 0.0 {
            return None;
        }
        at += Vector2::new(c[4] * c[2] - 2.0 * c[5] * c[1], c[4] * c[1] - 2.0 * c[3] * c[2]) / determinant;
    }
    Some(at)
}

/// Shortest distance to the neighbours in the corner's row and column, px.
fn shortest_side(corners: &[Option<CornerTruth>], index: usize) -> f64 {
    let position = |i: usize| Vector2::from(corners[i].expect("in the image").position_px);
    let (column, row) = (index % BOARD.columns, index / BOARD.columns);
    let across = [(column > 0).then(|| index - 1), (column + 1 < BOARD.columns).then(|| index + 1)];
    let down = [(row > 0).then(|| index - BOARD.columns), (row + 1 < BOARD.rows).then(|| index + BOARD.columns)];
    let sides = across.into_iter().chain(down).flatten().map(|i| (position(i) - position(index)).norm());
    sides.fold(f64::INFINITY, f64::min)
}

/// Mean for each medium and camera, and worst distance (px) of saddles from the true corners, without noise.
fn assert_saddles_at_true_corners(light: fn(&mut Scene), mean_px: f64, worst_px: f64) -> Result<(), SceneError> {
    for medium in MEDIA {
        let renderer = renderer(medium)?;
        let mut errors = [Vec::new(), Vec::new()];
        for pose in renderer.board_poses(&BOARD, 10, 3)? {
            let mut scene = Scene::calibration(PlacedBoard::new(BOARD, pose), medium);
            scene.sensor.noise = None;
            light(&mut scene);
            let frame = renderer.render(&scene, 1)?;
            let truth = truth(frame.truth);
            for ((corners, image), errors) in truth.corners.iter().zip(&frame.images).zip(&mut errors) {
                for index in 0..BOARD.corners() {
                    // The edges of smaller squares would pull at the fit.
                    if shortest_side(corners, index) >= 12.0 {
                        let corner = Vector2::from(corners[index].expect("in the image").position_px);
                        let found = saddle(image, corner.map(f64::round)).expect("a saddle");
                        errors.push((found - corner).norm());
                    }
                }
            }
        }
        for (camera, errors) in errors.iter().enumerate() {
            assert!(errors.len() > 200, "{medium:?}: {} corners", errors.len());
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            let worst = errors.iter().copied().fold(0.0, f64::max);
            assert!(mean < mean_px && worst < worst_px, "{medium:?}, camera {camera}: {mean} px, worst {worst} px");
        }
    }
    Ok(())
}

#[test]
fn saddles_are_at_the_true_corners_within_0_02_px_in_even_light() -> Result<(), SceneError> {
    let even = |scene: &mut Scene| {
        scene.light.ambient_w_m2 += scene.light.lamp_w_m2;
        scene.light.lamp_w_m2 = 0.0;
    };
    // What is left: edges bent by the mirror, and grey levels.
    assert_saddles_at_true_corners(even, 0.02, 0.08)
}

#[test]
fn saddles_are_at_the_true_corners_within_0_03_px_in_the_lamp_s_light() -> Result<(), SceneError> {
    // Where a board slants away from the lamp, brightness changes across the corner, which moves the saddle itself.
    assert_saddles_at_true_corners(|_| {}, 0.03, 0.13)
}

#[test]
fn true_corners_are_where_the_camera_model_projects_them() -> Result<(), SceneError> {
    let placed = upright();
    for medium in MEDIA {
        let rig = medium.rig(&Rig::default());
        let frame = Renderer::new(&rig)?.render_linear(&Scene::calibration(placed, medium), 1)?;
        for (camera, corners) in truth(frame.truth).corners.iter().enumerate() {
            for (index, corner) in corners.iter().enumerate() {
                let [x, y] = BOARD.corner_mm(index);
                let point = placed.pose.isometry() * Point3::new(x, y, 0.0);
                let expected = match medium {
                    Medium::Air => rig.cameras[camera].air.as_ref().expect("air model").project(point, 380.0),
                    Medium::Water => rig.traced_camera(camera).expect("tube").project(point),
                };
                let corner = corner.expect("in the image");
                assert!((Vector2::from(corner.position_px) - expected.expect("in the image")).norm() < 1e-9);
                assert!(corner.visible);
            }
        }
    }
    Ok(())
}

#[test]
fn images_are_mirror_free_and_the_square_outside_of_corner_0_is_dark() -> Result<(), SceneError> {
    let placed = upright();
    for medium in MEDIA {
        let renderer = renderer(medium)?;
        let frame = renderer.render(&Scene::calibration(placed, medium), 1)?;
        let truth = truth(frame.truth);
        for (corners, image) in truth.corners.iter().zip(&frame.images) {
            let at = |index: usize| Vector2::from(corners[index].expect("in the image").position_px);
            let (x, y) = (at(1) - at(0), at(BOARD.columns) - at(0));
            // From x to y clockwise, as for an eye in front of the board.
            assert!(x.perp(&y) > 0.0);
            let grey = |at: Vector2<f64>| image.get_pixel(at.x.round() as u32, at.y.round() as u32)[1];
            assert!(grey(at(0) - 0.5 * x - 0.5 * y) < 40);
            assert!(grey(at(0) + 0.5 * x - 0.5 * y) > 120);
            assert!(grey(at(0) + 0.5 * x + 0.5 * y) < 40);
        }
    }
    Ok(())
}

#[test]
fn white_squares_are_well_exposed_at_all_distances_and_never_saturate() -> Result<(), SceneError> {
    for medium in MEDIA {
        let renderer = renderer(medium)?;
        for pose in renderer.board_poses(&BOARD, 8, 5)? {
            let frame = renderer.render(&Scene::calibration(PlacedBoard::new(BOARD, pose), medium), 1)?;
            let truth = truth(frame.truth);
            for (image, corners) in frame.images.iter().zip(&truth.corners) {
                let at = |index: usize| Vector2::from(corners[index].expect("in the image").position_px);
                // The light squares between corners (column, row) and (column + 1, row + 1).
                let squares = (0..BOARD.corners() - BOARD.columns).filter(|index| {
                    let (column, row) = (index % BOARD.columns, index / BOARD.columns);
                    column + 1 < BOARD.columns && (column + row) % 2 == 1
                });
                let greys = squares.map(|index| {
                    let middle = (at(index) + at(index + BOARD.columns + 1)) / 2.0;
                    image.get_pixel(middle.x.round() as u32, middle.y.round() as u32)[1]
                });
                let greys: Vec<u8> = greys.collect();
                let (darkest, brightest) = (greys.iter().min(), greys.iter().max());
                assert!(
                    brightest.is_some_and(|dn| (150..=225).contains(dn)),
                    "{medium:?}: {brightest:?} DN at {pose:?}"
                );
                assert!(darkest.is_some_and(|&dn| dn > 50), "{medium:?}: {darkest:?} DN at {pose:?}");
            }
        }
    }
    Ok(())
}

#[test]
fn the_back_of_a_board_is_even_and_shows_no_corners() -> Result<(), SceneError> {
    let front = upright();
    // Turned about its vertical middle line: y stays, x and z are reversed.
    let pose = Pose { position_mm: [700.0, -240.0, 150.0], rotation_deg: [-90.0, 0.0, 90.0] };
    let back = PlacedBoard { pose, ..front };
    let renderer = renderer(Medium::Air)?;
    let mut scene = Scene::calibration(front, Medium::Air);
    scene.board = Some(back);
    let frame = renderer.render_linear(&scene, 1)?;
    let truth = truth(frame.truth);
    for (corners, image) in truth.corners.iter().zip(&frame.images) {
        for corner in corners.iter().flatten() {
            assert!(!corner.visible);
            let [x, y] = corner.position_px.map(|p| p.round() as u32);
            let grey = |dx: i32, dy: i32| image.get_pixel(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy))[1];
            assert!(grey(0, 0) > 20.0);
            for (dx, dy) in [(5, 5), (-5, 5)] {
                assert!((grey(dx, dy) / grey(-dx, -dy) - 1.0).abs() < 0.15);
            }
        }
    }
    Ok(())
}

#[test]
fn a_board_hides_the_walls_and_a_wall_hides_the_board() -> Result<(), SceneError> {
    let renderer = renderer(Medium::Water)?;
    // A black board: what light there is comes from beyond it.
    let black = PlacedBoard { dark_albedo: 0.0, light_albedo: 0.0, ..upright() };
    let mut scene = Scene::calibration(upright(), Medium::Water).in_air();
    scene.board = Some(black);
    let frame = renderer.render_linear(&scene, 1)?;
    let [x, y] = truth(frame.truth).corners[0][22].expect("in the image").position_px.map(|p| p.round() as u32);
    let hidden = frame.images[0].get_pixel(x, y)[1];
    scene.board = None;
    let open = renderer.render_linear(&scene, 1)?.images[0].get_pixel(x, y)[1];
    // Only the halo of the point spread function may reach the middle of the board.
    assert!(open > 5.0 && hidden < 0.01, "{hidden} of {open} DN");

    let mut scene = Scene::calibration(upright(), Medium::Water);
    scene.shape = Shape::RoundTube { radius_mm: 600.0 };
    let frame = renderer.render_linear(&scene, 1)?;
    assert!(truth(frame.truth).corners.iter().flatten().flatten().all(|corner| !corner.visible));
    scene.board = None;
    assert_eq!(renderer.render_linear(&scene, 1)?.images, frame.images);
    Ok(())
}

#[test]
fn a_laser_meets_the_board_in_front_of_the_wall() -> Result<(), SceneError> {
    let renderer = renderer(Medium::Water)?;
    let scene = Scene { lasers: Some(Default::default()), ..Scene::calibration(upright(), Medium::Water) };
    let frame = renderer.render_linear(&scene, 1)?;
    let target = frame.truth.lasers[0].target.expect("the board");
    assert!((target.point_mm[0] - 700.0).abs() < 1e-9);
    assert!(frame.truth.lasers[0].spots.iter().all(|spot| spot.expect("in the image").visible));
    assert!(frame.truth.lasers[6].target.expect("the wall").range_mm > 2000.0);
    Ok(())
}

#[test]
fn both_cameras_see_all_corners_in_every_pose_and_the_poses_cover_both_images() -> Result<(), SceneError> {
    for medium in MEDIA {
        let rig = medium.rig(&Rig::default());
        let renderer = Renderer::new(&rig)?;
        let poses = renderer.board_poses(&BOARD, 20, 1)?;
        assert_eq!(poses.len(), 20);
        assert_eq!(renderer.board_poses(&BOARD, 20, 1)?, poses);
        assert_ne!(renderer.board_poses(&BOARD, 20, 2)?, poses);
        let (mut radii, mut sectors) = ([[f64::INFINITY, 0.0]; 2], [[false; 12]; 2]);
        let (mut distances, mut tilts) = (Vec::new(), Vec::new());
        for pose in poses {
            let to_rig = pose.isometry();
            let middle = to_rig * Point3::new(240.0, 150.0, 0.0);
            distances.push(middle.x.hypot(middle.y));
            let outwards = Vector3::new(middle.x, middle.y, 0.0).normalize();
            tilts.push((to_rig * Vector3::z()).dot(&outwards).acos().to_degrees());
            for (camera, (radii, sectors)) in radii.iter_mut().zip(&mut sectors).enumerate() {
                let centre = Vector2::from(rig.cameras[camera].air.as_ref().expect("air model").centre_px);
                for index in 0..BOARD.corners() {
                    let [x, y] = BOARD.corner_mm(index);
                    let point = to_rig * Point3::new(x, y, 0.0);
                    let pixel = match rig.traced_camera(camera) {
                        Some(traced) => traced.project(point),
                        None => rig.cameras[camera].air.as_ref().expect("air model").project(point, 380.0),
                    };
                    let offset = pixel.expect("in the image") - centre;
                    let radius = offset.norm();
                    assert!((111.0..=354.0).contains(&radius), "{medium:?}: {radius} px");
                    *radii = [radii[0].min(radius), radii[1].max(radius)];
                    sectors[((offset.y.atan2(offset.x).to_degrees() + 360.0) % 360.0 / 30.0) as usize % 12] = true;
                }
            }
        }
        for (radii, sectors) in radii.iter().zip(sectors) {
            assert!(radii[0] < 130.0 && radii[1] > 340.0, "{medium:?}: {radii:?} px");
            assert_eq!(sectors, [true; 12], "{medium:?}");
        }
        let range = |values: &[f64]| values.iter().fold([f64::INFINITY, 0.0], |[a, b], v| [v.min(a), v.max(b)]);
        let [near, far] = range(&distances);
        assert!(near > 349.0 && near < 700.0 && far > 1300.0 && far < 1601.0, "{medium:?}: {near} to {far} mm");
        let [least, most] = range(&tilts);
        assert!(least < 15.0 && most > 30.0 && most < 45.1, "{medium:?}: {least} to {most} degrees");
    }
    Ok(())
}

#[test]
fn boards_that_fit_nowhere_have_no_poses() -> Result<(), SceneError> {
    let renderer = renderer(Medium::Water)?;
    for square_mm in [1.0, 1000.0] {
        let result = renderer.board_poses(&Board { square_mm, ..BOARD }, 2, 1);
        assert!(matches!(result, Err(SceneError::NoBoardPose { found: 0, count: 2 })), "{square_mm} mm: {result:?}");
    }
    Ok(())
}

#[test]
fn boards_without_meaning_are_refused() -> Result<(), SceneError> {
    let renderer = renderer(Medium::Water)?;
    let refused = |change: fn(&mut PlacedBoard)| {
        let mut placed = upright();
        change(&mut placed);
        match renderer.render(&Scene::calibration(placed, Medium::Water), 1) {
            Err(SceneError::Parameter { name, .. }) => name,
            other => panic!("{:?}", other.map(|frame| frame.truth)),
        }
    };
    assert_eq!(refused(|p| p.board.columns = 1), "columns");
    assert_eq!(refused(|p| p.board.rows = 101), "rows");
    assert_eq!(refused(|p| p.board.square_mm = f64::NAN), "square_mm");
    assert_eq!(refused(|p| p.pose.position_mm[1] = f64::INFINITY), "pose of the board");
    assert_eq!(refused(|p| p.dark_albedo = -0.1), "dark_albedo");
    assert_eq!(refused(|p| p.light_albedo = 1.1), "light_albedo");
    let board = Board { columns: usize::MAX, rows: 2, square_mm: 60.0 };
    assert!(matches!(renderer.board_poses(&board, 1, 1), Err(SceneError::Parameter { name: "columns", .. })));
    Ok(())
}

#[test]
fn truth_of_a_board_survives_json_and_is_left_out_without_a_board() -> Result<(), SceneError> {
    let renderer = renderer(Medium::Air)?;
    let mut scene = Scene::calibration(upright(), Medium::Air);
    let with_board = renderer.render_linear(&scene, 1)?.truth;
    let text = serde_json::to_string(&with_board).expect("JSON");
    assert_eq!(serde_json::from_str::<FrameTruth>(&text).expect("JSON"), with_board);
    scene.board = None;
    let text = serde_json::to_string(&renderer.render_linear(&scene, 1)?.truth).expect("JSON");
    assert!(!text.contains("board"), "{text}");
    assert_eq!(serde_json::from_str::<FrameTruth>(&text).expect("JSON").board, None);
    Ok(())
}
