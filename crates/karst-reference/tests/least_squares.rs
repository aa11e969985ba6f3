//! The decoupled weighted solve against the plain three-dimensional one.

use karst_core::{Bounds, Cluster, I18F14, Method, Spot};
use karst_reference::{BeamRay, Reference};
use karst_rig::Rig;
use nalgebra::{Matrix3, Point3, RowVector3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn spot_at(pixel: Vector2<f64>) -> Spot {
    let weight = 1 << 20; // so large that its rounding does not matter
    let sum = |v: f64| (v * f64::from(weight)).round() as u64;
    let (x, y) = (pixel.x as u16, pixel.y as u16);
    Spot {
        position: [pixel.x, pixel.y].map(I18F14::from_num),
        variance: 1,
        cluster: Cluster {
            pixels: weight / 150,
            green: 10,
            saturated: 0,
            weight,
            weight_x: sum(pixel.x),
            weight_y: sum(pixel.y),
            bounds: Bounds { x_min: x, x_max: x, y_min: y, y_max: y },
            radius_squared: 0,
        },
    }
}

/// Normal equations of all six observations of a point in the beam's frame: height and offset of each ray, height and
/// offset of the beam, each over its standard deviation.
fn solve(rays: &[BeamRay; 2], ray_sigmas: [[f64; 2]; 2], beam_sigma: f64) -> (Vector3<f64>, f64) {
    let mut observations = Vec::new();
    for (ray, [up, across]) in rays.iter().zip(ray_sigmas) {
        observations.push((RowVector3::new(-ray.up_slope, 1.0, 0.0) / up, ray.up / up));
        observations.push((RowVector3::new(-ray.across_slope, 0.0, 1.0) / across, ray.across / across));
    }
    observations.push((RowVector3::new(0.0, 1.0, 0.0) / beam_sigma, 0.0));
    observations.push((RowVector3::new(0.0, 0.0, 1.0) / beam_sigma, 0.0));
    let normal: Matrix3<f64> = observations.iter().map(|(a, _)| a.transpose() * a).sum();
    let right: Vector3<f64> = observations.iter().map(|(a, b)| a.transpose() * *b).sum();
    let point = normal.try_inverse().unwrap() * right;
    let chi2 = observations.iter().map(|(a, b)| ((a * point)[0] - b).powi(2)).sum();
    (point, chi2)
}

#[test]
fn the_decoupled_solve_is_the_three_dimensional_one_within_a_hundredth_of_its_sigma() {
    let rig = Rig::default();
    let cameras = rig.water_cameras().unwrap();
    let reference = Reference::new(rig.clone(), cameras.clone());
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut compared = 0;
    while compared < 2000 {
        let laser = rng.random_range(0..12);
        let beam = &rig.lasers[laser];
        let along = 300.0 + 4500.0 * rng.random::<f64>();
        let beam_sigma = 1.0_f64.hypot(2e-3 * along);
        let mut offset = || 2.0 * beam_sigma * (rng.random::<f64>() - 0.5);
        let in_beam = Vector3::new(along, offset(), offset());
        let target = Point3::from(Vector3::from(beam.origin_mm) + beam.frame().transpose() * in_beam);
        let mut pixel = |camera: usize| {
            let pixel = rig.traced_camera(camera)?.project(target)?;
            let mut noise = || 0.04 * (rng.random::<f64>() - 0.5);
            Some(pixel + Vector2::new(noise(), noise()))
        };
        let (Some(first), Some(second)) = (pixel(0), pixel(1)) else { continue };
        let pixels = [first, second];
        let spots = pixels.map(spot_at);
        let Ok(point) = reference.reconstruct(laser, [&spots[..1], &spots[1..]], Method::Weighted) else { continue };
        compared += 1;

        let rays = [0, 1].map(|i| BeamRay::new(&cameras[i], (laser, beam), pixels[i]).unwrap());
        let sigma_px = reference.spot(&spots[0].cluster).variance.sqrt();
        let sigmas = [0, 1].map(|i| {
            // Numeric derivatives along the radius and across it
            let step = |direction: Vector2<f64>, axis: usize| {
                let at = |sign: f64| {
                    let moved = pixels[i] + sign * 0.05 * direction;
                    BeamRay::new(&cameras[i], (laser, beam), moved).unwrap().at(point.along)[axis]
                };
                (at(1.0) - at(-1.0)).abs() / 0.1 * sigma_px
            };
            let radial = (pixels[i] - Vector2::from(cameras[i].model.centre_px)).normalize();
            [step(radial, 0), step(Vector2::new(-radial.y, radial.x), 1)]
        });
        let (solved, chi2) = solve(&rays, sigmas, 1.0_f64.hypot(2e-3 * point.along));
        let in_rig = Vector3::from(beam.origin_mm) + beam.frame().transpose() * solved;
        let difference = (in_rig - Vector3::from(point.position)).norm();
        let sigma = point.sigma.unwrap();
        assert!(difference <= 0.01 * sigma + 1e-4, "{difference} mm, sigma {sigma} mm at {along} mm");
        assert!((chi2 - point.chi2.unwrap()).abs() <= 0.02 * chi2 + 1e-3, "chi squared {chi2}, {:?}", point.chi2);
    }
}
