//! The manifest of a calibration: which pictures show what.

use std::path::{Path, PathBuf};

use karst_rig::Board;
use serde::Deserialize;

/// Name of the manifest in its folder.
pub const MANIFEST: &str = "calibration.toml";

/// What `karst calibrate init` writes.
pub const TEMPLATE: &str = include_str!("calibration.toml");

/// Version of the manifest's format.
const FORMAT: u32 = 1;

/// The manifest. Paths are relative to its folder.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    format: u32,
    /// Rig file with what is known before: image sizes, radii, tube, water, the rough poses, the rough beams.
    pub drawing: PathBuf,
    /// The calibration board.
    pub board: Board,
    /// Pictures of the board.
    pub boards: Boards,
    /// How to fit the cameras.
    #[serde(default)]
    pub camera: CameraFit,
    /// How well the tube of the drawing is known.
    #[serde(default)]
    pub tube_sigma: TubeSigmas,
    /// Pictures of the laser spots.
    pub belt: Belt,
}

/// Pictures of the board: folders of camera 1 and camera 2, with pictures of one moment under one name.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Boards {
    /// In air, without the tube.
    pub air: Option<[PathBuf; 2]>,
    /// Under water, through the tube.
    pub water: Option<[PathBuf; 2]>,
}

/// How to fit the cameras.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraFit {
    /// Degree of the polynomials, 2 to 7; none: by hold-out.
    pub degree: Option<usize>,
    /// Whether to find the tangential (decentring) terms.
    pub tangential: bool,
}

impl Default for CameraFit {
    fn default() -> Self {
        Self { degree: None, tangential: true }
    }
}

/// How well tube and water of the drawing are known: standard deviations, such as half of a tolerance. What has one is
/// refined with the boards under water; what has none holds exactly. The pose of the tube is always found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TubeSigmas {
    /// Of the inner radius, mm.
    pub inner_radius_mm: Option<f64>,
    /// Of the thickness of the wall, mm.
    pub wall_mm: Option<f64>,
    /// Of the refractive index of the wall.
    pub index: Option<f64>,
}

/// Pictures of the laser spots on walls at several distances, under water: folders of camera 1 and camera 2.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Belt {
    /// The two folders.
    pub pictures: [PathBuf; 2],
}

/// Why a manifest cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// Not there, or not readable.
    #[error("cannot read {}: {source}; `karst calibrate init` writes one", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// No TOML, a field missing, misspelt or of the wrong type.
    #[error("{}: {message}", .path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the line.
        message: String,
    },
    /// A value out of range.
    #[error("{}: `{key}` is {found}, expected {expected}", .path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The field.
        key: &'static str,
        /// Its value.
        found: String,
        /// What is possible.
        expected: &'static str,
    },
}

impl Manifest {
    /// Reads the manifest of a folder. Its paths are resolved: they start from where the program runs.
    pub fn load(folder: &Path) -> Result<Self, ManifestError> {
        let path = folder.join(MANIFEST);
        let text =
            std::fs::read_to_string(&path).map_err(|source| ManifestError::Read { path: path.clone(), source })?;
        let mut manifest: Self = toml::from_str(&text)
            .map_err(|error| ManifestError::Syntax { path: path.clone(), message: error.to_string() })?;
        let value = |key, found: String, expected| ManifestError::Value { path: path.clone(), key, found, expected };
        let Board { columns, rows, square_mm } = manifest.board;
        if manifest.format != FORMAT {
            return Err(value("format", manifest.format.to_string(), "1"));
        }
        if !(3..=100).contains(&columns.min(rows)) || columns.max(rows) > 100 {
            return Err(value("board", format!("{columns} x {rows} inner corners"), "3 to 100 each way"));
        }
        if !(1.0..=1000.0).contains(&square_mm) {
            return Err(value("board.square_mm", square_mm.to_string(), "1 to 1000 mm; is it in metres?"));
        }
        let TubeSigmas { inner_radius_mm, wall_mm, index } = manifest.tube_sigma;
        if let Some(sigma) =
            [inner_radius_mm, wall_mm, index].into_iter().flatten().find(|sigma| sigma.is_nan() || *sigma <= 0.0)
        {
            return Err(value("tube_sigma", sigma.to_string(), "positive standard deviations"));
        }
        if manifest.boards.air.is_none() && manifest.boards.water.is_none() {
            return Err(value("boards", "empty".to_owned(), "`air`, `water` or both"));
        }
        let paths = [&mut manifest.boards.air, &mut manifest.boards.water].into_iter().flatten().flatten();
        for path in paths.chain(&mut manifest.belt.pictures).chain([&mut manifest.drawing]) {
            *path = folder.join(&*path);
        }
        Ok(manifest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str) -> Result<Manifest, ManifestError> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(MANIFEST), text).unwrap();
        let manifest = Manifest::load(folder.path())?;
        assert!(manifest.drawing.starts_with(folder.path()) && manifest.belt.pictures[1].starts_with(folder.path()));
        Ok(manifest)
    }

    fn message(from: &str, to: &str) -> String {
        assert!(TEMPLATE.contains(from));
        load(&TEMPLATE.replace(from, to)).unwrap_err().to_string()
    }

    #[test]
    fn the_template_is_a_manifest() {
        let manifest = load(TEMPLATE).unwrap();
        assert_eq!(manifest.board, Board { columns: 9, rows: 6, square_mm: 60.0 });
        assert!(manifest.boards.air.is_some() && manifest.boards.water.is_some());
        assert_eq!((manifest.camera, manifest.tube_sigma), (CameraFit::default(), TubeSigmas::default()));
    }

    #[test]
    fn bad_values_are_named_with_what_is_expected() {
        assert!(message("format = 1", "format = 2").contains("`format` is 2, expected 1"));
        assert!(message("columns = 9", "columns = 2").contains("2 x 6 inner corners"));
        assert!(message("# wall_mm", "wall_mm = 0.0 #").contains("`tube_sigma` is 0"));
        assert!(message("square_mm = 60.0", "square_mm = 0.06").contains("is it in metres?"));
    }

    #[test]
    fn what_is_missing_or_misspelt_is_named_with_its_line() {
        let error = message("square_mm = 60.0", "square = 60.0");
        assert!(error.contains("line") && error.contains("unknown field `square`"), "{error}");
        let error = message("drawing = ", "# drawing = ");
        assert!(error.contains("missing field `drawing`"), "{error}");
        assert!(Manifest::load(Path::new("/nowhere")).unwrap_err().to_string().contains("karst calibrate init"));
    }

    #[test]
    fn a_calibration_without_boards_is_refused() {
        let text = TEMPLATE.replace("air = ", "# air = ").replace("water = ", "# water = ");
        assert!(load(&text).unwrap_err().to_string().contains("`boards` is empty"));
    }
}
