//! Walls as analytic surfaces, and where a ray meets them.

use crate::{Gallery, Mesh};
use karst_rig::Ray;
use nalgebra::{Point3, Vector2, Vector3};
use std::{f64::consts::PI, sync::Arc};

/// Where a ray meets the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Point on the wall, mm.
    pub point: Point3<f64>,
    /// Unit normal of the wall, on the side the ray comes from.
    pub normal: Vector3<f64>,
    /// Distance from the ray's origin, mm.
    pub t_mm: f64,
}

/// The walls around the instrument. The analytic shapes are endless along z and closed around it.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Regular hexagonal pool.
    HexagonalPool {
        /// Distance between opposite walls, mm.
        across_flats_mm: f64,
    },
    /// Square gallery.
    Square {
        /// Distance between opposite walls, mm.
        side_mm: f64,
    },
    /// Circular pipe.
    RoundTube {
        /// Radius, mm.
        radius_mm: f64,
    },
    /// Natural cave passage.
    IrregularGallery(Gallery),
    /// Triangle mesh from a file.
    Mesh(Arc<Mesh>),
}

impl Shape {
    /// First meeting of a ray (frame of the shape) with the wall. The ray has to start inside.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        match self {
            Shape::HexagonalPool { across_flats_mm } => prism(ray, 6, across_flats_mm / 2.0),
            Shape::Square { side_mm } => prism(ray, 4, side_mm / 2.0),
            Shape::RoundTube { radius_mm } => cylinder(ray, *radius_mm),
            Shape::IrregularGallery(gallery) => gallery.intersect(ray),
            Shape::Mesh(mesh) => mesh.intersect(ray),
        }
    }

    /// Whether a point is inside the walls. Meshes need not be closed: any point counts as inside.
    pub fn contains(&self, point: Point3<f64>) -> bool {
        let inside_prism = |sides, apothem| flats(sides).all(|n| n.dot(&point.xy().coords) < apothem);
        match self {
            Shape::HexagonalPool { across_flats_mm } => inside_prism(6, across_flats_mm / 2.0),
            Shape::Square { side_mm } => inside_prism(4, side_mm / 2.0),
            Shape::RoundTube { radius_mm } => point.x.hypot(point.y) < *radius_mm,
            Shape::IrregularGallery(gallery) => gallery.contains(point),
            Shape::Mesh(_) => true,
        }
    }
}

/// Outward normals of the flats of a regular prism; the first one is x.
fn flats(sides: u32) -> impl Iterator<Item = Vector2<f64>> {
    (0..sides).map(move |i| {
        let (sin, cos) = (2.0 * PI * f64::from(i) / f64::from(sides)).sin_cos();
        Vector2::new(cos, sin)
    })
}

fn prism(ray: &Ray, sides: u32, apothem_mm: f64) -> Option<Hit> {
    let (origin, direction) = (ray.origin.xy().coords, ray.direction.xy());
    flats(sides)
        .filter_map(|n| {
            let speed = n.dot(&direction);
            (speed > 1e-12).then(|| ((apothem_mm - n.dot(&origin)) / speed, n))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(t, _)| *t > 0.0)
        .map(|(t, n)| Hit { point: ray.origin + t * ray.direction, normal: Vector3::new(-n.x, -n.y, 0.0), t_mm: t })
}

fn cylinder(ray: &Ray, radius_mm: f64) -> Option<Hit> {
    let t = leave_cylinder(ray, radius_mm)?;
    let point = ray.origin + t * ray.direction;
    Some(Hit { point, normal: Vector3::new(-point.x, -point.y, 0.0).try_normalize(0.0)?, t_mm: t })
}

/// Distance at which a ray that starts inside leaves the circular cylinder around z.
pub(crate) fn leave_cylinder(ray: &Ray, radius_mm: f64) -> Option<f64> {
    let (o, d) = (ray.origin.xy().coords, ray.direction.xy());
    let (a, half_b, c) = (d.norm_squared(), o.dot(&d), o.norm_squared() - radius_mm * radius_mm);
    let discriminant = half_b * half_b - a * c;
    if a < 1e-24 || c >= 0.0 || discriminant < 0.0 {
        return None;
    }
    // The two forms of the root avoid cancellation for either sign of half_b.
    let q = discriminant.sqrt();
    Some(if half_b > 0.0 { -c / (half_b + q) } else { (q - half_b) / a })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneError;

    pub(crate) fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: Point3::from(origin), direction: Vector3::from(direction).normalize() }
    }

    #[test]
    fn rays_meet_the_analytic_walls_within_1e_9_mm() -> Result<(), SceneError> {
        // Origin, direction, point and normal of the hit.
        type Vectors = [[f64; 3]; 4];
        let cases: [(Shape, Vectors); 6] = [
            (
                Shape::Square { side_mm: 2000.0 },
                [[100.0, 50.0, 7.0], [1.0, 0.0, 0.0], [1000.0, 50.0, 7.0], [-1.0, 0.0, 0.0]],
            ),
            (
                Shape::Square { side_mm: 2000.0 },
                [[0.0; 3], [0.5, -1.0, 0.25], [500.0, -1000.0, 250.0], [0.0, 1.0, 0.0]],
            ),
            (
                Shape::HexagonalPool { across_flats_mm: 3000.0 },
                [[-200.0, 0.0, 0.0], [-1.0, 0.0, 1.0], [-1500.0, 0.0, 1300.0], [1.0, 0.0, 0.0]],
            ),
            (
                // Along the y axis a hexagon with a flat on x has a corner, at 2 / sqrt(3) apothems.
                Shape::HexagonalPool { across_flats_mm: 3000.0 },
                [
                    [1e-6, 0.0, 0.0],
                    [0.0, 1.0, 0.0],
                    [1e-6, 3000.0 / 3f64.sqrt() - 1e-6 / 3f64.sqrt(), 0.0],
                    [-0.5, -(3f64.sqrt()) / 2.0, 0.0],
                ],
            ),
            (
                Shape::RoundTube { radius_mm: 500.0 },
                [[300.0, 0.0, 0.0], [0.0, 1.0, 0.0], [300.0, 400.0, 0.0], [-0.6, -0.8, 0.0]],
            ),
            (
                Shape::RoundTube { radius_mm: 500.0 },
                [[-300.0, 0.0, 0.0], [1.0, 0.0, 0.0], [500.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
            ),
        ];
        for (shape, [origin, direction, point, normal]) in cases {
            let hit = shape.intersect(&ray(origin, direction)).ok_or(SceneError::Outside)?;
            assert!((hit.point - Point3::from(point)).norm() < 1e-9, "{shape:?}: {hit:?}");
            assert!((hit.normal - Vector3::from(normal)).norm() < 1e-9, "{shape:?}: {hit:?}");
            assert!((hit.t_mm - (hit.point - Point3::from(origin)).norm()).abs() < 1e-9);
        }
        Ok(())
    }

    #[test]
    fn rays_along_the_axis_or_from_outside_meet_nothing() {
        for shape in [
            Shape::HexagonalPool { across_flats_mm: 3000.0 },
            Shape::Square { side_mm: 3000.0 },
            Shape::RoundTube { radius_mm: 1500.0 },
            Shape::IrregularGallery(Gallery::new(1, 700.0, 1500.0)),
        ] {
            assert_eq!(shape.intersect(&ray([0.0; 3], [0.0, 0.0, 1.0])), None);
            assert_eq!(shape.intersect(&ray([9000.0, 0.0, 0.0], [1.0, 0.0, 0.0])), None);
            assert!(shape.contains(Point3::origin()));
            assert!(!shape.contains(Point3::new(9000.0, 0.0, 0.0)));
        }
    }
}
