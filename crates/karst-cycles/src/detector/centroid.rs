//! `centroid.vhd`.

use super::Early;
use crate::timing::centroid::latency;

/// The words of a cluster or of the frame: their last one is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Words {
    Of(Early),
    Frame,
}

#[derive(Debug)]
pub struct Centroid {
    latency: u64,
    /// The spot under way, and the clocks that are left to its record.
    spot: Option<(Early, u64)>,
    is_frame: bool,
}

impl Centroid {
    pub fn new(x_bits: u32) -> Self {
        Self { latency: latency(x_bits), spot: None, is_frame: false }
    }

    /// `ready`.
    pub fn is_ready(&self) -> bool {
        self.spot.is_none()
    }

    /// `spot_valid`.
    pub fn early(&self) -> Option<Early> {
        self.spot.filter(|&(_, left)| left == 0).map(|(spot, _)| spot)
    }

    /// `frame_valid`.
    pub fn is_frame(&self) -> bool {
        self.is_frame
    }

    pub fn clock(&mut self, words: Option<Words>) {
        self.is_frame = words == Some(Words::Frame);
        self.spot = match words {
            Some(Words::Of(spot)) => Some((spot, self.latency - 1)),
            _ => self.spot.filter(|&(_, left)| left > 0).map(|(spot, left)| (spot, left - 1)),
        };
    }
}
