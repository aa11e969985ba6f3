//! Calibrations at the ends of their formats, and spots anywhere: a point or a reason, never an overflow. (The test
//! profile checks every integer operation.)

use karst_core::{Bounds, Calibration, Cluster, I18F14, LaserCalibration, Method, Spot, reconstruct};
use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A value of up to `bits` bits and a sign, small ones as likely as large ones.
fn any(rng: &mut ChaCha8Rng, bits: u32) -> i32 {
    let limit = (1_i64 << rng.random_range(0..=bits)) - 1;
    rng.random_range(-limit..=limit) as i32
}

fn q30(matrix: Matrix3<f64>) -> [[i32; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (matrix[(i, j)] * f64::from(1 << 30)).round() as i32))
}

/// A random rotation; or one near to that of an instrument, whose camera looks across the beam.
fn rotation(rng: &mut ChaCha8Rng) -> Matrix3<f64> {
    let mut angle = |limit: f64| rng.random_range(-limit..=limit);
    let near = Rotation3::new(Vector3::new(angle(0.1), angle(0.1), angle(0.1)));
    let anyhow = Rotation3::new(Vector3::new(angle(3.0), angle(3.0), angle(3.0)));
    (if rng.random() { near } else { anyhow }).into_inner()
}

fn calibration(rng: &mut ChaCha8Rng) -> Calibration<1> {
    let mut calibration = Calibration::default();
    for camera in &mut calibration.cameras {
        camera.centre = [I18F14::from_bits(any(rng, 25)), I18F14::from_bits(any(rng, 25))];
        camera.inverse_affine = [(1 << 30) + any(rng, 29), any(rng, 28), any(rng, 28), (1 << 30) + any(rng, 29)];
        camera.decentring = [any(rng, 30), any(rng, 30)];
        camera.polynomial = (0..8).map(|_| any(rng, 31)).collect();
        camera.axial = (0..rng.random_range(0..8)).map(|_| any(rng, 31)).collect();
    }
    let mut laser = LaserCalibration {
        origin: [any(rng, 31), any(rng, 31), any(rng, 31)],
        axes: q30(rotation(rng)),
        origin_variance: (any(rng, 31).unsigned_abs() as u64) << rng.random_range(0..11),
        // (20 mrad)^2
        direction_variance: rng.random_range(0..=7_036_874_418),
        ..Default::default()
    };
    for frame in &mut laser.cameras {
        frame.rotation = q30(rotation(rng));
        frame.viewpoint = [any(rng, 31), any(rng, 31), any(rng, 31)];
    }
    calibration.lasers.push(laser).unwrap();
    calibration.settings.range = [I18F14::ZERO, I18F14::MAX];
    calibration.settings.chi2_max = I18F14::MAX;
    calibration.settings.single_camera = rng.random();
    calibration
}

fn spot(rng: &mut ChaCha8Rng) -> Spot {
    Spot {
        position: [I18F14::from_bits(any(rng, 31)), I18F14::from_bits(any(rng, 31))],
        variance: any(rng, 31).unsigned_abs(),
        cluster: Cluster {
            pixels: 9,
            green: 9,
            saturated: 0,
            weight: 900,
            weight_x: 0,
            weight_y: 0,
            bounds: Bounds { x_min: 0, x_max: rng.random_range(0..2048), y_min: 0, y_max: rng.random_range(0..2048) },
            radius_squared: 0,
        },
    }
}

#[test]
fn calibrations_at_the_ends_of_their_formats_give_points_or_reasons() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut points = [0, 0];
    for _ in 0..1_000_000 {
        let calibration = calibration(&mut rng);
        let spots = [[spot(&mut rng)], [spot(&mut rng)]];
        for (count, method) in points.iter_mut().zip([Method::Weighted, Method::Paper]) {
            if let Ok(point) = reconstruct(&calibration, 0, [&spots[0], &spots[1]], method) {
                assert!((0..8192).contains(&point.along.to_num::<i32>()), "{point:?}");
                *count += 1;
            }
        }
    }
    assert!(points.iter().all(|&count| count > 1000), "too few points to show anything: {points:?}");
}
