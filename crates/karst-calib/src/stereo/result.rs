//! What a calibration of two cameras starts from and what it gives.

use std::fmt;

use karst_rig::{Board, Medium, Pose, Tube};
use nalgebra::{DMatrix, Isometry3, Matrix6};
use serde::Serialize;

use crate::{CalibratedCamera, CameraError, CameraSettings, CornerList, Warning};

/// Pictures of boards by both cameras. Pictures with the same name, but for the extension, show the same board in the same
/// place; pictures by one camera only serve that camera.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardSet {
    /// Name before those of its views in messages and results; may be empty.
    pub name: String,
    /// What the boards were in.
    pub medium: Medium,
    /// Corners by camera 1 and camera 2. One index is one corner of the board for both.
    pub corners: [CornerList; 2],
}

/// What is known of a quantity beside its nominal value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known {
    /// The nominal value holds.
    Exactly,
    /// The nominal value is a measurement with this standard deviation, such as half the tolerance in a data sheet.
    Within(f64),
    /// Nothing: the corners have to tell it.
    NotAtAll,
}

/// What is known of tube and water, each in the unit of its name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TubeKnowledge {
    /// Position of the tube across its axis.
    pub offset_mm: Known,
    /// Direction of the tube's axis.
    pub tilt_mrad: Known,
    /// Inner radius.
    pub inner_radius_mm: Known,
    /// Wall thickness.
    pub wall_mm: Known,
    /// Refractive index of the wall.
    pub wall_index: Known,
    /// Refractive index of the water.
    pub water_index: Known,
}

impl Default for TubeKnowledge {
    /// Unknown pose; dimensions and indices as the data sheet says.
    fn default() -> Self {
        Self {
            offset_mm: Known::NotAtAll,
            tilt_mrad: Known::NotAtAll,
            inner_radius_mm: Known::Exactly,
            wall_mm: Known::Exactly,
            wall_index: Known::Exactly,
            water_index: Known::Exactly,
        }
    }
}

/// Tube and water in front of boards in water.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TubeSettings {
    /// The tube as designed, in the rig frame.
    pub tube: Tube,
    /// Refractive index of the water; `Water::index` has it.
    pub water_index: f64,
    /// How well that is known.
    pub known: TubeKnowledge,
}

/// What is known before, and what is to be found.
#[derive(Debug, Clone, PartialEq)]
pub struct StereoSettings {
    /// The cameras. Without a degree, where a camera was not seen in air: the lowest of 4 to 6 that predicts boards held out
    /// of the joint fit as well as any.
    pub cameras: [CameraSettings; 2],
    /// The board. Where it cannot be told from itself turned by 180 degrees (even sum of columns and rows), views of
    /// camera 2 that were numbered from the other end are found and turned. None: they are rejected.
    pub board: Option<Board>,
    /// Pose of camera 1 in the rig frame. Corners do not tell it; everything else follows in the same frame.
    pub first_pose: Pose,
    /// Tube and water; needed where a set of boards was in water.
    pub tube: Option<TubeSettings>,
}

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StereoError {
    /// A setting is out of range or missing.
    #[error("{what} is {found}, expected {expected}")]
    Setting {
        /// The setting.
        what: &'static str,
        /// Its value.
        found: String,
        /// What is possible.
        expected: &'static str,
    },
    /// One of the cameras cannot be calibrated.
    #[error("camera {camera}: {source}")]
    Camera {
        /// 1 or 2.
        camera: usize,
        /// Why not.
        source: CameraError,
    },
    /// Two pictures of a camera have the same name.
    #[error("camera {camera}: two pictures are called {name}, expected one: pictures are paired by name")]
    SameName {
        /// 1 or 2.
        camera: usize,
        /// The name without extension.
        name: String,
    },
    /// Fewer pairs than determine and confirm a pose.
    #[error("{found} usable pairs of pictures with the same name, expected at least {expected}{}", reasons(rejected))]
    TooFewPairs {
        /// Pairs that can be used.
        found: usize,
        /// Pairs needed.
        expected: usize,
        /// The others.
        rejected: Vec<RejectedPair>,
    },
    /// The numbers of corners in the two lists have nothing in common.
    #[error("no pair of pictures has a corner with the same index: are the lists of the same board?")]
    NoCommonCorner,
    /// The lists do not agree about the board.
    #[error(
        "{pair}, corner {index}: at ({}, {}) mm on the board for camera 1, ({}, {}) mm for camera 2; the board of camera 2 \
         is {ratio:.4} times as large: other units or another board?", first_mm[0], first_mm[1], second_mm[0], second_mm[1]
    )]
    BoardsDiffer {
        /// Name of the pair.
        pair: String,
        /// Number of the corner.
        index: usize,
        /// Where it is by the list of camera 1, mm.
        first_mm: [f64; 2],
        /// Where it is by the list of camera 2, mm.
        second_mm: [f64; 2],
        /// Size of the board for camera 2 by that for camera 1.
        ratio: f64,
    },
    /// A corner is not where the board in the settings has it.
    #[error("{view}, corner {index}: at ({}, {}) mm, expected ({}, {}) mm on the board given", found_mm[0], found_mm[1], expected_mm[0], expected_mm[1])]
    NotTheBoard {
        /// Name of the view.
        view: String,
        /// Number of the corner.
        index: usize,
        /// Where it is by the list, mm.
        found_mm: [f64; 2],
        /// Where the board has it, mm; NaN if it has no such corner.
        expected_mm: [f64; 2],
    },
    /// All boards of one camera are mirrored, those of the other are not.
    #[error("camera {camera}: every board appears mirrored, but not for the other camera: mirrored corner order?")]
    MirroredOrder {
        /// 1 or 2.
        camera: usize,
    },
    /// The pairs do not tell one relative pose.
    #[error(
        "{agree} of {pairs} pairs agree on the pose of camera 2 against camera 1, expected most of them: wrong pairing of \
         the pictures, or another corner order?{}",
        reasons(rejected)
    )]
    PairsDisagree {
        /// Most pairs that agree on a pose.
        agree: usize,
        /// All pairs.
        pairs: usize,
        /// The pairs that do not agree.
        rejected: Vec<RejectedPair>,
    },
    /// A quantity does not follow from these boards.
    #[error(
        "{quantity} cannot be observed: place the board at other distances, angles and radii, or give what is known"
    )]
    Unobservable {
        /// The quantity that has most part in what is unknown.
        quantity: String,
    },
}

fn reasons(rejected: &[RejectedPair]) -> String {
    rejected.iter().map(|pair| format!("\n  {pair}")).collect()
}

/// Why a pair of pictures does not count as one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum PairReason {
    /// Camera 1 or 2 has rejected its view.
    #[error("the view of camera {0} was rejected")]
    View(usize),
    /// The board is not where the other pairs say it is for the second camera.
    #[error("the views disagree: not the same board position, or another corner order")]
    Disagree,
}

/// A pair of pictures that does not count as one. Views that fit their own camera still serve that.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RejectedPair {
    /// Name of the pair.
    pub pair: String,
    /// Why.
    pub reason: PairReason,
    /// Median distance of the corners from where the other camera says they are, px.
    pub residual_px: Option<f64>,
}

impl fmt::Display for RejectedPair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.pair, self.reason)?;
        match self.residual_px {
            Some(residual) => write!(f, " (median residual {residual:.2} px)"),
            None => Ok(()),
        }
    }
}

/// A pair of pictures that was used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// Name of the pair.
    pub pair: String,
    /// RMS residual of the corners in either picture, px.
    pub rms_px: [f64; 2],
    /// Whether the view of camera 2 was numbered from the other end of the board.
    pub turned: bool,
}

/// What is allowed but probably not meant, or makes the result weak.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StereoWarning {
    /// About one camera.
    #[error("camera {camera}: {warning}")]
    Camera {
        /// 1 or 2.
        camera: usize,
        /// The warning.
        warning: Warning,
    },
    /// Few pairs.
    #[error("{pairs} pairs only, expected at least {expected}: wrong ones among them may stay unnoticed")]
    FewPairs {
        /// Pairs used.
        pairs: usize,
        /// What a good calibration has.
        expected: usize,
    },
    /// Many pairs do not fit.
    #[error("{rejected} of {pairs} pairs were rejected: wrong pairing, or a board that moved between the pictures?")]
    ManyRejected {
        /// Pairs rejected.
        rejected: usize,
        /// All pairs.
        pairs: usize,
    },
    /// The cameras are too close together for millimetres.
    #[error("the baseline is {baseline_mm:.3} mm: are the board's coordinates in metres?")]
    SmallBaseline {
        /// Distance of the viewpoints, mm.
        baseline_mm: f64,
    },
    /// A quantity is poorly determined.
    #[error("{quantity} is known to {sigma:.4} {unit} only (standard deviation), expected {limit:.4} {unit}")]
    Uncertain {
        /// The quantity.
        quantity: &'static str,
        /// Its standard deviation.
        sigma: f64,
        /// What a usable calibration has.
        limit: f64,
        /// Unit of both.
        unit: &'static str,
    },
    /// A quantity is far from what was said of it.
    #[error("{quantity} is {change:.4} {unit} off the value given, which is said to hold within {sigma} {unit}")]
    Implausible {
        /// The quantity.
        quantity: &'static str,
        /// Value found less value given.
        change: f64,
        /// Standard deviation given.
        sigma: f64,
        /// Unit of both.
        unit: &'static str,
    },
}

/// Standard deviation of one unknown.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// `camera1.polynomial[0]` and so on: the field of the rig file. `turn` is a rotation about the rig's axes, or the
    /// tube's; `shear` is d = e.
    pub name: String,
    /// Unit of the standard deviation; empty for a ratio.
    pub unit: &'static str,
    /// Standard deviation.
    pub sigma: f64,
}

/// Where a corner is against where the calibrated instrument sees it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CornerResidual {
    /// Name of the view.
    pub view: String,
    /// 1 or 2.
    pub camera: usize,
    /// Number of the corner.
    pub index: usize,
    /// Where it was found, px.
    pub pixel: [f64; 2],
    /// Found less expected, px. None: the camera does not see it at all.
    pub residual_px: Option<[f64; 2]>,
    /// Whether it is no outlier.
    pub inlier: bool,
}

/// Two calibrated cameras, the tube around them where there is one, and how good all that is. Residuals are lengths in the
/// picture (2-D), RMS over corners.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedStereo {
    /// The cameras in air, each with the pose in the rig frame; hold-out RMS is that of both.
    pub cameras: [CalibratedCamera; 2],
    /// Frame of camera 2 to frame of camera 1, mm.
    pub relative: Isometry3<f64>,
    /// Covariance of `relative`: rotation vector (rad), then position (mm), both along the axes of camera 1.
    pub relative_covariance: Matrix6<f64>,
    /// Distance of the viewpoints, mm.
    pub baseline_mm: f64,
    /// Its standard deviation, mm.
    pub baseline_sigma_mm: f64,
    /// Rotation of `relative`, degrees: about x, then y, then z of camera 1, as `Pose` has it.
    pub rotation_deg: [f64; 3],
    /// Tube and refractive index of the water, where boards were in water. The tube's position along its axis is the one
    /// given, and so is its rotation about it: nothing depends on these.
    pub tube: Option<(Tube, f64)>,
    /// All unknowns but the poses of the boards.
    pub parameters: Vec<Parameter>,
    /// Their covariance, in their units.
    pub covariance: DMatrix<f64>,
    /// The pairs used.
    pub pairs: Vec<Pair>,
    /// The pairs not used as such.
    pub rejected_pairs: Vec<RejectedPair>,
    /// Views without a partner, used for their camera only: camera (1 or 2) and name.
    pub single_views: Vec<(usize, String)>,
    /// Residuals of all corners of all views used.
    pub residuals: Vec<CornerResidual>,
    /// RMS residual of all corners, px.
    pub rms_px: f64,
    /// RMS residual of the inliers, px.
    pub rms_inliers_px: f64,
    /// RMS residual of inliers on boards held out of the fit: a quarter of the boards at a time, their poses from every
    /// other corner, px.
    pub holdout_rms_px: Option<f64>,
    /// What may be wrong, that of the cameras included.
    pub warnings: Vec<StereoWarning>,
}
