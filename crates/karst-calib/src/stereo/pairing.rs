//! Which pictures show the same board, and the first relative pose.

use std::collections::HashMap;

use karst_rig::Board;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::check::{full_name, same_names, stem};
use super::start::{Picture, Start};
use super::{BoardSet, PairReason, RejectedPair, StereoError, StereoSettings};
use crate::{bundle::BoardView, initial::median};

/// Fewest pairs: one determines the relative pose, the others confirm it.
pub(super) const MIN_PAIRS: usize = 3;
/// Pairs agree when a board is where the other camera says within this part of the image width, before refinement.
const AGREE_PART: f64 = 0.03;
/// Corners of a view that the search for the relative pose looks at.
const AGREE_CORNERS: usize = 12;

/// Half a turn of a board, from corner 0 to the last one.
pub(super) fn half_turn(board: &Board) -> Isometry3<f64> {
    let [x, y] = board.corner_mm(board.corners() - 1);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    Isometry3::from_parts(Translation3::new(x, y, 0.0), turn)
}

/// Views of one board by both cameras, as places in the lists of pictures, and the name of the pair.
pub(super) struct Candidate {
    pub name: String,
    pub pictures: [usize; 2],
}

/// What the pairs say about the relative pose.
pub(super) struct Pairing {
    /// Frame of camera 2 to frame of camera 1.
    pub relative: Isometry3<f64>,
    /// The pairs that agree, and whether the view of camera 2 is numbered from the other end.
    pub agreed: Vec<(Candidate, bool)>,
    pub rejected: Vec<RejectedPair>,
}

pub(super) fn pair_up(
    sets: &[BoardSet],
    settings: &StereoSettings,
    starts: &[Start; 2],
) -> Result<Pairing, StereoError> {
    let place: [HashMap<&str, usize>; 2] = [0, 1].map(|camera| {
        starts[camera].pictures.iter().enumerate().map(|(place, picture)| (picture.name.as_str(), place)).collect()
    });
    let (mut candidates, mut rejected) = (Vec::new(), Vec::new());
    for set in sets {
        for views in same_names(set) {
            let name = full_name(set, stem(&views[0].name));
            let places = [0, 1].map(|camera| place[camera].get(full_name(set, &views[camera].name).as_str()).copied());
            match places {
                [Some(first), Some(second)] => candidates.push(Candidate { name, pictures: [first, second] }),
                [first, _] => {
                    let reason = PairReason::View(if first.is_none() { 1 } else { 2 });
                    rejected.push(RejectedPair { pair: name, reason, residual_px: None });
                }
            }
        }
    }
    if candidates.len() < MIN_PAIRS {
        return Err(StereoError::TooFewPairs { found: candidates.len(), expected: MIN_PAIRS, rejected });
    }
    let turns: Vec<(bool, Isometry3<f64>)> = match &settings.board {
        Some(board) if (board.columns + board.rows).is_multiple_of(2) => {
            vec![(false, Isometry3::identity()), (true, half_turn(board))]
        }
        _ => vec![(false, Isometry3::identity())],
    };
    let limit = AGREE_PART * f64::from(settings.cameras[1].image_size_px[0]);
    // Some corners of each view of camera 2.
    let sparse: Vec<[BoardView; 1]> = starts[1].pictures.iter().map(sparse_view).collect();
    // How far the view of camera 2 is from where camera 1 says, px, and the turn with which it is nearest.
    let misfit = |relative: &Isometry3<f64>, candidate: &Candidate| {
        let [first, second] = candidate.pictures;
        let of_turn = |(turned, turn): &(bool, Isometry3<f64>)| {
            let bundle = starts[1].alone(relative.inverse() * starts[0].pictures[first].pose * turn);
            (median(bundle.lengths(&sparse[second]).concat()), *turned)
        };
        turns.iter().map(of_turn).fold((f64::INFINITY, false), |best, new| if new.0 < best.0 { new } else { best })
    };
    let trials = candidates.iter().flat_map(|candidate| {
        let [first, second] = candidate.pictures;
        let (first, second) = (&starts[0].pictures[first], &starts[1].pictures[second]);
        turns.iter().map(move |(_, turn)| first.pose * turn * second.pose.inverse())
    });
    let cost = |relative: &Isometry3<f64>| candidates.iter().map(|c| misfit(relative, c).0.min(limit)).sum::<f64>();
    let best = trials.map(|relative| (cost(&relative), relative)).min_by(|a, b| a.0.total_cmp(&b.0));
    let relative = best.map_or_else(Isometry3::identity, |(_, relative)| relative);
    let pairs = candidates.len();
    let mut agreed = Vec::new();
    for candidate in candidates {
        let (residual, turned) = misfit(&relative, &candidate);
        if residual <= limit {
            agreed.push((candidate, turned));
        } else {
            rejected.push(disagree(candidate.name, residual));
        }
    }
    if agreed.len() < MIN_PAIRS || 2 * agreed.len() <= pairs {
        return Err(StereoError::PairsDisagree { agree: agreed.len(), pairs, rejected });
    }
    Ok(Pairing { relative, agreed, rejected })
}

/// Some corners of a picture, with its camera alone.
fn sparse_view(picture: &Picture) -> [BoardView; 1] {
    let mut view = picture.view(0, 0);
    let step = view.corners.len().div_ceil(AGREE_CORNERS).max(1);
    view.corners = view.corners.into_iter().step_by(step).collect();
    [view]
}

pub(super) fn disagree(pair: String, residual: f64) -> RejectedPair {
    let residual_px = Some(residual).filter(|residual| residual.is_finite());
    RejectedPair { pair, reason: PairReason::Disagree, residual_px }
}
