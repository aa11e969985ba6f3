//! What a camera calibration starts from and what it gives.

use std::fmt;

use karst_rig::{CameraModel, MAX_POLYNOMIAL_COEFFICIENT};
use nalgebra::Isometry3;
use serde::Serialize;

/// Fewest corners of a view: its pose takes three, the camera and the search for outliers need more.
pub(crate) const MIN_CORNERS: usize = 8;

/// What is known before, and what is to be found.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSettings {
    /// Width and height of the pictures, px.
    pub image_size_px: [u32; 2],
    /// Degree of the polynomial, 2 to 7. None: the lowest of [`DEGREES`](crate::DEGREES) that predicts views held out of the fit as well
    /// as any.
    pub degree: Option<usize>,
    /// Whether to find the two tangential (decentring) terms: for mirrors that are tilted against their camera.
    pub tangential: bool,
}

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A setting is out of range.
    #[error("{what} is {found}, expected {expected}")]
    Setting {
        /// The setting.
        what: &'static str,
        /// Its value.
        found: String,
        /// What is possible.
        expected: &'static str,
    },
    /// A coordinate is not finite.
    #[error("{view}, corner {index}: a coordinate is not finite")]
    NotFinite {
        /// Name of the view.
        view: String,
        /// Number of the corner.
        index: usize,
    },
    /// A corner is outside the picture.
    #[error("{view}, corner {index}: at ({}, {}) px, outside of a picture of {} x {} px: wrong image size?", pixel[0], pixel[1], image_size_px[0], image_size_px[1])]
    OutsideImage {
        /// Name of the view.
        view: String,
        /// Number of the corner.
        index: usize,
        /// Where it is, px.
        pixel: [f64; 2],
        /// Image size as given, px.
        image_size_px: [u32; 2],
    },
    /// Fewer views than determine a camera.
    #[error("{found} usable views, expected at least {expected}{}", reasons(rejected))]
    TooFewViews {
        /// Views that can be used.
        found: usize,
        /// Views needed.
        expected: usize,
        /// The others.
        rejected: Vec<RejectedView>,
    },
    /// Most views do not show a board as described.
    #[error(
        "{found} of {views} views do not fit a plane board with these coordinates: wrong board size or corner order?{}",
        reasons(rejected)
    )]
    NotABoard {
        /// Views that do not fit.
        found: usize,
        /// All views.
        views: usize,
        /// Which, and how far they are off.
        rejected: Vec<RejectedView>,
    },
    /// All boards are parallel.
    #[error(
        "all boards are within {within_deg:.1} degrees of parallel: {quantity} cannot be observed; tilt the board differently in each view"
    )]
    Parallel {
        /// The largest angle between two boards, or between a board and the image plane, degrees.
        within_deg: f64,
        /// What does not follow from such views.
        quantity: &'static str,
    },
    /// A quantity does not follow from these views.
    #[error("{quantity} cannot be observed in these views: place the board at other distances, angles and radii")]
    Unobservable {
        /// The quantity.
        quantity: &'static str,
    },
    /// No camera explains the corners.
    #[error(
        "the best camera leaves {rms_px:.2} px rms, expected at most {limit_px:.2} px: wrong board size or corner order?"
    )]
    PoorFit {
        /// RMS residual of the inliers, px.
        rms_px: f64,
        /// What would be believed, px.
        limit_px: f64,
    },
}

fn reasons(rejected: &[RejectedView]) -> String {
    rejected.iter().map(|view| format!("\n  {view}")).collect()
}

/// Why a view was not used.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum ViewReason {
    /// Too few corners.
    #[error("fewer than {MIN_CORNERS} corners")]
    TooFewCorners,
    /// The corners do not fit a plane board with these coordinates, whatever the camera.
    #[error("does not fit the board: wrong corner order or board size?")]
    NotTheBoard,
    /// The corners do not fit the camera that fits the other views.
    #[error("does not fit the camera that fits the other views")]
    NotTheCamera,
    /// The board appears mirrored against the other views.
    #[error("mirrored corner order against the other views")]
    Mirrored,
}

/// A view that was not used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RejectedView {
    /// Name of the view.
    pub view: String,
    /// Why.
    pub reason: ViewReason,
    /// Median residual of its corners, px, where there is one.
    pub residual_px: Option<f64>,
}

impl fmt::Display for RejectedView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.view, self.reason)?;
        match self.residual_px {
            Some(residual) => write!(f, " (median residual {residual:.2} px)"),
            None => Ok(()),
        }
    }
}

/// A corner that is off by so much that it did not count as its neighbours did, in a view that was used: the fit gave it
/// the pull of a corner at the limit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outlier {
    /// Name of the view.
    pub view: String,
    /// Number of the corner.
    pub index: usize,
    /// Where it was found, px.
    pub pixel: [f64; 2],
    /// Distance from where the camera sees it, px. None: the camera does not see it at all.
    pub residual_px: Option<f64>,
    /// Residual up to which corners are inliers, px.
    pub limit_px: f64,
}

impl fmt::Display for Outlier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [u, v] = self.pixel;
        write!(f, "{}, corner {} at ({u:.2}, {v:.2}) px: ", self.view, self.index)?;
        match self.residual_px {
            Some(residual) => write!(f, "{residual:.2} px off, limit {:.2} px", self.limit_px),
            None => write!(f, "not seen by the camera"),
        }
    }
}

/// What is allowed but probably not meant, or makes the result weak.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Warning {
    /// The image centre is far from the middle of the picture.
    #[error("the image centre ({:.1}, {:.1}) px is far from the middle of a picture of {} x {} px: wrong image size?", centre_px[0], centre_px[1], image_size_px[0], image_size_px[1])]
    CentreOffMiddle {
        /// The centre found, px.
        centre_px: [f64; 2],
        /// Image size as given, px.
        image_size_px: [u32; 2],
    },
    /// The board is too small for millimetres.
    #[error("the board is {size_mm:.3} mm across: are its coordinates in metres?")]
    SmallBoard {
        /// Diagonal of its corners, mm.
        size_mm: f64,
    },
    /// All boards are seen from behind.
    #[error(
        "every board appears mirrored (x right, y down, seen from behind): either the corner order is mirrored or the \
         pictures show a mirror image; the camera model holds, the poses are mirrored"
    )]
    AllMirrored,
    /// A quantity is poorly determined.
    #[error(
        "{quantity} is known to {sigma:.2} {unit} only (standard deviation), expected {limit} {unit}: more views needed"
    )]
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
    /// Boards in the water are at one distance.
    #[error(
        "most corners are {near_mm:.0} to {far_mm:.0} mm from the axis: where rays leave the axis (z_v) follows from boards \
         at different distances; add some at half and at twice that"
    )]
    OneDistance {
        /// Distance that a tenth of the corners is nearer than, mm.
        near_mm: f64,
        /// Distance that a tenth of the corners is beyond, mm.
        far_mm: f64,
    },
    /// The polynomial does not fit the rig file.
    #[error(
        "a polynomial coefficient is {coefficient:.1}, but rig files take less than {MAX_POLYNOMIAL_COEFFICIENT}: choose a lower degree"
    )]
    LargeCoefficient {
        /// The largest, in units of 512 px.
        coefficient: f64,
    },
    /// Many corners are outliers.
    #[error("{outliers} of {corners} corners are outliers: moved board, or a model that does not fit this camera?")]
    ManyOutliers {
        /// Outliers.
        outliers: usize,
        /// Corners of all views in use.
        corners: usize,
    },
}

/// A view that was used.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewResult {
    /// Name of the view.
    pub view: String,
    /// Board frame to camera frame, mm.
    pub pose: Isometry3<f64>,
    /// Its corners.
    pub corners: usize,
    /// Its inliers.
    pub inliers: usize,
    /// RMS residual of all its corners, px.
    pub rms_px: f64,
}

/// Standard deviations of the terms of a camera model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraSigma {
    /// Of `polynomial`, as long as that.
    pub polynomial: Vec<f64>,
    /// Of `axial`, as long as that; its constant term is a convention, not a result.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub axial: Vec<f64>,
    /// Of the elevation of a ray against the plane across the axis, from that of the polynomial: the largest within
    /// `radius_px`, mrad.
    pub ray_mrad: f64,
    /// Of `centre_px`, px.
    pub centre_px: [f64; 2],
    /// Of the aspect c and the symmetric shear d = e.
    pub affine: [f64; 2],
    /// Of `tangential`; zeros where it was not looked for.
    pub tangential: [f64; 2],
}

/// A calibrated camera, and how good it is. Residuals are lengths in the picture (2-D), RMS over corners.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedCamera {
    /// The model. Its pose is zero where nothing ties the camera to a rig frame.
    pub model: CameraModel,
    /// Width and height of the pictures, px.
    pub image_size_px: [u32; 2],
    /// Standard deviations of its terms.
    pub sigma: CameraSigma,
    /// Degree of the polynomial.
    pub degree: usize,
    /// RMS residual of all corners of the views used, px.
    pub rms_px: f64,
    /// RMS residual of the inliers, px.
    pub rms_inliers_px: f64,
    /// RMS residual of inliers in views held out of the fit: a quarter of the views at a time, their poses from every
    /// other corner, px. None: too few views.
    pub holdout_rms_px: Option<f64>,
    /// Hold-out RMS by degree, residuals cut at one limit for all, where the degree was chosen, px. Without the degrees
    /// whose coefficients do not fit the rig file.
    pub degrees: Vec<(usize, f64)>,
    /// Corners of the views used.
    pub corners: usize,
    /// Corners without the outliers.
    pub inliers: usize,
    /// The views used.
    pub views: Vec<ViewResult>,
    /// The views not used.
    pub rejected_views: Vec<RejectedView>,
    /// The outliers in the views used.
    pub outliers: Vec<Outlier>,
    /// Radii (after the affine and tangential corrections) at which inliers are: the model holds in between, px.
    pub radius_px: [f64; 2],
    /// What may be wrong.
    pub warnings: Vec<Warning>,
}
