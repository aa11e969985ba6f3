//! Corner lists from pictures.

use std::fmt;
use std::path::{Path, PathBuf};

use image::{GrayImage, ImageError, ImageReader};
use karst_rig::Board;
use rayon::prelude::*;

use crate::{CornerList, NotFound, View, find_corners};

/// Corners found in pictures of a board.
#[derive(Debug)]
pub struct FoundBoards {
    /// The pictures in which the board was found, by file name, with the size of all pictures.
    pub list: CornerList,
    /// The others.
    pub rejected: Vec<RejectedPicture>,
}

/// A picture without corners.
#[derive(Debug)]
pub struct RejectedPicture {
    /// File name.
    pub picture: String,
    /// Why there are none.
    pub reason: PictureReason,
}

impl fmt::Display for RejectedPicture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.picture, self.reason)
    }
}

/// Why a picture has no corners.
#[derive(Debug, thiserror::Error)]
pub enum PictureReason {
    /// The file is no picture, or damaged.
    #[error("no picture that can be read: {0}")]
    Unreadable(#[from] ImageError),
    /// The board is not seen.
    #[error(transparent)]
    NotFound(#[from] NotFound),
}

/// Why pictures cannot be used at all.
#[derive(Debug, thiserror::Error)]
pub enum PicturesError {
    /// A file or folder that cannot be read.
    #[error("cannot read {}: {source}", .path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// A folder without pictures.
    #[error("{}: found no PNG or JPEG file", .0.display())]
    NoPictures(PathBuf),
    /// A picture of another size.
    #[error("{}: found {} x {} px, expected {} x {} px as {reference}", .path.display(), found[0], found[1], expected[0], expected[1])]
    Size {
        /// The picture.
        path: PathBuf,
        /// Its width and height, px.
        found: [u32; 2],
        /// Width and height of the others, px.
        expected: [u32; 2],
        /// Where those are from.
        reference: String,
    },
}

/// The pictures among files and folders: of a folder its PNG and JPEG files by name, files as they are.
pub fn picture_files(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, PicturesError> {
    let mut files = Vec::new();
    for input in inputs {
        let failed = |source| PicturesError::Read { path: input.clone(), source };
        if !std::fs::metadata(input).map_err(failed)?.is_dir() {
            files.push(input.clone());
            continue;
        }
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(input).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
            if extension.is_some_and(|extension| ["png", "jpg", "jpeg"].contains(&extension.as_str())) {
                inside.push(path);
            }
        }
        if inside.is_empty() {
            return Err(PicturesError::NoPictures(input.clone()));
        }
        inside.sort();
        files.append(&mut inside);
    }
    Ok(files)
}

/// Finds the corners of a board in pictures. `image_size_px` is their width and height where that is known, else all have
/// to be like the first. `progress` is called after each picture.
pub fn find_boards(
    pictures: &[PathBuf],
    board: &Board,
    image_size_px: Option<[u32; 2]>,
    progress: impl Fn() + Sync,
) -> Result<FoundBoards, PicturesError> {
    type Outcome = Result<([u32; 2], Result<View, NotFound>), ImageError>;
    let outcomes: Vec<Outcome> = pictures
        .par_iter()
        .map(|path| {
            let picture = read(path);
            let outcome = picture.map(|picture| {
                let corners = find_corners(&picture, board);
                (picture.dimensions().into(), corners.map(|corners| View { name: name(path), corners }))
            });
            progress();
            outcome
        })
        .collect();
    let mut found = FoundBoards { list: CornerList { views: Vec::new(), image_size_px }, rejected: Vec::new() };
    let mut reference = "given".to_owned();
    for (path, outcome) in pictures.iter().zip(outcomes) {
        let reason = match outcome {
            Ok((size, view)) => {
                let expected = *found.list.image_size_px.get_or_insert_with(|| {
                    reference = path.display().to_string();
                    size
                });
                if size != expected {
                    return Err(PicturesError::Size { path: path.clone(), found: size, expected, reference });
                }
                match view {
                    Ok(view) => {
                        found.list.views.push(view);
                        continue;
                    }
                    Err(reason) => PictureReason::NotFound(reason),
                }
            }
            Err(error) => PictureReason::Unreadable(error),
        };
        found.rejected.push(RejectedPicture { picture: name(path), reason });
    }
    Ok(found)
}

fn read(path: &Path) -> Result<GrayImage, ImageError> {
    Ok(ImageReader::open(path)?.with_guessed_format()?.decode()?.to_luma8())
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
