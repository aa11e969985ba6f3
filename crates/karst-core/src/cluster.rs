//! Clusters of hits within one sector, split by a gap.

use karst_math::sqrt_round;

use crate::segment::Hit;

/// Smallest box around a cluster, px, ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Bounds {
    /// Leftmost column.
    pub x_min: u16,
    /// Rightmost column.
    pub x_max: u16,
    /// Topmost row.
    pub y_min: u16,
    /// Bottom row.
    pub y_max: u16,
}

/// Exact integer sums over the pixels of one candidate spot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Cluster {
    /// Number of pixels, cores included.
    pub pixels: u32,
    /// Green pixels among them.
    pub green: u32,
    /// Clipped and core pixels among them.
    pub saturated: u32,
    /// Sum of the weights w.
    pub weight: u32,
    /// Sum of w x, x in px.
    pub weight_x: u64,
    /// Sum of w y, y in px.
    pub weight_y: u64,
    /// Smallest box.
    pub bounds: Bounds,
    /// Square of the largest distance from the image centre, (1/16 px)^2.
    pub radius_squared: u32,
}

impl Cluster {
    pub(crate) fn new(x: u16, y: u16, radius_squared: u32, hit: Hit) -> Self {
        let weight = u32::from(hit.weight);
        Self {
            pixels: 1,
            green: hit.green.into(),
            saturated: hit.clipped.into(),
            weight,
            weight_x: u64::from(weight) * u64::from(x),
            weight_y: u64::from(weight) * u64::from(y),
            bounds: Bounds { x_min: x, x_max: x, y_min: y, y_max: y },
            radius_squared,
        }
    }

    /// Largest distance from the image centre, 1/16 px, rounded.
    pub fn r_max(&self) -> u16 {
        // A distance in an image fits
        sqrt_round(self.radius_squared.into()) as u16
    }

    /// The union of two clusters.
    pub(crate) fn merge(&self, other: &Self) -> Self {
        Self {
            pixels: self.pixels + other.pixels,
            green: self.green + other.green,
            saturated: self.saturated + other.saturated,
            weight: self.weight + other.weight,
            weight_x: self.weight_x + other.weight_x,
            weight_y: self.weight_y + other.weight_y,
            bounds: Bounds {
                x_min: self.bounds.x_min.min(other.bounds.x_min),
                x_max: self.bounds.x_max.max(other.bounds.x_max),
                y_min: self.bounds.y_min.min(other.bounds.y_min),
                y_max: self.bounds.y_max.max(other.bounds.y_max),
            },
            radius_squared: self.radius_squared.max(other.radius_squared),
        }
    }

    /// Whether the boxes are at most `gap` px away from each other, in x and in y.
    fn is_near(&self, other: &Bounds, gap: u16) -> bool {
        let near =
            |low: u16, high: u16, min: u16, max: u16| high.saturating_add(gap) >= min && low <= max.saturating_add(gap);
        near(other.x_min, other.x_max, self.bounds.x_min, self.bounds.x_max)
            && near(other.y_min, other.y_max, self.bounds.y_min, self.bounds.y_max)
    }
}

/// The candidates of one sector: up to `K` clusters.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidates<const K: usize> {
    slots: [Option<Cluster>; K],
}

impl<const K: usize> Candidates<K> {
    pub const EMPTY: Self = Self { slots: [None; K] };

    /// Adds a run of hits; gives the number of hits that had to be dropped for it.
    ///
    /// A run joins every cluster whose box is within the gap, and so makes them one, in the first slot that is free
    /// then. With all slots taken, the cluster of the fewest pixels (the first of those) makes room: specks of noise go
    /// before a spot does.
    pub fn add(&mut self, run: &Cluster, gap: u16) -> u32 {
        let mut cluster = *run;
        for slot in &mut self.slots {
            if let Some(near) = slot.filter(|c| c.is_near(&run.bounds, gap)) {
                cluster = near.merge(&cluster);
                *slot = None;
            }
        }
        // A free slot is one of no pixels
        match self.slots.iter_mut().min_by_key(|slot| slot.map_or(0, |c| c.pixels)) {
            Some(slot) => slot.replace(cluster).map_or(0, |lost| lost.pixels),
            None => run.pixels,
        }
    }

    pub fn iter(&self) -> impl Iterator<Item = &Cluster> {
        self.slots.iter().flatten()
    }
}
