//! A cave passage: a cross-section that is irregular and changes along the axis.

use crate::Hit;
use crate::geometry::leave_cylinder;
use karst_rig::Ray;
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

/// Length along z after which the passage repeats, mm.
const PERIOD_MM: f64 = 9000.0;
/// Wave number of the longest wave along z, rad/mm.
const WAVE_NUMBER: f64 = 2.0 * PI / PERIOD_MM;
/// Highest number of bumps around the passage.
const BUMPS: usize = 9;
/// Highest number of bumps along one period.
const WAVES: usize = 4;
/// Longest step of the search for the wall, mm: no feature of the wall is thinner.
const STEP_MM: f64 = 60.0;
/// Steps after which a ray that runs along the passage counts as lost.
const STEPS: usize = 400;

/// Smooth random passage around z: the radius in direction phi at height z is
/// `min + (max - min) (1 + u / sqrt(1 + u²)) / 2` with u a random Fourier series in phi and z.
#[derive(Debug, Clone)]
pub struct Gallery {
    min_mm: f64,
    max_mm: f64,
    terms: Vec<Term>,
}

/// `re cos(k phi + 2 pi m z / PERIOD) + im sin(..)`
#[derive(Debug, Clone)]
struct Term {
    k: usize,
    m: isize,
    re: f64,
    im: f64,
}

impl Gallery {
    /// Passage drawn from a seed; its radius stays between the two bounds, mm.
    pub fn new(seed: u64, min_mm: f64, max_mm: f64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut terms = Vec::new();
        for k in 0..=BUMPS {
            for m in [0, 1, -1, 2, -2, 4, -4] {
                // A natural spectrum falls with frequency; few terms per ring keep the evaluation cheap.
                if (k > 4 && m != 2 && m != -1) || (k == 0 && m <= 0) {
                    continue;
                }
                let size = 1.1 / (1.0 + (k as f64).powf(1.4) + (m as f64).abs());
                let phase = rng.random_range(0.0..2.0 * PI);
                terms.push(Term { k, m, re: size * phase.cos(), im: size * phase.sin() });
            }
        }
        Self { min_mm, max_mm, terms }
    }

    /// Smallest and largest radius, mm.
    pub(crate) fn bounds_mm(&self) -> [f64; 2] {
        [self.min_mm, self.max_mm]
    }

    /// The waves exp(i (k phi + 2 pi m z / PERIOD)) of all terms towards a point off the axis, as (cos, sin).
    fn waves(&self, point: Point3<f64>) -> impl Iterator<Item = (&Term, f64, f64)> {
        // Powers of exp(i phi) and exp(i 2 pi z / PERIOD): one square root and one sine for the whole series.
        let rho = point.coords.xy().norm().max(1e-9);
        let (sin, cos) = (WAVE_NUMBER * point.z).sin_cos();
        let multiply = |a: (f64, f64), b: (f64, f64)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
        let mut around = [(1.0, 0.0); BUMPS + 1];
        for k in 1..=BUMPS {
            around[k] = multiply(around[k - 1], (point.x / rho, point.y / rho));
        }
        // Negative orders come first.
        let mut along = [(1.0, 0.0); 2 * WAVES + 1];
        for m in 1..=WAVES {
            along[WAVES + m] = multiply(along[WAVES + m - 1], (cos, sin));
            along[WAVES - m] = (along[WAVES + m].0, -along[WAVES + m].1);
        }
        self.terms.iter().map(move |term| {
            let (c, s) = multiply(around[term.k], along[(WAVES as isize + term.m) as usize]);
            (term, c, s)
        })
    }

    /// Distance to the wall in the direction away from the axis, mm: positive inside.
    fn depth(&self, point: Point3<f64>) -> f64 {
        let u: f64 = self.waves(point).map(|(term, c, s)| term.re * c + term.im * s).sum();
        let radius = self.min_mm + (self.max_mm - self.min_mm) / 2.0 * (1.0 + u / (1.0 + u * u).sqrt());
        radius - point.coords.xy().norm()
    }

    /// Unit normal of the wall at one of its points, to the inside.
    fn normal(&self, point: Point3<f64>) -> Vector3<f64> {
        let (mut u, mut by_phi, mut by_z) = (0.0, 0.0, 0.0);
        for (term, c, s) in self.waves(point) {
            let slope = term.im * c - term.re * s;
            u += term.re * c + term.im * s;
            by_phi += slope * term.k as f64;
            by_z += slope * term.m as f64 * WAVE_NUMBER;
        }
        let gain = (self.max_mm - self.min_mm) / 2.0 / (1.0 + u * u).powf(1.5);
        // Gradient of depth in cylindrical coordinates: (-1, r_phi / rho, r_z).
        let rho = point.coords.xy().norm();
        let (c, s, across) = (point.x / rho, point.y / rho, gain * by_phi / rho);
        Vector3::new(-c - s * across, -s + c * across, gain * by_z).normalize()
    }

    pub(crate) fn contains(&self, point: Point3<f64>) -> bool {
        self.depth(point) > 0.0
    }

    pub(crate) fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let at = |t: f64| ray.origin + t * ray.direction;
        let start = self.depth(ray.origin);
        if start <= 0.0 {
            return None;
        }
        // Nothing to search inside the narrowest cylinder.
        let mut t = leave_cylinder(ray, self.min_mm).unwrap_or(0.0);
        let mut depth = self.depth(at(t));
        for _ in 0..STEPS {
            let step = (0.5 * depth).clamp(STEP_MM / 8.0, 4.0 * STEP_MM);
            let next = self.depth(at(t + step));
            if next <= 0.0 {
                let t = root(|t| self.depth(at(t)), (t, depth), (t + step, next));
                let point = at(t);
                return Some(Hit { point, normal: self.normal(point), t_mm: t });
            }
            (t, depth) = (t + step, next);
        }
        None
    }
}

/// Root of a function between a positive and a negative value (Illinois variant of the false position method).
fn root(f: impl Fn(f64) -> f64, inside: (f64, f64), outside: (f64, f64)) -> f64 {
    let (mut a, mut fa) = inside;
    let (mut b, mut fb) = outside;
    for _ in 0..60 {
        let t = (a * fb - b * fa) / (fb - fa);
        let ft = f(t);
        if ft.abs() < 1e-10 || (b - a).abs() < 1e-10 {
            return t;
        }
        if ft * fb < 0.0 {
            (a, fa) = (b, fb);
        } else {
            fa /= 2.0;
        }
        (b, fb) = (t, ft);
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fan(origin: Point3<f64>) -> impl Iterator<Item = Ray> {
        (0..720).map(move |i| {
            let (sin, cos) = (f64::from(i) * PI / 360.0).sin_cos();
            let direction = Vector3::new(cos, sin, 0.6 * (7.0 * sin).sin()).normalize();
            Ray { origin, direction }
        })
    }

    #[test]
    fn hits_lie_on_the_wall_within_1e_9_mm_and_are_the_first() {
        for seed in 0..6 {
            let gallery = Gallery::new(seed, 600.0, 4800.0);
            for ray in fan(Point3::new(150.0, -100.0, 300.0)) {
                let Some(hit) = gallery.intersect(&ray) else { panic!("no wall along {ray:?}") };
                assert!(gallery.depth(hit.point).abs() < 1e-9, "{} mm", gallery.depth(hit.point));
                assert!(hit.normal.dot(&ray.direction) < 1e-9);
                for i in 0..1000 {
                    let t = hit.t_mm * f64::from(i) / 1000.0;
                    let depth = gallery.depth(ray.origin + t * ray.direction);
                    assert!(depth > -1.0, "seed {seed}: wall of {depth} mm before the hit");
                }
            }
        }
    }

    #[test]
    fn normals_agree_with_differences_of_the_depth() {
        let gallery = Gallery::new(3, 600.0, 4800.0);
        for ray in fan(Point3::origin()).step_by(37) {
            let Some(hit) = gallery.intersect(&ray) else { panic!("no wall along {ray:?}") };
            let difference = |axis: Vector3<f64>| {
                (gallery.depth(hit.point + 1e-3 * axis) - gallery.depth(hit.point - 1e-3 * axis)) / 2e-3
            };
            let gradient =
                Vector3::new(difference(Vector3::x()), difference(Vector3::y()), difference(Vector3::z())).normalize();
            assert!((gradient - hit.normal).norm() < 1e-6, "{gradient} {}", hit.normal);
        }
    }

    #[test]
    fn passages_are_irregular_and_keep_their_bounds() {
        let gallery = Gallery::new(11, 600.0, 4800.0);
        let radii: Vec<f64> = fan(Point3::origin()).map(|r| gallery.depth(r.origin + r.direction) + 1.0).collect();
        let (min, max) = radii.iter().fold((f64::MAX, 0f64), |(a, b), r| (a.min(*r), b.max(*r)));
        assert!(600.0 < min && max < 4800.0 && max - min > 1000.0, "{min} to {max} mm");
    }
}
