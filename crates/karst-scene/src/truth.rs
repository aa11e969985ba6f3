//! What the renderer knows and the instrument has to find out.

use karst_rig::{Board, Pose};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Truth of one stereo pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameTruth {
    /// Seed the pair was rendered with.
    pub seed: u64,
    /// Where the instrument was: from the rig frame to the frame of the shape.
    pub instrument: Pose,
    /// One entry per laser, in the order of the rig; none with the lasers off.
    pub lasers: Vec<LaserTruth>,
    /// The calibration board, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<BoardTruth>,
}

/// Truth of the calibration board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardTruth {
    /// Squares and corners.
    pub board: Board,
    /// From the board's frame to the rig frame.
    pub pose: Pose,
    /// For each camera, one entry per inner corner in the board's order. None: outside the mirror's image.
    pub corners: [Vec<Option<CornerTruth>>; 2],
}

/// One inner corner in one image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CornerTruth {
    /// Image of the corner, traced through tube and water where there are any, px.
    pub position_px: [f64; 2],
    /// Whether the corner can be seen: at least [`FIELD_MARGIN_PX`](crate::FIELD_MARGIN_PX) inside the ring between the
    /// rig's inner and mirror radius, from the board's front, with no wall in between. Nothing is said about the size of
    /// the squares in the image.
    pub visible: bool,
}

impl FrameTruth {
    /// Describes what is in the rig frame in another frame, with the transform to that one. The pose of the instrument
    /// and the images stay.
    pub fn transform(&mut self, to: &Isometry3<f64>) {
        if let Some(board) = &mut self.board {
            board.pose = (to * board.pose.isometry()).into();
        }
        for laser in &mut self.lasers {
            laser.origin_mm = (to * Point3::from(laser.origin_mm)).coords.into();
            laser.direction = (to * Vector3::from(laser.direction)).into();
            if let Some(target) = &mut laser.target {
                target.point_mm = (to * Point3::from(target.point_mm)).coords.into();
                target.range_mm = target.point_mm[0].hypot(target.point_mm[1]);
            }
        }
    }
}

/// Truth of one laser.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserTruth {
    /// Index of the laser in the rig.
    pub laser: usize,
    /// A point of the actual beam, laser errors included, rig frame, mm.
    pub origin_mm: [f64; 3],
    /// Unit direction of the actual beam, rig frame.
    pub direction: [f64; 3],
    /// Where the axis of the actual beam meets the wall. None: nowhere.
    pub target: Option<TargetTruth>,
    /// The spot in each camera. None: outside the mirror's image, or no target.
    pub spots: [Option<SpotTruth>; 2],
}

/// Where a beam meets the wall.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetTruth {
    /// Point, rig frame, mm.
    pub point_mm: [f64; 3],
    /// Its distance from the rig's z axis, mm.
    pub range_mm: f64,
}

/// One spot in one image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpotTruth {
    /// Image of the target point, traced through tube and water, px.
    pub position_px: [f64; 2],
    /// Noise-free peak of G above the background, before clipping and before the response curve, DN.
    pub peak_dn: f64,
    /// Whether G clips at 255 DN somewhere in the spot.
    pub saturated: bool,
    /// Pixels that are green without noise: 2G-R-B of the clipped channels above the first `excess_min` of the rig's
    /// detector plus [`VISIBLE_SIGMAS`](crate::VISIBLE_SIGMAS) standard deviations of the noise there.
    pub green_pixels: u32,
    /// Whether a detector has to find the spot: the target is at least [`FIELD_MARGIN_PX`](crate::FIELD_MARGIN_PX)
    /// inside the ring between the rig's inner and mirror radius, its wall faces the camera and is not hidden, and
    /// `green_pixels` is at least the rig's `min_pixels`.
    pub visible: bool,
}
