//! Pixel to ray and back for one camera model.

use crate::{CameraModel, Laser, NORMAL_RADIUS_PX, Pose, Ray};
use nalgebra::{Isometry3, Matrix2, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

/// Steps of the inward search for the radius that sees a point.
const SEARCH_STEPS: u32 = 16;
/// Newton steps; the bracket halves at least every other one, so this is never reached with sane polynomials.
const MAX_STEPS: u32 = 100;

impl Pose {
    /// The transform from the part's frame to the rig frame.
    pub fn isometry(&self) -> Isometry3<f64> {
        let [x, y, z] = self.rotation_deg.map(f64::to_radians);
        let rotation = Rotation3::from_euler_angles(x, y, z);
        Isometry3::from_parts(Translation3::from(self.position_mm), UnitQuaternion::from_rotation_matrix(&rotation))
    }
}

impl From<Isometry3<f64>> for Pose {
    fn from(isometry: Isometry3<f64>) -> Self {
        let (x, y, z) = isometry.rotation.euler_angles();
        Self { position_mm: isometry.translation.vector.into(), rotation_deg: [x, y, z].map(f64::to_degrees) }
    }
}

impl Laser {
    /// Unit direction, rig frame.
    pub fn direction(&self) -> Vector3<f64> {
        let (sin_azimuth, cos_azimuth) = self.azimuth_deg.to_radians().sin_cos();
        let (sin_elevation, cos_elevation) = self.elevation_deg.to_radians().sin_cos();
        Vector3::new(cos_elevation * cos_azimuth, cos_elevation * sin_azimuth, sin_elevation)
    }
}

/// Horner's rule, constant term first.
pub(crate) fn horner(coefficients: &[f64], s: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c)
}

/// Value and derivative of a polynomial.
fn horner_with_derivative(coefficients: &[f64], s: f64) -> (f64, f64) {
    coefficients.iter().rev().fold((0.0, 0.0), |(sum, derivative), c| (sum * s + c, derivative * s + sum))
}

impl CameraModel {
    /// Ray through a pixel, rig frame.
    pub fn ray(&self, pixel: Vector2<f64>) -> Ray {
        let ray = self.camera_ray(self.corrected(pixel));
        let to_rig = self.pose.isometry();
        Ray { origin: to_rig * ray.origin, direction: to_rig * ray.direction }
    }

    /// Pixel of a point in the rig frame, mm. None: no radius up to `max_radius_px` (after the affine and tangential
    /// corrections) sees the point. Where several radii do, the outermost counts: polynomials of cameras in the water
    /// are not valid near the centre.
    pub fn project(&self, point: Point3<f64>, max_radius_px: f64) -> Option<Vector2<f64>> {
        let local = self.pose.isometry().inverse_transform_point(&point);
        self.pixel(self.corrected_of(local, max_radius_px)?)
    }

    /// (u'', v'') of a pixel, px: relative to the centre, after the affine and tangential corrections.
    pub fn corrected(&self, pixel: Vector2<f64>) -> Vector2<f64> {
        let [c, d, e] = self.affine;
        let offset = pixel - Vector2::from(self.centre_px);
        // A = [c d; e 1]
        let determinant = c - d * e;
        let ideal = Vector2::new(offset.x - d * offset.y, c * offset.y - e * offset.x) / determinant;
        self.decentred(ideal / NORMAL_RADIUS_PX) * NORMAL_RADIUS_PX
    }

    /// Pixel of (u'', v''), px: the inverse of `corrected`. None: the decentring has no inverse there.
    pub fn pixel(&self, corrected: Vector2<f64>) -> Option<Vector2<f64>> {
        let target = corrected / NORMAL_RADIUS_PX;
        let mut ideal = target;
        for _ in 0..MAX_STEPS {
            let step = self.decentring_jacobian(ideal).try_inverse()? * (target - self.decentred(ideal));
            ideal += step;
            if step.norm() <= 1e-15 * (1.0 + ideal.norm()) {
                let [c, d, e] = self.affine;
                let [x, y] = (ideal * NORMAL_RADIUS_PX).into();
                return Some(Vector2::new(c * x + d * y, e * x + y) + Vector2::from(self.centre_px));
            }
        }
        None
    }

    fn decentred(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let [p1, p2] = self.tangential;
        let [x, y] = ideal.into();
        let r2 = x * x + y * y;
        Vector2::new(x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y)
    }

    /// Derivative of (u'', v'') by (u', v'), at (x, y) = (u', v') / 512 px.
    pub fn decentring_jacobian(&self, ideal: Vector2<f64>) -> Matrix2<f64> {
        let [p1, p2] = self.tangential;
        let [x, y] = ideal.into();
        let cross = 2.0 * (p1 * x + p2 * y);
        Matrix2::new(1.0 + 2.0 * p1 * y + 6.0 * p2 * x, cross, cross, 1.0 + 6.0 * p1 * y + 2.0 * p2 * x)
    }

    /// Ray of (u'', v''), camera frame.
    pub(crate) fn camera_ray(&self, corrected: Vector2<f64>) -> Ray {
        let s = corrected.norm() / NORMAL_RADIUS_PX;
        let f = NORMAL_RADIUS_PX * horner(&self.polynomial, s);
        let z_v = NORMAL_RADIUS_PX * horner(&self.axial, s);
        Ray { origin: Point3::new(0.0, 0.0, z_v), direction: Vector3::new(corrected.x, corrected.y, f).normalize() }
    }

    /// (u'', v'') of a point in the camera frame, mm.
    pub(crate) fn corrected_of(&self, point: Point3<f64>, max_radius_px: f64) -> Option<Vector2<f64>> {
        let across = point.coords.xy();
        let distance = across.norm();
        let s = self.radius_of(distance, point.z, max_radius_px / NORMAL_RADIUS_PX)?;
        if distance == 0.0 {
            return Some(Vector2::zeros());
        }
        Some(across * (s * NORMAL_RADIUS_PX / distance))
    }

    /// The outermost s up to `s_max` whose ray passes the point at `distance` from the axis and height `z`.
    fn radius_of(&self, distance: f64, z: f64, s_max: f64) -> Option<f64> {
        // The ray passes the point when distance * f / rho + z_v = z. Times s, so that s = 0 is regular:
        let excess = |s: f64| {
            let (p, dp) = horner_with_derivative(&self.polynomial, s);
            let (q, dq) = horner_with_derivative(&self.axial, s);
            let height = z - NORMAL_RADIUS_PX * q;
            (distance * p - s * height, distance * dp - height + s * NORMAL_RADIUS_PX * dq)
        };
        // Rays climb towards the centre: the excess is negative outside and positive inside.
        let mut outer = s_max;
        // Also refuses a point or a polynomial that is not finite.
        if !(excess(outer).0 <= 0.0 && outer.is_finite()) {
            return None;
        }
        let mut inner =
            (0..SEARCH_STEPS).rev().map(|step| s_max * f64::from(step) / f64::from(SEARCH_STEPS)).find(|&s| {
                let found = excess(s).0 >= 0.0;
                if !found {
                    outer = s;
                }
                found
            })?;
        let mut s = 0.5 * (inner + outer);
        for _ in 0..MAX_STEPS {
            let (value, derivative) = excess(s);
            if value >= 0.0 {
                inner = s;
            } else {
                outer = s;
            }
            let newton = s - value / derivative;
            // Also false when the derivative vanishes.
            let next = if newton > inner && newton < outer { newton } else { 0.5 * (inner + outer) };
            if (next - s).abs() <= 1e-15 * s_max || value == 0.0 {
                return Some(s);
            }
            s = next;
        }
        Some(s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skewed() -> CameraModel {
        CameraModel {
            pose: Pose { position_mm: [1.0, -2.0, -250.0], rotation_deg: [1.0, -2.0, 30.0] },
            centre_px: [513.0, 380.0],
            affine: [1.01, 0.003, -0.002],
            tangential: [2e-3, -1e-3],
            polynomial: vec![0.301954714, 0.0, -0.784147565, -0.002778367, 0.12653417, -0.02922423, -0.006110336],
            axial: vec![],
        }
    }

    fn assert_round_trip(camera: &CameraModel, inner_px: f64) {
        for degrees in (0..360).step_by(7) {
            for step in 0..=20 {
                let radius = inner_px + (355.0 - inner_px) * f64::from(step) / 20.0;
                let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
                let pixel = Vector2::from(camera.centre_px) + radius * Vector2::new(cos, sin);
                let ray = camera.ray(pixel);
                for range in [100.0, 1000.0, 20_000.0] {
                    let seen = camera.project(ray.origin + range * ray.direction, 365.0);
                    let error = seen.map(|seen| (seen - pixel).norm());
                    assert!(error.is_some_and(|error| error < 1e-9), "{pixel} at {range} mm: {error:?} px");
                }
            }
        }
    }

    #[test]
    fn compact_round_trip_is_below_1e9_px() {
        assert_round_trip(&skewed(), 0.0);
    }

    #[test]
    fn axial_round_trip_is_below_1e9_px() {
        let mut camera = skewed();
        camera.axial = vec![0.3, -0.9, 0.7];
        assert_round_trip(&camera, 105.0);
    }

    #[test]
    fn points_below_the_rim_are_not_seen() {
        let camera = skewed();
        let below = camera.pose.isometry() * Point3::new(100.0, 0.0, -50.0);
        assert_eq!(camera.project(below, 360.0), None);
        assert_eq!(camera.project(Point3::new(f64::NAN, 0.0, 0.0), 360.0), None);
        assert_eq!(camera.project(Point3::new(1e3, 0.0, 0.0), f64::NAN), None);
    }

    #[test]
    fn rotations_apply_about_x_then_y_then_z() {
        let pose = Pose { position_mm: [1.0, 2.0, 3.0], rotation_deg: [90.0, 0.0, 90.0] };
        // z turns to -y about x, then to x about z.
        let error = pose.isometry() * Point3::new(0.0, 0.0, 1.0) - Point3::new(2.0, 2.0, 3.0);
        assert!(error.norm() < 1e-12);
    }

    #[test]
    fn laser_directions_follow_azimuth_and_elevation() {
        let laser = Laser {
            origin_mm: [0.0; 3],
            azimuth_deg: 90.0,
            elevation_deg: 30.0,
            origin_sigma_mm: 1.0,
            direction_sigma_mrad: 2.0,
        };
        let error = laser.direction() - Vector3::new(0.0, 0.75_f64.sqrt(), 0.5);
        assert!(error.norm() < 1e-12);
    }
}
