//! Calibration and detector configuration as words of the settings memory.

use core::fmt;

use karst_core::{
    Calibration, CameraCalibration, ConfigError, DetectorConfig, I18F14, LaserCalibration, LaserFrame, Method,
};

use crate::map;

/// Everything that is loaded into the IP.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings<'a, const LASERS: usize> {
    /// Cameras, lasers, limits.
    pub calibration: &'a Calibration<LASERS>,
    /// The detectors of camera 0 and camera 1.
    pub detectors: [&'a DetectorConfig<LASERS>; 2],
    /// How spots become points.
    pub method: Method,
}

/// Why settings do not fit the IP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingsError {
    /// No laser, or more than the IP was built for.
    Lasers {
        /// Lasers of the calibration.
        found: usize,
        /// Lasers that fit.
        capacity: u16,
    },
    /// A detector has another number of lasers than the calibration.
    DetectorLasers {
        /// Camera, from 0.
        camera: usize,
        /// Lasers of the detector.
        found: usize,
    },
    /// The image width is not a multiple of the pixels per clock.
    Width {
        /// Camera, from 0.
        camera: usize,
        /// Width found, px.
        found: u16,
    },
    /// The detector refuses its configuration.
    Detector {
        /// Camera, from 0.
        camera: usize,
        /// What is wrong.
        error: ConfigError,
    },
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lasers { found, capacity } => write!(f, "{found} lasers, expected 1 to {capacity}"),
            Self::DetectorLasers { camera, found } => {
                write!(f, "camera {camera}: {found} lasers, not as many as the calibration has")
            }
            Self::Width { camera, found } => {
                write!(f, "camera {camera}: width of {found} px is no multiple of the pixels per clock")
            }
            Self::Detector { camera, error } => write!(f, "camera {camera}: {error}"),
        }
    }
}

impl core::error::Error for SettingsError {}

/// Whether an IP was built for so many lasers.
pub(crate) fn lasers_fit(found: usize, capacity: u16) -> Result<(), SettingsError> {
    if found == 0 || found > usize::from(capacity) { Err(SettingsError::Lasers { found, capacity }) } else { Ok(()) }
}

impl<const LASERS: usize> Settings<'_, LASERS> {
    /// Whether an IP can work with them.
    pub(crate) fn check(&self, capacity: u16) -> Result<(), SettingsError> {
        let count = self.calibration.lasers.len();
        lasers_fit(count, capacity)?;
        for (camera, config) in self.detectors.iter().enumerate() {
            if config.azimuths.len() != count {
                return Err(SettingsError::DetectorLasers { camera, found: config.azimuths.len() });
            }
            config.check().map_err(|error| SettingsError::Detector { camera, error })?;
        }
        Ok(())
    }
}

/// Gives every word of the settings memory that a rig has a say in, with its address.
pub(crate) fn words_of<const LASERS: usize>(
    calibration: &Calibration<LASERS>,
    detectors: [&DetectorConfig<LASERS>; 2],
    put: Put,
) {
    let settings = &calibration.settings;
    // No number that the rig agrees on is none that the IP takes
    let count = calibration.lasers.len();
    let count = if detectors.iter().all(|config| config.azimuths.len() == count) { count } else { 0 };
    let lasers = map::SETTINGS_INSTRUMENT_LASERS_COUNT.saturating(count as u32)
        | map::SETTINGS_INSTRUMENT_LASERS_SINGLE_CAMERA.of(settings.single_camera.into());
    put(map::SETTINGS_INSTRUMENT_LASERS, lasers);
    put(map::SETTINGS_INSTRUMENT_RANGE_MIN, word(settings.range[0]));
    put(map::SETTINGS_INSTRUMENT_RANGE_MAX, word(settings.range[1]));
    put(map::SETTINGS_INSTRUMENT_CHI2_MAX, word(settings.chi2_max));
    for camera in 0..2 {
        detector_words(camera, detectors[camera as usize], put);
        camera_words(camera, &calibration.cameras[camera as usize], put);
    }
    for (index, laser) in (0..).zip(&calibration.lasers) {
        let azimuths = detectors.map(|config| config.azimuths.get(index as usize).copied().unwrap_or(0));
        let azimuths = map::SETTINGS_LASER_AZIMUTH_CAMERA_1.of(azimuths[0].into())
            | map::SETTINGS_LASER_AZIMUTH_CAMERA_2.of(azimuths[1].into());
        put(map::settings_laser_azimuth(index), azimuths);
        laser_words(index, laser, put);
    }
}

/// Takes an address and a word.
type Put<'a> = &'a mut dyn FnMut(u32, u32);

fn word(value: I18F14) -> u32 {
    value.to_bits() as u32
}

/// A coordinate of the image centre as the detector uses it, 1/16 px. A negative one becomes one beyond every image.
fn sixteenths(centre: I18F14) -> u32 {
    (centre.to_bits().saturating_add(1 << 9) >> 10) as u32
}

/// Lower edge of the first of the lasers' sectors, 2^-16 turn.
pub(crate) fn first_edge(mut azimuths: impl ExactSizeIterator<Item = u16>) -> u16 {
    let half_sector = (1 << 15) / azimuths.len().max(1);
    azimuths.next().unwrap_or(0).wrapping_sub(half_sector as u16)
}

fn detector_words<const LASERS: usize>(camera: u32, config: &DetectorConfig<LASERS>, put: Put) {
    let t = &config.thresholds;
    let size = map::SETTINGS_CAMERA_DETECTOR_SIZE_WIDTH.saturating(config.width.into())
        | map::SETTINGS_CAMERA_DETECTOR_SIZE_HEIGHT.saturating(config.height.into());
    put(map::settings_camera_detector_size(camera), size);
    let green_min = map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_FIRST.of(t.green_min[0].into())
        | map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SECOND.of(t.green_min[1].into())
        | map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SATURATION.of(t.saturation_min.into())
        | map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_CLIP.of(t.clip_min.into());
    put(map::settings_camera_detector_green_min(camera), green_min);
    let excess_min = map::SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_FIRST.saturating(t.excess_min[0].into())
        | map::SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_SECOND.saturating(t.excess_min[1].into());
    put(map::settings_camera_detector_excess_min(camera), excess_min);
    // The detector counts what is outside 1 to 500 as the nearest of these
    let weight = map::SETTINGS_CAMERA_DETECTOR_WEIGHT_CLIPPED_WEIGHT.of(t.clipped_weight.clamp(1, 500).into())
        | map::SETTINGS_CAMERA_DETECTOR_WEIGHT_CLOCKWISE.of(config.clockwise.into());
    put(map::settings_camera_detector_weight(camera), weight);
    let centre = map::SETTINGS_CAMERA_DETECTOR_CENTRE_X.saturating(sixteenths(config.centre[0]))
        | map::SETTINGS_CAMERA_DETECTOR_CENTRE_Y.saturating(sixteenths(config.centre[1]));
    put(map::settings_camera_detector_centre(camera), centre);
    let radius = map::SETTINGS_CAMERA_DETECTOR_RADIUS_INNER.of(config.inner_radius.into())
        | map::SETTINGS_CAMERA_DETECTOR_RADIUS_MIRROR.of(config.mirror_radius.into());
    put(map::settings_camera_detector_radius(camera), radius);
    // No two pixels are 2048 px apart in x or y: a larger gap is the same as 2047
    let cluster = map::SETTINGS_CAMERA_DETECTOR_CLUSTER_GAP.of(config.cluster_gap.min(2047).into())
        | map::SETTINGS_CAMERA_DETECTOR_CLUSTER_MIN_PIXELS.of(config.min_pixels.into());
    put(map::settings_camera_detector_cluster(camera), cluster);
    let first_edge = first_edge(config.azimuths.iter().copied());
    let sector = map::SETTINGS_CAMERA_DETECTOR_SECTOR_HALF_WIDTH.of(config.sector_half_width.into())
        | map::SETTINGS_CAMERA_DETECTOR_SECTOR_FIRST_EDGE.of(first_edge.into());
    put(map::settings_camera_detector_sector(camera), sector);
    put(map::settings_camera_detector_noise_floor(camera), config.noise.floor);
    put(map::settings_camera_detector_noise(camera), config.noise.noise);
}

fn camera_words(camera: u32, model: &CameraCalibration, put: Put) {
    for (i, value) in (0..).zip(model.centre) {
        put(map::settings_camera_centre(camera, i), word(value));
    }
    for (i, value) in (0..).zip(model.inverse_affine) {
        put(map::settings_camera_inverse_affine(camera, i), value as u32);
    }
    for (i, value) in (0..).zip(model.decentring) {
        put(map::settings_camera_decentring(camera, i), value as u32);
    }
    // Coefficients of zero beyond the last one change no result
    let coefficient = |of: &[i32], i: u32| of.get(i as usize).map_or(0, |&value| value as u32);
    for i in 0..karst_core::MAX_COEFFICIENTS as u32 {
        put(map::settings_camera_polynomial(camera, i), coefficient(&model.polynomial, i));
        put(map::settings_camera_axial(camera, i), coefficient(&model.axial, i));
    }
}

fn laser_words(index: u32, laser: &LaserCalibration, put: Put) {
    for (i, value) in (0..).zip(laser.origin) {
        put(map::settings_laser_origin(index, i), value as u32);
    }
    for (i, &value) in (0..).zip(laser.axes.as_flattened()) {
        put(map::settings_laser_axes(index, i), value as u32);
    }
    for i in 0..2 {
        put(map::settings_laser_origin_variance(index, i), (laser.origin_variance >> (32 * i)) as u32);
        put(map::settings_laser_direction_variance(index, i), (laser.direction_variance >> (32 * i)) as u32);
    }
    for (camera, frame) in (0..).zip(&laser.cameras) {
        let LaserFrame { rotation, viewpoint } = frame;
        for (i, &value) in (0..).zip(rotation.as_flattened()) {
            put(map::settings_laser_camera_rotation(index, camera, i), value as u32);
        }
        for (i, &value) in (0..).zip(viewpoint) {
            put(map::settings_laser_camera_viewpoint(index, camera, i), value as u32);
        }
    }
}
