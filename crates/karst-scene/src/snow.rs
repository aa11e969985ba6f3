//! Marine snow: particles drifting in the water.

use nalgebra::{Point3, Unit, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson};
use std::f64::consts::PI;

/// Particle sizes (diameters), mm. Their density falls with the third power of the size.
const SIZE_MM: [f64; 2] = [0.3, 3.0];
/// Albedo of a particle.
pub(crate) const ALBEDO: f64 = 0.5;
/// Cylinder around the rig's axis in which particles are drawn one by one: radius and half height, mm. Those farther
/// away are dimmer than the noise.
const REGION_MM: [f64; 2] = [1200.0, 700.0];

/// One particle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Particle {
    pub position: Point3<f64>,
    pub diameter_mm: f64,
}

/// Particles around the instrument outside of a radius, rig frame.
pub(crate) fn around(per_m3: f64, clear_radius_mm: f64, rng: &mut ChaCha8Rng) -> Vec<Particle> {
    let [outer, half_height] = REGION_MM;
    let areas = [clear_radius_mm.powi(2), outer * outer];
    let volume_m3 = PI * (areas[1] - areas[0]).max(0.0) * 2.0 * half_height * 1e-9;
    (0..count(per_m3 * volume_m3, rng))
        .map(|_| {
            let radius = (areas[0] + (areas[1] - areas[0]) * rng.random::<f64>()).sqrt();
            let (sin, cos) = (2.0 * PI * rng.random::<f64>()).sin_cos();
            let z = half_height * (2.0 * rng.random::<f64>() - 1.0);
            Particle { position: Point3::new(radius * cos, radius * sin, z), diameter_mm: size(rng) }
        })
        .collect()
}

/// Particles that touch a beam of a radius (of 1/e²) within a length from a start: with the fraction of its power that
/// each intercepts.
pub(crate) fn in_beam(
    per_m3: f64,
    start: Point3<f64>,
    direction: Unit<Vector3<f64>>,
    length_mm: f64,
    beam_radius_mm: f64,
    rng: &mut ChaCha8Rng,
) -> Vec<(Particle, f64)> {
    let reach = 1.5 * beam_radius_mm + SIZE_MM[1] / 2.0;
    let volume_m3 = PI * reach * reach * length_mm * 1e-9;
    let [u, v] = transverse(direction);
    (0..count(per_m3 * volume_m3, rng))
        .map(|_| {
            let radius = reach * rng.random::<f64>().sqrt();
            let (sin, cos) = (2.0 * PI * rng.random::<f64>()).sin_cos();
            let along = length_mm * rng.random::<f64>();
            let position = start + along * direction.into_inner() + radius * (cos * u + sin * v);
            let diameter_mm = size(rng);
            // The Gaussian's integral over a centred disc, times its fall towards the side: exact for small particles.
            let w2 = beam_radius_mm * beam_radius_mm;
            let fraction =
                (1.0 - (-diameter_mm * diameter_mm / (2.0 * w2)).exp()) * (-2.0 * radius * radius / w2).exp();
            (Particle { position, diameter_mm }, fraction)
        })
        .collect()
}

/// Two unit vectors across a direction.
pub(crate) fn transverse(direction: Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let mut axis = Vector3::zeros();
    axis[direction.iamin()] = 1.0;
    let u = direction.cross(&axis).normalize();
    [u, direction.cross(&u)]
}

fn count(mean: f64, rng: &mut ChaCha8Rng) -> usize {
    // The distribution refuses a mean of zero.
    Poisson::new(mean).map_or(0, |p| p.sample(rng) as usize)
}

/// Size from a density proportional to size^-3, by its inverse cumulative distribution.
fn size(rng: &mut ChaCha8Rng) -> f64 {
    let [a, b] = SIZE_MM.map(|s| s.powi(-2));
    (a + (b - a) * rng.random::<f64>()).powf(-0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn particles_have_the_asked_density_and_sizes() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let particles = around(1000.0, 80.0, &mut rng);
        let volume_m3 = PI * (1.2f64.powi(2) - 0.08f64.powi(2)) * 1.4;
        let expected = 1000.0 * volume_m3;
        assert!((particles.len() as f64 - expected).abs() < 4.0 * expected.sqrt());
        let (mut large, mut near) = (0, 0);
        for p in &particles {
            assert!((SIZE_MM[0]..=SIZE_MM[1]).contains(&p.diameter_mm));
            let r = p.position.x.hypot(p.position.y);
            assert!((80.0..=1200.0).contains(&r) && p.position.z.abs() <= 700.0);
            large += usize::from(p.diameter_mm > 0.6);
            near += usize::from(r < 600.0);
        }
        let share = |n: usize| n as f64 / particles.len() as f64;
        // A quarter less the tail beyond 3 mm is larger than twice the least size.
        assert!((share(large) - 0.2424).abs() < 0.03, "{}", share(large));
        assert!((share(near) - 0.2466).abs() < 0.03, "{}", share(near));
    }

    #[test]
    fn no_particle_takes_more_than_the_whole_beam() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let hits = in_beam(1e6, Point3::origin(), Vector3::x_axis(), 3000.0, 1.5, &mut rng);
        assert!(hits.len() > 50);
        assert!(hits.iter().all(|(p, f)| (0.0..=1.0).contains(f) && p.position.y.hypot(p.position.z) < 3.8));
        assert!(around(0.0, 80.0, &mut rng).is_empty());
    }
}
