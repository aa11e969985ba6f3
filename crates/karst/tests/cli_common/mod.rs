//! Runs the built command in a folder of its own.

#![allow(dead_code, reason = "every test file uses its own part")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use image::{ImageFormat, RgbImage};
use karst_rig::Rig;
use serde_json::Value;
use tempfile::TempDir;

/// The command in a folder, with its arguments in one text.
pub fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_karst"));
    command.current_dir(folder).args(arguments.split_whitespace());
    command
}

/// Runs the command in a folder.
pub fn run(folder: &Path, arguments: &str) -> Run {
    Run::new(arguments, command(folder, arguments).output().unwrap())
}

/// What came of it.
pub struct Run {
    arguments: String,
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    pub fn new(arguments: &str, output: Output) -> Self {
        let run = Self {
            arguments: arguments.to_owned(),
            status: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        };
        assert!(!run.stderr.contains("panicked"), "{}: {}", run.arguments, run.stderr);
        run
    }

    /// The run ended with this exit status.
    #[track_caller]
    pub fn status(self, expected: i32) -> Self {
        assert_eq!(self.status, Some(expected), "{}: {}{}", self.arguments, self.stdout, self.stderr);
        self
    }

    /// The run did all it had to and complained about nothing.
    #[track_caller]
    pub fn done(self) -> Self {
        let run = self.status(0);
        assert_eq!(run.stderr, "", "{}", run.arguments);
        run
    }

    /// Standard error has these words in one line.
    #[track_caller]
    pub fn says(self, words: &str) -> Self {
        assert!(self.stderr.lines().any(|line| line.contains(words)), "{:?} lacks {words:?}", self.stderr);
        self
    }

    /// The run failed with status 1 and one line that has these words.
    #[track_caller]
    pub fn fails(self, words: &str) -> Self {
        let run = self.status(1).says(words);
        assert!(run.stderr.starts_with("error: ") && run.stderr.lines().count() == 1, "{:?}", run.stderr);
        run
    }

    /// The arguments were refused with status 2 and these words.
    #[track_caller]
    pub fn misused(self, words: &str) -> Self {
        self.status(2).says(words)
    }

    /// Standard output as JSON.
    #[track_caller]
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }
}

/// A folder to run the command in, with the default rig in `rig.toml`.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write("rig.toml", Rig::DEFAULT_TOML);
        folder
    }

    pub fn root(&self) -> &Path {
        self.0.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn run(&self, arguments: &str) -> Run {
        run(self.0.path(), arguments)
    }

    /// Writes a file, with the folders on the way to it.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }

    /// Writes a picture of the default rig's size without any spot; the extension gives the format.
    pub fn write_dark_picture(&self, name: &str) {
        self.write(name, dark_picture(ImageFormat::from_path(name).unwrap()));
    }

    /// Writes dark pictures of both cameras in `camera1` and `camera2`.
    pub fn write_dark_sequence(&self, numbers: &[u32]) {
        for number in numbers {
            for camera in ["camera1", "camera2"] {
                self.write_dark_picture(&format!("{camera}/{number:04}.png"));
            }
        }
    }
}

/// A file with a picture of the default rig's size without any spot.
pub fn dark_picture(format: ImageFormat) -> Vec<u8> {
    let [width, height] = Rig::default().cameras[0].image_size_px;
    let mut bytes = std::io::Cursor::new(Vec::new());
    // Some texture, so that a truncated file lacks something.
    let image = RgbImage::from_fn(width, height, |x, y| image::Rgb([(x % 7) as u8, (y % 5) as u8, (x * y % 11) as u8]));
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// The points of a section as `--json` prints it: per laser its coordinates, mm.
pub fn points(section: &Value) -> Vec<Option<[f64; 3]>> {
    let lasers = section["lasers"].as_array().unwrap();
    lasers
        .iter()
        .map(|laser| serde_json::from_value(laser["point"].get("position_mm").cloned().unwrap_or_default()).unwrap())
        .collect()
}

/// Mean of |range error| / true range over all lasers with a point, per cent.
pub fn mean_range_error_percent<'a>(sections: impl IntoIterator<Item = &'a Value>) -> f64 {
    let lasers: Vec<&Value> = sections.into_iter().flat_map(|section| section["lasers"].as_array().unwrap()).collect();
    let errors: Vec<f64> = lasers
        .iter()
        .filter_map(|laser| {
            let [measured, truth] = ["point", "truth"].map(|part| laser[part]["range_mm"].as_f64());
            Some(100.0 * (measured? / truth? - 1.0).abs())
        })
        .collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}
