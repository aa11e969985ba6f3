//! What the commands report: one [`Section`] per stereo frame, serialised as it stands for `--json`.

use serde::{Deserialize, Serialize};

/// The result of one stereo frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// Name of the frame: the file stem of its first image, or the scene's name.
    pub frame: String,
    /// `weighted` or `paper`.
    pub method: String,
    /// `fixed` or `f64`.
    pub arithmetic: String,
    /// One entry per laser of the rig, in order.
    pub lasers: Vec<LaserResult>,
    /// Detector counters of the two cameras.
    pub detector: [DetectorCounters; 2],
    /// Time spent, if measured.
    pub timing: Option<Timing>,
}

/// The result of one laser: a point, or the reason why there is none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LaserResult {
    /// Laser index, from 0.
    pub laser: usize,
    /// `point`, or the reason for no point in words.
    pub status: String,
    /// The point.
    pub point: Option<PointResult>,
    /// The spots of the two cameras that the point was made from; without a point, the farthest spot found.
    pub spots: [Option<SpotResult>; 2],
    /// What is really there, if known.
    pub truth: Option<TruthResult>,
}

/// A reconstructed point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PointResult {
    /// Rig frame, mm.
    pub position_mm: [f64; 3],
    /// Distance from the rig axis, mm.
    pub range_mm: f64,
    /// Standard deviation along the beam, mm (none for the paper's method).
    pub sigma_mm: Option<f64>,
    /// Chi squared with three degrees of freedom (none for the paper's method).
    pub chi2: Option<f64>,
    /// Range of the single estimates (camera 1 + laser, camera 2 + laser, stereo), mm along the beam.
    pub estimates_mm: [Option<f64>; 3],
}

/// A detected spot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpotResult {
    /// Position, px.
    pub pixel: [f64; 2],
    /// Standard uncertainty per axis, px.
    pub sigma_px: f64,
    /// Number of pixels.
    pub pixels: u32,
    /// Saturated pixels among them.
    pub saturated: u32,
    /// Smallest box around the spot: x min, y min, x max, y max, px.
    pub bounds: [u16; 4],
}

/// Truth of one laser.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthResult {
    /// Where the beam axis meets the wall, rig frame, mm; none when it meets nothing.
    pub position_mm: Option<[f64; 3]>,
    /// Its range, mm.
    pub range_mm: Option<f64>,
    /// Image of that point in the two cameras, px.
    pub pixels: [Option<[f64; 2]>; 2],
    /// Whether the spot is visible in each camera.
    pub visible: [bool; 2],
}

/// Detector counters of one image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DetectorCounters {
    /// Pixels that passed the colour test.
    pub hits: u32,
    /// Hits outside the mirror or outside every sector.
    pub outside: u32,
    /// Hits that found no free candidate.
    pub overflow: u32,
    /// Candidates kept, if they are known: a sensor sends them only on demand.
    pub spots: Option<u32>,
}

/// Wall-clock times of one frame, milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Detection in both images.
    pub detect_ms: f64,
    /// Reconstruction.
    pub reconstruct_ms: f64,
}
