//! Words of the settings memory back to a rig, and results of `karst-core` to words.

use karst_core::{FrameStatus, Method, NoPoint, Point, Spot};

use super::registers::RESULT_WORDS;
use crate::results::{REASONS, SPOT_WORDS};
use crate::{OTHER_BLOCKS, RigWords, map};

/// What the settings memory says: the rig and the method. None: more lasers than the IP has.
pub fn settings<const LASERS: usize>(memory: &[u32]) -> Option<(RigWords<LASERS>, Method)> {
    let from = |address: u32| memory.get(((address - map::SETTINGS_INSTRUMENT_LASERS) / 4) as usize..);
    let instrument = *memory.first()?;
    let lasers = map::SETTINGS_INSTRUMENT_LASERS_COUNT.get(instrument) as u16;
    if usize::from(lasers) > LASERS {
        return None;
    }
    let mut words = RigWords::EMPTY;
    words.clear(lasers);
    for number in 0..OTHER_BLOCKS + lasers {
        let block = words.block_mut(number)?;
        block.copy_from_slice(from(RigWords::<LASERS>::address(number))?.get(..block.len())?);
    }
    let paper = map::SETTINGS_INSTRUMENT_LASERS_PAPER.is_set(instrument);
    Some((words, if paper { Method::Paper } else { Method::Weighted }))
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
