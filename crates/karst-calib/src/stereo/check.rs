//! Settings and corner lists before the calibration, and how pictures are named and paired.

use std::collections::{HashMap, HashSet};
use std::ffi::OsStr;
use std::path::Path;

use karst_rig::{Board, Medium};

use super::pairing::MIN_PAIRS;
use super::{BoardSet, Known, StereoError, StereoSettings, TubeKnowledge, TubeSettings};
use crate::{
    View,
    camera::{check_corners, check_settings, extent},
};

/// Lists agree about the board within this part of its size.
const BOARD_PART: f64 = 1e-3;

pub(super) fn settings(sets: &[BoardSet], settings: &StereoSettings) -> Result<(), StereoError> {
    let wrong = |what, found: String, expected| Err(StereoError::Setting { what, found, expected });
    for (camera, own) in settings.cameras.iter().enumerate() {
        check_settings(own).map_err(|source| StereoError::Camera { camera: camera + 1, source })?;
    }
    if let Some(board) = &settings.board
        && !(board.columns >= 2 && board.rows >= 2 && board.square_mm > 0.0 && board.square_mm.is_finite())
    {
        return wrong("the board", format!("{board:?}"), "at least 2 x 2 corners and squares of some size");
    }
    let Some(TubeSettings { tube, water_index, known }) = &settings.tube else {
        return match sets.iter().any(|set| set.medium == Medium::Water) {
            true => wrong("the tube", "missing".to_owned(), "tube and water, for the boards in water"),
            false => Ok(()),
        };
    };
    let lengths = [("the tube's inner radius", tube.inner_radius_mm), ("the tube's wall", tube.wall_mm)];
    if let Some((what, value)) = lengths.into_iter().find(|(_, value)| !(*value > 0.0 && value.is_finite())) {
        return wrong(what, format!("{value} mm"), "a positive length, mm");
    }
    let indices = [("the wall's refractive index", tube.index), ("the water's refractive index", *water_index)];
    if let Some((what, value)) = indices.into_iter().find(|(_, value)| !(1.0..=3.0).contains(value)) {
        return wrong(what, value.to_string(), "1 to 3");
    }
    let TubeKnowledge { offset_mm, tilt_mrad, inner_radius_mm, wall_mm, wall_index, water_index } = *known;
    for known in [offset_mm, tilt_mrad, inner_radius_mm, wall_mm, wall_index, water_index] {
        if let Known::Within(sigma) = known
            && !(sigma > 0.0 && sigma.is_finite())
        {
            return wrong("a standard deviation of tube or water", sigma.to_string(), "a positive number");
        }
    }
    Ok(())
}

/// Name of a picture without folder and extension.
pub(super) fn stem(name: &str) -> &str {
    let path = Path::new(name);
    let is_type = |extension: &OsStr| extension.to_string_lossy().contains(char::is_alphabetic);
    let part = if path.extension().is_some_and(is_type) { path.file_stem() } else { path.file_name() };
    part.and_then(|part| part.to_str()).unwrap_or(name)
}

/// Name of a view or pair with that of its set.
pub(super) fn full_name(set: &BoardSet, name: &str) -> String {
    if set.name.is_empty() { name.to_owned() } else { format!("{}/{name}", set.name) }
}

/// The views of both cameras with the same name.
pub(super) fn same_names(set: &BoardSet) -> impl Iterator<Item = [&View; 2]> {
    let [first, second] = &set.corners;
    let of_name: HashMap<&str, &View> = second.views.iter().map(|view| (stem(&view.name), view)).collect();
    first.views.iter().filter_map(move |view| Some([view, *of_name.get(stem(&view.name))?]))
}

pub(super) fn lists(sets: &[BoardSet], settings: &StereoSettings) -> Result<(), StereoError> {
    let (mut pairs, mut common) = (0, 0);
    let mut seen = HashSet::new();
    for set in sets {
        for (camera, list) in set.corners.iter().enumerate() {
            check_corners(list, settings.cameras[camera].image_size_px)
                .map_err(|source| StereoError::Camera { camera: camera + 1, source })?;
            for view in &list.views {
                let name = full_name(set, stem(&view.name));
                if !seen.insert((camera, name.clone())) {
                    return Err(StereoError::SameName { camera: camera + 1, name });
                }
                check_board(set, view, settings.board.as_ref())?;
            }
        }
        for [first, second] in same_names(set) {
            pairs += 1;
            let index_of: HashMap<usize, [f64; 2]> = first.corners.iter().map(|c| (c.index, c.board_mm)).collect();
            let both = second.corners.iter().filter_map(|c| Some((c.index, *index_of.get(&c.index)?, c.board_mm)));
            let both: Vec<(usize, [f64; 2], [f64; 2])> = both.collect();
            common += both.len();
            let first_size = extent(both.iter().map(|(_, first_mm, _)| (*first_mm).into()));
            let second_size = extent(both.iter().map(|(_, _, second_mm)| (*second_mm).into()));
            let limit = BOARD_PART * first_size.min(second_size);
            let differs = |a: [f64; 2], b: [f64; 2]| (0..2).any(|axis| (a[axis] - b[axis]).abs() > limit);
            if let Some(&(index, first_mm, second_mm)) = both.iter().find(|(_, a, b)| differs(*a, *b)) {
                let (pair, ratio) = (full_name(set, stem(&first.name)), second_size / first_size);
                return Err(StereoError::BoardsDiffer { pair, index, first_mm, second_mm, ratio });
            }
        }
    }
    if pairs >= MIN_PAIRS && common == 0 {
        return Err(StereoError::NoCommonCorner);
    }
    Ok(())
}

fn check_board(set: &BoardSet, view: &View, board: Option<&Board>) -> Result<(), StereoError> {
    let Some(board) = board else { return Ok(()) };
    for corner in &view.corners {
        let known = corner.index < board.corners();
        let expected_mm = if known { board.corner_mm(corner.index) } else { [f64::NAN; 2] };
        let off = |axis: usize| (corner.board_mm[axis] - expected_mm[axis]).abs();
        // Also false for NaN.
        if !(off(0).max(off(1)) <= 10.0 * BOARD_PART * board.square_mm && known) {
            let (view, index, found_mm) = (full_name(set, &view.name), corner.index, corner.board_mm);
            return Err(StereoError::NotTheBoard { view, index, found_mm, expected_mm });
        }
    }
    Ok(())
}
