//! `karst calibrate`: from pictures to the parameters of an instrument.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use karst_calib::{
    CalibratedCamera, CameraSettings, CameraSigma, CornerList, FoundBoards, MeiModel, OcamModel, Outlier,
    PictureReason, RejectedPicture, RejectedView, calibrate_camera, find_boards, is_opencv, picture_files,
};
use karst_rig::{Board, CameraModel};
use serde::Serialize;

use super::calibrate_belt::Belt;
use super::calibrate_refraction::Refraction;
use super::calibrate_rig::{Init, RigCommand};
use super::calibrate_stereo::Stereo;
use super::{board, complain, count, print, print_json, progress, write_text};

#[derive(Debug, Subcommand)]
pub enum CalibrateCommand {
    /// One camera from the corners of a board in its pictures
    Camera(Camera),
    /// Two cameras together from the corners of a board that both see, in air
    Stereo(Stereo),
    /// Compare the models of a camera in the water
    Refraction(Refraction),
    /// The beams of a rig from pictures of their spots
    Belt(Belt),
    /// Start the calibration of a whole instrument: write its manifest and a drawing to edit
    Init(Init),
    /// A whole instrument from a folder of pictures
    Rig(RigCommand),
    /// Convert a camera file of another program
    Convert(Convert),
}

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst calibrate convert calib_results.txt --out camera.toml

The camera file is an OCamCalib calib_results.txt, or XML or YAML by OpenCV's omnidirectional calibration (file name ending
in .xml, .yml or .yaml), for which the residual of the conversion is shown.")]
pub struct Convert {
    /// OCamCalib text, or OpenCV XML or YAML
    file: PathBuf,
    /// Camera to write: .toml for the [camera.air] section of a rig file, .txt for OCamCalib
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst calibrate camera --board 11x7x30 pictures --degree 4 --out camera.toml
  karst calibrate camera --corners corners.csv --image-size 640x480 --degree 4 --out camera.toml

A corner list is CSV with the header image,idx,board_x_mm,board_y_mm,u_px,v_px, or OpenCV XML or YAML with
objectPoints and imagePoints (file name ending in .xml, .yml or .yaml). Pixel (0, 0) is the centre of the top left pixel.")]
pub struct Camera {
    /// Pictures of the board, PNG or JPEG, or folders of them
    #[arg(value_name = "PICTURES", requires = "board")]
    pictures: Vec<PathBuf>,
    /// Find the corners of this board in the pictures: inner corners along both sides and side of a square, mm
    #[arg(long, value_name = "COLUMNSxROWSxMM", value_parser = board, requires = "pictures")]
    board: Option<Board>,
    /// Corner list to write
    #[arg(long, value_name = "FILE.csv", requires = "board")]
    save_corners: Option<PathBuf>,
    /// Corner list in place of pictures, CSV or OpenCV XML or YAML
    #[arg(long, value_name = "FILE", conflicts_with = "board", required_unless_present = "board")]
    corners: Option<PathBuf>,
    /// Width and height of the pictures, such as 640x480; not needed for pictures or where the corner list has it
    #[arg(long, value_name = "WxH", value_parser = size)]
    image_size: Option<[u32; 2]>,
    /// Degree of the polynomial, 2 to 7; without it, the lowest that predicts held-out views as well as any
    #[arg(long)]
    degree: Option<usize>,
    /// Find the tangential (decentring) terms too
    #[arg(long)]
    tangential: bool,
    /// Camera to write: .toml for the [camera.air] section of a rig file, .txt for OCamCalib
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// What `calibrate camera --json` prints. Lengths of residuals in the picture, RMS over corners.
#[derive(Serialize)]
pub(super) struct CameraResult<'a> {
    rms_px: f64,
    rms_inliers_px: f64,
    holdout_rms_px: Option<f64>,
    corners: usize,
    inliers: usize,
    image_size_px: [u32; 2],
    centre_px: [f64; 2],
    degree: usize,
    /// f / 512 px as a polynomial in s = rho / 512 px, as in the rig file.
    polynomial: &'a [f64],
    affine: [f64; 3],
    tangential: [f64; 2],
    sigma: &'a CameraSigma,
    /// Hold-out RMS by degree.
    holdout_by_degree: &'a [(usize, f64)],
    radius_px: [f64; 2],
    views_used: usize,
    views: Vec<ViewRow<'a>>,
    views_rejected: Vec<RejectedRow<'a>>,
    outliers: &'a [Outlier],
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct ViewRow<'a> {
    view: &'a str,
    corners: usize,
    inliers: usize,
    rms_px: f64,
}

#[derive(Serialize)]
#[serde(untagged)]
enum RejectedRow<'a> {
    View {
        #[serde(flatten)]
        rejected: &'a RejectedView,
        message: String,
    },
    /// A picture without corners, with the same fields.
    Picture { view: &'a str, reason: &'static str, residual_px: Option<f64>, message: String },
}

impl CalibrateCommand {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Camera(command) => command.run(),
            Self::Stereo(command) => command.run(),
            Self::Refraction(command) => command.run(),
            Self::Belt(command) => command.run(),
            Self::Init(command) => command.run(),
            Self::Rig(command) => command.run(),
            Self::Convert(command) => command.run(),
        }
    }
}

/// Degree of the polynomial that an OpenCV camera is converted to.
const CONVERTED_DEGREE: usize = 6;

impl Convert {
    fn run(self) -> anyhow::Result<ExitCode> {
        let format = Format::of(&self.out)?;
        // Quoted: names may have line ends, comments may not.
        let name = format!("{:?}", self.file.display().to_string());
        let (model, image_size_px, radius_px, origin);
        if is_opencv(&self.file) {
            let mei = MeiModel::load(&self.file)?;
            let converted = mei.to_camera(CONVERTED_DEGREE)?;
            origin = format!(
                "Converted from {name}: residual {:.3} px rms, {:.3} px worst, up to {:.0} px from the centre.",
                converted.rms_px, converted.worst_px, converted.radius_px
            );
            (model, image_size_px, radius_px) = (converted.model, mei.image_size_px, converted.radius_px);
        } else {
            let ocam = OcamModel::load(&self.file)?;
            origin = format!("Converted from {name}, exactly.");
            // The circle inside the picture: beyond, published polynomials may turn back.
            let [width, height] = ocam.image_size_px;
            (model, image_size_px) = (ocam.to_camera(), ocam.image_size_px);
            radius_px = 0.5 * f64::from(width.min(height));
        }
        write_text(self.out.clone(), &format.text(&model, image_size_px, radius_px, &origin)?)?;
        print(format_args!("{origin}\nwritten to {}", self.out.display()))?;
        Ok(ExitCode::SUCCESS)
    }
}

impl Camera {
    /// The corners that are given, or found in the pictures.
    fn corners(&self) -> anyhow::Result<FoundBoards> {
        let Some(board) = &self.board else {
            let path = self.corners.as_ref().context("give --corners, or --board and pictures")?;
            return Ok(FoundBoards { list: CornerList::load(path)?, rejected: Vec::new() });
        };
        let pictures = picture_files(&self.pictures)?;
        let bar = progress(pictures.len(), "finding corners");
        let found = find_boards(&pictures, board, self.image_size, || bar.inc(1))?;
        bar.finish_and_clear();
        if found.list.views.is_empty() {
            found.rejected.iter().for_each(|picture| complain(format_args!("not used: {picture}")));
            bail!("the board was found in none of {}", count(pictures.len(), "picture"));
        }
        Ok(found)
    }

    fn run(self) -> anyhow::Result<ExitCode> {
        let format = self.out.as_deref().map(Format::of).transpose()?;
        let FoundBoards { list, rejected } = self.corners()?;
        if let Some(path) = self.save_corners {
            write_text(path, &list.to_csv())?;
        }
        let image_size_px = match (self.image_size, list.image_size_px) {
            (Some(given), Some(read)) if given != read => {
                bail!("--image-size is {given:?}, but the corner list says {read:?}")
            }
            (given, read) => given.or(read).context("the corner list has no image size: give --image-size")?,
        };
        let settings = CameraSettings { image_size_px, degree: self.degree, tangential: self.tangential };
        let camera = calibrate_camera(&list, &settings)
            .inspect_err(|_| rejected.iter().for_each(|picture| complain(format_args!("not used: {picture}"))))?;
        for warning in &camera.warnings {
            complain(format_args!("warning: {warning}"));
        }
        if self.json {
            let mut result = CameraResult::new(&camera);
            result.views_rejected.extend(rejected.iter().map(RejectedRow::picture));
            print_json(&result)?;
        } else {
            print(summary(&camera))?;
            for picture in &rejected {
                print(format_args!("rejected view {picture}"))?;
            }
        }
        if let (Some(path), Some(format)) = (self.out, format) {
            let origin = format!(
                "Calibrated: {:.3} px rms on {} of {} corners in {} views, valid from {:.0} to {:.0} px from the centre.",
                camera.rms_inliers_px,
                camera.inliers,
                camera.corners,
                camera.views.len(),
                camera.radius_px[0],
                camera.radius_px[1],
            );
            let text = format.text(&camera.model, camera.image_size_px, camera.radius_px[1], &origin)?;
            write_text(path.clone(), &text)?;
            if !self.json {
                print(format_args!("written to {}", path.display()))?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

impl<'a> RejectedRow<'a> {
    fn picture(rejected: &'a RejectedPicture) -> Self {
        let reason = match rejected.reason {
            PictureReason::Unreadable(_) => "unreadable",
            PictureReason::NotFound(_) => "board_not_found",
        };
        Self::Picture { view: &rejected.picture, reason, residual_px: None, message: rejected.to_string() }
    }
}

/// What `--out` writes.
#[derive(Clone, Copy)]
enum Format {
    Rig,
    Ocam,
}

impl Format {
    fn of(path: &Path) -> anyhow::Result<Self> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("toml") => Ok(Self::Rig),
            Some("txt") => Ok(Self::Ocam),
            _ => bail!("--out is {}, expected a name that ends in .toml or .txt", path.display()),
        }
    }

    /// The text of the file; `origin` says where the camera comes from.
    fn text(
        self,
        model: &CameraModel,
        image_size_px: [u32; 2],
        radius_px: f64,
        origin: &str,
    ) -> anyhow::Result<String> {
        #[derive(Serialize)]
        struct Rig<'a> {
            camera: Section<'a>,
        }
        #[derive(Serialize)]
        struct Section<'a> {
            air: &'a CameraModel,
        }
        match self {
            Self::Rig => {
                let [width, height] = image_size_px;
                let section = toml::to_string(&Rig { camera: Section { air: model } })?;
                Ok(format!(
                    "# {origin}\n# Pictures of {width} x {height} px. The pose is that in the rig's frame: set it.\n{section}"
                ))
            }
            Self::Ocam => {
                let (model, inverse_error_px) = OcamModel::from_camera(model, image_size_px, radius_px)?;
                complain(format_args!(
                    "inverse polynomial: worst error {inverse_error_px:.4} px up to {radius_px:.0} px"
                ));
                Ok(format!("# {origin}\n\n{}", model.to_text()))
            }
        }
    }
}

impl<'a> CameraResult<'a> {
    pub(super) fn new(camera: &'a CalibratedCamera) -> Self {
        let views = camera.views.iter();
        let rejected_views = camera.rejected_views.iter();
        Self {
            rms_px: camera.rms_px,
            rms_inliers_px: camera.rms_inliers_px,
            holdout_rms_px: camera.holdout_rms_px,
            corners: camera.corners,
            inliers: camera.inliers,
            image_size_px: camera.image_size_px,
            centre_px: camera.model.centre_px,
            degree: camera.degree,
            polynomial: &camera.model.polynomial,
            affine: camera.model.affine,
            tangential: camera.model.tangential,
            sigma: &camera.sigma,
            holdout_by_degree: &camera.degrees,
            radius_px: camera.radius_px,
            views_used: camera.views.len(),
            views: views
                .map(|v| ViewRow { view: &v.view, corners: v.corners, inliers: v.inliers, rms_px: v.rms_px })
                .collect(),
            views_rejected: rejected_views
                .map(|rejected| RejectedRow::View { rejected, message: rejected.to_string() })
                .collect(),
            outliers: &camera.outliers,
            warnings: camera.warnings.iter().map(ToString::to_string).collect(),
        }
    }
}

/// The result for people.
pub(super) fn summary(camera: &CalibratedCamera) -> String {
    let mut lines = Vec::new();
    let (model, sigma) = (&camera.model, &camera.sigma);
    lines.push(format!(
        "{} views, {} corners: {:.3} px rms, {:.3} px on the {} inliers",
        camera.views.len(),
        camera.corners,
        camera.rms_px,
        camera.rms_inliers_px,
        camera.inliers
    ));
    match camera.holdout_rms_px {
        Some(rms) => lines.push(format!("views held out of the fit: {rms:.3} px rms")),
        None => lines.push("too few views to hold some out of the fit".to_owned()),
    }
    for (degree, rms) in &camera.degrees {
        let chosen = if *degree == camera.degree { ", chosen" } else { "" };
        lines.push(format!("  degree {degree}: {rms:.3} px with outliers cut{chosen}"));
    }
    let [u, v] = model.centre_px;
    lines.push(format!("centre ({u:.2} ± {:.2}, {v:.2} ± {:.2}) px", sigma.centre_px[0], sigma.centre_px[1]));
    // There is no linear term.
    for (power, (a, sigma)) in model.polynomial.iter().zip(&sigma.polynomial).enumerate().filter(|(i, _)| *i != 1) {
        lines.push(format!("polynomial[{power}] {a:.6} ± {sigma:.6}"));
    }
    let [c, d, e] = model.affine;
    lines.push(format!("affine c {c:.5} ± {:.5}, d {d:.5} and e {e:.5} ± {:.5}", sigma.affine[0], sigma.affine[1]));
    let [p1, p2] = model.tangential;
    if sigma.tangential != [0.0; 2] {
        lines.push(format!(
            "tangential p1 {p1:.5} ± {:.5}, p2 {p2:.5} ± {:.5}",
            sigma.tangential[0], sigma.tangential[1]
        ));
    }
    let [inner, outer] = camera.radius_px;
    lines.push(format!(
        "rays known to {:.2} mrad or better from {inner:.0} to {outer:.0} px from the centre",
        sigma.ray_mrad
    ));
    for view in &camera.views {
        lines.push(format!(
            "  {}: {:.3} px rms, {} of {} corners inliers",
            view.view, view.rms_px, view.inliers, view.corners
        ));
    }
    for view in &camera.rejected_views {
        lines.push(format!("rejected view {view}"));
    }
    for outlier in &camera.outliers {
        lines.push(format!("outlier {outlier}"));
    }
    lines.join("\n")
}

/// Width and height of a picture.
pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    parsed.ok_or_else(|| format!("found '{text}', expected width and height such as 640x480"))
}
