//! Corners found in painted pictures of boards.

mod common;
#[path = "common/paint.rs"]
mod paint;

use std::path::PathBuf;

use common::{SIZE, truth};
use image::{GrayImage, Luma, imageops};
use karst_calib::{
    Corner, CornerList, NotFound, PictureReason, PicturesError, find_boards, find_corners, picture_files,
};
use karst_rig::{Board, CameraModel};
use nalgebra::{Isometry3, Vector2, Vector3};
use paint::{BOARD, DARK, LIGHT, paint, poses, true_pixel};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// RMS distance of corners from where the camera sees those with the same numbers, px.
fn rms_px(corners: &[Corner], camera: &CameraModel, pose: &Isometry3<f64>, board: &Board) -> f64 {
    let off = |corner: &Corner| (Vector2::from(corner.pixel) - true_pixel(camera, pose, board, corner.index)).norm();
    (corners.iter().map(|corner| off(corner).powi(2)).sum::<f64>() / corners.len() as f64).sqrt()
}

fn first_picture() -> GrayImage {
    paint(&truth(), &poses()[0], &BOARD, 2.0)
}

#[test]
fn corners_of_painted_boards_are_right_to_50_millipixels_rms() {
    let camera = truth();
    for pose in poses() {
        let corners = find_corners(&paint(&camera, &pose, &BOARD, 2.0), &BOARD).unwrap();
        assert_eq!(corners.len(), BOARD.corners());
        let rms = rms_px(&corners, &camera, &pose, &BOARD);
        println!("{rms:.4} px rms");
        assert!(rms <= 0.05, "{rms} px");
        assert!(corners.iter().all(|corner| corner.board_mm == BOARD.corner_mm(corner.index)));
    }
}

#[test]
fn a_board_of_odd_sum_turned_by_180_degrees_keeps_its_numbers() {
    let camera = truth();
    let [x, y] = BOARD.corner_mm(BOARD.corners() - 1);
    let turn = Isometry3::translation(x, y, 0.0) * Isometry3::rotation(std::f64::consts::PI * Vector3::z());
    for pose in [poses()[1], poses()[1] * turn] {
        let corners = find_corners(&paint(&camera, &pose, &BOARD, 2.0), &BOARD).unwrap();
        assert!(rms_px(&corners, &camera, &pose, &BOARD) <= 0.05);
    }
}

#[test]
fn of_a_board_of_even_sum_corner_0_is_the_end_nearer_to_the_top_left() {
    let (camera, board) = (truth(), Board { columns: 7, rows: 5, square_mm: 50.0 });
    for pose in poses() {
        let corners = find_corners(&paint(&camera, &pose, &board, 2.0), &board).unwrap();
        let end = |index: usize| corners[index].pixel[0] + corners[index].pixel[1];
        assert!(end(0) < end(board.corners() - 1));
        let opposite = |corner: &Corner| Corner { index: board.corners() - 1 - corner.index, ..*corner };
        let turned: Vec<Corner> = corners.iter().map(opposite).collect();
        assert!(rms_px(&corners, &camera, &pose, &board).min(rms_px(&turned, &camera, &pose, &board)) <= 0.05);
    }
}

#[test]
fn a_square_board_has_a_dark_square_outside_of_corner_0() {
    let (camera, board) = (truth(), Board { columns: 6, rows: 6, square_mm: 45.0 });
    for pose in poses() {
        let picture = paint(&camera, &pose, &board, 2.0);
        let corners = find_corners(&picture, &board).unwrap();
        // Half a square outside.
        let [a, b] = [0, 7].map(|index| Vector2::from(corners[index].pixel));
        let outside = a - 0.5 * (b - a);
        let grey = picture.get_pixel(outside.x.round() as u32, outside.y.round() as u32).0[0];
        assert!(f64::from(grey) < 0.5 * (DARK + LIGHT), "{grey}");
    }
}

#[test]
fn a_picture_turned_by_90_degrees_has_the_same_corners() {
    let picture = first_picture();
    let corners = find_corners(&picture, &BOARD).unwrap();
    let turned = find_corners(&imageops::rotate90(&picture), &BOARD).unwrap();
    let top = f64::from(SIZE[1]) - 1.0;
    for (corner, turned) in corners.iter().zip(&turned) {
        let expected = Vector2::new(top - corner.pixel[1], corner.pixel[0]);
        let off = (Vector2::from(turned.pixel) - expected).norm();
        assert!(corner.index == turned.index && off < 1e-3, "{off} px");
    }
}

#[test]
fn dim_and_hazy_and_noisy_pictures_are_no_obstacle() {
    let (camera, pose) = (truth(), poses()[2]);
    for (noise, level, contrast, limit) in [(2.0, 0.0, 0.2, 0.1), (2.0, 150.0, 0.15, 0.1), (12.0, 0.0, 1.0, 0.1)] {
        let mut picture = paint(&camera, &pose, &BOARD, noise);
        for pixel in picture.pixels_mut() {
            pixel.0[0] = (level + contrast * f64::from(pixel.0[0])).round() as u8;
        }
        let corners = find_corners(&picture, &BOARD).unwrap();
        let rms = rms_px(&corners, &camera, &pose, &BOARD);
        println!("{rms:.4} px rms");
        assert!(corners.len() == BOARD.corners() && rms <= limit, "{rms} px");
    }
}

#[test]
fn blurred_pictures_are_no_obstacle() {
    let (camera, pose) = (truth(), poses()[3]);
    let picture = imageops::blur(&paint(&camera, &pose, &BOARD, 2.0), 2.0);
    let corners = find_corners(&picture, &BOARD).unwrap();
    let rms = rms_px(&corners, &camera, &pose, &BOARD);
    println!("{rms:.4} px rms");
    assert!(corners.len() == BOARD.corners() && rms <= 0.1, "{rms} px");
}

#[test]
fn a_hidden_corner_is_left_out_and_the_others_keep_their_numbers() {
    let (camera, pose) = (truth(), poses()[4]);
    let mut picture = paint(&camera, &pose, &BOARD, 2.0);
    let hidden = true_pixel(&camera, &pose, &BOARD, 21);
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        if (Vector2::new(f64::from(x), f64::from(y)) - hidden).norm() < 12.0 {
            pixel.0[0] = 100;
        }
    }
    let corners = find_corners(&picture, &BOARD).unwrap();
    assert!(corners.len() >= 49 && corners.iter().all(|corner| corner.index != 21), "{}", corners.len());
    let beside = |corner: &&Corner| (Vector2::from(corner.pixel) - hidden).norm() > 60.0;
    let far: Vec<Corner> = corners.iter().filter(beside).copied().collect();
    assert!(rms_px(&far, &camera, &pose, &BOARD) <= 0.05);
}

#[test]
fn no_board_is_not_found() {
    let grey = GrayImage::from_pixel(320, 240, Luma([120]));
    assert_eq!(find_corners(&grey, &BOARD), Err(NotFound::NoBoard { candidates: 0 }));
}

#[test]
fn another_board_is_not_found_and_its_size_is_named() {
    let message = |board: Board| find_corners(&first_picture(), &board).unwrap_err().to_string();
    let wider = message(Board { columns: 10, ..BOARD });
    assert!(wider.starts_with("54 corners of a grid of 9 x 6, expected all of 10 x 6"), "{wider}");
    let smaller = message(Board { columns: 5, rows: 8, ..BOARD });
    assert!(smaller.starts_with("54 corners of a grid of 9 x 6, expected all of 8 x 5"), "{smaller}");
    assert_eq!(message(Board { rows: 2, ..BOARD }), "a board of 9 x 2 corners, expected 3 to 200 along each side");
    assert!(find_corners(&first_picture(), &Board { columns: usize::MAX, ..BOARD }).is_err());
}

#[test]
fn half_a_board_is_not_found() {
    let (camera, pose) = (truth(), poses()[0]);
    let mut picture = paint(&camera, &pose, &BOARD, 2.0);
    let middle = true_pixel(&camera, &pose, &BOARD, 22).x as u32;
    picture.enumerate_pixels_mut().filter(|(x, ..)| *x > middle).for_each(|(.., pixel)| pixel.0[0] = 90);
    let error = find_corners(&picture, &BOARD).unwrap_err();
    assert!(matches!(error, NotFound::OtherGrid { .. } | NotFound::Unclear { .. }), "{error}");
}

/// A folder with these pictures.
fn folder(pictures: &[(&str, &GrayImage)]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    for (name, picture) in pictures {
        picture.save(folder.path().join(name)).unwrap();
    }
    let path = folder.path().to_owned();
    (folder, path)
}

#[test]
fn every_picture_of_a_folder_is_a_view_or_rejected_with_its_reason() {
    let picture = first_picture();
    let blank = GrayImage::new(SIZE[0], SIZE[1]);
    let (_folder, path) = folder(&[("b.png", &picture), ("a.png", &picture), ("c.png", &blank)]);
    std::fs::write(path.join("d.png"), "no picture").unwrap();
    let files = picture_files(&[path]).unwrap();
    let found = find_boards(&files, &BOARD, None, || ()).unwrap();
    let names: Vec<&str> = found.list.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!((names, found.list.image_size_px), (vec!["a.png", "b.png"], Some(SIZE)));
    let [blank, damaged] = &found.rejected[..] else { panic!("{:?}", found.rejected) };
    assert!(blank.picture == "c.png" && matches!(blank.reason, PictureReason::NotFound(_)), "{blank}");
    assert!(damaged.picture == "d.png" && matches!(damaged.reason, PictureReason::Unreadable(_)), "{damaged}");

    let again = CornerList::from_csv(&found.list.to_csv(), "").unwrap();
    for (view, again) in found.list.views.iter().zip(&again.views) {
        for (corner, again) in view.corners.iter().zip(&again.corners) {
            let off = (Vector2::from(corner.pixel) - Vector2::from(again.pixel)).norm();
            assert!((corner.index, corner.board_mm) == (again.index, again.board_mm) && off < 1e-4);
        }
    }
}

#[test]
fn pictures_of_two_sizes_are_refused_by_name() {
    let picture = first_picture();
    let small = GrayImage::new(640, 480);
    let (_folder, path) = folder(&[("a.png", &picture), ("b.png", &small)]);
    let error = find_boards(&picture_files(&[path]).unwrap(), &BOARD, None, || ()).unwrap_err();
    assert!(matches!(error, PicturesError::Size { found: [640, 480], expected: SIZE, .. }));
    assert!(error.to_string().contains("b.png: found 640 x 480 px, expected 1024 x 768 px"), "{error}");
}

#[test]
fn missing_files_and_empty_folders_are_named() {
    let (_folder, path) = folder(&[]);
    assert!(matches!(picture_files(std::slice::from_ref(&path)), Err(PicturesError::NoPictures(_))));
    let error = picture_files(&[path.join("none.png")]).unwrap_err().to_string();
    assert!(error.contains("none.png"), "{error}");
}

#[test]
fn tiny_and_flat_and_noisy_pictures_have_no_board() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let sizes = [(0, 0), (1, 1), (3, 3), (1, 500), (11, 11), (200, 150), (1024, 768)];
    for (width, height) in sizes {
        let flat = GrayImage::from_pixel(width, height, Luma([255]));
        let noise = GrayImage::from_fn(width, height, |_, _| Luma([random.random()]));
        let extremes = GrayImage::from_fn(width, height, |_, _| Luma([if random.random() { 255 } else { 0 }]));
        // A lattice without end.
        let tiles = GrayImage::from_fn(width, height, |x, y| Luma([if (x / 9 + y / 9) % 2 == 0 { 255 } else { 0 }]));
        for picture in [flat, noise, extremes, tiles] {
            assert!(find_corners(&picture, &BOARD).is_err(), "{width} x {height}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_picture_is_accepted_or_refused(
        width in 1_u32..60,
        height in 1_u32..60,
        square in 1_u32..12,
        seed: u64,
        noise in 0.0_f64..1.0,
    ) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let picture = GrayImage::from_fn(width, height, |x, y| {
            let tile = if (x / square + y / square) % 2 == 0 { 255 } else { 0 };
            Luma([if random.random_bool(noise) { random.random() } else { tile }])
        });
        for (columns, rows) in [(3, 3), (4, 3), (9, 6)] {
            let board = Board { columns, rows, square_mm: 10.0 };
            if let Ok(corners) = find_corners(&picture, &board) {
                prop_assert!(corners.len() <= board.corners());
            }
        }
    }
}
