//! What the detector model sees of a picture: where hits are, and whose. `karst-core` says so.

use karst_core::{ConfigError, DetectorConfig, SpotDetector};

/// Most pixels per clock.
pub(crate) const MOST_LANES: usize = 8;

/// A pixel that passed the colour test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Hit {
    pub x: u16,
    pub laser: u16,
    pub green: bool,
    pub accepted: bool,
}

/// A row of pixels as it comes over the stream.
#[derive(Debug, Clone, Copy)]
pub struct Pixels<'a> {
    /// R, G, B of each pixel: a multiple of the pixels per clock.
    pub rgb: &'a [u8],
    /// tuser on its first beat.
    pub start: bool,
    /// tlast on its last beat.
    pub last: bool,
}

/// The same for the model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    pixels: u32,
    start: bool,
    last: bool,
    hits: Vec<Hit>,
}

/// Rows of any number of frames, as the detector with this configuration sees them. A row without a last beat has to be
/// followed by a start.
pub fn rows_of<'a, const LASERS: usize>(
    config: &DetectorConfig<LASERS>,
    pixels: impl IntoIterator<Item = Pixels<'a>>,
) -> Result<Vec<Row>, ConfigError> {
    let mut detector = Box::new(SpotDetector::<LASERS, 1>::new(config.clone())?);
    let row = |pixels: Pixels| {
        if pixels.start {
            detector.start_frame();
        }
        let mut hits = Vec::new();
        // Rows of a wrong length count as far as they go, and rows outside a frame have no hits: as in the gateware
        let _ = detector.row_observed(pixels.rgb, |hit| {
            hits.push(Hit { x: hit.x, laser: hit.laser, green: hit.green, accepted: hit.accepted });
        });
        let Pixels { rgb, start, last } = pixels;
        Row { pixels: rgb.len() as u32 / 3, start, last, hits }
    };
    Ok(pixels.into_iter().map(row).collect())
}

/// What the camera offers in a clock: some pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Beat {
    /// tuser.
    pub start: bool,
    /// tlast.
    pub last: bool,
    pub(crate) hits: Lanes,
}

/// The hits of a beat, from left to right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Lanes {
    hits: [Hit; MOST_LANES],
    count: u8,
}

impl Lanes {
    pub fn as_slice(&self) -> &[Hit] {
        &self.hits[..usize::from(self.count)]
    }

    fn push(&mut self, hit: Hit) {
        self.hits[usize::from(self.count)] = hit;
        self.count += 1;
    }
}

impl Row {
    /// Its beats, from left to right.
    pub fn beats(&self, pixels_per_clock: u32) -> impl Iterator<Item = Beat> {
        let count = self.pixels / pixels_per_clock;
        let mut hits = self.hits.iter().copied().peekable();
        (1..=count).map(move |beat| {
            let mut lanes = Lanes::default();
            while let Some(hit) = hits.next_if(|hit| u32::from(hit.x) < beat * pixels_per_clock) {
                lanes.push(hit);
            }
            Beat { start: self.start && beat == 1, last: self.last && beat == count, hits: lanes }
        })
    }
}
