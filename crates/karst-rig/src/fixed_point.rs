//! The rig in the fixed-point formats of karst-core: what is loaded into the sensor.

use karst_core::{
    Calibration, CameraCalibration, ConfigError, DetectorConfig, FixedRig, I18F14, LaserCalibration, LaserFrame,
    MAX_COEFFICIENTS, ReconstructionSettings, SpotDetector, SpotNoise, Thresholds,
};
use nalgebra::{Matrix2, Matrix3, Point3, Vector3};

use crate::{CameraModel, Laser, Pose, Rig, WaterCamera};

/// Why a rig does not fit the fixed-point formats.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FixedPointError {
    /// More lasers than the sensor was built for.
    #[error("{found} lasers, but at most {capacity} fit")]
    TooManyLasers {
        /// Lasers in the rig.
        found: usize,
        /// Lasers that fit.
        capacity: usize,
    },
    /// More polynomial coefficients than the sensor was built for.
    #[error("camera {camera}: {found} coefficients in one polynomial, but at most {capacity} fit")]
    TooManyCoefficients {
        /// Camera, from 0.
        camera: usize,
        /// Coefficients found.
        found: usize,
        /// Coefficients that fit.
        capacity: usize,
    },
    /// A value is beyond its fixed-point format.
    #[error("{what} is {found}, expected at most {limit} in magnitude")]
    OutOfRange {
        /// The quantity, with its unit.
        what: &'static str,
        /// Its value.
        found: f64,
        /// The largest magnitude that fits.
        limit: f64,
    },
    /// A camera does not see a laser's beam at all.
    #[error("camera {camera} does not see the beam of laser {laser}")]
    BeamNotSeen {
        /// Camera, from 0.
        camera: usize,
        /// Laser, from 0.
        laser: usize,
    },
    /// The detector refuses its configuration.
    #[error("camera {camera}: {error}")]
    Detector {
        /// Camera, from 0.
        camera: usize,
        /// What is wrong.
        error: ConfigError,
    },
}

/// Distance along the beam at which a laser's direction in the image is taken, mm.
const AZIMUTH_RANGE_MM: f64 = 1500.0;

impl Rig {
    /// The rig in fixed point, with its cameras in the water.
    pub fn to_fixed<const LASERS: usize>(
        &self,
        cameras: &[WaterCamera; 2],
    ) -> Result<FixedRig<LASERS>, FixedPointError> {
        let capacity = LASERS;
        let too_many = FixedPointError::TooManyLasers { found: self.lasers.len(), capacity };
        let lasers = (0..self.lasers.len())
            .map(|i| laser_to_fixed(&self.lasers[i], cameras.each_ref().map(|camera| camera.pose(i))))
            .collect::<Result<Vec<_>, _>>()?;
        let settings = &self.reconstruction;
        let calibration = Calibration {
            cameras: [cameras[0].model.to_fixed(0)?, cameras[1].model.to_fixed(1)?],
            lasers: heapless::Vec::from_slice(&lasers).map_err(|_| too_many)?,
            settings: ReconstructionSettings {
                range: [q14("range, mm", settings.range_mm[0])?, q14("range, mm", settings.range_mm[1])?],
                chi2_max: q14("chi2_max", settings.chi2_max)?,
                single_camera: settings.single_camera,
            },
        };
        let detectors = [self.detector_to_fixed(0, &cameras[0].model)?, self.detector_to_fixed(1, &cameras[1].model)?];
        Ok(FixedRig { calibration, detectors })
    }

    fn detector_to_fixed<const LASERS: usize>(
        &self,
        camera: usize,
        model: &CameraModel,
    ) -> Result<DetectorConfig<LASERS>, FixedPointError> {
        let settings = &self.detector;
        let part = &self.cameras[camera];
        let clockwise = (model.pose.isometry() * Vector3::z()).z < 0.0;
        let mut azimuths = heapless::Vec::new();
        for (laser, beam) in self.lasers.iter().enumerate() {
            let point = Point3::from(Vector3::from(beam.origin_mm) + AZIMUTH_RANGE_MM * beam.direction());
            let pixel =
                model.project(point, part.mirror_radius_px).ok_or(FixedPointError::BeamNotSeen { camera, laser })?;
            let angle = (pixel.y - model.centre_px[1]).atan2(pixel.x - model.centre_px[0]);
            let turns = if clockwise { -angle } else { angle } / std::f64::consts::TAU;
            let too_many = FixedPointError::TooManyLasers { found: self.lasers.len(), capacity: LASERS };
            azimuths.push((turns.rem_euclid(1.0) * 65536.0).round() as u32 as u16).map_err(|_| too_many)?;
        }
        let config = DetectorConfig {
            width: part.image_size_px[0].min(u16::MAX.into()) as u16,
            height: part.image_size_px[1].min(u16::MAX.into()) as u16,
            thresholds: Thresholds {
                green_min: settings.green_min,
                excess_min: settings.excess_min,
                saturation_min: settings.saturation_min,
                clip_min: settings.clip_min,
                clipped_weight: settings.clipped_weight,
            },
            centre: [q14("image centre, px", model.centre_px[0])?, q14("image centre, px", model.centre_px[1])?],
            mirror_radius: sixteenths("mirror_radius_px", part.mirror_radius_px)?,
            inner_radius: sixteenths("inner_radius_px", part.inner_radius_px)?,
            cluster_gap: settings.cluster_gap_px.round().clamp(0.0, 2048.0) as u16,
            min_pixels: settings.min_pixels,
            clockwise,
            azimuths,
            sector_half_width: (settings.sector_half_width_deg / 360.0 * 65536.0).round().clamp(0.0, 32767.0) as u16,
            noise: SpotNoise {
                floor: unsigned("sigma_floor_px, squared", settings.sigma_floor_px.powi(2), 24, 8)? as u32,
                noise: unsigned("noise_dn, squared", settings.noise_dn.powi(2) / (4.0 * std::f64::consts::PI), 16, 16)?
                    as u32,
            },
        };
        // Let the detector itself say what it does not take.
        SpotDetector::<LASERS, 1>::new(config.clone()).map_err(|error| FixedPointError::Detector { camera, error })?;
        Ok(config)
    }
}

impl CameraModel {
    /// The model in fixed point. `camera` (from 0) is for the message when it does not fit.
    pub fn to_fixed(&self, camera: usize) -> Result<CameraCalibration, FixedPointError> {
        let [c, d, e] = self.affine;
        let inverse = Matrix2::new(c, d, e, 1.0).try_inverse().unwrap_or_else(Matrix2::zeros);
        let axial: Vec<f64> = self.axial.iter().map(|a| a * AXIAL_UNIT_RATIO).collect();
        let coefficients = |what, values: &[f64]| {
            let raw = values.iter().map(|&v| signed(what, v, 26)).collect::<Result<Vec<_>, _>>()?;
            let error =
                FixedPointError::TooManyCoefficients { camera, found: values.len(), capacity: MAX_COEFFICIENTS };
            heapless::Vec::from_slice(&raw).map_err(|_| error)
        };
        Ok(CameraCalibration {
            centre: [q14("image centre, px", self.centre_px[0])?, q14("image centre, px", self.centre_px[1])?],
            inverse_affine: try_map([inverse.m11, inverse.m12, inverse.m21, inverse.m22], |v| {
                signed("inverse affine term", v, 30)
            })?,
            decentring: try_map(self.tangential, |v| signed("tangential term", v, 30))?,
            polynomial: coefficients("polynomial coefficient", &self.polynomial)?,
            axial: coefficients("axial coefficient / 8", &axial)?,
        })
    }
}

/// The rig file counts axial coefficients in 512 mm, the fixed-point format in 4096 mm.
const AXIAL_UNIT_RATIO: f64 = 512.0 / 4096.0;

fn laser_to_fixed(laser: &Laser, cameras: [Pose; 2]) -> Result<LaserCalibration, FixedPointError> {
    let axes = laser.frame();
    let origin = Vector3::from(laser.origin_mm);
    let to_q30 = |v: Vector3<f64>| try_map([v.x, v.y, v.z], |v| signed("direction cosine", v, 30));
    let to_q20 = |v: Vector3<f64>| try_map([v.x, v.y, v.z], |v| signed("position, mm", v, 20));
    let frame = |camera: Pose| -> Result<LaserFrame, FixedPointError> {
        let pose = camera.isometry();
        let rotation = axes * pose.rotation.to_rotation_matrix().matrix();
        let viewpoint = axes * (pose.translation.vector - origin);
        let row = |i: usize| to_q30(rotation.row(i).transpose());
        Ok(LaserFrame { rotation: [row(0)?, row(1)?, row(2)?], viewpoint: to_q20(viewpoint)? })
    };
    let row = |i: usize| to_q30(axes.row(i).transpose());
    let direction_sigma = laser.direction_sigma_mrad * 1e-3;
    if direction_sigma > 0.02 {
        return Err(FixedPointError::OutOfRange {
            what: "direction_sigma_mrad",
            found: laser.direction_sigma_mrad,
            limit: 20.0,
        });
    }
    Ok(LaserCalibration {
        origin: to_q20(origin)?,
        axes: [row(0)?, row(1)?, row(2)?],
        origin_variance: unsigned("origin_sigma_mm, squared", laser.origin_sigma_mm.powi(2), 32, 10)?,
        direction_variance: unsigned("direction_sigma_mrad", direction_sigma.powi(2), 44, 20)?,
        cameras: [frame(cameras[0])?, frame(cameras[1])?],
    })
}

impl Laser {
    /// The frame of the beam: rows are the unit vectors along, up (across the beam, towards the rig's z) and across.
    pub fn frame(&self) -> Matrix3<f64> {
        let along = self.direction();
        let across = along.cross(&Vector3::z()).normalize();
        let up = across.cross(&along);
        Matrix3::from_rows(&[along.transpose(), up.transpose(), across.transpose()])
    }
}

fn try_map<T, U: Copy + Default, const N: usize>(
    values: [T; N],
    mut map: impl FnMut(T) -> Result<U, FixedPointError>,
) -> Result<[U; N], FixedPointError> {
    let mut mapped = [U::default(); N];
    for (to, from) in mapped.iter_mut().zip(values) {
        *to = map(from)?;
    }
    Ok(mapped)
}

/// `value` with `bits` fraction bits in an i32, rounded to nearest.
fn signed(what: &'static str, value: f64, bits: i32) -> Result<i32, FixedPointError> {
    let raw = (value * 2_f64.powi(bits)).round();
    if raw.abs() <= f64::from(i32::MAX) {
        Ok(raw as i32)
    } else {
        Err(FixedPointError::OutOfRange { what, found: value, limit: 2_f64.powi(31 - bits) })
    }
}

fn q14(what: &'static str, value: f64) -> Result<I18F14, FixedPointError> {
    signed(what, value, 14).map(I18F14::from_bits)
}

/// `value` with `fraction_bits`, at most 2^`integer_bits`.
fn unsigned(what: &'static str, value: f64, fraction_bits: i32, integer_bits: i32) -> Result<u64, FixedPointError> {
    let limit = 2_f64.powi(integer_bits);
    if (0.0..limit).contains(&value) {
        Ok((value * 2_f64.powi(fraction_bits)).round() as u64)
    } else {
        Err(FixedPointError::OutOfRange { what, found: value, limit })
    }
}

fn sixteenths(what: &'static str, pixels: f64) -> Result<u16, FixedPointError> {
    let raw = (pixels * 16.0).round();
    if (0.0..=f64::from(u16::MAX)).contains(&raw) {
        Ok(raw as u16)
    } else {
        Err(FixedPointError::OutOfRange { what, found: pixels, limit: 4095.0 })
    }
}
