//! The frame of an instrument as its own parts define it, and rigs in other frames.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::{Camera, Laser, Pose, Rig};

impl Laser {
    /// The same laser with another line as its beam: through a point (mm) in a direction (unit).
    pub fn with_beam(&self, origin: Point3<f64>, direction: Vector3<f64>) -> Self {
        Self {
            origin_mm: origin.coords.into(),
            azimuth_deg: direction.y.atan2(direction.x).to_degrees(),
            elevation_deg: direction.z.atan2(direction.xy().norm()).to_degrees(),
            ..*self
        }
    }
}

impl Rig {
    /// Transform to the rig frame from the frame that the instrument's own parts define: z runs through the viewpoints
    /// of both cameras, the origin is where the beams pass this axis (the mean of their heights), and the first laser
    /// has azimuth 0. It tells two descriptions of one instrument in different frames to be the same. None: a camera
    /// has no model, or the viewpoints coincide.
    pub fn own_frame(&self) -> Option<Isometry3<f64>> {
        let viewpoint = |camera: &Camera| camera.model().map(|(_, model)| Point3::from(model.pose.position_mm));
        let [first, second] = [viewpoint(&self.cameras[0])?, viewpoint(&self.cameras[1])?];
        let axis = (second - first).try_normalize(f64::EPSILON)?;
        // Height over the first viewpoint at which a beam is nearest to the axis.
        let height = |laser: &Laser| {
            let (start, direction) = (Vector3::from(laser.origin_mm) - first.coords, laser.direction());
            let cosine = axis.dot(&direction);
            (axis.dot(&start) - cosine * direction.dot(&start)) / (1.0 - cosine * cosine)
        };
        let mean = self.lasers.iter().map(height).sum::<f64>() / self.lasers.len() as f64;
        let beam = self.lasers.first()?.direction();
        let x = (beam - axis * axis.dot(&beam)).try_normalize(f64::EPSILON)?;
        let rotation = Rotation3::from_basis_unchecked(&[x, axis.cross(&x), axis]);
        let origin = first + mean * axis;
        let isometry =
            Isometry3::from_parts(Translation3::from(origin), UnitQuaternion::from_rotation_matrix(&rotation));
        isometry.translation.vector.iter().all(|value| value.is_finite()).then_some(isometry)
    }

    /// The same instrument described in another frame, with the transform from the present frame to that one. Ranges
    /// along each beam count from where it is nearest to the new z axis.
    pub fn in_frame(&self, transform: &Isometry3<f64>) -> Self {
        let mut rig = self.clone();
        let moved = |pose: Pose| Pose::from(transform * pose.isometry());
        for model in rig.cameras.iter_mut().flat_map(|camera| [&mut camera.air, &mut camera.water]).flatten() {
            model.pose = moved(model.pose);
        }
        if let Some(tube) = &mut rig.tube {
            tube.pose = moved(tube.pose);
        }
        for laser in &mut rig.lasers {
            let (origin, direction) = (transform * Point3::from(laser.origin_mm), transform * laser.direction());
            let across = direction.xy();
            let foot = origin - origin.coords.xy().dot(&across) / across.norm_squared() * direction;
            *laser = laser.with_beam(foot, direction);
        }
        rig
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_becomes_an_isometry_and_back() {
        let pose = Pose { position_mm: [1.0, -2.0, 3.0], rotation_deg: [179.0, 20.0, -140.0] };
        let back = Pose::from(pose.isometry());
        let difference = pose.isometry().inverse() * back.isometry();
        assert!(difference.translation.vector.norm() < 1e-12 && difference.rotation.angle() < 1e-12);
    }

    #[test]
    fn the_own_frame_of_the_ideal_rig_is_the_rig_frame() {
        let frame = Rig::ideal().own_frame().unwrap();
        assert!(frame.translation.vector.norm() < 1e-9 && frame.rotation.angle() < 1e-9, "{frame}");
    }

    #[test]
    fn a_rig_described_in_its_own_frame_does_not_depend_on_the_frame_it_came_from() {
        let rig = Rig::default();
        let transform = Pose { position_mm: [3.0, -2.0, 5.0], rotation_deg: [0.5, -0.4, 20.0] }.isometry();
        let own = |rig: &Rig| rig.in_frame(&rig.own_frame().unwrap().inverse());
        let (a, b) = (own(&rig), own(&rig.in_frame(&transform)));
        let pixel = nalgebra::Vector2::new(700.0, 500.0);
        for index in 0..2 {
            let [p, q] = [&a, &b].map(|rig| rig.traced_camera(index).unwrap().ray(pixel).unwrap());
            assert!((p.origin - q.origin).norm() < 1e-9 && (p.direction - q.direction).norm() < 1e-12);
        }
        for (p, q) in a.lasers.iter().zip(&b.lasers) {
            assert!((Point3::from(p.origin_mm) - Point3::from(q.origin_mm)).norm() < 1e-9);
            assert!((p.direction() - q.direction()).norm() < 1e-12);
        }
    }

    #[test]
    fn cameras_in_one_place_define_no_frame() {
        let mut rig = Rig::default();
        let pose = rig.cameras[0].air.as_ref().unwrap().pose;
        rig.cameras[1].air.as_mut().unwrap().pose.position_mm = pose.position_mm;
        assert!(rig.own_frame().is_none());
    }
}
