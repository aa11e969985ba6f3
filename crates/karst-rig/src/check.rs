//! Whether the values of a rig make sense.

use std::ops::RangeInclusive;

use nalgebra::Point3;

use crate::{
    Camera, CameraModel, DetectorSettings, Laser, MAX_AXIAL_COEFFICIENT, MAX_COEFFICIENTS, MAX_IMAGE_SIZE_PX,
    MAX_LASERS, MAX_POLYNOMIAL_COEFFICIENT, NORMAL_RADIUS_PX, Pose, ReconstructionSettings, Rig, Tube, Water,
    camera::horner,
};

/// Shortest distance between the viewpoints, and of a viewpoint from a beam's plane, mm: nearer, a ray and a beam (or
/// two rays) are so alike that a point has no range.
const LEAST_BASELINE_MM: f64 = 10.0;
/// Radii at which the slope of the rays is compared.
const SLOPE_CHECKS: u32 = 64;

/// A value of a rig that cannot be right.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{key}` is {found}, expected {expected}")]
pub struct Problem {
    /// Path of the field in the rig file, for example `camera[0].air.centre_px[1]`; lists count from 0.
    pub key: String,
    /// The value, or what follows from it.
    pub found: String,
    /// What would be right, with its unit.
    pub expected: String,
}

impl Problem {
    pub(crate) fn new(key: impl Into<String>, found: impl ToString, expected: impl Into<String>) -> Self {
        Problem { key: key.into(), found: found.to_string(), expected: expected.into() }
    }
}

impl Rig {
    /// Checks ranges and consistency; `from_toml` does so by itself. The first problem in the order of the file is
    /// returned.
    pub fn check(&self) -> Result<(), Problem> {
        self.water.check()?;
        if let Some(tube) = &self.tube {
            tube.check()?;
        }
        for (index, camera) in self.cameras.iter().enumerate() {
            camera.check(&format!("camera[{index}]"), self)?;
        }
        self.detector.check()?;
        self.reconstruction.check()?;
        if self.lasers.is_empty() || self.lasers.len() > MAX_LASERS {
            let expected = format!("1 to {MAX_LASERS} lasers");
            return Err(Problem::new("laser", format!("a list of {}", self.lasers.len()), expected));
        }
        for (index, laser) in self.lasers.iter().enumerate() {
            laser.check(&format!("laser[{index}]"))?;
        }
        self.check_sectors()?;
        self.check_baselines()
    }

    /// What is allowed but probably not meant, one sentence each.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            let Some((key, model)) = camera.model() else {
                continue;
            };
            let cut = (0..2).any(|axis| {
                let last = f64::from(camera.image_size_px[axis]) - 1.0;
                let centre = model.centre_px[axis];
                centre.min(last - centre) < camera.mirror_radius_px
            });
            if cut {
                warnings.push(format!(
                    "The mirror around `camera[{index}].{key}.centre_px` reaches beyond the image: lasers whose spots \
                     fall there give no points."
                ));
            }
        }
        warnings
    }

    /// Sectors around the lasers must not overlap: a spot belongs to one laser.
    fn check_sectors(&self) -> Result<(), Problem> {
        let least = 2.0 * self.detector.sector_half_width_deg;
        let mut order: Vec<usize> = (0..self.lasers.len()).collect();
        let azimuth = |index: usize| self.lasers[index].azimuth_deg.rem_euclid(360.0);
        order.sort_by(|&a, &b| azimuth(a).total_cmp(&azimuth(b)));
        // Of a single laser the neighbour is itself, a whole turn away.
        let neighbours = order.iter().zip(order.iter().cycle().skip(1));
        for (&a, &b) in neighbours.filter(|(a, b)| a != b) {
            let separation = (azimuth(b) - azimuth(a)).rem_euclid(360.0);
            // Rounding of decimal azimuths must not refuse sectors that touch.
            if separation < least - 1e-9 {
                let (first, second) = (a.min(b), a.max(b));
                return Err(Problem::new(
                    format!("laser[{second}].azimuth_deg"),
                    self.lasers[second].azimuth_deg,
                    format!("at least twice `detector.sector_half_width_deg`, {least} degrees, from laser[{first}]"),
                ));
            }
        }
        Ok(())
    }

    fn check_baselines(&self) -> Result<(), Problem> {
        let viewpoints = [0, 1].map(|index| {
            let (key, model) = self.cameras[index].model()?;
            let key = format!("camera[{index}].{key}.position_mm");
            Some((key, Point3::from(model.pose.position_mm)))
        });
        for (key, viewpoint) in viewpoints.iter().flatten() {
            for (index, laser) in self.lasers.iter().enumerate() {
                let height = laser.frame().row(1).transpose().dot(&(viewpoint - Point3::from(laser.origin_mm)));
                if height.abs() < LEAST_BASELINE_MM {
                    return Err(Problem::new(
                        key,
                        format!("{:.1} mm from the plane of laser[{index}]", height.abs()),
                        format!("at least {LEAST_BASELINE_MM} mm"),
                    ));
                }
            }
        }
        if let [Some((_, first)), Some((key, second))] = &viewpoints {
            let baseline = (second - first).norm();
            if baseline < LEAST_BASELINE_MM {
                return Err(Problem::new(
                    key,
                    format!("{baseline:.1} mm from the other camera"),
                    format!("at least {LEAST_BASELINE_MM} mm"),
                ));
            }
        }
        Ok(())
    }
}

impl Laser {
    fn check(&self, key: &str) -> Result<(), Problem> {
        check_position(&format!("{key}.origin_mm"), self.origin_mm)?;
        check_range(format!("{key}.azimuth_deg"), self.azimuth_deg, -360.0..=360.0, "degrees")?;
        check_range(format!("{key}.elevation_deg"), self.elevation_deg, -45.0..=45.0, "degrees")?;
        check_range(format!("{key}.origin_sigma_mm"), self.origin_sigma_mm, 0.001..=32.0, "mm")?;
        let sigma = self.direction_sigma_mrad;
        check_range(format!("{key}.direction_sigma_mrad"), sigma, 0.001..=20.0, "mrad")
    }
}

impl Water {
    fn check(&self) -> Result<(), Problem> {
        let temperature = self.temperature_c;
        check_range("water.temperature_c", temperature, -2.0..=40.0, "degrees Celsius")?;
        check_range("water.salinity", self.salinity, 0.0..=45.0, "per mille")?;
        check_range("water.wavelength_nm", self.wavelength_nm, 400.0..=700.0, "nm")
    }
}

impl Tube {
    fn check(&self) -> Result<(), Problem> {
        self.pose.check("tube")?;
        check_range("tube.inner_radius_mm", self.inner_radius_mm, 1.0..=1000.0, "mm")?;
        check_range("tube.wall_mm", self.wall_mm, 0.0..=100.0, "mm")?;
        check_range("tube.index", self.index, 1.0..=3.0, "")
    }
}

impl Pose {
    fn check(&self, key: &str) -> Result<(), Problem> {
        check_position(&format!("{key}.position_mm"), self.position_mm)?;
        for (axis, angle) in self.rotation_deg.into_iter().enumerate() {
            check_range(format!("{key}.rotation_deg[{axis}]"), angle, -360.0..=360.0, "degrees")?;
        }
        Ok(())
    }
}

impl Camera {
    /// The model whose viewpoint counts, with its key.
    pub(crate) fn model(&self) -> Option<(&'static str, &CameraModel)> {
        let water = self.water.as_ref().map(|model| ("water", model));
        water.or(self.air.as_ref().map(|model| ("air", model)))
    }

    fn check(&self, key: &str, rig: &Rig) -> Result<(), Problem> {
        for (axis, size) in self.image_size_px.into_iter().enumerate() {
            let limits = 16.0..=f64::from(MAX_IMAGE_SIZE_PX);
            check_range(format!("{key}.image_size_px[{axis}]"), f64::from(size), limits, "px")?;
        }
        let largest = f64::from(MAX_IMAGE_SIZE_PX);
        check_range(format!("{key}.mirror_radius_px"), self.mirror_radius_px, 1.0..=largest, "px")?;
        let inner = 0.0..=self.mirror_radius_px - 1.0;
        check_range(format!("{key}.inner_radius_px"), self.inner_radius_px, inner, "px")?;
        if self.air.is_none() && self.water.is_none() {
            let expected = "a model `air` or `water`";
            return Err(Problem::new(key, "a camera without a model", expected));
        }
        if let Some(air) = &self.air {
            let key = format!("{key}.air");
            // In air the slope alone counts: the rays meet the tube within some centimetres.
            self.check_model(air, &key, &[f64::INFINITY])?;
            if let Some(tube) = &rig.tube {
                let viewpoint = Point3::from(air.pose.position_mm);
                let across = tube.pose.isometry().inverse_transform_point(&viewpoint).coords.xy();
                if across.norm() >= tube.inner_radius_mm {
                    return Err(Problem::new(
                        format!("{key}.position_mm"),
                        format!("{:.1} mm from the axis of the tube", across.norm()),
                        format!("less than `tube.inner_radius_mm`, {} mm", tube.inner_radius_mm),
                    ));
                }
            }
        }
        match &self.water {
            Some(water) => self.check_model(water, &format!("{key}.water"), &rig.reconstruction.range_mm),
            None => Ok(()),
        }
    }

    fn check_model(&self, model: &CameraModel, key: &str, ranges_mm: &[f64]) -> Result<(), Problem> {
        model.pose.check(key)?;
        for axis in 0..2 {
            let limits = 0.0..=f64::from(self.image_size_px[axis]);
            check_range(format!("{key}.centre_px[{axis}]"), model.centre_px[axis], limits, "px")?;
        }
        let affine = [(0, 0.6..=1.6), (1, -0.2..=0.2), (2, -0.2..=0.2)];
        for (term, limits) in affine {
            check_range(format!("{key}.affine[{term}]"), model.affine[term], limits, "")?;
        }
        for (term, value) in model.tangential.into_iter().enumerate() {
            check_range(format!("{key}.tangential[{term}]"), value, -0.1..=0.1, "")?;
        }
        let polynomial = format!("{key}.polynomial");
        if model.polynomial.is_empty() {
            return Err(Problem::new(polynomial, "empty", "at least one coefficient"));
        }
        check_coefficients(&polynomial, &model.polynomial, MAX_POLYNOMIAL_COEFFICIENT)?;
        check_coefficients(&format!("{key}.axial"), &model.axial, MAX_AXIAL_COEFFICIENT)?;
        self.check_slope(model, &polynomial, ranges_mm)
    }

    /// Towards the rim the rays must turn downwards, or a point has no single image.
    fn check_slope(&self, model: &CameraModel, key: &str, ranges_mm: &[f64]) -> Result<(), Problem> {
        let inner = self.inner_radius_px.max(1.0);
        for range in ranges_mm {
            let mut last = f64::INFINITY;
            for step in 0..=SLOPE_CHECKS {
                let part = f64::from(step) / f64::from(SLOPE_CHECKS);
                let radius = inner + part * (self.mirror_radius_px - inner);
                let s = radius / NORMAL_RADIUS_PX;
                // Slope of the line from the viewpoint to the ray's point at this range.
                let slope = horner(&model.polynomial, s) / s + NORMAL_RADIUS_PX * horner(&model.axial, s) / range;
                if slope >= last {
                    return Err(Problem::new(
                        key,
                        format!("a model whose rays turn upwards near {radius:.0} px"),
                        "rays that turn downwards all the way from inner_radius_px to mirror_radius_px",
                    ));
                }
                last = slope;
            }
        }
        Ok(())
    }
}

impl DetectorSettings {
    fn check(&self) -> Result<(), Problem> {
        for (index, excess) in self.excess_min.into_iter().enumerate() {
            let key = format!("detector.excess_min[{index}]");
            check_range(key, f64::from(excess), 0.0..=510.0, "grey levels")?;
        }
        let weight = f64::from(self.clipped_weight);
        check_range("detector.clipped_weight", weight, 1.0..=500.0, "grey levels")?;
        check_range("detector.cluster_gap_px", self.cluster_gap_px, 0.0..=256.0, "px")?;
        check_range("detector.min_pixels", f64::from(self.min_pixels), 1.0..=65535.0, "")?;
        let half_width = self.sector_half_width_deg;
        check_range("detector.sector_half_width_deg", half_width, 0.01..=180.0, "degrees")?;
        check_range("detector.sigma_floor_px", self.sigma_floor_px, 0.001..=1.0, "px")?;
        check_range("detector.noise_dn", self.noise_dn, 0.0..=100.0, "grey levels")
    }
}

impl ReconstructionSettings {
    fn check(&self) -> Result<(), Problem> {
        let [near, far] = self.range_mm;
        check_range("reconstruction.range_mm[0]", near, 50.0..=8000.0, "mm")?;
        check_range("reconstruction.range_mm[1]", far, near + 1.0..=8000.0, "mm")?;
        check_range("reconstruction.chi2_max", self.chi2_max, 0.001..=1e4, "")
    }
}

fn check_position(key: &str, position_mm: [f64; 3]) -> Result<(), Problem> {
    for (axis, value) in position_mm.into_iter().enumerate() {
        check_range(format!("{key}[{axis}]"), value, -2000.0..=2000.0, "mm")?;
    }
    Ok(())
}

fn check_coefficients(key: &str, coefficients: &[f64], limit: f64) -> Result<(), Problem> {
    if coefficients.len() > MAX_COEFFICIENTS {
        let found = format!("a list of {}", coefficients.len());
        return Err(Problem::new(key, found, format!("at most {MAX_COEFFICIENTS} coefficients")));
    }
    for (index, value) in coefficients.iter().enumerate() {
        if value.is_nan() || value.abs() >= limit {
            let key = format!("{key}[{index}]");
            return Err(Problem::new(key, value, format!("a magnitude below {limit}")));
        }
    }
    Ok(())
}

fn check_range(key: impl Into<String>, value: f64, limits: RangeInclusive<f64>, unit: &str) -> Result<(), Problem> {
    if limits.contains(&value) {
        return Ok(());
    }
    let expected = format!("{} to {} {unit}", limits.start(), limits.end());
    Err(Problem::new(key, value, expected.trim_end()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The message for the ideal rig after a change.
    fn message(change: impl Fn(&mut Rig)) -> String {
        let mut rig = Rig::ideal();
        assert_eq!(rig.check(), Ok(()));
        change(&mut rig);
        rig.check().unwrap_err().to_string()
    }

    fn air(rig: &mut Rig, index: usize) -> &mut CameraModel {
        rig.cameras[index].air.as_mut().unwrap()
    }

    #[test]
    fn a_laser_listed_twice_is_refused() {
        assert_eq!(
            message(|rig| rig.lasers.push(rig.lasers[3])),
            "`laser[12].azimuth_deg` is 90, expected at least twice `detector.sector_half_width_deg`, 24 degrees, \
             from laser[3]"
        );
    }

    #[test]
    fn sectors_that_overlap_across_zero_are_refused() {
        let error = message(|rig| rig.lasers[11].azimuth_deg = -20.0);
        assert!(error.starts_with("`laser[11].azimuth_deg` is -20"), "{error}");
    }

    #[test]
    fn too_many_lasers_are_refused() {
        assert_eq!(
            message(|rig| rig.lasers = vec![rig.lasers[0]; 721]),
            "`laser` is a list of 721, expected 1 to 720 lasers"
        );
        assert_eq!(message(|rig| rig.lasers.clear()), "`laser` is a list of 0, expected 1 to 720 lasers");
    }

    #[test]
    fn a_zero_baseline_is_refused() {
        assert_eq!(
            message(|rig| air(rig, 1).pose.position_mm[2] = -251.0),
            "`camera[1].air.position_mm` is 1.0 mm from the other camera, expected at least 10 mm"
        );
    }

    #[test]
    fn a_viewpoint_in_the_belt_plane_is_refused() {
        assert_eq!(
            message(|rig| air(rig, 0).pose.position_mm[2] = 3.0),
            "`camera[0].air.position_mm` is 3.0 mm from the plane of laser[0], expected at least 10 mm"
        );
    }

    #[test]
    fn a_camera_without_a_model_is_refused() {
        assert_eq!(
            message(|rig| rig.cameras[1].air = None),
            "`camera[1]` is a camera without a model, expected a model `air` or `water`"
        );
    }

    #[test]
    fn a_camera_outside_the_tube_is_refused() {
        assert_eq!(
            message(|rig| air(rig, 0).pose.position_mm[0] = 75.0),
            "`camera[0].air.position_mm` is 75.0 mm from the axis of the tube, expected less than \
             `tube.inner_radius_mm`, 75 mm"
        );
    }

    #[test]
    fn rays_that_turn_upwards_are_refused() {
        let error = message(|rig| air(rig, 0).polynomial = vec![-0.3, 0.0, 0.8]);
        assert!(error.starts_with("`camera[0].air.polynomial` is a model whose rays turn"), "{error}");
        let error = message(|rig| {
            let mut water = air(rig, 1).clone();
            water.axial = vec![0.0, 0.0, 5.0];
            rig.cameras[1].water = Some(water);
        });
        assert!(error.starts_with("`camera[1].water.polynomial` is a model whose rays turn"), "{error}");
    }

    #[test]
    fn coefficients_beyond_fixed_point_are_refused() {
        assert_eq!(
            message(|rig| air(rig, 0).polynomial[3] = 32.0),
            "`camera[0].air.polynomial[3]` is 32, expected a magnitude below 32"
        );
        assert_eq!(
            message(|rig| air(rig, 0).axial = vec![0.0, -256.0]),
            "`camera[0].air.axial[1]` is -256, expected a magnitude below 256"
        );
        assert_eq!(
            message(|rig| air(rig, 0).axial = vec![0.0; 9]),
            "`camera[0].air.axial` is a list of 9, expected at most 8 coefficients"
        );
        assert_eq!(
            message(|rig| air(rig, 0).polynomial.clear()),
            "`camera[0].air.polynomial` is empty, expected at least one coefficient"
        );
    }

    #[test]
    fn an_image_larger_than_2048_px_is_refused() {
        assert_eq!(
            message(|rig| rig.cameras[0].image_size_px = [2049, 768]),
            "`camera[0].image_size_px[0]` is 2049, expected 16 to 2048 px"
        );
    }

    #[test]
    fn an_inner_radius_beyond_the_mirror_is_refused() {
        assert_eq!(
            message(|rig| rig.cameras[0].inner_radius_px = 360.0),
            "`camera[0].inner_radius_px` is 360, expected 0 to 359 px"
        );
    }

    #[test]
    fn every_other_value_out_of_range_is_refused() {
        type Change = (&'static str, fn(&mut Rig));
        let changes: [Change; 19] = [
            ("water.temperature_c", |rig| rig.water.temperature_c = 50.0),
            ("water.salinity", |rig| rig.water.salinity = -1.0),
            ("water.wavelength_nm", |rig| rig.water.wavelength_nm = 0.532),
            ("tube.rotation_deg[0]", |rig| rig.tube.as_mut().unwrap().pose.rotation_deg[0] = 361.0),
            ("tube.inner_radius_mm", |rig| rig.tube.as_mut().unwrap().inner_radius_mm = 0.0),
            ("tube.wall_mm", |rig| rig.tube.as_mut().unwrap().wall_mm = -1.0),
            ("tube.index", |rig| rig.tube.as_mut().unwrap().index = 0.9),
            ("camera[1].air.affine[0]", |rig| air(rig, 1).affine[0] = -1.0),
            ("camera[1].air.tangential[1]", |rig| air(rig, 1).tangential[1] = f64::NAN),
            ("detector.excess_min[1]", |rig| rig.detector.excess_min[1] = 511),
            ("detector.clipped_weight", |rig| rig.detector.clipped_weight = 501),
            ("detector.min_pixels", |rig| rig.detector.min_pixels = 0),
            ("detector.sector_half_width_deg", |rig| rig.detector.sector_half_width_deg = 0.0),
            ("detector.sigma_floor_px", |rig| rig.detector.sigma_floor_px = 1.5),
            ("reconstruction.range_mm[1]", |rig| rig.reconstruction.range_mm[1] = 100.0),
            ("reconstruction.chi2_max", |rig| rig.reconstruction.chi2_max = 0.0),
            ("laser[2].origin_mm[1]", |rig| rig.lasers[2].origin_mm[1] = f64::INFINITY),
            ("laser[2].elevation_deg", |rig| rig.lasers[2].elevation_deg = 90.0),
            ("laser[2].origin_sigma_mm", |rig| rig.lasers[2].origin_sigma_mm = 0.0),
        ];
        for (key, change) in changes {
            let error = message(change);
            assert!(error.starts_with(&format!("`{key}` is ")), "{key}: {error}");
        }
    }

    #[test]
    fn cameras_may_have_different_image_sizes() {
        let mut rig = Rig::ideal();
        rig.cameras[1].image_size_px = [1280, 800];
        assert_eq!(rig.check(), Ok(()));
    }

    #[test]
    fn a_mirror_beyond_the_image_is_a_warning() {
        let mut rig = Rig::ideal();
        assert!(rig.warnings().is_empty());
        air(&mut rig, 0).centre_px[1] = 300.0;
        assert_eq!(rig.check(), Ok(()));
        assert!(rig.warnings()[0].contains("`camera[0].air.centre_px`"));
    }
}
