//! Calibration of the belt on computed spots with known beams.

use karst_calib::{BeltError, BeltPicture, BeltSpot, CalibratedBelt, SpotReason, calibrate_belt};
use karst_rig::Rig;
use nalgebra::{Point3, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

const SIGMA_PX: f64 = 0.03;
const WALLS_MM: [f64; 8] = [400.0, 550.0, 700.0, 1000.0, 1400.0, 2000.0, 2800.0, 3800.0];

/// The true rig, and what is known of it before the belt is calibrated: its cameras, and the drawing of its belt.
fn rigs() -> (Rig, Rig) {
    let truth = Rig::default();
    let drawing = Rig { lasers: Rig::ideal().lasers, ..truth.clone() };
    (truth, drawing)
}

/// Spots on walls at these distances, uneven from laser to laser.
fn pictures(truth: &Rig, walls_mm: &[f64], seed: u64) -> Vec<BeltPicture> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let noise = Normal::new(0.0, SIGMA_PX).unwrap();
    let optics = [0, 1].map(|camera| truth.camera_optics(camera).unwrap());
    let mut picture = |(number, wall): (usize, &f64)| BeltPicture {
        name: format!("{:04}", number + 1),
        spots: truth
            .lasers
            .iter()
            .enumerate()
            .map(|(k, laser)| {
                let range = wall * (1.0 + 0.01 * k as f64);
                let point = Point3::from(laser.origin_mm) + range * laser.direction();
                [0, 1].map(|camera| {
                    let offset = Vector2::new(noise.sample(&mut random), noise.sample(&mut random));
                    let pixel = (optics[camera].project(point).unwrap() + offset).into();
                    vec![BeltSpot { pixel, sigma_px: SIGMA_PX }]
                })
            })
            .collect(),
    };
    walls_mm.iter().enumerate().map(&mut picture).collect()
}

/// Distance of the calibrated from the true beam, up and to the side (mm), at a distance along it.
fn offsets(truth: &Rig, belt: &CalibratedBelt, laser: usize, along: f64) -> [f64; 2] {
    let (found, actual) = (&belt.lasers[laser].laser, &truth.lasers[laser]);
    let point = Point3::from(found.origin_mm) + along * found.direction();
    let off = point - Point3::from(actual.origin_mm);
    let direction = actual.direction();
    let off = off - off.dot(&direction) * direction;
    let side = Vector3::z().cross(&direction).normalize();
    [off.dot(&direction.cross(&side)), off.dot(&side)]
}

#[test]
fn beams_are_within_0_5_mm_up_to_3_m_of_the_true_ones() {
    let (truth, drawing) = rigs();
    let belt = calibrate_belt(&drawing, &pictures(&truth, &WALLS_MM, 1)).unwrap();
    assert_eq!(belt.rejected, []);
    assert!((0.8..1.2).contains(&belt.chi2_per_dof), "{}", belt.chi2_per_dof);
    assert!((belt.rms_px / SIGMA_PX - 0.85).abs() < 0.15, "{}", belt.rms_px);
    for laser in 0..truth.lasers.len() {
        for along in [300.0, 1000.0, 3000.0] {
            let [up, side] = offsets(&truth, &belt, laser, along);
            assert!(up.abs().max(side.abs()) < 0.5, "laser {laser} at {along} mm: {up} {side}");
        }
    }
}

#[test]
fn errors_agree_with_the_covariance_and_the_rig_file_does_not_understate_them() {
    let (truth, drawing) = rigs();
    let (mut chi2, mut count, mut stated) = (0.0, 0, 0.0);
    for seed in 0..8 {
        let belt = calibrate_belt(&drawing, &pictures(&truth, &WALLS_MM, seed)).unwrap();
        for (k, found) in belt.lasers.iter().enumerate() {
            for along in [300.0, 1000.0, 3000.0] {
                let c = &found.covariance;
                for (i, off) in offsets(&truth, &belt, k, along).into_iter().enumerate() {
                    let variance = c[(i, i)] + 2.0 * along * c[(i, i + 2)] + along * along * c[(i + 2, i + 2)];
                    chi2 += off * off / variance;
                    let laser = &found.laser;
                    let in_file = laser.origin_sigma_mm.powi(2) + (1e-3 * along * laser.direction_sigma_mrad).powi(2);
                    stated += off * off / in_file;
                    count += 1;
                }
            }
        }
    }
    let (chi2, stated) = (chi2 / f64::from(count), stated / f64::from(count));
    assert!((0.8..1.25).contains(&chi2), "{chi2}");
    assert!((0.2..1.1).contains(&stated), "{stated}");
}

#[test]
fn a_spot_off_its_beam_is_named_and_changes_nothing() {
    let (truth, drawing) = rigs();
    let clean = pictures(&truth, &WALLS_MM, 2);
    let mut moved = clean.clone();
    moved[3].spots[5][0][0].pixel[1] += 2.0;
    moved[4].spots[7][1][0].pixel[0] += 60.0;
    let [clean, belt] = [clean, moved].map(|pictures| calibrate_belt(&drawing, &pictures).unwrap());
    let named: Vec<_> = belt.rejected.iter().map(|spot| (spot.picture.as_str(), spot.laser)).collect();
    assert_eq!(named.len(), 2, "{:?}", belt.rejected);
    assert!(named.contains(&("0004", 5)) && named.contains(&("0005", 7)));
    for laser in [5, 7] {
        let [a, b] = [&clean, &belt].map(|belt| offsets(&truth, belt, laser, 2000.0));
        assert!((a[0] - b[0]).abs() < 0.3 && (a[1] - b[1]).abs() < 0.3);
    }
}

#[test]
fn false_candidates_beside_the_spots_do_no_harm() {
    let (truth, drawing) = rigs();
    let clean = pictures(&truth, &WALLS_MM, 3);
    let mut ghosts = clean.clone();
    for (number, picture) in ghosts.iter_mut().enumerate() {
        for spots in picture.spots.iter_mut().flatten() {
            let [u, v] = spots[0].pixel;
            let away = 8.0 + 5.0 * (number % 3) as f64;
            spots.insert(0, BeltSpot { pixel: [u + 0.6 * away, v - 0.4 * away], sigma_px: SIGMA_PX });
        }
    }
    let [clean, belt] = [clean, ghosts].map(|pictures| calibrate_belt(&drawing, &pictures).unwrap());
    assert_eq!(belt, clean);
}

#[test]
fn a_larger_scatter_than_the_image_noise_widens_the_floor() {
    let (truth, drawing) = rigs();
    let mut pictures = pictures(&truth, &WALLS_MM, 4);
    for spot in pictures.iter_mut().flat_map(|picture| &mut picture.spots).flatten().flatten() {
        spot.sigma_px = 0.01;
    }
    let belt = calibrate_belt(&drawing, &pictures).unwrap();
    let floor = drawing.detector.sigma_floor_px;
    let expected = (floor * floor + SIGMA_PX * SIGMA_PX - 0.01 * 0.01).sqrt();
    assert!((belt.sigma_floor_px - expected).abs() < 0.003, "{}", belt.sigma_floor_px);
    assert!((belt.chi2_per_dof - 1.0).abs() < 0.15, "{}", belt.chi2_per_dof);
}

#[test]
fn walls_at_one_distance_only_are_an_error() {
    let (truth, drawing) = rigs();
    let error = calibrate_belt(&drawing, &pictures(&truth, &[1000.0, 1005.0, 1010.0, 1040.0, 1100.0], 5)).unwrap_err();
    assert!(matches!(error, BeltError::OneDistance { laser: 0, .. }), "{error}");
    assert!(error.to_string().contains("direction of the beam cannot be observed"), "{error}");
}

#[test]
fn a_laser_that_is_out_is_an_error_that_names_it() {
    let (truth, drawing) = rigs();
    let mut pictures = pictures(&truth, &WALLS_MM, 6);
    pictures.iter_mut().for_each(|picture| picture.spots[9] = [Vec::new(), Vec::new()]);
    let error = calibrate_belt(&drawing, &pictures).unwrap_err();
    assert!(matches!(error, BeltError::TooFewSpots { laser: 9, found: 0, pictures: 8 }), "{error}");
    assert!(matches!(calibrate_belt(&drawing, &[]), Err(BeltError::TooFewSpots { laser: 0, .. })));
}

#[test]
fn a_spot_that_one_camera_misses_is_named() {
    let (truth, drawing) = rigs();
    let mut pictures = pictures(&truth, &WALLS_MM, 7);
    pictures[7].spots[2][1].clear();
    let belt = calibrate_belt(&drawing, &pictures).unwrap();
    let [rejected] = belt.rejected.as_slice() else { panic!("{:?}", belt.rejected) };
    assert_eq!((rejected.picture.as_str(), rejected.laser, rejected.reason), ("0008", 2, SpotReason::NotFound));
    assert_eq!(rejected.to_string(), "0008, laser 2: not found in both pictures");
}

#[test]
fn rigs_and_pictures_that_do_not_belong_together_are_errors() {
    let (truth, mut drawing) = rigs();
    let mut pictures = pictures(&truth, &WALLS_MM, 8);
    pictures[1].spots.pop();
    let error = calibrate_belt(&drawing, &pictures).unwrap_err();
    assert_eq!(error, BeltError::Lasers { picture: "0002".into(), found: 11, expected: 12 });
    drawing.cameras[1].air = None;
    assert_eq!(calibrate_belt(&drawing, &[]), Err(BeltError::NoModel { camera: 1 }));
}
