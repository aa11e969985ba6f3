//! The instrument as data: what a rig file holds.

pub use karst_core::MAX_COEFFICIENTS;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Radius that normalises the camera polynomials: s = rho / 512 px.
pub const NORMAL_RADIUS_PX: f64 = 512.0;

/// Coefficients of `polynomial` are smaller than this: they have to fit the fixed-point format of the gateware.
pub const MAX_POLYNOMIAL_COEFFICIENT: f64 = 32.0;
/// Coefficients of `axial` are smaller than this.
pub const MAX_AXIAL_COEFFICIENT: f64 = 256.0;
/// Most lasers of a rig.
pub const MAX_LASERS: usize = 720;
/// Largest width and height of an image, px.
pub const MAX_IMAGE_SIZE_PX: u32 = 2048;

/// A half-line in the rig frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Start, mm.
    pub origin: Point3<f64>,
    /// Unit direction.
    pub direction: Vector3<f64>,
}

/// Position and orientation of a part in the rig frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Origin of the part's frame in the rig frame, mm.
    pub position_mm: [f64; 3],
    /// Rotation from the part's frame to the rig frame, degrees: about the rig's x, then y, then z axis
    /// (R = Rz Ry Rx).
    pub rotation_deg: [f64; 3],
}

/// Pixel to ray, in one medium. The pixel origin is the centre of the top left pixel; x runs along a row, y along a
/// column. In the camera frame x and y are the image's, z is the viewing direction at the image centre.
///
/// ```text
/// (x, y) = A (u', v') + centre, A = [c d; e 1]
/// (u'', v'') = (u', v') + decentring(u', v')        (tangential terms, in the normalised radius)
/// s = |(u'', v'')| / 512 px
/// ray = (u'', v'', f),  f = 512 px * sum polynomial[i] s^i,  starting at (0, 0, z_v), z_v = 512 mm * sum axial[i] s^i
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraModel {
    /// Pose of the viewpoint.
    #[serde(flatten)]
    pub pose: Pose,
    /// Image centre (u0, v0), px.
    pub centre_px: [f64; 2],
    /// Affine terms c, d, e.
    pub affine: [f64; 3],
    /// Decentring terms p1, p2 of the normalised coordinates (x, y) = (u', v') / 512:
    /// dx = 2 p1 x y + p2 (r^2 + 2 x^2), dy = p1 (r^2 + 2 y^2) + 2 p2 x y.
    pub tangential: [f64; 2],
    /// f / 512 px as a polynomial in s, constant term first.
    pub polynomial: Vec<f64>,
    /// z_v / 512 mm as a polynomial in s, constant term first. Empty: a compact (single-viewpoint) model.
    pub axial: Vec<f64>,
}

/// One camera with its mirror.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Camera {
    /// Width and height, px.
    pub image_size_px: [u32; 2],
    /// Radius of the mirror's image around the centre, px: pixels beyond it are ignored.
    pub mirror_radius_px: f64,
    /// Radius below which the models are not valid, px: pixels inside are ignored (the image of the tube near the axis).
    pub inner_radius_px: f64,
    /// Camera in air, without the tube.
    pub air: Option<CameraModel>,
    /// Camera as it works, through tube and water: compact or axial. Traced from `air` when absent.
    pub water: Option<CameraModel>,
}

/// The transparent tube around the instrument: a circular cylinder, endless along its axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tube {
    /// Pose; the axis is the tube's own z.
    #[serde(flatten)]
    pub pose: Pose,
    /// Inner radius, mm.
    pub inner_radius_mm: f64,
    /// Wall thickness, mm.
    pub wall_mm: f64,
    /// Refractive index of the wall at the laser wavelength.
    pub index: f64,
}

/// The water around the instrument.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Water {
    /// Temperature, degrees Celsius.
    pub temperature_c: f64,
    /// Practical salinity, per mille: 0 fresh, 35 sea.
    pub salinity: f64,
    /// Laser wavelength, nm.
    pub wavelength_nm: f64,
}

/// One laser: the beam in the water as a line, with its standard uncertainties.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Laser {
    /// A point of the beam, rig frame, mm. Ranges along the beam count from here.
    pub origin_mm: [f64; 3],
    /// Azimuth of the beam in the rig frame, degrees from x towards y.
    pub azimuth_deg: f64,
    /// Elevation of the beam above the belt plane, degrees.
    pub elevation_deg: f64,
    /// Standard uncertainty of the origin across the beam, mm per axis.
    pub origin_sigma_mm: f64,
    /// Standard uncertainty of the direction across the beam, mrad per axis.
    pub direction_sigma_mrad: f64,
}

/// Settings of the spot detector, as in eq. 2 of the paper and beyond.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DetectorSettings {
    /// Thresholds of eq. 2 on G: a pixel is green when `G > green_min[0]` and
    /// `2G-R-B > excess_min[0]`, or when `G > green_min[1]` and `2G-R-B > excess_min[1]`.
    pub green_min: [u8; 2],
    /// Thresholds of eq. 2 on 2G-R-B, see `green_min`.
    pub excess_min: [u16; 2],
    /// R, G and B all at or above this: a saturated spot core, counted with its cluster.
    pub saturation_min: u8,
    /// G at or above this is clipped, grey levels: the pixel then counts with `clipped_weight`.
    pub clip_min: u8,
    /// Weight of a clipped or core pixel in the centroid is this (1 to 500) plus R and B, grey levels.
    pub clipped_weight: u16,
    /// Hits of one sector this close to the box around a cluster, in x and in y, belong to it, px; rounded to whole px.
    pub cluster_gap_px: f64,
    /// Fewest green pixels of a spot.
    pub min_pixels: u16,
    /// Half width of the sector around each laser's image, degrees.
    pub sector_half_width_deg: f64,
    /// Smallest standard uncertainty of a spot position, px per axis.
    pub sigma_floor_px: f64,
    /// Image noise of 2G-R-B, as it enters the standard uncertainty of a spot position, grey levels.
    pub noise_dn: f64,
}

/// Settings of the reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ReconstructionSettings {
    /// Working range along the beam, mm.
    pub range_mm: [f64; 2],
    /// Largest chi squared (3 degrees of freedom) of an accepted point.
    pub chi2_max: f64,
    /// Whether a spot seen by one camera only gives a (flagged, less certain) point.
    pub single_camera: bool,
}

/// A whole instrument.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rig {
    /// Name shown in reports.
    pub name: String,
    /// The water.
    pub water: Water,
    /// The tube.
    pub tube: Option<Tube>,
    /// The two cameras.
    #[serde(rename = "camera")]
    pub cameras: [Camera; 2],
    /// The lasers, in the order of their indices.
    #[serde(rename = "laser")]
    pub lasers: Vec<Laser>,
    /// Spot detector.
    pub detector: DetectorSettings,
    /// Reconstruction.
    pub reconstruction: ReconstructionSettings,
}
