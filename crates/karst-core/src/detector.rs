//! The streaming spot detector: rows of pixels in, spots with sub-pixel positions out, in fixed memory.

use core::fmt;

use fixed::types::I18F14;
use heapless::Vec;
use karst_math::{azimuth, div_round, saturate_i32};

use crate::cluster::{Candidates, Cluster};
use crate::segment::{MAX_WIDTH, RowBackground, Thresholds};

/// How sure a spot position is: variance = `floor` + `noise` / (mean weight)^2, per axis.
///
/// The second term is the variance of a centroid over n pixels of white noise sigma: sigma^2 n^2 / (4 pi) over the
/// squared sum of weights, for a round spot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SpotNoise {
    /// Least variance, px^2 in Q8.24, at least 1.
    pub floor: u32,
    /// sigma^2 / (4 pi) with sigma the noise of 2G-R-B, squared grey levels in Q16.16.
    pub noise: u32,
}

impl SpotNoise {
    /// Variance of a centroid in px^2, Q8.24, at most 1 px^2.
    fn variance(&self, cluster: &Cluster) -> u32 {
        // 1 / mean weight in Q.24 is at most 1, so its square fits Q.24 too
        let inverse_mean = div_round(i64::from(cluster.pixels) << 24, i64::from(cluster.weight)) as u64;
        let noise = (((inverse_mean * inverse_mean) >> 24) * u64::from(self.noise)) >> 16;
        (u64::from(self.floor) + noise).min(1 << 24) as u32
    }
}

/// The background is sampled in every fourth row.
const BACKGROUND_ROWS: u16 = 4;

/// What a detector needs to know of its camera and belt.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DetectorConfig<const LASERS: usize> {
    /// Image width, px, 1 to 2048.
    pub width: u16,
    /// Image height, px, 1 to 2048.
    pub height: u16,
    /// Colour thresholds.
    pub thresholds: Thresholds,
    /// Image centre (column, row), px, in the image; used to 1/16 px.
    pub centre: [I18F14; 2],
    /// Hits at this distance from the centre and beyond are ignored, 1/16 px.
    pub mirror_radius: u16,
    /// Hits closer to the centre than this are ignored, 1/16 px.
    pub inner_radius: u16,
    /// Hits of one sector this close to a cluster's bounding box, in x and in y, belong to it, px.
    pub cluster_gap: u16,
    /// Fewest green pixels of a spot.
    pub min_pixels: u16,
    /// Whether the laser indices run clockwise in the image (from y towards x), as in a camera that looks down the
    /// rig axis.
    pub clockwise: bool,
    /// Angle at which each laser's spots lie in the image, from the x axis in the direction of rising laser indices,
    /// 2^-16 turn. There is one equal sector per laser, the first centred on the first angle; each angle must lie in
    /// its own sector.
    pub azimuths: Vec<u16, LASERS>,
    /// Hits further than this from their laser's angle are ignored, 2^-16 turn.
    pub sector_half_width: u16,
    /// Position noise.
    pub noise: SpotNoise,
}

/// Why a [`DetectorConfig`] is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ConfigError {
    /// Width or height is zero or above 2048 px.
    ImageSize {
        /// Width found, px.
        width: u16,
        /// Height found, px.
        height: u16,
    },
    /// There is no laser.
    NoLasers,
    /// A laser's angle lies in another laser's sector.
    OutsideSector {
        /// Index of the laser.
        laser: u16,
    },
    /// The inner radius is not below the mirror radius, 1/16 px.
    Radii {
        /// Inner radius found.
        inner: u16,
        /// Mirror radius found.
        mirror: u16,
    },
    /// The variance floor is zero: a spot can not be perfectly sure.
    NoiseFloor,
    /// The image centre is not in the image.
    Centre,
    /// A threshold on 2G-R-B is above 510 grey levels.
    Excess {
        /// Threshold found.
        found: u16,
    },
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImageSize { width, height } => write!(f, "image of {width} x {height} px, expected 1 to 2048"),
            Self::NoLasers => write!(f, "no laser"),
            Self::OutsideSector { laser } => write!(f, "laser {laser} lies outside its sector of the image"),
            Self::Radii { inner, mirror } => {
                write!(f, "inner radius {inner}/16 px is not below the mirror radius {mirror}/16 px")
            }
            Self::NoiseFloor => write!(f, "the least spot variance is zero"),
            Self::Centre => write!(f, "the image centre is outside the image"),
            Self::Excess { found } => write!(f, "threshold of {found} on 2G-R-B, expected 0 to 510"),
        }
    }
}

impl core::error::Error for ConfigError {}

/// Why a row was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RowError {
    /// No frame was started.
    NotStarted,
    /// The row has the wrong number of bytes. It counts as far as it goes; what is too much does not.
    Length {
        /// Bytes expected: three per pixel.
        expected: usize,
        /// Bytes found.
        found: usize,
    },
    /// The frame has all its rows. The row is ignored.
    TooMany,
}

impl fmt::Display for RowError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotStarted => write!(f, "row without a start of frame"),
            Self::Length { expected, found } => write!(f, "row of {found} bytes, expected {expected}"),
            Self::TooMany => write!(f, "more rows than the image has"),
        }
    }
}

impl core::error::Error for RowError {}

/// What happened to the pixels of a frame. Every hit is in a cluster or in one of the counters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FrameStatus {
    /// Rows taken, damaged ones included.
    pub rows: u16,
    /// Pixels that passed the colour test.
    pub hits: u32,
    /// Hits outside the mirror's ring or outside every laser's sector.
    pub outside: u32,
    /// Hits lost because a sector had more clusters than slots.
    pub overflow: u32,
    /// Rows of the wrong length.
    pub damaged_rows: u16,
    /// Rows after the last one.
    pub excess_rows: u16,
    /// The frame ended before its last row.
    pub truncated: bool,
}

/// A spot: a cluster with its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Spot {
    /// Weighted centroid (column, row), px.
    pub position: [I18F14; 2],
    /// Variance of the position per axis, px^2 in Q8.24.
    pub variance: u32,
    /// The sums behind it.
    pub cluster: Cluster,
}

impl Spot {
    /// Middle of the bounding box: eq. 3 of the paper as corrected, px.
    pub fn midpoint(&self) -> [I18F14; 2] {
        let b = &self.cluster.bounds;
        [(b.x_min, b.x_max), (b.y_min, b.y_max)]
            .map(|(low, high)| I18F14::from_bits((i32::from(low) + i32::from(high)) << 13))
    }
}

/// A pixel that passed the colour test, as [`SpotDetector::row_observed`] tells of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ObservedHit {
    /// Column, px.
    pub x: u16,
    /// The laser in whose sector it is.
    pub laser: u16,
    /// Green, not only saturated.
    pub green: bool,
    /// It is in the mirror's ring and close enough to the laser's angle: a cluster gets it.
    pub accepted: bool,
}

/// Finds the laser spots in one camera's image while its rows arrive.
///
/// `LASERS` is the most lasers it can serve, `K` the most candidate spots per laser. All memory is in the value itself:
/// `size_of::<SpotDetector<12>>()` bytes for twelve lasers.
#[derive(Debug, Clone)]
pub struct SpotDetector<const LASERS: usize, const K: usize = 4> {
    config: DetectorConfig<LASERS>,
    /// Centre in 1/16 px.
    centre: [i32; 2],
    sectors: [Candidates<K>; LASERS],
    backgrounds: RowBackground,
    status: FrameStatus,
    started: bool,
}

impl<const LASERS: usize, const K: usize> SpotDetector<LASERS, K> {
    /// A detector for one camera.
    pub fn new(config: DetectorConfig<LASERS>) -> Result<Self, ConfigError> {
        config.check()?;
        let centre = config.centre.map(|c| (c.to_bits() + (1 << 9)) >> 10);
        Ok(Self {
            config,
            centre,
            sectors: [const { Candidates::EMPTY }; LASERS],
            backgrounds: RowBackground::default(),
            status: FrameStatus::default(),
            started: false,
        })
    }

    /// Starts a frame; an unfinished one is forgotten.
    pub fn start_frame(&mut self) {
        self.sectors.fill(Candidates::EMPTY);
        self.backgrounds = RowBackground::default();
        self.status = FrameStatus::default();
        self.started = true;
    }

    /// Takes the next row: `3 * width` bytes, R, G, B of each pixel from left to right.
    pub fn row(&mut self, rgb: &[u8]) -> Result<(), RowError> {
        self.row_observed(rgb, |_| ())
    }

    /// The same, and calls `observe` with every hit, from left to right: for models of what a hit costs.
    pub fn row_observed(&mut self, rgb: &[u8], mut observe: impl FnMut(ObservedHit)) -> Result<(), RowError> {
        if !self.started {
            return Err(RowError::NotStarted);
        }
        if self.status.rows == self.config.height {
            self.status.excess_rows = self.status.excess_rows.saturating_add(1);
            return Err(RowError::TooMany);
        }
        let y = self.status.rows;
        self.status.rows += 1;
        let Self { config, centre, sectors, backgrounds, status, .. } = self;
        // Neighbouring hits of one sector enter its clusters as one run
        let mut run: Option<(usize, Cluster)> = None;
        let mut add = |(laser, run): (usize, Cluster)| {
            sectors.get_mut(laser).map_or(run.pixels, |sector| sector.add(&run, config.cluster_gap))
        };
        let ring = u32::from(config.inner_radius).pow(2)..u32::from(config.mirror_radius).pow(2);
        let width = usize::from(config.width);
        config.thresholds.scan_row(rgb, width, backgrounds, y.is_multiple_of(BACKGROUND_ROWS), |x, hit| {
            status.hits += 1;
            let [dx, dy] = [i32::from(x) * 16 - centre[0], i32::from(y) * 16 - centre[1]];
            // At most 2 * (2048 px)^2
            let radius_squared = (dx * dx) as u32 + (dy * dy) as u32;
            let angle = config.laser_angle(azimuth(dx, dy));
            let laser = config.sector(angle);
            // Every sector has its laser: what has none would be outside
            let off_laser = |&azimuth: &u16| (angle.wrapping_sub(azimuth) as i16).unsigned_abs();
            let off_laser = config.azimuths.get(laser).map_or(u16::MAX, off_laser);
            let accepted = ring.contains(&radius_squared) && off_laser <= config.sector_half_width;
            observe(ObservedHit { x, laser: laser as u16, green: hit.green, accepted });
            if !accepted {
                status.outside += 1;
                return;
            }
            let cluster = Cluster::new(x, y, radius_squared, hit);
            run = match run.take() {
                Some((of, run)) if of == laser && run.bounds.x_max + 1 == x => Some((laser, run.merge(&cluster))),
                other => {
                    status.overflow += other.map_or(0, &mut add);
                    Some((laser, cluster))
                }
            };
        });
        status.overflow += run.map_or(0, add);
        let expected = 3 * width;
        if rgb.len() != expected {
            status.damaged_rows += 1;
            return Err(RowError::Length { expected, found: rgb.len() });
        }
        Ok(())
    }

    /// Ends the frame: says what happened. The spots stay until the next frame starts.
    pub fn end_frame(&mut self) -> FrameStatus {
        self.status.truncated = self.status.rows < self.config.height;
        self.started = false;
        self.status
    }

    /// The spots of one laser, in no particular order; none for a laser that does not exist.
    pub fn spots(&self, laser: usize) -> Vec<Spot, K> {
        let clusters = self.sectors.get(laser).into_iter().flat_map(Candidates::iter);
        let mut spots = Vec::new();
        for cluster in clusters.filter(|c| c.green >= u32::from(self.config.min_pixels)) {
            // There are no more than K clusters
            let _ = spots.push(self.spot(cluster));
        }
        spots
    }

    fn spot(&self, cluster: &Cluster) -> Spot {
        // Weights are at least 1, so the sum is not zero; a centroid lies inside the image, so it fits.
        let centroid =
            |sum: u64| I18F14::from_bits(saturate_i32(div_round((sum as i64) << 14, i64::from(cluster.weight))));
        Spot {
            position: [centroid(cluster.weight_x), centroid(cluster.weight_y)],
            variance: self.config.noise.variance(cluster),
            cluster: *cluster,
        }
    }
}

impl<const LASERS: usize> DetectorConfig<LASERS> {
    /// Whether a detector can work with it.
    pub fn check(&self) -> Result<(), ConfigError> {
        let (width, height) = (self.width, self.height);
        let sizes = 1..=MAX_WIDTH as u16;
        if !sizes.contains(&width) || !sizes.contains(&height) {
            return Err(ConfigError::ImageSize { width, height });
        }
        if self.inner_radius >= self.mirror_radius {
            return Err(ConfigError::Radii { inner: self.inner_radius, mirror: self.mirror_radius });
        }
        if self.noise.floor == 0 {
            return Err(ConfigError::NoiseFloor);
        }
        if self.azimuths.is_empty() {
            return Err(ConfigError::NoLasers);
        }
        // Keeps every coordinate from the centre within 2^15 units of 1/16 px
        let inside = |c: I18F14, size: u16| c >= 0 && c <= size;
        if !inside(self.centre[0], width) || !inside(self.centre[1], height) {
            return Err(ConfigError::Centre);
        }
        if let Some(&found) = self.thresholds.excess_min.iter().find(|&&excess| excess > 510) {
            return Err(ConfigError::Excess { found });
        }
        for (laser, &azimuth) in (0..).zip(&self.azimuths) {
            if self.sector(azimuth) != usize::from(laser) {
                return Err(ConfigError::OutsideSector { laser });
            }
        }
        Ok(())
    }

    /// Image angle counted in the direction of rising laser indices.
    fn laser_angle(&self, image_angle: u16) -> u16 {
        if self.clockwise { image_angle.wrapping_neg() } else { image_angle }
    }

    /// Index of the sector that holds an angle: of `n` equal sectors, the first centred on the first laser.
    fn sector(&self, angle: u16) -> usize {
        let Some(first) = self.azimuths.first() else { return 0 };
        let lasers = self.azimuths.len() as u32;
        let from_first_edge = angle.wrapping_sub(*first).wrapping_add(((1 << 15) / lasers) as u16);
        ((u32::from(from_first_edge) * lasers) >> 16) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::{vec, vec::Vec as StdVec};

    const WIDTH: u16 = 128;
    const HEIGHT: u16 = 96;

    fn config<const LASERS: usize>(lasers: u32, clockwise: bool) -> DetectorConfig<LASERS> {
        DetectorConfig {
            width: WIDTH,
            height: HEIGHT,
            thresholds: Thresholds::default(),
            centre: [I18F14::from_num(63.5), I18F14::from_num(47.5)],
            mirror_radius: 45 * 16,
            inner_radius: 5 * 16,
            cluster_gap: 3,
            min_pixels: 3,
            clockwise,
            azimuths: (0..lasers).map(|i| (i * 65536 / lasers) as u16).collect(),
            sector_half_width: (65536 / lasers / 2) as u16,
            noise: SpotNoise { floor: 2416, noise: 83443 },
        }
    }

    fn detector() -> SpotDetector<12> {
        SpotDetector::new(config(12, false)).unwrap()
    }

    /// A dark image with a square of one colour.
    fn image(left: usize, top: usize, size: usize, colour: [u8; 3]) -> StdVec<StdVec<u8>> {
        let mut rows = vec![vec![0; 3 * usize::from(WIDTH)]; usize::from(HEIGHT)];
        for row in &mut rows[top..top + size] {
            for x in left..left + size {
                row[3 * x..3 * x + 3].copy_from_slice(&colour);
            }
        }
        rows
    }

    fn detect<const L: usize, const K: usize>(detector: &mut SpotDetector<L, K>, rows: &[StdVec<u8>]) -> FrameStatus {
        detector.start_frame();
        for row in rows {
            detector.row(row).unwrap();
        }
        detector.end_frame()
    }

    const GREEN: [u8; 3] = [20, 200, 30];

    #[test]
    fn memory_for_twelve_lasers_is_within_eight_kibibytes() {
        assert!(size_of::<SpotDetector<12>>() <= 8 * 1024, "{}", size_of::<SpotDetector<12>>());
    }

    #[test]
    fn a_square_spot_is_found_at_its_middle() {
        let mut detector = detector();
        let status = detect(&mut detector, &image(90, 46, 4, GREEN));
        assert_eq!((status.hits, status.outside, status.overflow, status.truncated), (16, 0, 0, false));
        let spots = detector.spots(0);
        assert_eq!(spots.len(), 1);
        assert_eq!(spots[0].position, [91.5, 47.5].map(I18F14::from_num));
        assert_eq!(spots[0].midpoint(), spots[0].position);
        assert_eq!((spots[0].cluster.pixels, spots[0].cluster.saturated), (16, 0));
        assert!((1..12).all(|laser| detector.spots(laser).is_empty()));
    }

    #[test]
    fn laser_indices_follow_the_direction_of_the_camera() {
        // Below the centre: a quarter turn from x towards y
        let rows = image(62, 70, 4, GREEN);
        let mut counterclockwise = detector();
        detect(&mut counterclockwise, &rows);
        assert_eq!(counterclockwise.spots(3).len(), 1);
        let mut clockwise = SpotDetector::<12>::new(config(12, true)).unwrap();
        detect(&mut clockwise, &rows);
        assert_eq!(clockwise.spots(9).len(), 1);
    }

    #[test]
    fn a_saturated_core_belongs_to_the_green_spot_around_it() {
        let mut rows = image(86, 44, 8, GREEN);
        for row in &mut rows[46..50] {
            row[3 * 88..3 * 92].fill(255);
        }
        let mut detector = detector();
        detect(&mut detector, &rows);
        let spots = detector.spots(0);
        assert_eq!(spots[0].cluster.pixels, 64);
        assert_eq!(spots[0].cluster.saturated, 16);
        let [x, y] = spots[0].position.map(I18F14::to_num::<f64>);
        assert!((x - 89.5).abs() < 1e-3 && (y - 47.5).abs() < 1e-3, "{x}, {y}");
    }

    #[test]
    fn a_white_spot_without_green_is_no_spot() {
        let mut detector = detector();
        let status = detect(&mut detector, &image(86, 44, 8, [255; 3]));
        assert_eq!(status.hits, 64);
        assert!((0..12).all(|laser| detector.spots(laser).is_empty()));
    }

    #[test]
    fn spots_of_one_sector_are_split_by_a_gap() {
        let mut rows = image(76, 46, 4, GREEN);
        for (row, other) in rows.iter_mut().zip(image(90, 46, 4, GREEN)) {
            for (byte, more) in row.iter_mut().zip(other) {
                *byte |= more;
            }
        }
        let mut detector = detector();
        detect(&mut detector, &rows);
        assert_eq!(detector.spots(0).len(), 2);
    }

    #[test]
    fn a_white_particle_at_the_radius_of_a_spot_does_not_move_it() {
        let mut rows = image(90, 46, 4, GREEN);
        for row in &mut rows[55..58] {
            row[3 * 89..3 * 92].fill(255);
        }
        let mut detector = detector();
        detect(&mut detector, &rows);
        let spots = detector.spots(0);
        assert_eq!(spots.len(), 1);
        assert_eq!(spots[0].position, [91.5, 47.5].map(I18F14::from_num));
    }

    #[test]
    fn rows_of_a_wrong_length_early_and_late_rows_are_told_and_counted() {
        let mut detector = detector();
        let row = vec![0; 3 * usize::from(WIDTH)];
        assert_eq!(detector.row(&row), Err(RowError::NotStarted));
        detector.start_frame();
        assert_eq!(detector.row(&row[1..]), Err(RowError::Length { expected: row.len(), found: row.len() - 1 }));
        for _ in 1..HEIGHT {
            detector.row(&row).unwrap();
        }
        assert_eq!(detector.row(&row), Err(RowError::TooMany));
        let status = detector.end_frame();
        assert_eq!((status.rows, status.damaged_rows, status.excess_rows, status.truncated), (HEIGHT, 1, 1, false));
        assert_eq!(detector.row(&row), Err(RowError::NotStarted));
    }

    #[test]
    fn a_run_that_reaches_a_cluster_needs_no_slot_of_its_own() {
        // One slot, and a run whose first hit is too far away from the cluster in it
        let mut rows = image(0, 0, 0, GREEN);
        for (row, columns) in [(46, 100..102), (47, 90..100)] {
            for x in columns {
                rows[row][3 * x..3 * x + 3].copy_from_slice(&GREEN);
            }
        }
        let mut detector = SpotDetector::<12, 1>::new(config(12, false)).unwrap();
        assert_eq!(detect(&mut detector, &rows).overflow, 0);
        assert_eq!(detector.spots(0)[0].cluster.pixels, 12);
    }

    #[test]
    fn a_truncated_frame_is_flagged_and_the_next_one_is_whole() {
        let mut detector = detector();
        let rows = image(90, 46, 4, GREEN);
        assert!(detect(&mut detector, &rows[..50]).truncated);
        assert!(!detect(&mut detector, &rows).truncated);
        assert_eq!(detector.spots(0).len(), 1);
        assert_eq!(detector.spots(0)[0].cluster.pixels, 16);
    }

    #[test]
    fn an_all_green_frame_loses_nothing() {
        let mut detector = detector();
        let status = detect(&mut detector, &image(0, 0, 96, GREEN));
        let kept: u32 = (0..12).flat_map(|laser| detector.spots(laser)).map(|s| s.cluster.pixels).sum();
        // After some rows all that green is background
        assert!(status.hits > 96 * 8 && status.overflow == 0, "{status:?}");
        assert_eq!(kept + status.outside, status.hits);
    }

    #[test]
    fn seven_hundred_and_twenty_lasers_have_sectors_of_their_own() {
        let mut detector = SpotDetector::<720, 2>::new(config(720, false)).unwrap();
        detect(&mut detector, &image(90, 46, 4, GREEN));
        let found: StdVec<usize> = (0..720).filter(|&laser| !detector.spots(laser).is_empty()).collect();
        // 4 px at 28 px from the centre are 8 degrees, 16 lasers
        assert!(!found.is_empty() && found.iter().all(|&laser| laser <= 9 || laser >= 711), "{found:?}");
    }

    #[test]
    fn bad_configurations_are_refused() {
        let refused = |config| SpotDetector::<12>::new(config).unwrap_err();
        assert_eq!(
            refused(DetectorConfig { width: 0, ..config(12, false) }),
            ConfigError::ImageSize { width: 0, height: HEIGHT }
        );
        assert_eq!(
            refused(DetectorConfig { height: 2049, ..config(12, false) }),
            ConfigError::ImageSize { width: WIDTH, height: 2049 }
        );
        assert_eq!(refused(DetectorConfig { azimuths: Vec::new(), ..config(12, false) }), ConfigError::NoLasers);
        assert_eq!(
            refused(DetectorConfig { inner_radius: 720, ..config(12, false) }),
            ConfigError::Radii { inner: 720, mirror: 720 }
        );
        let noise = SpotNoise { floor: 0, noise: 1 };
        assert_eq!(refused(DetectorConfig { noise, ..config(12, false) }), ConfigError::NoiseFloor);
        for centre in [[I18F14::MAX, I18F14::ZERO], [I18F14::ZERO, I18F14::from_num(HEIGHT + 1)]] {
            assert_eq!(refused(DetectorConfig { centre, ..config(12, false) }), ConfigError::Centre);
        }
        let thresholds = Thresholds { excess_min: [70, 511], ..Thresholds::default() };
        assert_eq!(refused(DetectorConfig { thresholds, ..config(12, false) }), ConfigError::Excess { found: 511 });
        let mut twice = config(12, false);
        twice.azimuths[5] = twice.azimuths[4];
        assert_eq!(refused(twice), ConfigError::OutsideSector { laser: 5 });
    }

    proptest! {
        #[test]
        fn every_hit_is_in_a_cluster_or_in_a_counter(
            pixels in prop::collection::vec((0..WIDTH, 0..HEIGHT, any::<[u8; 3]>()), 0..800),
        ) {
            let mut rows = image(0, 0, 0, GREEN);
            for (x, y, colour) in pixels {
                rows[usize::from(y)][3 * usize::from(x)..3 * usize::from(x) + 3].copy_from_slice(&colour);
            }
            let mut detector = detector();
            let status = detect(&mut detector, &rows);
            let clusters: StdVec<Cluster> = detector.sectors.iter().flat_map(Candidates::iter).copied().collect();
            let kept: u32 = clusters.iter().map(|c| c.pixels).sum();
            prop_assert_eq!(kept + status.outside + status.overflow, status.hits);
            for c in &clusters {
                let (x, y) = (c.weight_x / u64::from(c.weight), c.weight_y / u64::from(c.weight));
                prop_assert!((u64::from(c.bounds.x_min)..=u64::from(c.bounds.x_max)).contains(&x));
                prop_assert!((u64::from(c.bounds.y_min)..=u64::from(c.bounds.y_max)).contains(&y));
            }
        }

        #[test]
        fn centroids_are_rounded_to_half_a_unit(
            colours in prop::collection::vec((0_u8..40, 150_u8..=255, 0_u8..40), 25),
        ) {
            let mut rows = image(0, 0, 0, GREEN);
            for (i, &(r, g, b)) in colours.iter().enumerate() {
                let (x, y) = (90 + i % 5, 45 + i / 5);
                rows[y][3 * x..3 * x + 3].copy_from_slice(&[r, g, b]);
            }
            let mut detector = detector();
            detect(&mut detector, &rows);
            let spot = detector.spots(0)[0];
            let c = spot.cluster;
            let exact = [c.weight_x, c.weight_y].map(|sum| sum as f64 / f64::from(c.weight));
            for (found, exact) in spot.position.iter().zip(exact) {
                prop_assert!((f64::from(found.to_bits()) - exact * 16384.0).abs() <= 0.5 + 1e-6);
            }
        }
    }
}
