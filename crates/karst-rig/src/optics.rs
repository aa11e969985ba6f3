//! Ray tracing through the tube.

use crate::{CameraModel, Ray, Tube};
use nalgebra::{Isometry3, Matrix2, Point3, Vector2, Vector3};

/// Newton steps of a projection before it counts as failed.
const MAX_STEPS: u32 = 30;
/// Step of the numeric derivative, px: small against the curvature of the mirror, large against rounding.
const DERIVATIVE_STEP_PX: f64 = 1e-4;
/// Newton's method keeps its derivative after steps up to this, px.
const SAME_DERIVATIVE_PX: f64 = 0.1;
/// A projection has converged when its Newton step is below this, px.
const CONVERGED_PX: f64 = 1e-10;

/// A camera model *in air* looking through the tube: every ray is refracted exactly, in three dimensions, at both tube
/// surfaces, whatever the misalignment between camera and tube.
#[derive(Debug, Clone)]
pub struct TracedCamera {
    /// Camera in air.
    pub air: CameraModel,
    /// Tube between the camera and the water.
    pub tube: Tube,
    /// Refractive index of the water.
    pub water_index: f64,
    /// Largest radius, after the affine and tangential corrections, at which `project` finds a point, px.
    pub max_radius_px: f64,
}

impl TracedCamera {
    /// Ray in the water, rig frame: origin on the tube's outer surface, unit direction. None: total reflection, or the
    /// ray never reaches the tube.
    pub fn ray(&self, pixel: Vector2<f64>) -> Option<Ray> {
        let frames = Frames::new(self);
        let ray = self.trace(&frames, self.air.corrected(pixel))?;
        Some(Ray { origin: frames.tube_to_rig * ray.origin, direction: frames.tube_to_rig * ray.direction })
    }

    /// Image position of a point in the water (rig frame, mm). None: not imaged.
    pub fn project(&self, point: Point3<f64>) -> Option<Vector2<f64>> {
        let frames = Frames::new(self);
        let point = self.in_water(&frames, point)?;
        let image = self.search(&frames, point, self.coaxial_estimate(&frames, &point)?)?;
        (image.norm() <= self.max_radius_px).then(|| self.air.pixel(image)).flatten()
    }

    /// As `project`, from a pixel that is about right: faster, and for any radius. Of several pixels that see the point, the
    /// one that Newton's method reaches.
    pub fn project_near(&self, point: Point3<f64>, near: Vector2<f64>) -> Option<Vector2<f64>> {
        let frames = Frames::new(self);
        let point = self.in_water(&frames, point)?;
        self.air.pixel(self.search(&frames, point, self.air.corrected(near))?)
    }

    /// A point (rig frame) in the tube's frame, if it is outside of the tube.
    fn in_water(&self, frames: &Frames, point: Point3<f64>) -> Option<Point3<f64>> {
        let point = frames.tube_to_rig.inverse_transform_point(&point);
        (point.coords.xy().norm() >= self.tube.inner_radius_mm + self.tube.wall_mm).then_some(point)
    }

    /// (u'', v'') of a point (tube frame), by Newton's method.
    fn search(&self, frames: &Frames, point: Point3<f64>, mut image: Vector2<f64>) -> Option<Vector2<f64>> {
        let first = self.trace(frames, image)?;
        // Where a ray pierces the plane through the point and across the first ray, relative to the point.
        let normal = first.direction;
        let across = normal.cross(&least_aligned_axis(&normal)).normalize();
        let along = normal.cross(&across);
        let miss = |image: Vector2<f64>| -> Option<Vector2<f64>> {
            let ray = self.trace(frames, image)?;
            let distance = (point - ray.origin).dot(&normal) / ray.direction.dot(&normal);
            let offset = ray.origin + distance * ray.direction - point;
            (distance >= 0.0).then(|| Vector2::new(across.dot(&offset), along.dot(&offset)))
        };
        let inverse = |image: Vector2<f64>, missed: Vector2<f64>| {
            let column = |step| Some((miss(image + step)? - missed) / DERIVATIVE_STEP_PX);
            let x = column(Vector2::x() * DERIVATIVE_STEP_PX)?;
            let y = column(Vector2::y() * DERIVATIVE_STEP_PX)?;
            Matrix2::from_columns(&[x, y]).try_inverse()
        };
        let mut missed = miss(image)?;
        let mut by_miss = inverse(image, missed)?;
        for _ in 0..MAX_STEPS {
            let mut step = -(by_miss * missed);
            if step.norm() < CONVERGED_PX {
                return Some(image + step);
            }
            // Far from the solution a whole step may overshoot.
            let mut next = miss(image + step);
            while next.is_none_or(|next| next.norm() > missed.norm()) && step.norm() > CONVERGED_PX {
                step *= 0.5;
                next = miss(image + step);
            }
            missed = next?;
            image += step;
            // Nearby it hardly changes.
            if step.norm() > SAME_DERIVATIVE_PX {
                by_miss = inverse(image, missed)?;
            }
        }
        None
    }

    /// Ray in the water of (u'', v''), tube frame.
    fn trace(&self, frames: &Frames, corrected: Vector2<f64>) -> Option<Ray> {
        let ray = self.air.camera_ray(corrected);
        let air = Ray { origin: frames.camera_to_tube * ray.origin, direction: frames.camera_to_tube * ray.direction };
        let inner = self.tube.inner_radius_mm;
        let wall = refracted_by_cylinder(&air, inner, 1.0, self.tube.index)?;
        refracted_by_cylinder(&wall, inner + self.tube.wall_mm, self.tube.index, self.water_index)
    }

    /// (u'', v'') of a point (tube frame) as if the viewpoint were on the tube's axis: exact when it is.
    fn coaxial_estimate(&self, frames: &Frames, point: &Point3<f64>) -> Option<Vector2<f64>> {
        let viewpoint = frames.camera_to_tube * Point3::origin();
        let distance = point.coords.xy().norm();
        let inner = self.tube.inner_radius_mm;
        let slope = self.tube.air_slope(self.water_index, distance, point.z - viewpoint.z);
        let at_tube = Point3::new(point.x / distance * inner, point.y / distance * inner, viewpoint.z + inner * slope);
        let local = frames.camera_to_tube.inverse_transform_point(&at_tube);
        // Misalignment moves the image by some pixels: search beyond the limit, or start from there.
        let search_radius = 1.05 * self.max_radius_px;
        self.air.corrected_of(local, search_radius).or_else(|| {
            let across = local.coords.xy();
            (across.norm() > 0.0).then(|| across.normalize() * search_radius)
        })
    }
}

impl Tube {
    /// Height (mm, along the axis) at `distance` (mm, from the axis, outside of the tube) of the ray that starts on the
    /// tube's axis with this slope (tangent of elevation) in air.
    pub fn height_in_water(&self, water_index: f64, slope: f64, distance: f64) -> f64 {
        self.height_with_derivative(water_index, slope, distance).0
    }

    /// The inverse: slope in air of the ray that starts on the tube's axis and reaches `height` at `distance`.
    pub fn air_slope(&self, water_index: f64, distance: f64, height: f64) -> f64 {
        // The height is concave in the slope and the straight line is too flat: Newton climbs monotonically.
        let mut slope = height / distance;
        for _ in 0..MAX_STEPS {
            let (reached, derivative) = self.height_with_derivative(water_index, slope, distance);
            let step = (height - reached) / derivative;
            slope += step;
            // An estimate: the projection refines it.
            if step.abs() <= 1e-9 * (1.0 + slope.abs()) {
                break;
            }
        }
        slope
    }

    fn height_with_derivative(&self, water_index: f64, slope: f64, distance: f64) -> (f64, f64) {
        let outer = self.inner_radius_mm + self.wall_mm;
        let layers = [(self.inner_radius_mm, 1.0), (self.wall_mm, self.index), (distance - outer, water_index)];
        layers.into_iter().fold((0.0, 0.0), |(height, derivative), (thickness, index)| {
            // sin(elevation) scales with 1 / index.
            let root2 = index * index + (index * index - 1.0) * slope * slope;
            (height + thickness * slope / root2.sqrt(), derivative + thickness * index * index / (root2 * root2.sqrt()))
        })
    }
}

/// The transforms of one camera behind its tube.
struct Frames {
    tube_to_rig: Isometry3<f64>,
    camera_to_tube: Isometry3<f64>,
}

impl Frames {
    fn new(camera: &TracedCamera) -> Self {
        let tube_to_rig = camera.tube.pose.isometry();
        Frames { tube_to_rig, camera_to_tube: tube_to_rig.inv_mul(&camera.air.pose.isometry()) }
    }
}

/// The coordinate axis that is farthest from parallel to `direction`.
fn least_aligned_axis(direction: &Vector3<f64>) -> Vector3<f64> {
    let mut axis = Vector3::zeros();
    axis[direction.iamin()] = 1.0;
    axis
}

/// The ray that leaves a cylinder about z from its inside, refracted at its surface.
fn refracted_by_cylinder(ray: &Ray, radius: f64, n1: f64, n2: f64) -> Option<Ray> {
    let (start, across) = (ray.origin.coords.xy(), ray.direction.xy());
    // |start + t across| = radius, positive root.
    let a = across.norm_squared();
    let b = start.dot(&across);
    let c = start.norm_squared() - radius * radius;
    if !(c < 0.0 && a > 0.0) {
        return None;
    }
    let t = ((b * b - a * c).sqrt() - b) / a;
    let origin = ray.origin + t * ray.direction;
    let normal = Vector3::new(origin.x, origin.y, 0.0) / radius;
    Some(Ray { origin, direction: refract(ray.direction, normal, n1, n2)? })
}

/// Direction of a unit ray after refraction at a surface with unit `normal`, from index `n1` to `n2` (Snell's law in
/// vector form). The normal may point to either side. None: total internal reflection.
pub fn refract(direction: Vector3<f64>, normal: Vector3<f64>, n1: f64, n2: f64) -> Option<Vector3<f64>> {
    let ratio = n1 / n2;
    let cos1 = direction.dot(&normal);
    let cos2_squared = 1.0 - ratio * ratio * (1.0 - cos1 * cos1);
    if cos2_squared < 0.0 || cos2_squared.is_nan() {
        return None;
    }
    let cos2 = cos2_squared.sqrt().copysign(cos1);
    Some((ratio * direction + (cos2 - ratio * cos1) * normal).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pose, Rig};

    fn assert_snell(d1: Vector3<f64>, d2: Vector3<f64>, normal: Vector3<f64>, n1: f64, n2: f64) {
        let error = (n1 * d1.cross(&normal) - n2 * d2.cross(&normal)).norm();
        assert!(error < 1e-9, "n sin differs by {error}");
        let out_of_plane = d1.cross(&normal).dot(&d2).abs();
        assert!(out_of_plane < 1e-9, "out of the plane by {out_of_plane}");
        assert!(d1.dot(&normal) * d2.dot(&normal) > 0.0);
        assert!((d2.norm() - 1.0).abs() < 1e-12);
    }

    /// A camera 2 degrees and several mm off the tube's axis.
    fn tilted() -> TracedCamera {
        let mut camera = Rig::default().traced_camera(0).unwrap();
        camera.air.pose.position_mm = [4.0, -7.0, -250.0];
        camera.tube.pose = Pose { position_mm: [1.0, 2.0, 3.0], rotation_deg: [1.5, -2.0, 0.0] };
        camera
    }

    fn pixels(camera: &TracedCamera, inner_px: f64) -> Vec<Vector2<f64>> {
        let centre = Vector2::from(camera.air.centre_px);
        (0..360)
            .step_by(15)
            .flat_map(|degrees| {
                let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
                (0..=10).map(move |step| {
                    let radius = inner_px + (360.0 - inner_px) * f64::from(step) / 10.0;
                    centre + radius * Vector2::new(cos, sin)
                })
            })
            .collect()
    }

    #[test]
    fn refracted_rays_obey_snells_law_to_1e9() {
        let camera = tilted();
        let frames = Frames::new(&camera);
        let (inner, wall) = (camera.tube.inner_radius_mm, camera.tube.wall_mm);
        for pixel in pixels(&camera, 10.0) {
            let start = camera.air.camera_ray(camera.air.corrected(pixel));
            let air = Ray {
                origin: frames.camera_to_tube * start.origin,
                direction: frames.camera_to_tube * start.direction,
            };
            let plastic = refracted_by_cylinder(&air, inner, 1.0, camera.tube.index).unwrap();
            let water = camera.trace(&frames, camera.air.corrected(pixel)).unwrap();
            for (before, after, radius, n1, n2) in [
                (&air, &plastic, inner, 1.0, camera.tube.index),
                (&plastic, &water, inner + wall, camera.tube.index, camera.water_index),
            ] {
                let normal = Vector3::new(after.origin.x, after.origin.y, 0.0);
                assert!((normal.norm() - radius).abs() < 1e-9);
                let off_ray = (after.origin - before.origin).cross(&before.direction).norm();
                assert!(off_ray < 1e-9);
                assert_snell(before.direction, after.direction, normal / radius, n1, n2);
            }
        }
    }

    #[test]
    fn refraction_is_total_beyond_the_critical_angle() {
        let normal = Vector3::z();
        let direction = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            Vector3::new(sin, 0.0, cos)
        };
        // asin(1 / 1.5) = 41.81 degrees
        assert_eq!(refract(direction(42.0), normal, 1.5, 1.0), None);
        let bent = refract(direction(41.0), normal, 1.5, 1.0).unwrap();
        assert_snell(direction(41.0), bent, normal, 1.5, 1.0);
        let reversed = refract(direction(41.0), -normal, 1.5, 1.0).unwrap();
        assert!((bent - reversed).norm() < 1e-12);
        assert_eq!(refract(direction(f64::NAN), normal, 1.5, 1.0), None);
    }

    #[test]
    fn coaxial_rays_match_the_closed_form_to_1e9() {
        let camera = Rig::ideal().traced_camera(0).unwrap();
        let (d, e) = (camera.tube.inner_radius_mm, camera.tube.wall_mm);
        for pixel in pixels(&camera, 20.0) {
            let air = camera.air.ray(pixel);
            let sin_air = air.direction.z;
            let tangent = |sin: f64| sin / (1.0 - sin * sin).sqrt();
            let tan_wall = tangent(sin_air / camera.tube.index);
            let tan_water = tangent(sin_air / camera.water_index);
            let z_v = d * tangent(sin_air) + e * tan_wall - (d + e) * tan_water;
            let ray = camera.ray(pixel).unwrap();
            let traced = ray.direction.z / ray.direction.xy().norm();
            assert!((traced - tan_water).abs() < 1e-9);
            let at_1_m = camera.tube.height_in_water(camera.water_index, tangent(sin_air), 1000.0);
            assert!((at_1_m - (z_v + 1000.0 * tan_water)).abs() < 1e-9);
            let height = ray.origin.z - (d + e) * traced - air.origin.z;
            assert!((height - z_v).abs() < 1e-9, "{height} {z_v}");
            let azimuth = ray.direction.xy().normalize() - air.direction.xy().normalize();
            assert!(azimuth.norm() < 1e-9);
        }
    }

    #[test]
    fn traced_round_trip_is_below_1e9_px() {
        for camera in [
            Rig::ideal().traced_camera(1).unwrap(),
            Rig::default().traced_camera(0).unwrap(),
            Rig::default().traced_camera(1).unwrap(),
            tilted(),
        ] {
            let outer = camera.tube.inner_radius_mm + camera.tube.wall_mm;
            for pixel in pixels(&camera, 20.0) {
                let ray = camera.ray(pixel).unwrap();
                for range in [100.0 - outer, 300.0, 4800.0, 20_000.0] {
                    let seen = camera.project(ray.origin + range * ray.direction);
                    let error = seen.map(|seen| (seen - pixel).norm());
                    assert!(error.is_some_and(|error| error < 1e-9), "{pixel} at {range} mm: {error:?} px");
                }
            }
        }
    }

    #[test]
    fn a_projection_from_a_pixel_nearby_is_the_same_to_1e9_px() {
        for camera in [Rig::default().traced_camera(1).unwrap(), tilted()] {
            for pixel in pixels(&camera, 100.0) {
                let ray = camera.ray(pixel).unwrap();
                for range in [200.0, 4800.0] {
                    let point = ray.origin + range * ray.direction;
                    let seen = camera.project_near(point, pixel + Vector2::new(9.0, -7.0));
                    let error = seen.map(|seen| (seen - pixel).norm());
                    assert!(error.is_some_and(|error| error < 1e-9), "{pixel} at {range} mm: {error:?} px");
                }
            }
        }
    }

    #[test]
    fn without_refraction_the_traced_camera_is_the_plain_one() {
        let mut camera = tilted();
        camera.tube.index = 1.0;
        camera.water_index = 1.0;
        for pixel in pixels(&camera, 20.0) {
            let (traced, plain) = (camera.ray(pixel).unwrap(), camera.air.ray(pixel));
            assert!((traced.direction - plain.direction).norm() < 1e-12);
            let point = plain.origin + 2000.0 * plain.direction;
            let off_ray = (point - traced.origin).cross(&traced.direction).norm();
            assert!(off_ray < 1e-9);
            let (a, b) = (camera.project(point), camera.air.project(point, 380.0));
            assert!((a.unwrap() - b.unwrap()).norm() < 1e-9);
        }
    }

    #[test]
    fn points_that_are_not_imaged_have_no_projection() {
        let camera = Rig::default().traced_camera(0).unwrap();
        for point in
            [[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [1000.0, 0.0, -900.0], [f64::NAN, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0]]
        {
            assert_eq!(camera.project(Point3::from(point)), None, "{point:?}");
        }
    }

    #[test]
    fn a_camera_outside_the_tube_sees_nothing() {
        let mut camera = Rig::default().traced_camera(0).unwrap();
        camera.air.pose.position_mm = [76.0, 0.0, -250.0];
        assert_eq!(camera.ray(Vector2::new(700.0, 300.0)), None);
        assert_eq!(camera.project(Point3::new(1000.0, 0.0, 0.0)), None);
    }
}
