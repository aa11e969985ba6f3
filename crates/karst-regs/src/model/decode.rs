//! Words of the settings memory back to what `karst-core` works with, and its results to words.

use karst_core::{
    Calibration, CameraCalibration, DetectorConfig, FrameStatus, I18F14, LaserCalibration, LaserFrame,
    MAX_COEFFICIENTS, Method, NoPoint, Point, ReconstructionSettings, Spot, SpotNoise, Thresholds,
};

use super::registers::RESULT_WORDS;
use crate::map;
use crate::results::{REASONS, SPOT_WORDS};

/// What the settings memory says.
pub struct Decoded<const LASERS: usize> {
    pub calibration: Calibration<LASERS>,
    pub detectors: [DetectorConfig<LASERS>; 2],
    pub method: Method,
}

/// None: more lasers than the IP has.
pub fn settings<const LASERS: usize>(memory: &[u32]) -> Option<Decoded<LASERS>> {
    let read = |address: u32| memory[((address - map::SETTINGS_INSTRUMENT_LASERS) / 4) as usize];
    let q14 = |address: u32| I18F14::from_bits(read(address) as i32);
    let instrument = read(map::SETTINGS_INSTRUMENT_LASERS);
    let lasers = map::SETTINGS_INSTRUMENT_LASERS_COUNT.get(instrument);
    if lasers as usize > LASERS {
        return None;
    }
    Some(Decoded {
        calibration: Calibration {
            cameras: [camera(&read, 0), camera(&read, 1)],
            lasers: (0..lasers).map(|index| laser(&read, index)).collect(),
            settings: ReconstructionSettings {
                range: [q14(map::SETTINGS_INSTRUMENT_RANGE_MIN), q14(map::SETTINGS_INSTRUMENT_RANGE_MAX)],
                chi2_max: q14(map::SETTINGS_INSTRUMENT_CHI2_MAX),
                single_camera: map::SETTINGS_INSTRUMENT_LASERS_SINGLE_CAMERA.is_set(instrument),
            },
        },
        detectors: [detector(&read, 0, lasers), detector(&read, 1, lasers)],
        method: if map::SETTINGS_INSTRUMENT_LASERS_PAPER.is_set(instrument) { Method::Paper } else { Method::Weighted },
    })
}

fn detector<const LASERS: usize>(read: &impl Fn(u32) -> u32, camera: u32, lasers: u32) -> DetectorConfig<LASERS> {
    let size = read(map::settings_camera_detector_size(camera));
    let green_min = read(map::settings_camera_detector_green_min(camera));
    let excess_min = read(map::settings_camera_detector_excess_min(camera));
    let weight = read(map::settings_camera_detector_weight(camera));
    let centre = read(map::settings_camera_detector_centre(camera));
    let radius = read(map::settings_camera_detector_radius(camera));
    let cluster = read(map::settings_camera_detector_cluster(camera));
    let sector = read(map::settings_camera_detector_sector(camera));
    let azimuth = [map::SETTINGS_LASER_AZIMUTH_CAMERA_1, map::SETTINGS_LASER_AZIMUTH_CAMERA_2][camera as usize];
    let sixteenths = |value: u32| I18F14::from_bits((value << 10) as i32);
    DetectorConfig {
        width: map::SETTINGS_CAMERA_DETECTOR_SIZE_WIDTH.get(size) as u16,
        height: map::SETTINGS_CAMERA_DETECTOR_SIZE_HEIGHT.get(size) as u16,
        thresholds: Thresholds {
            green_min: [
                map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_FIRST.get(green_min) as u8,
                map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SECOND.get(green_min) as u8,
            ],
            excess_min: [
                map::SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_FIRST.get(excess_min) as u16,
                map::SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_SECOND.get(excess_min) as u16,
            ],
            saturation_min: map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SATURATION.get(green_min) as u8,
            clip_min: map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_CLIP.get(green_min) as u8,
            clipped_weight: map::SETTINGS_CAMERA_DETECTOR_WEIGHT_CLIPPED_WEIGHT.get(weight) as u16,
        },
        centre: [
            sixteenths(map::SETTINGS_CAMERA_DETECTOR_CENTRE_X.get(centre)),
            sixteenths(map::SETTINGS_CAMERA_DETECTOR_CENTRE_Y.get(centre)),
        ],
        mirror_radius: map::SETTINGS_CAMERA_DETECTOR_RADIUS_MIRROR.get(radius) as u16,
        inner_radius: map::SETTINGS_CAMERA_DETECTOR_RADIUS_INNER.get(radius) as u16,
        cluster_gap: map::SETTINGS_CAMERA_DETECTOR_CLUSTER_GAP.get(cluster) as u16,
        min_pixels: map::SETTINGS_CAMERA_DETECTOR_CLUSTER_MIN_PIXELS.get(cluster) as u16,
        clockwise: map::SETTINGS_CAMERA_DETECTOR_WEIGHT_CLOCKWISE.is_set(weight),
        azimuths: (0..lasers).map(|index| azimuth.get(read(map::settings_laser_azimuth(index))) as u16).collect(),
        sector_half_width: map::SETTINGS_CAMERA_DETECTOR_SECTOR_HALF_WIDTH.get(sector) as u16,
        noise: SpotNoise {
            floor: read(map::settings_camera_detector_noise_floor(camera)),
            noise: read(map::settings_camera_detector_noise(camera)),
        },
    }
}

fn camera(read: &impl Fn(u32) -> u32, camera: u32) -> CameraCalibration {
    let words = |address: fn(u32, u32) -> u32| move |index: usize| read(address(camera, index as u32)) as i32;
    CameraCalibration {
        centre: std::array::from_fn(words(map::settings_camera_centre)).map(I18F14::from_bits),
        inverse_affine: std::array::from_fn(words(map::settings_camera_inverse_affine)),
        decentring: std::array::from_fn(words(map::settings_camera_decentring)),
        polynomial: (0..MAX_COEFFICIENTS).map(words(map::settings_camera_polynomial)).collect(),
        axial: (0..MAX_COEFFICIENTS).map(words(map::settings_camera_axial)).collect(),
    }
}

fn laser(read: &impl Fn(u32) -> u32, laser: u32) -> LaserCalibration {
    let words = |address: fn(u32, u32) -> u32| move |index: usize| read(address(laser, index as u32)) as i32;
    let wide =
        |address: fn(u32, u32) -> u32| u64::from(read(address(laser, 1))) << 32 | u64::from(read(address(laser, 0)));
    let axes = words(map::settings_laser_axes);
    LaserCalibration {
        origin: std::array::from_fn(words(map::settings_laser_origin)),
        axes: std::array::from_fn(|row| std::array::from_fn(|column| axes(3 * row + column))),
        origin_variance: wide(map::settings_laser_origin_variance),
        direction_variance: wide(map::settings_laser_direction_variance),
        cameras: std::array::from_fn(|camera| {
            let rotation =
                |index: usize| read(map::settings_laser_camera_rotation(laser, camera as u32, index as u32)) as i32;
            LaserFrame {
                rotation: std::array::from_fn(|row| std::array::from_fn(|column| rotation(3 * row + column))),
                viewpoint: std::array::from_fn(|index| {
                    read(map::settings_laser_camera_viewpoint(laser, camera as u32, index as u32)) as i32
                }),
            }
        }),
    }
}

/// A camera's record of the result memory.
pub fn camera_words(status: &FrameStatus, spots: usize) -> [u32; RESULT_WORDS] {
    let rows = map::RESULT_CAMERA_ROWS_TAKEN.of(status.rows.into())
        | map::RESULT_CAMERA_ROWS_DAMAGED.of(status.damaged_rows.into())
        | map::RESULT_CAMERA_ROWS_TRUNCATED.of(status.truncated.into());
    let mut words = [0; RESULT_WORDS];
    words[..5].copy_from_slice(&[status.hits, status.outside, status.overflow, rows, spots as u32]);
    words
}

/// A spot's record.
pub fn spot_words(laser: usize, spot: &Spot) -> [u32; SPOT_WORDS] {
    let cluster = &spot.cluster;
    let b = &cluster.bounds;
    let bounds = |min: u16, max: u16| {
        map::SPOTS_CAMERA_SPOT_BOUNDS_MIN.of(min.into()) | map::SPOTS_CAMERA_SPOT_BOUNDS_MAX.of(max.into())
    };
    let origin = map::SPOTS_CAMERA_SPOT_ORIGIN_R_MAX.of(cluster.r_max().into())
        | map::SPOTS_CAMERA_SPOT_ORIGIN_LASER.of(laser as u32);
    let [column, row] = spot.position.map(|axis| axis.to_bits() as u32);
    [
        column,
        row,
        spot.variance,
        cluster.pixels,
        cluster.saturated,
        bounds(b.x_min, b.x_max),
        bounds(b.y_min, b.y_max),
        origin,
    ]
}

/// A laser's record of the result memory.
pub fn point_words(point: &Result<Point, NoPoint>) -> [u32; RESULT_WORDS] {
    let mut words = [0; RESULT_WORDS];
    let point = match point {
        Ok(point) => point,
        Err(reason) => {
            let outcome = 1 + REASONS.iter().take_while(|other| *other != reason).count();
            words[0] = map::RESULT_POINT_STATUS_OUTCOME.of(outcome as u32);
            return words;
        }
    };
    let [spot_1, spot_2] = point.spots.map(|spot| u32::from(spot.unwrap_or(0)));
    words[0] = map::RESULT_POINT_STATUS_WEIGHTED.of(point.sigma.is_some().into())
        | map::RESULT_POINT_STATUS_CAMERA_1.of(point.spots[0].is_some().into())
        | map::RESULT_POINT_STATUS_SPOT_1.of(spot_1)
        | map::RESULT_POINT_STATUS_CAMERA_2.of(point.spots[1].is_some().into())
        | map::RESULT_POINT_STATUS_SPOT_2.of(spot_2);
    let values = [
        Some(point.position[0]),
        Some(point.position[1]),
        Some(point.position[2]),
        Some(point.along),
        point.sigma,
        point.chi2,
    ];
    for (word, value) in words[1..].iter_mut().zip(values) {
        *word = value.map_or(0, |value| value.to_bits() as u32);
    }
    words
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Settings;

    prop_compose! {
        fn detectors()(
            [width, height] in [1..=2048_u16, 1..=2048_u16],
            green_min: [u8; 2],
            excess_min in [0..=510_u16, 0..=510_u16],
            [saturation_min, clip_min] in any::<[u8; 2]>(),
            clipped_weight in 1..=500_u16,
            centre in [0..=2048_i32 * 16, 0..=2048 * 16],
            [mirror_radius, inner_radius, min_pixels, sector_half_width] in any::<[u16; 4]>(),
            cluster_gap in 0..=2047_u16,
            clockwise: bool,
            azimuths: [u16; 2],
            [floor, noise] in any::<[u32; 2]>(),
        ) -> DetectorConfig<3> {
            DetectorConfig {
                width,
                height,
                thresholds: Thresholds { green_min, excess_min, saturation_min, clip_min, clipped_weight },
                centre: centre.map(|c| I18F14::from_bits(c << 10)),
                mirror_radius,
                inner_radius,
                cluster_gap,
                min_pixels,
                clockwise,
                azimuths: azimuths.into_iter().collect(),
                sector_half_width,
                noise: SpotNoise { floor, noise },
            }
        }
    }

    prop_compose! {
        fn cameras()(
            centre: [i32; 2],
            inverse_affine: [i32; 4],
            decentring: [i32; 2],
            polynomial: [i32; MAX_COEFFICIENTS],
            axial: [i32; MAX_COEFFICIENTS],
        ) -> CameraCalibration {
            CameraCalibration {
                centre: centre.map(I18F14::from_bits),
                inverse_affine,
                decentring,
                polynomial: polynomial.into_iter().collect(),
                axial: axial.into_iter().collect(),
            }
        }
    }

    prop_compose! {
        fn lasers()(
            origin: [i32; 3],
            axes: [[i32; 3]; 3],
            [origin_variance, direction_variance] in any::<[u64; 2]>(),
            rotations: [[[i32; 3]; 3]; 2],
            viewpoints: [[i32; 3]; 2],
        ) -> LaserCalibration {
            let cameras = [0, 1].map(|i| LaserFrame { rotation: rotations[i], viewpoint: viewpoints[i] });
            LaserCalibration { origin, axes, origin_variance, direction_variance, cameras }
        }
    }

    proptest! {
        #[test]
        fn every_setting_has_bits_of_its_own_and_all_of_them(
            detectors in [detectors(), detectors()],
            cameras in [cameras(), cameras()],
            lasers in [lasers(), lasers()],
            [least, most, chi2_max] in any::<[i32; 3]>(),
            [single_camera, paper] in any::<[bool; 2]>(),
        ) {
            let calibration = Calibration::<3> {
                cameras,
                lasers: lasers.into_iter().collect(),
                settings: ReconstructionSettings {
                    range: [least, most].map(I18F14::from_bits),
                    chi2_max: I18F14::from_bits(chi2_max),
                    single_camera,
                },
            };
            let method = if paper { Method::Paper } else { Method::Weighted };
            let settings = Settings { calibration: &calibration, detectors: detectors.each_ref(), method };
            let mut memory = vec![None; 256 + 64 * 3];
            settings.words(&mut |address, word| {
                let place = &mut memory[((address - map::SETTINGS_INSTRUMENT_LASERS) / 4) as usize];
                if place.replace(word).is_none() { Ok(()) } else { Err(address) }
            }).map_err(|address| TestCaseError::fail(format!("{address:#x} is written twice")))?;
            let memory: Vec<u32> = memory.into_iter().map(|word| word.unwrap_or(0)).collect();
            let decoded = super::settings::<3>(&memory).expect("three lasers fit");
            prop_assert_eq!(decoded.calibration, calibration);
            prop_assert_eq!(decoded.detectors, detectors);
            prop_assert_eq!(decoded.method, method);
        }
    }
}
