//! Random messages of every kind.

use karst_core::{
    Bounds, Calibration, CameraCalibration, Cluster, DetectorConfig, Estimates, FixedRig, FrameStatus, I18F14,
    LaserCalibration, LaserFrame, Method, NoPoint, Point, ReconstructionSettings, RigError, Spot, SpotNoise,
    Thresholds,
};
use karst_link::*;
use karst_regs::MAX_BLOCK_WORDS;
use proptest::prelude::*;
use proptest::sample::select;

pub const MOST_LASERS: usize = 32;

fn fixed() -> impl Strategy<Value = I18F14> + Clone {
    any::<i32>().prop_map(I18F14::from_bits)
}

fn coefficients() -> impl Strategy<Value = heapless::Vec<i32, 8>> + Clone {
    prop::collection::vec(any::<i32>(), 0..=8).prop_map(|values| values.into_iter().collect())
}

fn camera() -> impl Strategy<Value = CameraCalibration> + Clone {
    ([fixed(), fixed()], any::<[i32; 4]>(), any::<[i32; 2]>(), coefficients(), coefficients()).prop_map(
        |(centre, inverse_affine, decentring, polynomial, axial)| CameraCalibration {
            centre,
            inverse_affine,
            decentring,
            polynomial,
            axial,
        },
    )
}

fn laser_frame() -> impl Strategy<Value = LaserFrame> + Clone {
    any::<([[i32; 3]; 3], [i32; 3])>().prop_map(|(rotation, viewpoint)| LaserFrame { rotation, viewpoint })
}

fn laser() -> impl Strategy<Value = LaserCalibration> {
    (any::<[i32; 3]>(), any::<[[i32; 3]; 3]>(), any::<u64>(), any::<u64>(), [laser_frame(), laser_frame()]).prop_map(
        |(origin, axes, origin_variance, direction_variance, cameras)| LaserCalibration {
            origin,
            axes,
            origin_variance,
            direction_variance,
            cameras,
        },
    )
}

fn reconstruction_settings() -> impl Strategy<Value = ReconstructionSettings> {
    ([fixed(), fixed()], fixed(), any::<bool>()).prop_map(|(range, chi2_max, single_camera)| ReconstructionSettings {
        range,
        chi2_max,
        single_camera,
    })
}

fn detector() -> impl Strategy<Value = DetectorConfig<0>> + Clone {
    (any::<[u16; 7]>(), any::<[u8; 4]>(), any::<[u16; 3]>(), [fixed(), fixed()], any::<bool>(), any::<[u32; 2]>())
        .prop_map(|(sizes, levels, [excess_0, excess_1, clipped_weight], centre, clockwise, [floor, noise])| {
            let [width, height, mirror_radius, inner_radius, cluster_gap, min_pixels, sector_half_width] = sizes;
            let [green_0, green_1, saturation_min, clip_min] = levels;
            DetectorConfig {
                width,
                height,
                thresholds: Thresholds {
                    green_min: [green_0, green_1],
                    excess_min: [excess_0, excess_1],
                    saturation_min,
                    clip_min,
                    clipped_weight: clipped_weight % 500 + 1,
                },
                centre,
                mirror_radius,
                inner_radius,
                cluster_gap: cluster_gap % 2048,
                min_pixels,
                clockwise,
                azimuths: heapless::Vec::new(),
                sector_half_width,
                noise: SpotNoise { floor, noise },
            }
        })
}

/// A rig that a sensor accepts, with random numbers wherever they are free.
pub fn rig(most_lasers: usize) -> impl Strategy<Value = FixedRig<MOST_LASERS>> {
    let laser = laser().prop_map(|laser| {
        let cosines = |rows: [[i32; 3]; 3]| rows.map(|row| row.map(|cosine| cosine >> 1));
        LaserCalibration {
            axes: cosines(laser.axes),
            origin_variance: laser.origin_variance >> 22,
            direction_variance: laser.direction_variance >> 32,
            cameras: laser.cameras.map(|frame| LaserFrame { rotation: cosines(frame.rotation), ..frame }),
            ..laser
        }
    });
    let cameras = camera().prop_map(|mut camera| {
        camera.inverse_affine[0] |= 1;
        // Full or not, there is a coefficient
        let _ = camera.polynomial.push(1);
        camera
    });
    let detectors = detector().prop_map(|detector| DetectorConfig {
        width: detector.width % 2048 + 1,
        height: detector.height % 2048 + 1,
        centre: [I18F14::ONE; 2],
        thresholds: Thresholds { excess_min: detector.thresholds.excess_min.map(|e| e % 511), ..detector.thresholds },
        mirror_radius: detector.mirror_radius | 0x8000,
        inner_radius: detector.inner_radius & 0x7fff,
        noise: SpotNoise { floor: detector.noise.floor | 1, ..detector.noise },
        ..detector
    });
    let settings = reconstruction_settings().prop_map(|settings| ReconstructionSettings {
        range: settings.range.map(|mm| I18F14::from_bits(mm.to_bits() & 0x3fff_ffff)),
        chi2_max: I18F14::from_bits(settings.chi2_max.to_bits() & 0x3fff_ffff | 1),
        ..settings
    });
    let settings = settings.prop_filter("an empty range", |settings| settings.range[0] < settings.range[1]);
    (
        [cameras.clone(), cameras],
        prop::collection::vec(laser, 1..=most_lasers),
        settings,
        [detectors.clone(), detectors],
    )
        .prop_map(|(cameras, lasers, settings, detectors)| {
            let count = lasers.len() as u32;
            let azimuths: heapless::Vec<u16, MOST_LASERS> = (0..count).map(|i| (i * 65536 / count) as u16).collect();
            let detectors = detectors.map(|d| DetectorConfig {
                width: d.width,
                height: d.height,
                thresholds: d.thresholds,
                centre: d.centre,
                mirror_radius: d.mirror_radius,
                inner_radius: d.inner_radius,
                cluster_gap: d.cluster_gap,
                min_pixels: d.min_pixels,
                clockwise: d.clockwise,
                azimuths: azimuths.clone(),
                sector_half_width: d.sector_half_width,
                noise: d.noise,
            });
            FixedRig { calibration: Calibration { cameras, lasers: lasers.into_iter().collect(), settings }, detectors }
        })
}

fn method() -> impl Strategy<Value = Method> {
    select(vec![Method::Weighted, Method::Paper])
}

fn no_point() -> impl Strategy<Value = NoPoint> {
    select(vec![
        NoPoint::NoLaser,
        NoPoint::NoSpot,
        NoPoint::OneCamera,
        NoPoint::NoIntersection,
        NoPoint::OutOfRange,
        NoPoint::Inconsistent,
    ])
}

fn point() -> impl Strategy<Value = Point> {
    let maybe = || prop::option::of(fixed());
    let spot = || prop::option::of(any::<u8>());
    (
        any::<u16>(),
        [fixed(), fixed(), fixed()],
        fixed(),
        maybe(),
        maybe(),
        [maybe(), maybe(), maybe()],
        [spot(), spot()],
    )
        .prop_map(|(laser, position, along, sigma, chi2, [first, second, stereo], spots)| Point {
            laser,
            position,
            along,
            sigma,
            chi2,
            estimates: Estimates { mono: [first, second], stereo },
            spots,
        })
}

fn spot() -> impl Strategy<Value = Spot> {
    ([fixed(), fixed()], any::<u32>(), any::<[u32; 5]>(), any::<[u64; 2]>(), any::<[u16; 4]>()).prop_map(
        |(position, variance, [pixels, green, saturated, weight, radius_squared], [weight_x, weight_y], sizes)| {
            let [x_min, x_max, y_min, y_max] = sizes;
            let bounds = Bounds { x_min, x_max, y_min, y_max };
            let cluster = Cluster { pixels, green, saturated, weight, weight_x, weight_y, bounds, radius_squared };
            Spot { position, variance, cluster }
        },
    )
}

fn frame_status() -> impl Strategy<Value = FrameStatus> {
    any::<([u16; 3], [u32; 3], bool)>().prop_map(
        |([rows, damaged_rows, excess_rows], [hits, outside, overflow], truncated)| FrameStatus {
            rows,
            hits,
            outside,
            overflow,
            damaged_rows,
            excess_rows,
            truncated,
        },
    )
}

fn counters() -> impl Strategy<Value = LinkCounters> {
    any::<[u32; 8]>().prop_map(|[received, lost, corrupt, oversize, reordered, duplicate, unknown, restarts]| {
        LinkCounters { received, lost, corrupt, oversize, reordered, duplicate, unknown, restarts }
    })
}

fn errors() -> impl Strategy<Value = Errors> {
    any::<[bool; 9]>().prop_map(|e| Errors {
        truncated_frame: e[0],
        stuck_camera: e[1],
        no_spots: e[2],
        detector_overflow: e[3],
        bad_calibration: e[4],
        link: e[5],
        bus: e[6],
        watchdog: e[7],
        self_test: e[8],
    })
}

fn part() -> impl Strategy<Value = CalibrationPart> {
    let words = prop::collection::vec(any::<u32>(), 0..=MAX_BLOCK_WORDS);
    (any::<u32>(), any::<[u16; 2]>(), words).prop_map(|(crc, [lasers, number], words)| CalibrationPart {
        crc,
        lasers,
        number,
        words: words.into_iter().collect(),
    })
}

fn transfer_state() -> impl Strategy<Value = TransferState> {
    prop_oneof![
        prop::collection::vec(any::<u16>(), 0..=MAX_MISSING)
            .prop_map(|missing| TransferState::Missing(missing.into_iter().collect())),
        Just(TransferState::Complete),
        any::<[u16; 2]>()
            .prop_map(|[found, capacity]| TransferState::Refused(TransferError::TooManyLasers { found, capacity })),
        Just(TransferState::Refused(TransferError::NoSuchPart)),
        any::<u16>().prop_map(|laser| TransferState::Refused(TransferError::Rig(RigError::Uncertainty { laser }))),
        any::<[u32; 2]>()
            .prop_map(|[expected, found]| TransferState::Refused(TransferError::Checksum { expected, found })),
    ]
}

/// Every message but Hello, which starts the numbering again.
pub fn numbered_message() -> impl Strategy<Value = Message> {
    let log_level = select(vec![LogLevel::Debug, LogLevel::Info, LogLevel::Warning, LogLevel::Error]);
    prop_oneof![
        select(vec![Request::Hello, Request::Status, Request::Settings, Request::Calibration])
            .prop_map(Message::Request),
        (select(vec![Mode::Accelerated, Mode::Software]), method(), any::<[bool; 2]>(), any::<u32>()).prop_map(
            |(mode, method, [spots, lasers], trigger_period_us)| Message::Settings(Settings {
                mode,
                method,
                spots,
                lasers,
                trigger_period_us
            })
        ),
        part().prop_map(Message::Calibration),
        (any::<u32>(), transfer_state())
            .prop_map(|(crc, state)| Message::CalibrationReply(CalibrationReply { crc, state })),
        (any::<u32>(), any::<u16>(), prop::result::maybe_err(point(), no_point()))
            .prop_map(|(frame, laser, result)| Message::Laser(LaserResult { frame, laser, result })),
        (any::<u32>(), any::<u8>(), any::<u16>(), spot())
            .prop_map(|(frame, camera, laser, spot)| Message::Spot(LaserSpot { frame, camera, laser, spot })),
        (any::<u32>(), any::<[u16; 2]>(), [frame_status(), frame_status()]).prop_map(
            |(frame, [lasers, spots], detectors)| Message::FrameEnd(FrameEnd { frame, lasers, spots, detectors })
        ),
        (any::<[u32; 4]>(), errors(), counters(), any::<Option<u32>>()).prop_map(
            |([uptime_ms, frames, dropped_frames, points], errors, link, calibration)| Message::Status(Status {
                uptime_ms,
                frames,
                dropped_frames,
                points,
                errors,
                link,
                calibration
            })
        ),
        (log_level, "[ -~]{0,96}")
            .prop_map(|(level, text)| Message::Log(Log { level, text: text.as_str().try_into().unwrap() })),
    ]
}

pub fn message() -> impl Strategy<Value = Message> {
    let hello = any::<([u8; 2], [u8; 3], u16)>().prop_map(|([oldest_protocol, newest_protocol], program, lasers)| {
        Message::Hello(Hello { oldest_protocol, newest_protocol, program, lasers })
    });
    prop_oneof![1 => hello, 9 => numbered_message()]
}

pub fn frame(encoder: &mut Encoder, message: &Message) -> Vec<u8> {
    encoder.encode(message, &mut [0; MAX_FRAME]).unwrap().to_vec()
}

pub fn decode(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Message> {
    let mut messages = Vec::new();
    decoder.feed(bytes, |message| messages.push(message));
    messages
}
