//! Segmentation: which pixels belong to a laser spot (eq. 2 of the paper).

/// Colour thresholds. A pixel is *green* when (G > `green_min[0]` and 2G-R-B > `excess_min[0]`) or
/// (G > `green_min[1]` and 2G-R-B > `excess_min[1]`); it is a *saturated core* when R, G and B all reach
/// `saturation_min`: the centre of a bright spot, where 2G-R-B falls to zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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

/// Pixels of a block.
const BLOCK: usize = 64;

/// Widest image, px.
pub(crate) const MAX_WIDTH: usize = 2048;

/// The background of every block of a row: the mean of the block in the last sampled row above, zero before the first.
/// Between the middles of two blocks it is interpolated.
pub(crate) type RowBackground = [Background; MAX_WIDTH / BLOCK];

/// Light that is there without a laser.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Background {
    /// G, grey levels.
    green: u16,
    /// R + B, grey levels.
    red_blue: u16,
}

impl Background {
    /// Linear interpolation: `step` of [`BLOCK`] steps from this background to another one.
    fn towards(&self, other: &Self, step: usize) -> Self {
        let mix = |from: u16, to: u16| {
            let step = step as u32;
            ((u32::from(from) * (BLOCK as u32 - step) + u32::from(to) * step) / BLOCK as u32) as u16
        };
        Self { green: mix(self.green, other.green), red_blue: mix(self.red_blue, other.red_blue) }
    }

    /// The background's own 2G-R-B where it is greenish, else 0.
    fn excess(&self) -> i16 {
        (2 * self.green as i16 - self.red_blue as i16).max(0)
    }
}

impl Thresholds {
    fn lowest_excess(&self) -> u16 {
        self.excess_min[0].min(self.excess_min[1])
    }

    /// Classifies one pixel.
    fn classify(&self, [r, g, b]: [u8; 3], background: &Background) -> Option<Hit> {
        let red_blue = u16::from(r) + u16::from(b);
        // Where G clips, 2G-R-B is too low already: with the background taken off as well, a ring would be missing
        // between the green rim and the white core of a spot
        let full_scale = g >= self.clip_min;
        let excess = 2 * i16::from(g) - red_blue as i16 - if full_scale { 0 } else { background.excess() };
        let passes = |i: usize| g > self.green_min[i] && excess > self.excess_min[i] as i16;
        let green = passes(0) || passes(1);
        let core = r.min(g).min(b) >= self.saturation_min;
        if !green && !core {
            return None;
        }
        let clipped = core || full_scale;
        let weight = if clipped {
            // R and B still tell how bright the spot is. The brighter the background, the earlier G clips.
            let full = u32::from(self.clipped_weight.clamp(1, MAX_CLIPPED_WEIGHT));
            let lost = ((full + u32::from(self.lowest_excess())) * u32::from(background.green)) >> 8;
            full.saturating_sub(lost).max(1) as u16 + red_blue.saturating_sub(background.red_blue)
        } else {
            // A green pixel is above the lowest threshold: the difference is at least 1
            excess as u16 - self.lowest_excess()
        };
        Some(Hit { green, clipped, weight })
    }

    /// Calls `found` with the column and class of every hit of a row of RGB pixels, from left to right. If `sample`, the
    /// row then becomes the background of the next ones. A row shorter than `width` is scanned as far as it goes; of a
    /// longer one, what is beyond `width` is ignored.
    ///
    /// Hits count little in the background: a spot must not raise the threshold for its own lower half. They count at
    /// all so that light which is no spot becomes background after some rows. An incomplete last block of `width` has
    /// none.
    pub(crate) fn scan_row(
        &self,
        rgb: &[u8],
        width: usize,
        backgrounds: &mut RowBackground,
        sample: bool,
        mut found: impl FnMut(u16, Hit),
    ) {
        // 2G-R-B > T implies G - ceil((R+B)/2) >= T/2, which needs bytes only: the compiler makes vector code of it. The
        // background only ever raises the threshold.
        let half_excess = self.lowest_excess().div_ceil(2).min(255) as u8;
        let whole_blocks = width / BLOCK;
        let (blocks, rest) = rgb[..rgb.len().min(3 * width)].as_chunks::<{ 3 * BLOCK }>();
        let mut left = backgrounds[0];
        for (index, block) in blocks.iter().enumerate().take(backgrounds.len()) {
            let around = Around::new(left, backgrounds, index, whole_blocks);
            let mut sums = if sample { Sums::new(block) } else { Sums::default() };
            if may_hold_hits(block, half_excess, self.saturation_min) {
                for (i, pixel) in block.as_chunks().0.iter().enumerate() {
                    let background = around.at(i);
                    if let Some(hit) = self.classify(*pixel, &background) {
                        found((index * BLOCK + i) as u16, hit);
                        sums.replace(*pixel, &background);
                    }
                }
            }
            if sample && let Some(background) = backgrounds.get_mut(index) {
                *background = sums.mean();
            }
            left = around.above;
        }
        let around = if blocks.len() < whole_blocks {
            Around::new(left, backgrounds, blocks.len(), whole_blocks)
        } else {
            Around::default()
        };
        for (i, pixel) in rest.as_chunks().0.iter().enumerate() {
            if let Some(hit) = self.classify(*pixel, &around.at(i)) {
                found((blocks.len() * BLOCK + i) as u16, hit);
            }
        }
    }
}

/// The background of a block and of its neighbours, as the last sampled row above left it.
#[derive(Default)]
struct Around {
    left: Background,
    above: Background,
    right: Background,
}

impl Around {
    /// `left` is that of block `index - 1`: a row that is sampled has already replaced it.
    fn new(left: Background, backgrounds: &RowBackground, index: usize, whole_blocks: usize) -> Self {
        let above = backgrounds.get(index).copied().unwrap_or_default();
        let right = backgrounds.get(index + 1).filter(|_| index + 1 < whole_blocks);
        Self { left, above, right: right.copied().unwrap_or(above) }
    }

    /// The background of pixel `i` of the block, interpolated between the middles of two blocks.
    fn at(&self, i: usize) -> Background {
        if i < BLOCK / 2 {
            self.left.towards(&self.above, i + BLOCK / 2)
        } else {
            self.above.towards(&self.right, i - BLOCK / 2)
        }
    }
}

/// Sums over the pixels of a block.
#[derive(Default)]
struct Sums {
    green: u32,
    red_blue: u32,
}

impl Sums {
    #[inline]
    fn new(block: &[u8; 3 * BLOCK]) -> Self {
        // Column sums over a whole number of pixels and of vector registers: bytes become vector additions
        const COLUMNS: usize = 48;
        let mut columns = [0_u16; COLUMNS];
        for part in block.as_chunks::<COLUMNS>().0 {
            for (sum, byte) in columns.iter_mut().zip(part) {
                *sum += u16::from(*byte);
            }
        }
        const IS_GREEN: [u16; COLUMNS] = {
            let mut mask = [0; COLUMNS];
            let mut i = 1;
            while i < COLUMNS {
                mask[i] = 0xffff;
                i += 3;
            }
            mask
        };
        let (mut all, mut green) = (0, 0);
        for (sum, mask) in columns.iter().zip(IS_GREEN) {
            all += u32::from(*sum);
            green += u32::from(sum & mask);
        }
        Self { green, red_blue: all - green }
    }

    /// Counts a pixel by a sixteenth, and the background for the rest of it.
    fn replace(&mut self, [r, g, b]: [u8; 3], background: &Background) {
        let dim = |sum: u32, value: u16, background: u16| {
            let share = (u32::from(value) + 15 * u32::from(background)) >> 4;
            sum.wrapping_sub(value.into()).wrapping_add(share)
        };
        self.green = dim(self.green, g.into(), background.green);
        self.red_blue = dim(self.red_blue, u16::from(r) + u16::from(b), background.red_blue);
    }

    fn mean(&self) -> Background {
        let mean = |sum: u32| (sum / BLOCK as u32) as u16;
        Background { green: mean(self.green), red_blue: mean(self.red_blue) }
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
    // Either class needs a bright byte, and most blocks of a dark scene have none
    let brightest = block.iter().fold(0, |brightest: u8, &byte| brightest.max(byte));
    if brightest < half_excess.min(saturation_min) {
        return false;
    }
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
        next_row(thresholds, row, &mut RowBackground::default())
    }

    fn next_row(thresholds: &Thresholds, row: &[u8], backgrounds: &mut RowBackground) -> Vec<(u16, Hit)> {
        let mut hits = Vec::new();
        thresholds.scan_row(row, row.len() / 3, backgrounds, true, |column, hit| hits.push((column, hit)));
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
            let hit = thresholds.classify([r, g, b], &Background::default());
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
            let weight = thresholds
                .classify([channel(15), channel(100), channel(25)], &Background::default())
                .map_or(0, |hit| hit.weight);
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
            let expected: Vec<_> = thresholds
                .classify([r, g, b], &Background::default())
                .map(|hit| (column as u16, hit))
                .into_iter()
                .collect();
            assert_eq!(hits(&thresholds, &row), expected, "{r} {g} {b} in column {column}");
        }
    }

    #[test]
    fn an_even_green_background_stops_to_hit_and_does_not_hide_a_spot() {
        // Lit rock far away in the water: 2G-R-B is 90
        let mut row: Vec<u8> = [40, 90, 50].repeat(2 * BLOCK);
        let (thresholds, mut backgrounds) = (Thresholds::default(), RowBackground::default());
        assert_eq!(next_row(&thresholds, &row, &mut backgrounds).len(), 2 * BLOCK);
        let rows = (1..64).find(|_| next_row(&thresholds, &row, &mut backgrounds).is_empty());
        assert!(rows.is_some_and(|rows| rows <= 8), "{rows:?}");
        next_row(&thresholds, &row, &mut backgrounds);
        let column = BLOCK + 20;
        row[3 * column..3 * column + 3].copy_from_slice(&[50, 160, 70]);
        // 2G-R-B is 200, 110 above the background: 40 above the threshold
        let spot = (column as u16, Hit { green: true, clipped: false, weight: 40 });
        assert_eq!(next_row(&thresholds, &row, &mut backgrounds), [spot]);
    }

    #[test]
    fn a_spot_of_eight_pixels_raises_its_own_threshold_by_at_most_four_grey_levels() {
        let mut row = [0; 3 * BLOCK];
        for pixel in row[3 * 30..3 * 38].as_chunks_mut().0 {
            *pixel = [40, 255, 70];
        }
        let (thresholds, mut backgrounds) = (Thresholds::default(), RowBackground::default());
        for _ in 0..8 {
            next_row(&thresholds, &row, &mut backgrounds);
        }
        assert!(backgrounds[0].excess() <= 4, "{}", backgrounds[0].excess());
    }

    proptest! {
        #[test]
        fn a_row_of_a_wrong_length_gives_the_hits_of_its_pixels_within_the_width(
            above in prop::collection::vec(any::<u8>(), 3 * 300),
            row in prop::collection::vec(any::<u8>(), 3 * 300),
            length in 0..400_usize,
        ) {
            let thresholds = Thresholds::default();
            let mut backgrounds = RowBackground::default();
            next_row(&thresholds, &above, &mut backgrounds);
            let scan = |row: &[u8]| {
                let mut hits = Vec::new();
                thresholds.scan_row(row, 300, &mut backgrounds.clone(), false, |column, hit| hits.push((column, hit)));
                hits
            };
            let mut whole = scan(&row);
            whole.retain(|&(column, _)| usize::from(column) < length);
            let mut damaged = row.clone();
            damaged.resize(3 * length, 255);
            prop_assert_eq!(scan(&damaged), whole);
        }

        #[test]
        fn a_row_gives_exactly_the_hits_of_its_pixels(
            row in prop::collection::vec(any::<u8>(), 0..3 * 300),
            excess_min in prop::array::uniform2(0_u16..=510),
            green_min: [u8; 2],
            saturation_min: u8,
        ) {
            let thresholds = Thresholds { green_min, excess_min, saturation_min, ..Thresholds::default() };
            // The same, pixel by pixel, for two rows
            let mut backgrounds = RowBackground::default();
            for _ in 0..2 {
                let mut expected = Vec::new();
                let mut next = RowBackground::default();
                let blocks = row.len() / (3 * BLOCK);
                // The middle of block j is at pixel 64 j + 32; before the first and after the last middle nothing changes
                let at = |x: usize, of: fn(&Background) -> u16| {
                    let (j, step) = ((x + 32) / 64, (x + 32) % 64);
                    let value = |j: usize| usize::from(of(&backgrounds[j.clamp(1, blocks) - 1]));
                    ((value(j) * (64 - step) + value(j + 1) * step) / 64) as u16
                };
                for (block, pixels) in row.chunks(3 * BLOCK).enumerate() {
                    let (mut green, mut red_blue) = (0, 0);
                    for (i, p) in pixels.chunks_exact(3).enumerate() {
                        let x = block * BLOCK + i;
                        let old = if block < blocks {
                            Background { green: at(x, |b| b.green), red_blue: at(x, |b| b.red_blue) }
                        } else {
                            Background::default()
                        };
                        let (g, rb) = (u16::from(p[1]), u16::from(p[0]) + u16::from(p[2]));
                        if let Some(hit) = thresholds.classify([p[0], p[1], p[2]], &old) {
                            expected.push((x as u16, hit));
                            green += (g + 15 * old.green) / 16;
                            red_blue += (rb + 15 * old.red_blue) / 16;
                        } else {
                            green += g;
                            red_blue += rb;
                        }
                    }
                    if block < blocks {
                        next[block] = Background { green: green / 64, red_blue: red_blue / 64 };
                    }
                }
                prop_assert_eq!(next_row(&thresholds, &row, &mut backgrounds), expected);
                prop_assert_eq!(backgrounds, next);
            }
        }
    }
}
