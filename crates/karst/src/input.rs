//! Stereo frames from image files: two files, or two folders of numbered files paired by number.

use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageReader, RgbImage};
use std::collections::BTreeMap;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

/// Why a frame, or the whole sequence, cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// Nothing there, or no permission.
    #[error("{}: cannot read it: {source}", .path.display())]
    Read {
        /// File or folder.
        path: PathBuf,
        /// What the operating system says.
        source: io::Error,
    },
    /// One input is a file, the other a folder.
    #[error("{} is a folder and {} is a file: expected two image files or two folders", .folder.display(), .file.display())]
    FileAndFolder {
        /// The input that is a folder.
        folder: PathBuf,
        /// The input that is a file.
        file: PathBuf,
    },
    /// A folder without frames.
    #[error("{}: found no numbered PNG or JPEG file, expected for instance frame_0001.png", .0.display())]
    NoFrames(PathBuf),
    /// Two files of one folder have the same number.
    #[error("frame {number}: found both {} and {}, expected one file per number", .first.display(), .second.display())]
    SameNumber {
        /// Frame number.
        number: u64,
        /// First file.
        first: PathBuf,
        /// Second file.
        second: PathBuf,
    },
    /// The folders hold frames, but no pair.
    #[error(
        "{} holds frames {} to {}, {} holds frames {} to {}: no number in common",
        .folders[0].display(), .ranges[0][0], .ranges[0][1], .folders[1].display(), .ranges[1][0], .ranges[1][1]
    )]
    NoCommonNumber {
        /// The folders of camera 1 and 2.
        folders: [PathBuf; 2],
        /// First and last frame number in each folder.
        ranges: [[u64; 2]; 2],
    },
    /// One camera has a frame that the other has not.
    #[error("frame {digits}: missing in camera {camera}'s folder {}, found only {}", .folder.display(), .found.display())]
    MissingFrame {
        /// Frame number as written in the file name.
        digits: String,
        /// Camera without the frame, 1 or 2.
        camera: usize,
        /// Its folder.
        folder: PathBuf,
        /// The other camera's file.
        found: PathBuf,
    },
    /// Not an image file.
    #[error("frame {frame}: {} is not an image: expected PNG or JPEG", .path.display())]
    NotAnImage {
        /// Name of the frame.
        frame: String,
        /// The file.
        path: PathBuf,
    },
    /// Damaged image file.
    #[error("frame {frame}: {} is damaged or truncated: {source}", .path.display())]
    Damaged {
        /// Name of the frame.
        frame: String,
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        source: ImageError,
    },
    /// A JPEG file that stops before its end marker.
    #[error("frame {frame}: {} is truncated: the JPEG end marker is missing", .path.display())]
    Truncated {
        /// Name of the frame.
        frame: String,
        /// The file.
        path: PathBuf,
    },
    /// Grey, transparent or 16-bit image.
    #[error("frame {frame}: {}: found {found}, expected 8-bit RGB", .path.display())]
    PixelFormat {
        /// Name of the frame.
        frame: String,
        /// The file.
        path: PathBuf,
        /// Pixel format in words.
        found: &'static str,
    },
    /// Not the size that the rig file gives for this camera.
    #[error(
        "frame {frame}: {}: found {} x {} px, expected {} x {} px for camera {camera} of the rig",
        .path.display(), .found[0], .found[1], .expected[0], .expected[1]
    )]
    ImageSize {
        /// Name of the frame.
        frame: String,
        /// The file.
        path: PathBuf,
        /// Camera, 1 or 2.
        camera: usize,
        /// Width and height of the image, px.
        found: [u32; 2],
        /// Width and height in the rig file, px.
        expected: [u32; 2],
    },
}

/// The two images of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePair {
    /// Name of the frame: the file stem of its first image.
    pub name: String,
    /// Images of camera 1 and 2.
    pub images: [RgbImage; 2],
}

/// The frames of a sequence, loaded one by one. A frame that cannot be loaded gives an error and the next call goes on
/// with the next frame.
#[derive(Debug)]
pub struct FramePairs {
    frames: std::vec::IntoIter<Frame>,
    image_sizes_px: [[u32; 2]; 2],
}

#[derive(Debug)]
enum Frame {
    Pair([PathBuf; 2]),
    Missing { camera: usize, folder: PathBuf, found: Numbered },
}

/// A file with a number in its name.
#[derive(Debug, Clone)]
struct Numbered {
    digits: String,
    path: PathBuf,
}

impl FramePairs {
    /// Opens two image files (one frame), or two folders. In a folder every PNG or JPEG file with a number in its name
    /// is a frame, the last group of digits counts (`run2_0007.png` is frame 7), and other files are ignored. Frames
    /// are paired by number and come in the order of the numbers; one that exists in one folder only comes as an error
    /// at its place. `image_sizes_px` are width and height of the two cameras in the rig file.
    pub fn open(camera1: &Path, camera2: &Path, image_sizes_px: [[u32; 2]; 2]) -> Result<Self, InputError> {
        let frames = match (is_folder(camera1)?, is_folder(camera2)?) {
            (false, false) => vec![Frame::Pair([camera1.to_owned(), camera2.to_owned()])],
            (true, true) => pair_folders(camera1, camera2)?,
            (true, false) => {
                return Err(InputError::FileAndFolder { folder: camera1.to_owned(), file: camera2.to_owned() });
            }
            (false, true) => {
                return Err(InputError::FileAndFolder { folder: camera2.to_owned(), file: camera1.to_owned() });
            }
        };
        Ok(Self { frames: frames.into_iter(), image_sizes_px })
    }
}

impl Iterator for FramePairs {
    type Item = Result<FramePair, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        Some(match self.frames.next()? {
            Frame::Pair(paths) => load_pair(&paths, self.image_sizes_px),
            Frame::Missing { camera, folder, found } => {
                Err(InputError::MissingFrame { digits: found.digits, camera, folder, found: found.path })
            }
        })
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.frames.size_hint()
    }
}

impl ExactSizeIterator for FramePairs {}

fn is_folder(path: &Path) -> Result<bool, InputError> {
    let metadata = std::fs::metadata(path).map_err(|source| InputError::Read { path: path.to_owned(), source })?;
    Ok(metadata.is_dir())
}

fn pair_folders(folder1: &Path, folder2: &Path) -> Result<Vec<Frame>, InputError> {
    let folders = [folder1.to_owned(), folder2.to_owned()];
    let [files1, mut files2] = [numbered_files(folder1)?, numbered_files(folder2)?];
    if !files1.keys().any(|number| files2.contains_key(number)) {
        let range = |files: &BTreeMap<u64, Numbered>| Some([*files.first_key_value()?.0, *files.last_key_value()?.0]);
        let ranges = [
            range(&files1).ok_or_else(|| InputError::NoFrames(folder1.to_owned()))?,
            range(&files2).ok_or_else(|| InputError::NoFrames(folder2.to_owned()))?,
        ];
        return Err(InputError::NoCommonNumber { folders, ranges });
    }
    let [folder1, folder2] = folders;
    let mut frames = BTreeMap::new();
    for (number, file1) in files1 {
        frames.insert(
            number,
            match files2.remove(&number) {
                Some(file2) => Frame::Pair([file1.path, file2.path]),
                None => Frame::Missing { camera: 2, folder: folder2.clone(), found: file1 },
            },
        );
    }
    for (number, file2) in files2 {
        frames.insert(number, Frame::Missing { camera: 1, folder: folder1.clone(), found: file2 });
    }
    Ok(frames.into_values().collect())
}

fn numbered_files(folder: &Path) -> Result<BTreeMap<u64, Numbered>, InputError> {
    let read_error = |source| InputError::Read { path: folder.to_owned(), source };
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(read_error)? {
        let path = entry.map_err(read_error)?.path();
        let Some((number, digits)) = frame_number(&path) else { continue };
        if let Some(Numbered { path: other, .. }) = files.insert(number, Numbered { digits, path: path.clone() }) {
            // The order of a folder listing is arbitrary; the message should not be.
            let [first, second] = if other < path { [other, path] } else { [path, other] };
            return Err(InputError::SameNumber { number, first, second });
        }
    }
    Ok(files)
}

/// The last group of digits in the name of a PNG or JPEG file, as number and as written.
fn frame_number(path: &Path) -> Option<(u64, String)> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    if !["png", "jpg", "jpeg"].contains(&extension.as_str()) {
        return None;
    }
    let stem = path.file_stem()?.to_str()?;
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |i| i + stem[i..].chars().next().map_or(1, char::len_utf8));
    let digits = &stem[start..end];
    Some((digits.parse().ok()?, digits.to_owned()))
}

fn load_pair(paths: &[PathBuf; 2], sizes_px: [[u32; 2]; 2]) -> Result<FramePair, InputError> {
    let name = paths[0].file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let images = [load_image(&name, &paths[0], 1, sizes_px[0])?, load_image(&name, &paths[1], 2, sizes_px[1])?];
    Ok(FramePair { name, images })
}

/// Loads one picture of camera 1 or 2 with the size that the rig file gives.
pub fn load_picture(path: &Path, camera: usize, image_size_px: [u32; 2]) -> Result<RgbImage, InputError> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    load_image(&name, path, camera, image_size_px)
}

fn load_image(frame: &str, path: &Path, camera: usize, expected: [u32; 2]) -> Result<RgbImage, InputError> {
    let frame = || frame.to_owned();
    let damaged = |source| InputError::Damaged { frame: frame(), path: path.to_owned(), source };
    let read_error = |source| InputError::Read { path: path.to_owned(), source };
    let bytes = std::fs::read(path).map_err(read_error)?;
    let reader = ImageReader::new(Cursor::new(&bytes)).with_guessed_format().map_err(read_error)?;
    let format = reader.format();
    let decoder = reader.into_decoder().map_err(|source| match source {
        ImageError::Unsupported(_) => InputError::NotAnImage { frame: frame(), path: path.to_owned() },
        source => damaged(source),
    })?;

    // From the header, so that a wrong or huge image costs no decoding.
    let (width, height) = decoder.dimensions();
    if [width, height] != expected {
        let path = path.to_owned();
        return Err(InputError::ImageSize { frame: frame(), path, camera, found: [width, height], expected });
    }
    let color = decoder.color_type();
    if color != ColorType::Rgb8 {
        return Err(InputError::PixelFormat { frame: frame(), path: path.to_owned(), found: pixel_format(color) });
    }
    // The JPEG decoder fills what is missing with grey instead of complaining.
    if format == Some(image::ImageFormat::Jpeg) && !jpeg_is_complete(&bytes) {
        return Err(InputError::Truncated { frame: frame(), path: path.to_owned() });
    }
    Ok(DynamicImage::from_decoder(decoder).map_err(damaged)?.into_rgb8())
}

/// Whether an end-of-image marker follows the last start of scan. Inside a scan 0xFF is always escaped, so neither
/// marker can occur there by chance.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xFF, marker]);
    let [start_of_scan, end_of_image] = [0xDA, 0xD9].map(last);
    start_of_scan < end_of_image
}

fn pixel_format(color: ColorType) -> &'static str {
    match color {
        ColorType::L8 => "8-bit grey",
        ColorType::La8 => "8-bit grey with transparency",
        ColorType::Rgb8 => "8-bit RGB",
        ColorType::Rgba8 => "8-bit RGB with transparency",
        ColorType::L16 => "16-bit grey",
        ColorType::La16 => "16-bit grey with transparency",
        ColorType::Rgb16 => "16-bit RGB",
        ColorType::Rgba16 => "16-bit RGB with transparency",
        _ => "another pixel format",
    }
}
