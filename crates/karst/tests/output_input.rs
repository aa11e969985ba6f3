//! Loading stereo frames: every way to get it wrong has its own message, and one bad frame does not end a sequence.

use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, Rgb, RgbImage, RgbaImage};
use karst::input::{FramePair, FramePairs, InputError};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const SIZE: [u32; 2] = [64, 48];

fn rgb(tint: u8) -> DynamicImage {
    RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| Rgb([(3 * x) as u8, (5 * y) as u8, tint])).into()
}

/// A folder per camera, filled with frames of the given numbers.
struct Sequence {
    _root: TempDir,
    folders: [PathBuf; 2],
}

impl Sequence {
    fn new(numbers: [&[u32]; 2]) -> Self {
        let root = tempfile::tempdir().unwrap();
        let folders = ["cam1", "cam2"].map(|name| root.path().join(name));
        for (folder, numbers) in folders.iter().zip(numbers) {
            std::fs::create_dir(folder).unwrap();
            for &number in numbers {
                rgb(number as u8).save(folder.join(format!("frame_{number:04}.png"))).unwrap();
            }
        }
        Self { _root: root, folders }
    }

    fn file(&self, camera: usize, name: &str) -> PathBuf {
        self.folders[camera].join(name)
    }

    fn open(&self) -> Result<FramePairs, InputError> {
        FramePairs::open(&self.folders[0], &self.folders[1], [SIZE; 2])
    }

    fn load(&self) -> Vec<Result<FramePair, InputError>> {
        self.open().unwrap().collect()
    }

    /// Loads frame 1 alone.
    fn load_single(&self) -> Result<FramePair, InputError> {
        let [file1, file2] = [0, 1].map(|camera| self.file(camera, "frame_0001.png"));
        load_files(&file1, &file2)
    }
}

fn load_files(file1: &Path, file2: &Path) -> Result<FramePair, InputError> {
    let mut pairs = FramePairs::open(file1, file2, [SIZE; 2])?;
    assert_eq!(pairs.len(), 1);
    pairs.next().unwrap()
}

fn assert_message(error: &InputError, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "{message:?} lacks {part:?}");
    }
}

#[test]
fn two_files_are_one_frame_named_after_the_first() {
    let pair = Sequence::new([&[1], &[1]]).load_single().unwrap();
    assert_eq!(pair.name, "frame_0001");
    assert_eq!(pair.images, [rgb(1).into_rgb8(), rgb(1).into_rgb8()]);
}

#[test]
fn folders_are_paired_by_number_in_numerical_order() {
    let sequence = Sequence::new([&[1, 2, 10], &[1, 2]]);
    rgb(10).save(sequence.file(1, "run5-left_010.PNG")).unwrap();
    std::fs::write(sequence.file(0, "notes_3.txt"), "ignored").unwrap();
    std::fs::write(sequence.file(0, "thumbnail.png"), "no number: ignored").unwrap();
    let names: Vec<_> = sequence.load().into_iter().map(|pair| pair.unwrap().name).collect();
    assert_eq!(names, ["frame_0001", "frame_0002", "frame_0010"]);
}

#[test]
fn jpeg_files_load() {
    let sequence = Sequence::new([&[], &[]]);
    for camera in [0, 1] {
        rgb(1).save(sequence.file(camera, "7.jpg")).unwrap();
    }
    assert_eq!(sequence.load()[0].as_ref().unwrap().name, "7");
}

#[test]
fn a_frame_missing_in_one_folder_is_reported_at_its_place_and_the_rest_goes_on() {
    let frames = Sequence::new([&[5, 6, 8], &[6, 7, 8]]).load();
    let summary: Vec<_> = frames.iter().map(|f| f.as_ref().map(|pair| pair.name.as_str()).map_err(|_| ())).collect();
    assert_eq!(summary, [Err(()), Ok("frame_0006"), Err(()), Ok("frame_0008")]);
    assert_message(frames[0].as_ref().unwrap_err(), &["frame 0005: missing in camera 2's", "cam2", "frame_0005.png"]);
    assert_message(frames[2].as_ref().unwrap_err(), &["frame 0007: missing in camera 1's", "cam1", "frame_0007.png"]);
}

#[test]
fn a_damaged_frame_is_reported_and_the_rest_goes_on() {
    let sequence = Sequence::new([&[1, 2, 3], &[1, 2, 3]]);
    std::fs::write(sequence.file(1, "frame_0002.png"), b"").unwrap();
    let frames = sequence.load();
    assert!(frames[0].is_ok() && frames[2].is_ok());
    assert_message(frames[1].as_ref().unwrap_err(), &["frame frame_0002", "frame_0002.png", "not an image"]);
}

#[test]
fn a_truncated_png_is_damaged() {
    let sequence = Sequence::new([&[1], &[1]]);
    let file = sequence.file(0, "frame_0001.png");
    let bytes = std::fs::read(&file).unwrap();
    // Every cut after the 8-byte signature, from inside the header to inside the end chunk's predecessor.
    for length in (9..bytes.len() - 16).step_by(7) {
        std::fs::write(&file, &bytes[..length]).unwrap();
        let error = sequence.load_single().unwrap_err();
        assert!(matches!(error, InputError::Damaged { .. }), "{length}: {error}");
        assert_message(&error, &["frame_0001.png is damaged or truncated"]);
    }
}

#[test]
fn a_truncated_jpeg_is_damaged_or_truncated() {
    let sequence = Sequence::new([&[], &[]]);
    let files = [0, 1].map(|camera| sequence.file(camera, "1.jpg"));
    files.iter().for_each(|file| rgb(1).save(file).unwrap());
    let bytes = std::fs::read(&files[1]).unwrap();
    for length in (3..bytes.len()).rev().step_by(5).skip(1) {
        std::fs::write(&files[1], &bytes[..length]).unwrap();
        let error = load_files(&files[0], &files[1]).unwrap_err();
        assert!(matches!(error, InputError::Damaged { .. } | InputError::Truncated { .. }), "{length}: {error}");
    }
}

#[test]
fn a_file_that_is_no_image_is_named() {
    let sequence = Sequence::new([&[1], &[1]]);
    std::fs::write(sequence.file(0, "frame_0001.png"), "[rig]\nname = \"x\"").unwrap();
    let error = sequence.load_single().unwrap_err();
    assert!(matches!(error, InputError::NotAnImage { .. }), "{error}");
    assert_message(&error, &["frame_0001.png is not an image: expected PNG or JPEG"]);
}

#[test]
fn another_image_format_is_refused() {
    let sequence = Sequence::new([&[1], &[1]]);
    std::fs::write(sequence.file(0, "frame_0001.png"), b"GIF89a\x40\x00\x30\x00\x00\x00\x00;").unwrap();
    assert!(matches!(sequence.load_single(), Err(InputError::NotAnImage { .. })));
}

#[test]
fn a_missing_file_or_folder_is_named() {
    let sequence = Sequence::new([&[1], &[]]);
    let error = sequence.load_single().unwrap_err();
    assert!(matches!(error, InputError::Read { .. }));
    assert_message(&error, &["cam2", "frame_0001.png", "cannot read"]);
    assert!(matches!(
        FramePairs::open("/nowhere/1".as_ref(), "/nowhere/2".as_ref(), [SIZE; 2]),
        Err(InputError::Read { .. })
    ));
}

#[test]
fn a_file_and_a_folder_do_not_pair() {
    let sequence = Sequence::new([&[1], &[1]]);
    let file = sequence.file(0, "frame_0001.png");
    for (camera1, camera2) in [(&file, &sequence.folders[1]), (&sequence.folders[1], &file)] {
        let error = FramePairs::open(camera1, camera2, [SIZE; 2]).unwrap_err();
        assert!(matches!(error, InputError::FileAndFolder { .. }));
        assert_message(&error, &["cam2 is a folder", "frame_0001.png is a file"]);
    }
}

#[test]
fn folders_without_frames_or_without_common_numbers_are_errors() {
    let error = Sequence::new([&[1], &[]]).open().unwrap_err();
    assert!(matches!(error, InputError::NoFrames(_)));
    assert_message(&error, &["cam2", "found no numbered PNG or JPEG file"]);
    let error = Sequence::new([&[1, 2], &[100, 101]]).open().unwrap_err();
    assert!(matches!(error, InputError::NoCommonNumber { .. }));
    assert_message(&error, &["frames 1 to 2", "frames 100 to 101", "no number in common"]);
}

#[test]
fn two_files_of_the_same_number_are_an_error() {
    let sequence = Sequence::new([&[1], &[1]]);
    rgb(1).save(sequence.file(0, "copy_1.png")).unwrap();
    let error = sequence.open().unwrap_err();
    assert!(matches!(error, InputError::SameNumber { number: 1, .. }));
    assert_message(&error, &["frame 1: found both", "copy_1.png and", "frame_0001.png"]);
}

#[test]
fn an_image_of_another_size_than_the_rigs_is_an_error() {
    let sequence = Sequence::new([&[1], &[1]]);
    RgbImage::new(32, 48).save(sequence.file(1, "frame_0001.png")).unwrap();
    let error = sequence.load_single().unwrap_err();
    assert!(matches!(error, InputError::ImageSize { camera: 2, found: [32, 48], expected: SIZE, .. }));
    assert_message(&error, &["frame_0001.png: found 32 x 48 px, expected 64 x 48 px for camera 2"]);
}

#[test]
fn pixel_formats_other_than_8_bit_rgb_are_errors() {
    let [width, height] = SIZE;
    let formats: [(DynamicImage, &str); 5] = [
        (GrayImage::new(width, height).into(), "8-bit grey"),
        (DynamicImage::ImageLuma16(ImageBuffer::new(width, height)), "16-bit grey"),
        (DynamicImage::ImageRgb16(ImageBuffer::new(width, height)), "16-bit RGB"),
        (RgbaImage::new(width, height).into(), "8-bit RGB with transparency"),
        (DynamicImage::ImageLumaA8(ImageBuffer::new(width, height)), "8-bit grey with transparency"),
    ];
    for (image, name) in formats {
        let sequence = Sequence::new([&[1], &[1]]);
        image.save(sequence.file(0, "frame_0001.png")).unwrap();
        let error = sequence.load_single().unwrap_err();
        assert!(matches!(error, InputError::PixelFormat { found, .. } if found == name));
        assert_message(&error, &[&format!("found {name}, expected 8-bit RGB")]);
    }
}

#[test]
fn the_content_counts_and_not_the_extension() {
    let sequence = Sequence::new([&[1], &[1]]);
    rgb(1).save_with_format(sequence.file(0, "frame_0001.png"), ImageFormat::Jpeg).unwrap();
    assert!(sequence.load_single().is_ok());
}
