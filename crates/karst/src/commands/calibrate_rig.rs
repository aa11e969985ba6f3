//! `karst calibrate init` and `karst calibrate rig`: a whole instrument from a folder of pictures.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::SystemTime;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use karst::calibration::{
    BeltResult, CamerasResult, CornersResult, MANIFEST, Manifest, Report, TEMPLATE, calibrate_cameras, html, inputs,
    rig_file, with_cameras, with_cameras_of,
};
use karst::output::folder;
use karst_calib::{BoardSet, CornerList, find_boards, picture_files};
use karst_rig::{Medium, Rig};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::calibrate_belt::belt;
use super::{complain, print, print_json, progress, spinner, write_text};

/// Folder for the results in that of the pictures.
const RESULT: &str = "result";

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst calibrate init pictures

writes pictures/calibration.toml, which says what the pictures show, and pictures/drawing.toml, a rig file with what is known
before: edit both, put the pictures where calibration.toml says, then run `karst calibrate rig pictures`.")]
pub struct Init {
    /// Folder for the pictures
    folder: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  karst calibrate rig pictures
  karst calibrate rig pictures --from cameras

Steps and what they leave in FOLDER/result:
  corners  corners of the boards in all pictures: corners_air_1.csv and so on
  cameras  cameras and tube: cameras.toml, a rig with the belt of the drawing
  belt     the beams: rig.toml, the calibrated rig, and report.html

A step starts from what the one before left, so corner lists can be corrected by hand and a step run again with --from.")]
pub struct RigCommand {
    /// Folder with calibration.toml
    folder: PathBuf,
    /// Step to start from, with the results of an earlier run
    #[arg(long, value_enum, default_value_t)]
    from: Step,
    /// Print what was found as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
enum Step {
    /// Find the corners of the boards in the pictures
    #[default]
    Corners,
    /// Calibrate cameras and tube from the corners
    Cameras,
    /// Calibrate the belt
    Belt,
}

/// What `calibrate rig --json` prints.
#[derive(Serialize)]
struct Output<'a> {
    rig: &'a Path,
    report: &'a Path,
    corners: &'a [CornersResult],
    #[serde(flatten)]
    cameras: &'a CamerasResult,
    belt: &'a BeltResult,
    advice: Vec<String>,
}

impl Init {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        folder::prepare(&self.folder)?;
        for (name, text) in [
            (MANIFEST, TEMPLATE),
            ("drawing.toml", &Rig::IDEAL_TOML.replace("name = \"ideal\"", "name = \"my instrument\"")),
        ] {
            let path = self.folder.join(name);
            if path.exists() {
                bail!("{}: exists already, expected a folder without it", path.display());
            }
            write_text(path, text)?;
        }
        let folder = self.folder.display();
        print(format_args!("edit {folder}/{MANIFEST} and {folder}/drawing.toml, then: karst calibrate rig {folder}"))?;
        Ok(ExitCode::SUCCESS)
    }
}

/// A calibration on its way.
struct Calibration {
    manifest: Manifest,
    drawing: Rig,
    result: PathBuf,
}

impl RigCommand {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let manifest = Manifest::load(&self.folder)?;
        let drawing = Rig::load(&manifest.drawing)?;
        let result = self.folder.join(RESULT);
        folder::prepare(&result)?;
        // What an earlier run left must not stand beside what this one finds.
        for name in ["rig.toml", "belt.json", "report.html"] {
            let path = result.join(name);
            if path.exists() {
                std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
            }
        }
        let calibration = Calibration { manifest, drawing, result };
        let corners: Vec<CornersResult> = match self.from {
            Step::Corners => calibration.kept("corners.json", calibration.find_corners()?)?,
            Step::Cameras | Step::Belt => calibration.earlier("corners.json", "corners")?,
        };
        let (cameras, with_cameras) = match self.from {
            Step::Corners | Step::Cameras => calibration.calibrate_cameras()?,
            Step::Belt => calibration.earlier_cameras()?,
        };
        for warning in &cameras.warnings {
            complain(format_args!("warning: {warning}"));
        }
        let [first, second] = &calibration.manifest.belt.pictures;
        let (belt, rig) = belt(&with_cameras, [first, second])?;
        let belt = calibration.kept("belt.json", belt)?;
        calibration.finish(&self, &corners, &cameras, &belt, &rig)
    }
}

impl Calibration {
    /// The sets of boards: name, medium, folders.
    fn sets(&self) -> impl Iterator<Item = (&'static str, Medium, &[PathBuf; 2])> {
        let boards = &self.manifest.boards;
        let air = boards.air.iter().map(|folders| ("air", Medium::Air, folders));
        air.chain(boards.water.iter().map(|folders| ("water", Medium::Water, folders)))
    }

    fn corner_file(&self, set: &str, camera: usize) -> PathBuf {
        self.result.join(format!("corners_{set}_{}.csv", camera + 1))
    }

    /// Writes a result to its folder for later steps.
    fn kept<T: Serialize>(&self, name: &str, result: T) -> anyhow::Result<T> {
        write_text(self.result.join(name), &serde_json::to_string_pretty(&result)?)?;
        Ok(result)
    }

    /// The result of a step in an earlier run.
    fn earlier<T: DeserializeOwned>(&self, name: &str, step: &str) -> anyhow::Result<T> {
        let path = self.result.join(name);
        let what = || format!("{}: no result of an earlier step, run again with --from {step}", path.display());
        let text = std::fs::read_to_string(&path).with_context(what)?;
        serde_json::from_str(&text).with_context(what)
    }

    /// Cameras and tube as calibrated by an earlier run; the rest of the rig as drawn now.
    fn earlier_cameras(&self) -> anyhow::Result<(CamerasResult, Rig)> {
        let cameras: CamerasResult = self.earlier("cameras.json", "cameras")?;
        if cameras.inputs != inputs(&self.manifest, &self.drawing) {
            bail!(
                "board, tube or water were changed after the cameras had been calibrated: run again with --from cameras"
            );
        }
        let earlier = Rig::load(self.result.join("cameras.toml"))?;
        Ok((cameras, with_cameras_of(&self.drawing, &earlier)))
    }

    fn find_corners(&self) -> anyhow::Result<Vec<CornersResult>> {
        let mut results = Vec::new();
        for (set, _, folders) in self.sets() {
            for (camera, folder) in folders.iter().enumerate() {
                let pictures = picture_files(std::slice::from_ref(folder))?;
                let bar = progress(pictures.len(), "finding corners");
                let size_px = self.drawing.cameras[camera].image_size_px;
                let found = find_boards(&pictures, &self.manifest.board, Some(size_px), || bar.inc(1))?;
                bar.finish_and_clear();
                write_text(self.corner_file(set, camera), &found.list.to_csv())?;
                let place = format!("{set}, camera {}", camera + 1);
                let rejected: Vec<String> =
                    found.rejected.iter().map(|rejected| format!("{place}, {rejected}")).collect();
                for rejected in &rejected {
                    complain(format_args!("not used: {rejected}"));
                }
                let (set, camera, found) = (set.to_owned(), camera + 1, found.list.views.len());
                results.push(CornersResult { set, camera, pictures: pictures.len(), found, rejected });
            }
        }
        Ok(results)
    }

    fn calibrate_cameras(&self) -> anyhow::Result<(CamerasResult, Rig)> {
        let mut sets = Vec::new();
        for (name, medium, _) in self.sets() {
            let list = |camera| CornerList::load(self.corner_file(name, camera));
            sets.push(BoardSet { name: name.to_owned(), medium, corners: [list(0)?, list(1)?] });
        }
        let bar = spinner("calibrating cameras");
        let stereo = calibrate_cameras(&self.manifest, &self.drawing, &sets)?;
        let water = sets.iter().find(|set| set.medium == Medium::Water).map(|set| &set.corners);
        let cameras = CamerasResult::new(&self.manifest, &self.drawing, &stereo, water);
        bar.finish_and_clear();
        let rig = with_cameras(&self.drawing, &stereo);
        write_text(self.result.join("cameras.toml"), &rig.to_toml())?;
        Ok((self.kept("cameras.json", cameras)?, rig))
    }

    fn finish(
        &self,
        command: &RigCommand,
        corners: &[CornersResult],
        cameras: &CamerasResult,
        belt: &BeltResult,
        rig: &Rig,
    ) -> anyhow::Result<ExitCode> {
        let [rig_path, report_path] = ["rig.toml", "report.html"].map(|name| self.result.join(name));
        write_text(rig_path.clone(), &rig_file(rig, cameras, belt))?;
        let report = html(&Report { created: SystemTime::now(), rig, corners, cameras, belt })?;
        write_text(report_path.clone(), &report)?;
        let advice = cameras.advice().into_iter().chain(belt.advice(rig.reconstruction.range_mm)).collect();
        if command.json {
            print_json(&Output { rig: &rig_path, report: &report_path, corners, cameras, belt, advice })?;
            return Ok(ExitCode::SUCCESS);
        }
        for set in corners {
            let CornersResult { set, camera, pictures, found, .. } = set;
            print(format_args!("{set}, camera {camera}: board found in {found} of {pictures} pictures"))?;
        }
        let holdout = cameras.holdout_rms_px.map_or(String::new(), |rms| format!(", {rms:.3} px held out"));
        print(format_args!("corners {:.3} px rms{holdout}", cameras.rms_inliers_px))?;
        print(format_args!(
            "baseline {:.2} ± {:.2} mm ({:.2} in the drawing), {} pairs",
            cameras.baseline_mm, cameras.baseline_sigma_mm, cameras.baseline_drawn_mm, cameras.pairs_used
        ))?;
        print(super::calibrate_belt::summary(belt))?;
        for line in &advice {
            print(line)?;
        }
        print(format_args!("rig {}\nreport {}", rig_path.display(), report_path.display()))?;
        Ok(ExitCode::SUCCESS)
    }
}
