//! Segmentation: which pixels belong to a laser spot (eq. 2 of the paper).

/// Colour thresholds. A pixel is *green* when (G > `green_min[0]` and 2G-R-B > `excess_min[0]`) or
/// (G > `green_min[1]` and 2G-R-B > `excess_min[1]`); it is a *saturated core* when R, G and B all reach
/// `saturation_min`: the centre of a bright spot, where 2G-R-B falls to zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Thresholds {
    /// Thresholds on G, grey levels.
    pub green_min: [u8; 2],
    /// Thresholds on 2G-R-B, grey levels, 0 to 510.
    pub excess_min: [u16; 2],
    /// Least R, G and B of a saturated core, grey levels.
    pub saturation_min: u8,
    /// G at or above this is clipped: 2G-R-B no longer tells how bright the pixel is.
    pub clip_min: u8,
    /// Weight of a clipped or core pixel in the centroid is this, 1 to 500, plus R and B: above the threshold by as many
    /// grey levels as 2G-R-B of a pixel that is about to clip.
    pub clipped_weight: u16,
}

impl Default for Thresholds {
    /// The printed values of eq. 2, with a saturated core from 180 on so that no gap remains between the two classes.
    fn default() -> Self {
        Self { green_min: [0, 110], excess_min: [70, 120], saturation_min: 180, clip_min: 250, clipped_weight: 236 }
    }
}

/// A pixel that passed the colour test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Hit {
    /// Green (true) or saturated core only.
    pub green: bool,
    /// Whether the pixel is clipped or a core.
    pub clipped: bool,
    /// Weight in the centroid, at least 1.
    pub weight: u16,
}

/// Keeps the sum of the weights of a 2048 x 2048 image within 32 bits.
const MAX_CLIPPED_WEIGHT: u16 = 500;

/// Pixels scanned at once.
const BLOCK: usize = 64;

impl Thresholds {
    fn lowest_excess(&self) -> u16 {
        self.excess_min[0].min(self.excess_min[1])
    }

    /// Classifies one pixel.
    pub(crate) fn classify(&self, [r, g, b]: [u8; 3]) -> Option<Hit> {
        let excess = 2 * i16::from(g) - i16::from(r) - i16::from(b);
        let passes = |i: usize| g > self.green_min[i] && excess > self.excess_min[i] as i16;
        let green = passes(0) || passes(1);
        let core = r.min(g).min(b) >= self.saturation_min;
        if !green && !core {
            return None;
        }
        let clipped = core || g >= self.clip_min;
        let weight = if clipped {
            // R and B still tell how bright the pixel is
            self.clipped_weight.clamp(1, MAX_CLIPPED_WEIGHT) + u16::from(r) + u16::from(b)
        } else {
            // A green pixel is above the lowest threshold: the difference is at least 1
            excess as u16 - self.lowest_excess()
        };
        Some(Hit { green, clipped, weight })
    }

    /// Calls `found` with the column and class of every hit of a row of RGB pixels, from left to right.
    pub(crate) fn scan_row(&self, rgb: &[u8], mut found: impl FnMut(u16, Hit)) {
        // 2G-R-B > T implies G - ceil((R+B)/2) >= T/2, which needs bytes only: the compiler makes vector code of it.
        let half_excess = self.lowest_excess().div_ceil(2).min(255) as u8;
        let (blocks, rest) = rgb.as_chunks::<{ 3 * BLOCK }>();
        let mut classify_all = |first_column: usize, pixels: &[u8]| {
            for (i, pixel) in pixels.as_chunks().0.iter().enumerate() {
                if let Some(hit) = self.classify(*pixel) {
                    found((first_column + i) as u16, hit);
                }
            }
        };
        for (index, block) in blocks.iter().enumerate() {
            if may_hold_hits(block, half_excess, self.saturation_min) {
                classify_all(index * BLOCK, block);
            }
        }
        classify_all(blocks.len() * BLOCK, rest);
    }
}

/// Whether any pixel of the block can pass: never false for a block with a hit.
///
/// The test runs over every byte as if it were a G, which wastes two thirds of the work and saves the deinterleaving;
/// the mask keeps the true Gs.
#[inline]
fn may_hold_hits(block: &[u8; 3 * BLOCK], half_excess: u8, saturation_min: u8) -> bool {
    const LANES: usize = 3 * BLOCK - 2;
    const IS_GREEN: [u8; LANES] = {
        let mut mask = [0; LANES];
        let mut i = 0;
        while i < LANES {
            mask[i] = 0xff;
            i += 3;
        }
        mask
    };
    let (mut excess, mut core) = (0_u8, 0_u8);
    for i in 0..LANES {
        let (r, g, b) = (block[i], block[i + 1], block[i + 2]);
        let mean = ((u16::from(r) + u16::from(b) + 1) >> 1) as u8;
        excess = excess.max(g.saturating_sub(mean) & IS_GREEN[i]);
        core = core.max(r.min(g).min(b) & IS_GREEN[i]);
    }
    excess >= half_excess || core >= saturation_min
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn hits(thresholds: &Thresholds, row: &[u8]) -> Vec<(u16, Hit)> {
        let mut hits = Vec::new();
        thresholds.scan_row(row, |column, hit| hits.push((column, hit)));
        hits
    }

    #[test]
    fn eq_2_and_the_core_class_hold_for_every_colour() {
        let thresholds = Thresholds::default();
        for rgb in 0..1_u32 << 24 {
            let [_, r, g, b] = rgb.to_be_bytes();
            let excess = 2 * i32::from(g) - i32::from(r) - i32::from(b);
            let green = (g > 0 && excess > 70) || (g > 110 && excess > 120);
            let core = r >= 180 && g >= 180 && b >= 180;
            let hit = thresholds.classify([r, g, b]);
            assert_eq!(hit.is_some(), green || core);
            if let Some(hit) = hit {
                assert_eq!(hit.green, green);
                assert!(hit.weight >= 1);
            }
        }
    }

    #[test]
    fn weights_do_not_fall_while_a_green_spot_gets_brighter() {
        // The sensor sees 532 nm in R with 0.15 and in B with 0.25 of G; each channel clips at 255.
        let thresholds = Thresholds::default();
        let mut last = 0;
        for light in 60..3000_u32 {
            let channel = |percent: u32| (light * percent / 100).min(255) as u8;
            let weight = thresholds.classify([channel(15), channel(100), channel(25)]).map_or(0, |hit| hit.weight);
            assert!(weight + 2 >= last, "falls from {last} to {weight} at {light}");
            last = last.max(weight);
        }
        assert_eq!(last, 236 + 255 + 255);
    }

    #[test]
    fn no_colour_is_skipped_in_a_dark_row() {
        // The vector test must let every hit through: every green level, against each mean of R and B and both
        // parities of their sum, alone in a row and at every place of a block.
        let thresholds = Thresholds::default();
        for (i, rgb) in (0..1_u32 << 24).step_by(101).enumerate() {
            let [_, r, g, b] = rgb.to_be_bytes();
            let mut row = [0; 3 * (BLOCK + 5)];
            let column = i % (BLOCK + 5);
            row[3 * column..3 * column + 3].copy_from_slice(&[r, g, b]);
            let expected: Vec<_> = thresholds.classify([r, g, b]).map(|hit| (column as u16, hit)).into_iter().collect();
            assert_eq!(hits(&thresholds, &row), expected, "{r} {g} {b} in column {column}");
        }
    }

    proptest! {
        #[test]
        fn a_row_gives_exactly_the_hits_of_its_pixels(
            row in prop::collection::vec(any::<u8>(), 0..3 * 200),
            excess_min in prop::array::uniform2(0_u16..=510),
            green_min: [u8; 2],
            saturation_min: u8,
        ) {
            let thresholds = Thresholds { green_min, excess_min, saturation_min, ..Thresholds::default() };
            let expected: Vec<_> = row
                .chunks_exact(3)
                .enumerate()
                .filter_map(|(i, p)| Some((i as u16, thresholds.classify([p[0], p[1], p[2]])?)))
                .collect();
            prop_assert_eq!(hits(&thresholds, &row), expected);
        }
    }
}
