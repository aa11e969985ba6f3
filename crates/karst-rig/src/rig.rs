//! The shipped rigs and the parts of a rig that follow from its data.

use crate::{Rig, TracedCamera};

/// How far beyond the mirror's rim a point still has a projection, px: a spot on the rim has pixels inside.
const RIM_MARGIN_PX: f64 = 16.0;

impl Default for Rig {
    /// The default rig: a calibrated instrument with small, known misalignments everywhere (`rigs/default.toml`).
    fn default() -> Self {
        shipped(include_str!("../rigs/default.toml"))
    }
}

impl Rig {
    /// The default rig without any misalignment (`rigs/ideal.toml`).
    pub fn ideal() -> Self {
        shipped(include_str!("../rigs/ideal.toml"))
    }

    /// Camera `index` (0 or 1) traced through tube and water. None: there is no such camera, it has no model in air, or
    /// the rig has no tube.
    pub fn traced_camera(&self, index: usize) -> Option<TracedCamera> {
        let camera = self.cameras.get(index)?;
        Some(TracedCamera {
            air: camera.air.clone()?,
            tube: self.tube?,
            water_index: self.water.index(),
            max_radius_px: camera.mirror_radius_px + RIM_MARGIN_PX,
        })
    }
}

fn shipped(text: &str) -> Rig {
    toml::from_str(text).expect("a test reads the shipped rigs")
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector2};

    #[test]
    fn the_belt_is_imaged_between_the_radii_from_300_to_4800_mm() {
        for rig in [Rig::default(), Rig::ideal()] {
            for (index, camera) in rig.cameras.iter().enumerate() {
                let traced = rig.traced_camera(index).unwrap();
                let centre = Vector2::from(traced.air.centre_px);
                for laser in &rig.lasers {
                    for range in [300.0, 1000.0, 4800.0] {
                        let point = Point3::from(laser.origin_mm) + range * laser.direction();
                        let radius = (traced.project(point).unwrap() - centre).norm();
                        assert!(
                            radius > camera.inner_radius_px && radius < camera.mirror_radius_px
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn the_ideal_rig_has_a_baseline_of_500_mm_and_12_lasers_30_degrees_apart() {
        let rig = Rig::ideal();
        let [first, second] = [0, 1].map(|i| rig.traced_camera(i).unwrap().air.pose.position_mm);
        assert_eq!(second[2] - first[2], 500.0);
        assert_eq!(rig.lasers.len(), 12);
        for (index, laser) in rig.lasers.iter().enumerate() {
            assert_eq!(laser.azimuth_deg, 30.0 * index as f64);
        }
    }
}
