//! Records of the result memories.

use karst_core::{Bounds, Cluster, Estimates, I18F14, NoPoint, Point, Spot};

use crate::map;

/// Words of a point's record that have a meaning.
pub(crate) const POINT_WORDS: usize = 7;

/// Words of a spot's record.
pub(crate) const SPOT_WORDS: usize = 8;

/// What happened to the pixels of one camera's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CameraFrame {
    /// Pixels that passed the colour test.
    pub hits: u32,
    /// Hits outside the mirror's ring or outside every laser's sector.
    pub outside: u32,
    /// Hits lost because a sector had more clusters than slots.
    pub overflow: u32,
    /// Rows taken, damaged ones included.
    pub rows: u16,
    /// Rows of the wrong length.
    pub damaged_rows: u16,
    /// The frame ended before its last row.
    pub truncated: bool,
    /// How many spots there are.
    pub spots: u32,
}

/// A spot as the detector of the IP gives it: what the reconstruction needs of a [`Spot`], and its laser.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SpotRecord {
    /// Index of the laser.
    pub laser: u16,
    /// Weighted centroid (column, row), px.
    pub position: [I18F14; 2],
    /// Variance of the position per axis, px^2 in Q8.24.
    pub variance: u32,
    /// Number of pixels.
    pub pixels: u32,
    /// Clipped and core pixels among them.
    pub saturated: u32,
    /// Smallest box.
    pub bounds: Bounds,
    /// Largest distance from the image centre, 1/16 px.
    pub r_max: u16,
}

impl From<&SpotRecord> for Spot {
    /// The spot for [`karst_core::reconstruct`]. What the IP does not give, and the reconstruction does not use, is
    /// zero: green pixels and sums of weights.
    fn from(record: &SpotRecord) -> Self {
        Self {
            position: record.position,
            variance: record.variance,
            cluster: Cluster {
                pixels: record.pixels,
                green: 0,
                saturated: record.saturated,
                weight: 0,
                weight_x: 0,
                weight_y: 0,
                bounds: record.bounds,
                radius_squared: u32::from(record.r_max).pow(2),
            },
        }
    }
}

impl SpotRecord {
    pub(crate) fn from_words(words: &[u32; SPOT_WORDS]) -> Self {
        let [columns, rows] = [words[5], words[6]].map(|bounds| {
            [map::SPOTS_CAMERA_SPOT_BOUNDS_MIN, map::SPOTS_CAMERA_SPOT_BOUNDS_MAX].map(|f| f.get(bounds) as u16)
        });
        Self {
            laser: map::SPOTS_CAMERA_SPOT_ORIGIN_LASER.get(words[7]) as u16,
            position: [q14(words[0]), q14(words[1])],
            variance: words[2],
            pixels: words[3],
            saturated: words[4],
            bounds: Bounds { x_min: columns[0], x_max: columns[1], y_min: rows[0], y_max: rows[1] },
            r_max: map::SPOTS_CAMERA_SPOT_ORIGIN_R_MAX.get(words[7]) as u16,
        }
    }
}

fn q14(word: u32) -> I18F14 {
    I18F14::from_bits(word as i32)
}

/// Why a laser gives no point, by the number in the record less one.
pub(crate) const REASONS: [NoPoint; 6] = [
    NoPoint::NoLaser,
    NoPoint::NoSpot,
    NoPoint::OneCamera,
    NoPoint::NoIntersection,
    NoPoint::OutOfRange,
    NoPoint::Inconsistent,
];

/// The point of a laser, or why there is none; the IP does not give the single estimates. None: a record that it does not
/// write.
pub(crate) fn point_from_words(laser: u16, words: &[u32; POINT_WORDS]) -> Option<Result<Point, NoPoint>> {
    let status = words[0];
    match map::RESULT_POINT_STATUS_OUTCOME.get(status) {
        0 => {}
        reason => return REASONS.get(reason as usize - 1).map(|&reason| Err(reason)),
    }
    let weighted = map::RESULT_POINT_STATUS_WEIGHTED.is_set(status);
    let estimate = |word: usize| weighted.then(|| q14(words[word]));
    let spot = |there: bool, index: u32| there.then_some(index as u8);
    Some(Ok(Point {
        laser,
        position: [q14(words[1]), q14(words[2]), q14(words[3])],
        along: q14(words[4]),
        sigma: estimate(5),
        chi2: estimate(6),
        estimates: Estimates::default(),
        spots: [
            spot(map::RESULT_POINT_STATUS_CAMERA_1.is_set(status), map::RESULT_POINT_STATUS_SPOT_1.get(status)),
            spot(map::RESULT_POINT_STATUS_CAMERA_2.is_set(status), map::RESULT_POINT_STATUS_SPOT_2.get(status)),
        ],
    }))
}
