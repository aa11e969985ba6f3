//! The Q18.14 chain against the f64 chain, from the spots to the point.

use karst_core::{Bounds, Cluster, FixedRig, I18F14, Method, NoPoint, Spot, SpotDetector};
use karst_reference::{Point, Reference};
use karst_rig::Rig;
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Largest difference in any coordinate, mm.
const BOUND_MM: f64 = 0.05;

struct Pair {
    rig: Rig,
    fixed: FixedRig<12>,
    reference: Reference,
}

impl Pair {
    fn new(rig: Rig) -> Self {
        let cameras = rig.water_cameras().unwrap();
        let fixed = rig.to_fixed(&cameras).unwrap();
        Self { reference: Reference::new(rig.clone(), cameras), fixed, rig }
    }

    fn reconstruct(
        &self,
        laser: usize,
        spots: [&[Spot]; 2],
        method: Method,
    ) -> (Result<karst_core::Point, NoPoint>, Result<Point, NoPoint>) {
        (
            karst_core::reconstruct(&self.fixed.calibration, laser, spots, method),
            self.reference.reconstruct(laser, spots, method),
        )
    }
}

/// A spot of plausible size whose weighted centroid is at a position.
fn spot_at([x, y]: [f64; 2], weight: u32, pixels: u32) -> Spot {
    let cluster = Cluster {
        pixels,
        green: pixels,
        saturated: 0,
        weight,
        weight_x: (x * f64::from(weight)).round() as u64,
        weight_y: (y * f64::from(weight)).round() as u64,
        bounds: Bounds { x_min: x as u16 - 1, x_max: x as u16 + 2, y_min: y as u16 - 1, y_max: y as u16 + 2 },
        radius_squared: (310 * 16_u32).pow(2),
    };
    let centroid = |sum: u64| I18F14::from_num(sum as f64 / f64::from(weight));
    // As the detector computes it: 0.012^2 + 5^2 / (4 pi) / (mean weight)^2
    let mean_weight = f64::from(weight) / f64::from(pixels);
    let variance = 0.012_f64.powi(2) + 25.0 / (4.0 * std::f64::consts::PI) / mean_weight.powi(2);
    Spot {
        position: [centroid(cluster.weight_x), centroid(cluster.weight_y)],
        variance: (variance * f64::from(1 << 24)).round() as u32,
        cluster,
    }
}

/// Spots of a random point near the beam of a laser, within its uncertainty, with some position noise.
fn random_spots(rng: &mut ChaCha8Rng, pair: &Pair, laser: usize, noise_px: f64) -> Option<[Spot; 2]> {
    let beam = &pair.rig.lasers[laser];
    let along = 300.0 * 16.0_f64.powf(rng.random());
    let mut offset = || (rng.random::<f64>() - 0.5) * (3.0 + 4e-3 * along);
    let in_beam = Vector3::new(along, offset(), offset());
    let point = Point3::from(Vector3::from(beam.origin_mm) + beam.frame().transpose() * in_beam);
    let mut spot = |camera: usize| {
        let part = &pair.rig.cameras[camera];
        let pixel = pair.rig.traced_camera(camera)?.project(point)?;
        let inside = (pixel - nalgebra::Vector2::from(pair.rig.cameras[camera].air.as_ref()?.centre_px)).norm();
        if !(part.inner_radius_px..part.mirror_radius_px).contains(&inside) {
            return None;
        }
        let mut moved = || (rng.random::<f64>() - 0.5) * noise_px;
        let position = [pixel.x + moved(), pixel.y + moved()];
        Some(spot_at(position, rng.random_range(300..20_000), rng.random_range(5..60)))
    };
    Some([spot(0)?, spot(1)?])
}

fn worst_difference(pair: &Pair, method: Method, noise_px: f64, points: u32) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut worst, mut compared) = (0.0_f64, 0);
    while compared < points {
        let laser = rng.random_range(0..pair.rig.lasers.len());
        let Some([a, b]) = random_spots(&mut rng, pair, laser, noise_px) else { continue };
        match pair.reconstruct(laser, [&[a], &[b]], method) {
            (Ok(fixed), Ok(exact)) => {
                // Up to 4.8 m is what is promised
                if exact.along > 4800.0 {
                    continue;
                }
                compared += 1;
                for (f, e) in fixed.position.iter().zip(exact.position) {
                    worst = worst.max((f.to_num::<f64>() - e).abs());
                }
                if let (Some(f), Some(e)) = (fixed.sigma, exact.sigma) {
                    assert!((f.to_num::<f64>() / e - 1.0).abs() < 0.03, "sigma {f} against {e}");
                }
                if let (Some(f), Some(e)) = (fixed.chi2, exact.chi2) {
                    assert!((f.to_num::<f64>() - e).abs() < 0.05 + 0.03 * e, "chi squared {f} against {e}");
                }
            }
            (Err(a), Err(b)) if a == b => {}
            // Within the tolerance of chi squared either decision is right
            (Ok(p), Err(NoPoint::Inconsistent)) => {
                assert!(p.chi2.is_some_and(|c| c > pair.fixed.calibration.settings.chi2_max * I18F14::from_num(0.95)))
            }
            (Err(NoPoint::Inconsistent), Ok(p)) => {
                assert!(p.chi2.is_some_and(|c| c > 0.95 * pair.rig.reconstruction.chi2_max))
            }
            (a, b) => panic!("{a:?} against {b:?}"),
        }
    }
    worst
}

#[test]
fn weighted_points_differ_from_f64_by_less_than_0_05_mm() {
    for rig in [Rig::default(), Rig::ideal()] {
        let worst = worst_difference(&Pair::new(rig), Method::Weighted, 0.1, 100_000);
        assert!(worst <= BOUND_MM, "{worst} mm");
    }
}

#[test]
fn paper_points_differ_from_f64_by_less_than_0_05_mm() {
    for rig in [Rig::default(), Rig::ideal()] {
        let worst = worst_difference(&Pair::new(rig), Method::Paper, 0.1, 100_000);
        assert!(worst <= BOUND_MM, "{worst} mm");
    }
}

#[test]
fn single_camera_points_differ_from_f64_by_less_than_0_05_mm() {
    let mut rig = Rig::default();
    rig.reconstruction.single_camera = true;
    let pair = Pair::new(rig);
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut compared = 0;
    while compared < 20_000 {
        let laser = rng.random_range(0..12);
        let Some([a, b]) = random_spots(&mut rng, &pair, laser, 0.1) else { continue };
        for spots in [[&[a][..], &[]], [&[], &[b][..]]] {
            match pair.reconstruct(laser, spots, Method::Weighted) {
                (Ok(fixed), Ok(exact)) if exact.along < 4800.0 => {
                    compared += 1;
                    for (f, e) in fixed.position.iter().zip(exact.position) {
                        let difference = (f.to_num::<f64>() - e).abs();
                        assert!(difference <= BOUND_MM, "{difference} mm at {} mm", exact.along);
                    }
                }
                (Ok(_), Ok(_)) => {}
                (a, b) => assert_eq!(a.map(|p| p.spots), b.map(|p| p.spots)),
            }
        }
    }
}

#[test]
fn reasons_for_no_point_agree() {
    let pair = Pair::new(Rig::default());
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let [a, b] = loop {
        if let Some(spots) = random_spots(&mut rng, &pair, 0, 0.0) {
            break spots;
        }
    };
    // Laser 0 lies along the image's x axis: 5 px in y are across its beam
    let [x, y] = b.position.map(|p| p.to_num::<f64>());
    let elsewhere = spot_at([x, y + 5.0], 3000, 20);
    type Case<'a> = (usize, [&'a [Spot]; 2], NoPoint);
    let cases: [Case; 4] = [
        (12, [&[a], &[b]], NoPoint::NoLaser),
        (0, [&[], &[]], NoPoint::NoSpot),
        (0, [&[a], &[]], NoPoint::OneCamera),
        (0, [&[a], &[elsewhere]], NoPoint::Inconsistent),
    ];
    for (laser, spots, reason) in cases {
        let (fixed, exact) = pair.reconstruct(laser, spots, Method::Weighted);
        assert_eq!((fixed.err(), exact.err()), (Some(reason), Some(reason)));
    }
}

#[test]
fn the_farthest_consistent_pair_wins() {
    let pair = Pair::new(Rig::default());
    let beam = &pair.rig.lasers[4];
    let spots_at = |along: f64| {
        let point = Point3::from(Vector3::from(beam.origin_mm) + beam.direction() * along);
        [0, 1].map(|camera| {
            let pixel = pair.rig.traced_camera(camera).unwrap().project(point).unwrap();
            spot_at([pixel.x, pixel.y], 3000, 20)
        })
    };
    let (wall, particle) = (spots_at(2000.0), spots_at(900.0));
    // A glint in one camera only, beyond the wall: it pairs with nothing
    let [glint, _] = spots_at(3500.0);
    let (fixed, exact) =
        pair.reconstruct(4, [&[particle[0], glint, wall[0]], &[wall[1], particle[1]]], Method::Weighted);
    let (fixed, exact) = (fixed.unwrap(), exact.unwrap());
    assert_eq!((fixed.spots, exact.spots), ([Some(2), Some(0)], [Some(2), Some(0)]));
    assert!((exact.along - 2000.0).abs() < 2.0, "{}", exact.along);
}

#[test]
fn no_spot_position_makes_the_chain_panic() {
    let pair = Pair::new(Rig::default());
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    for _ in 0..200_000 {
        let mut spot = || Spot {
            position: [I18F14::from_bits(rng.random()), I18F14::from_bits(rng.random())],
            variance: rng.random_range(0..=1 << 24),
            ..spot_at([500.0, 300.0], 1000, 10)
        };
        let spots = [spot(), spot()];
        for method in [Method::Weighted, Method::Paper] {
            let _ = karst_core::reconstruct(&pair.fixed.calibration, 0, [&spots[..1], &spots[1..]], method);
        }
    }
}

#[test]
fn detectors_take_their_configuration() {
    let pair = Pair::new(Rig::default());
    for config in pair.fixed.detectors {
        assert!(SpotDetector::<12>::new(config).is_ok());
    }
}
