//! `karst calibrate stereo`: two cameras together.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use karst_calib::{
    BoardSet, CalibratedCamera, CalibratedStereo, CameraSettings, CornerList, Pair, RejectedPair, StereoSettings,
    calibrate_stereo,
};
use karst_rig::{CameraModel, Medium, Pose};
use serde::Serialize;

use super::calibrate::{CameraResult, size, summary};
use super::{complain, print, print_json, triple, write_text};

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst calibrate stereo --corners1 left.csv --corners2 right.csv --image-size 1024x768 --position 0,0,-250 \\
    --out cameras.toml

Corner lists as for `karst calibrate camera`. Pictures with the same name, but for folder and extension, show the same
board in the same place. Pictures by one camera only serve that camera.")]
pub struct Stereo {
    /// Corner list of camera 1, CSV, or OpenCV XML or YAML
    #[arg(long, value_name = "FILE")]
    corners1: PathBuf,
    /// Corner list of camera 2
    #[arg(long, value_name = "FILE")]
    corners2: PathBuf,
    /// Width and height of the pictures, such as 640x480; not needed where the corner lists have it
    #[arg(long, value_name = "WxH", value_parser = size)]
    image_size: Option<[u32; 2]>,
    /// Degree of the polynomials, 2 to 7; without it, the lowest that predicts held-out views as well as any
    #[arg(long)]
    degree: Option<usize>,
    /// Find the tangential (decentring) terms too
    #[arg(long)]
    tangential: bool,
    /// Viewpoint of camera 1 in the rig frame, mm; its axes are those of the rig
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    position: [f64; 3],
    /// File to write, .toml: the [[camera]] sections of a rig file
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// What `calibrate stereo --json` prints. Lengths of residuals in the picture, RMS over corners.
#[derive(Serialize)]
struct StereoResult<'a> {
    baseline_mm: f64,
    baseline_sigma_mm: f64,
    /// Of camera 2 against camera 1: about x, then y, then z, degrees.
    rotation: [f64; 3],
    /// About the axes of camera 1, mrad.
    rotation_sigma_mrad: [f64; 3],
    /// Viewpoint of camera 2 in the frame of camera 1.
    position_mm: [f64; 3],
    position_sigma_mm: [f64; 3],
    pairs_used: usize,
    pairs: &'a [Pair],
    pairs_rejected: Vec<RejectedRow<'a>>,
    single_views: &'a [(usize, String)],
    rms_px: f64,
    rms_inliers_px: f64,
    holdout_rms_px: Option<f64>,
    cameras: [CameraResult<'a>; 2],
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct RejectedRow<'a> {
    #[serde(flatten)]
    rejected: &'a RejectedPair,
    message: String,
}

impl Stereo {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        if let Some(out) = &self.out
            && out.extension().is_none_or(|extension| extension != "toml")
        {
            bail!("--out is {}, expected a name that ends in .toml", out.display());
        }
        let (first, first_settings) = self.camera(&self.corners1)?;
        let (second, second_settings) = self.camera(&self.corners2)?;
        let set = BoardSet { name: String::new(), medium: Medium::Air, corners: [first, second] };
        let settings = StereoSettings {
            cameras: [first_settings, second_settings],
            board: None,
            first_pose: Pose { position_mm: self.position, rotation_deg: [0.0; 3] },
            tube: None,
        };
        let stereo = calibrate_stereo(&[set], &settings)?;
        for warning in &stereo.warnings {
            complain(format_args!("warning: {warning}"));
        }
        if self.json {
            print_json(&StereoResult::new(&stereo))?;
        } else {
            print(text(&stereo))?;
        }
        if let Some(path) = self.out {
            write_text(path.clone(), &sections(&stereo)?)?;
            if !self.json {
                print(format_args!("written to {}", path.display()))?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }

    /// Corners of one camera, and the settings for it.
    fn camera(&self, path: &Path) -> anyhow::Result<(CornerList, CameraSettings)> {
        let list = CornerList::load(path)?;
        let image_size_px = match (self.image_size, list.image_size_px) {
            (Some(given), Some(read)) if given != read => {
                bail!("--image-size is {given:?}, but {} says {read:?}", path.display())
            }
            (given, read) => given.or(read).context("the corner lists have no image size: give --image-size")?,
        };
        Ok((list, CameraSettings { image_size_px, degree: self.degree, tangential: self.tangential }))
    }
}

impl<'a> StereoResult<'a> {
    fn new(stereo: &'a CalibratedStereo) -> Self {
        let sigma = |row: usize| stereo.relative_covariance[(row, row)].sqrt();
        let rejected = stereo.rejected_pairs.iter();
        Self {
            baseline_mm: stereo.baseline_mm,
            baseline_sigma_mm: stereo.baseline_sigma_mm,
            rotation: stereo.rotation_deg,
            rotation_sigma_mrad: [0, 1, 2].map(|row| 1e3 * sigma(row)),
            position_mm: stereo.relative.translation.vector.into(),
            position_sigma_mm: [3, 4, 5].map(sigma),
            pairs_used: stereo.pairs.len(),
            pairs: &stereo.pairs,
            pairs_rejected: rejected.map(|rejected| RejectedRow { rejected, message: rejected.to_string() }).collect(),
            single_views: &stereo.single_views,
            rms_px: stereo.rms_px,
            rms_inliers_px: stereo.rms_inliers_px,
            holdout_rms_px: stereo.holdout_rms_px,
            cameras: stereo.cameras.each_ref().map(CameraResult::new),
            warnings: stereo.warnings.iter().map(ToString::to_string).collect(),
        }
    }
}

/// The result for people.
fn text(stereo: &CalibratedStereo) -> String {
    let mut lines = Vec::new();
    let [x, y, z] = stereo.rotation_deg;
    let turn = (0..3).map(|row| 1e3 * stereo.relative_covariance[(row, row)].sqrt()).fold(0.0, f64::max);
    lines.push(format!("baseline {:.3} ± {:.3} mm", stereo.baseline_mm, stereo.baseline_sigma_mm));
    lines.push(format!(
        "rotation of camera 2 against camera 1: ({x:.4}, {y:.4}, {z:.4}) degrees about x, y, z, known to {turn:.2} mrad"
    ));
    lines.push(format!(
        "{} pairs: {:.3} px rms, {:.3} px on the inliers",
        stereo.pairs.len(),
        stereo.rms_px,
        stereo.rms_inliers_px
    ));
    for Pair { pair, rms_px: [first, second], .. } in &stereo.pairs {
        lines.push(format!("  {pair}: {first:.3} and {second:.3} px rms"));
    }
    for pair in &stereo.rejected_pairs {
        lines.push(format!("rejected pair {pair}"));
    }
    for (camera, view) in &stereo.single_views {
        lines.push(format!("no partner for {view} of camera {camera}"));
    }
    for (number, camera) in (1..).zip(&stereo.cameras) {
        lines.push(format!("\ncamera {number}\n{}", summary(camera)));
    }
    lines.join("\n")
}

/// The sections of a rig file.
fn sections(stereo: &CalibratedStereo) -> anyhow::Result<String> {
    #[derive(Serialize)]
    struct Rig<'a> {
        camera: Vec<Section<'a>>,
    }
    #[derive(Serialize)]
    struct Section<'a> {
        image_size_px: [u32; 2],
        mirror_radius_px: f64,
        inner_radius_px: f64,
        air: &'a CameraModel,
    }
    let mut camera = Vec::new();
    for CalibratedCamera { image_size_px, radius_px: [inner, outer], model, .. } in &stereo.cameras {
        let (image_size_px, inner_radius_px, mirror_radius_px) = (*image_size_px, *inner, *outer);
        camera.push(Section { image_size_px, mirror_radius_px, inner_radius_px, air: model });
    }
    let text = toml::to_string(&Rig { camera })?;
    Ok(format!(
        "# Calibrated: baseline {:.3} ± {:.3} mm, {:.3} px rms on the inliers of {} pairs.\n\
         # The rig frame has the axes of camera 1. The radii are those up to which corners were seen.\n{text}",
        stereo.baseline_mm,
        stereo.baseline_sigma_mm,
        stereo.rms_inliers_px,
        stereo.pairs.len()
    ))
}
