//! Spots of two cameras to a point in f64: the twin of `karst_core`'s module `reconstruct`.

use karst_core::{Cluster, Method, NoPoint, Spot};
use karst_rig::{Laser, Rig, WaterCamera};
use nalgebra::{Vector2, Vector3};

use crate::beam::{BeamRay, Fused, Variances, fuse_single, fuse_stereo, mono, sensitivity, stereo};

/// The f64 chain of one instrument.
#[derive(Debug, Clone)]
pub struct Reference {
    rig: Rig,
    cameras: [WaterCamera; 2],
}

/// A spot without rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceSpot {
    /// Weighted centroid, px.
    pub position: Vector2<f64>,
    /// Variance per axis, px^2.
    pub variance: f64,
}

/// The three single estimates of the distance along the beam, mm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimates {
    /// Camera 1 and laser, camera 2 and laser.
    pub mono: [Option<f64>; 2],
    /// Camera 1 and camera 2.
    pub stereo: Option<f64>,
}

/// A reconstructed point; the fields are those of [`karst_core::Point`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// X, Y, Z in the rig frame, mm.
    pub position: [f64; 3],
    /// Distance along the beam from the laser's origin, mm.
    pub along: f64,
    /// Standard deviation along the beam, mm (weighted method).
    pub sigma: Option<f64>,
    /// chi squared (weighted method).
    pub chi2: Option<f64>,
    /// The three single estimates.
    pub estimates: Estimates,
    /// Which of the laser's spots each camera gave.
    pub spots: [Option<u8>; 2],
}

impl Reference {
    /// The chain for a rig with its cameras in the water.
    pub fn new(rig: Rig, cameras: [WaterCamera; 2]) -> Self {
        Self { rig, cameras }
    }

    /// Position and variance of a spot from the exact sums of its pixels.
    pub fn spot(&self, cluster: &Cluster) -> ReferenceSpot {
        let settings = &self.rig.detector;
        let weight = f64::from(cluster.weight);
        let mean_weight = weight / f64::from(cluster.pixels);
        let noise = settings.noise_dn.powi(2) / (4.0 * std::f64::consts::PI);
        ReferenceSpot {
            position: Vector2::new(cluster.weight_x as f64, cluster.weight_y as f64) / weight,
            variance: (settings.sigma_floor_px.powi(2) + noise / (mean_weight * mean_weight)).min(1.0),
        }
    }

    /// The point of one laser from its candidate spots in the two cameras: the rules of [`karst_core::reconstruct`].
    pub fn reconstruct(&self, laser: usize, spots: [&[Spot]; 2], method: Method) -> Result<Point, NoPoint> {
        let beam = (laser, self.rig.lasers.get(laser).ok_or(NoPoint::NoLaser)?);
        match method {
            Method::Weighted => self.weighted(beam, spots),
            Method::Paper => self.paper(beam, spots),
        }
    }

    fn weighted(&self, beam: (usize, &Laser), spots: [&[Spot]; 2]) -> Result<Point, NoPoint> {
        let mut best = Err(match (spots[0].len(), spots[1].len()) {
            (0, 0) => NoPoint::NoSpot,
            (0, _) | (_, 0) => NoPoint::OneCamera,
            _ => NoPoint::NoIntersection,
        });
        for (i, a) in spots[0].iter().enumerate() {
            for (j, b) in spots[1].iter().enumerate() {
                let pair = [self.spot(&a.cluster), self.spot(&b.cluster)];
                best = better(best, self.fuse(beam, pair.map(Some), [Some(i as u8), Some(j as u8)]));
            }
        }
        if best.is_err() && self.rig.reconstruction.single_camera {
            for (i, a) in spots[0].iter().enumerate() {
                best = better(best, self.fuse(beam, [Some(self.spot(&a.cluster)), None], [Some(i as u8), None]));
            }
            for (i, b) in spots[1].iter().enumerate() {
                best = better(best, self.fuse(beam, [None, Some(self.spot(&b.cluster))], [None, Some(i as u8)]));
            }
        }
        best
    }

    fn fuse(
        &self,
        beam: (usize, &Laser),
        spots: [Option<ReferenceSpot>; 2],
        indices: [Option<u8>; 2],
    ) -> Result<Point, NoPoint> {
        let rays = [0, 1].map(|i| spots[i].and_then(|s| BeamRay::new(&self.cameras[i], beam, s.position)));
        let variances = Variances {
            beam: &|along| beam.1.origin_sigma_mm.powi(2) + (along * beam.1.direction_sigma_mrad * 1e-3).powi(2),
            rays: &|camera, along| {
                let spot = spots[camera]?;
                let change = sensitivity(&self.cameras[camera], beam, spot.position, along)?;
                Some(change.map(|c| c * c * spot.variance))
            },
        };
        let fused = match rays {
            [Some(a), Some(b)] => fuse_stereo(&[a, b], &variances),
            [Some(a), None] if spots[1].is_none() => fuse_single(0, &a, &variances),
            [None, Some(b)] if spots[0].is_none() => fuse_single(1, &b, &variances),
            _ => Err(NoPoint::NoIntersection),
        }?;
        if fused.chi2 > self.rig.reconstruction.chi2_max {
            return Err(NoPoint::Inconsistent);
        }
        let Fused { beam: position, sigma, chi2 } = fused;
        let point = self.point(beam, position, &rays, indices)?;
        Ok(Point { sigma: Some(sigma), chi2: Some(chi2), ..point })
    }

    fn paper(&self, beam: (usize, &Laser), spots: [&[Spot]; 2]) -> Result<Point, NoPoint> {
        let farthest = spots.map(|s| s.iter().enumerate().max_by_key(|(_, spot)| spot.cluster.r_max()));
        if farthest == [None, None] {
            return Err(NoPoint::NoSpot);
        }
        let rays = [0, 1].map(|i| {
            let b = farthest[i]?.1.cluster.bounds;
            let middle = |low: u16, high: u16| (f64::from(low) + f64::from(high)) / 2.0;
            let pixel = Vector2::new(middle(b.x_min, b.x_max), middle(b.y_min, b.y_max));
            BeamRay::new(&self.cameras[i], beam, pixel)
        });
        let mut points = Vec::new();
        for ray in rays.iter().flatten() {
            points.extend(mono(ray).map(|along| Vector3::new(along, 0.0, ray.at(along)[1])));
        }
        if let [Some(a), Some(b)] = rays {
            points.extend(
                stereo(&[a, b])
                    .map(|along| Vector3::new(along, a.at(along)[0], (a.at(along)[1] + b.at(along)[1]) / 2.0)),
            );
        }
        if points.is_empty() {
            return Err(NoPoint::NoIntersection);
        }
        let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        self.point(beam, mean.into(), &rays, farthest.map(|f| f.map(|(i, _)| i as u8)))
    }

    fn point(
        &self,
        beam: (usize, &Laser),
        position: [f64; 3],
        rays: &[Option<BeamRay>; 2],
        spots: [Option<u8>; 2],
    ) -> Result<Point, NoPoint> {
        let [least, most] = self.rig.reconstruction.range_mm;
        if !(least..=most).contains(&position[0]) {
            return Err(NoPoint::OutOfRange);
        }
        let in_rig = Vector3::from(beam.1.origin_mm) + beam.1.frame().transpose() * Vector3::from(position);
        let both = if let [Some(a), Some(b)] = *rays { Some([a, b]) } else { None };
        Ok(Point {
            position: in_rig.into(),
            along: position[0],
            sigma: None,
            chi2: None,
            estimates: Estimates {
                mono: rays.map(|ray| ray.as_ref().and_then(mono)),
                stereo: both.as_ref().and_then(stereo),
            },
            spots,
        })
    }
}

/// The farther of two points, or the reason nearer to a point.
fn better(a: Result<Point, NoPoint>, b: Result<Point, NoPoint>) -> Result<Point, NoPoint> {
    match (a, b) {
        (Ok(p), Ok(q)) => Ok(if q.along > p.along { q } else { p }),
        (Err(a), Err(b)) => Err(a.max(b)),
        (Ok(p), Err(_)) | (Err(_), Ok(p)) => Ok(p),
    }
}
