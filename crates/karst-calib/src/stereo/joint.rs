//! Both cameras, the tube and all boards in one fit.

use std::collections::{HashMap, HashSet};

use nalgebra::Isometry3;

use super::check::{full_name, same_names};
use super::pairing::{Candidate, MIN_PAIRS, Pairing, disagree, half_turn, pair_up};
use super::start::{Picture, Start};
use super::{BoardSet, Known, PairReason, RejectedPair, StereoError, StereoSettings, TubeKnowledge, TubeSettings};
use crate::{
    RejectedView, ViewReason,
    bundle::{BoardView, Bundle, FreeTerm, JointUnknowns, TubeAndWater, TubeTerm},
    camera::{DEGREE_GAIN, FOLDS, GATE_SIGMAS, MISFIT_PX, MISFIT_RATIO},
    initial::median,
    refine::{Loss, Unknowns},
};

/// Degrees that are tried when none is given and a camera was not calibrated in air; the first without boards to hold out.
const WATER_DEGREES: std::ops::RangeInclusive<usize> = 4..=6;

/// Everything in one fit.
pub(super) struct Joint {
    pub bundle: Bundle,
    pub unknowns: JointUnknowns,
    pub views: Vec<BoardView>,
    /// For each board the name of the pair and whether its second view is numbered from the other end, if it is a pair.
    pub pairs: Vec<Option<(String, bool)>>,
    pub rejected_pairs: Vec<RejectedPair>,
    pub single_views: Vec<(usize, String)>,
    pub rejected_views: [Vec<RejectedView>; 2],
    pub degrees: [Vec<(usize, f64)>; 2],
    /// Whether the degree is still to be chosen.
    pub choose: [bool; 2],
    pub all_mirrored: bool,
}

impl Joint {
    pub fn new(sets: &[BoardSet], settings: &StereoSettings, starts: [Start; 2]) -> Result<Self, StereoError> {
        let Pairing { relative, agreed, rejected } = pair_up(sets, settings, &starts)?;
        let first_pose = settings.first_pose.isometry();
        let camera_poses = [first_pose, first_pose * relative];
        let (mut boards, mut pairs, mut views) = (Vec::new(), Vec::new(), Vec::new());
        let mut single_views = Vec::new();
        // Of each picture of either camera its board, if it is one of a pair.
        let mut taken = [0, 1].map(|camera| vec![None; starts[camera].pictures.len()]);
        for (Candidate { name, pictures: [first, second] }, turned) in agreed {
            taken[0][first] = Some((boards.len(), false));
            taken[1][second] = Some((boards.len(), turned));
            let turn = match &settings.board {
                Some(board) if turned => half_turn(board),
                _ => Isometry3::identity(),
            };
            let poses = [starts[0].pictures[first].pose, starts[1].pictures[second].pose * turn.inverse()];
            // The nearer camera knows better where the board is.
            let nearer = usize::from(poses[1].translation.vector.norm() < poses[0].translation.vector.norm());
            boards.push(camera_poses[nearer] * poses[nearer]);
            pairs.push(Some((name, turned)));
        }
        // Camera and name of each view that has a partner, used or not.
        let names = |set| same_names(set).flat_map(move |views| [0, 1].map(|i| (i, full_name(set, &views[i].name))));
        let paired: HashSet<(usize, String)> = sets.iter().flat_map(names).collect();
        let mut rejected_views = [Vec::new(), Vec::new()];
        let mut degrees = [Vec::new(), Vec::new()];
        let choose = [0, 1].map(|camera| starts[camera].degree.is_none());
        let all_mirrored = starts[0].all_mirrored;
        let mut unknowns = JointUnknowns { relative: true, ..JointUnknowns::default() };
        let models = [0, 1].map(|camera| starts[camera].air.clone());
        for (camera, start) in starts.into_iter().enumerate() {
            let degree = start.degree.unwrap_or(*WATER_DEGREES.start());
            unknowns.cameras[camera] = Unknowns::of_degree(degree, settings.cameras[camera].tangential);
            rejected_views[camera] = start.rejected;
            degrees[camera] = start.degrees;
            for (picture, taken) in start.pictures.into_iter().zip(&taken[camera]) {
                let Picture { name, in_water, mut corners, pose } = picture;
                if !paired.contains(&(camera, name.clone())) {
                    single_views.push((camera + 1, name.clone()));
                }
                let (board, turned) = taken.unwrap_or((boards.len(), false));
                if taken.is_none() {
                    boards.push(camera_poses[camera] * pose);
                    pairs.push(None);
                }
                let mut own_pose = pose;
                if let (true, Some(board)) = (turned, &settings.board) {
                    let turn = half_turn(board);
                    corners.iter_mut().for_each(|corner| corner.board = turn * corner.board);
                    own_pose = pose * turn.inverse();
                }
                views.push(BoardView { camera, board, in_water, name, corners, own_pose });
            }
        }
        let tube_and_water = settings
            .tube
            .filter(|_| views.iter().any(|view| view.in_water))
            .map(|TubeSettings { tube, water_index, .. }| TubeAndWater { tube, water_index });
        if let (Some(_), Some(TubeSettings { known, .. })) = (tube_and_water, &settings.tube) {
            unknowns.terms = free_terms(known);
            unknowns.nominal = tube_and_water;
        }
        let bundle = Bundle { models, camera_poses, tube_and_water, boards };
        let rejected_pairs = rejected;
        Ok(Self {
            bundle,
            unknowns,
            views,
            pairs,
            rejected_pairs,
            single_views,
            rejected_views,
            degrees,
            choose,
            all_mirrored,
        })
    }

    pub fn fit(&mut self) -> Result<(), StereoError> {
        // Misfits may hide behind worse ones.
        for _ in 0..2 {
            self.bundle.robust_fit(&self.views, &self.unknowns);
            self.split_misfits()?;
        }
        self.reject_misfits();
        self.choose_degree();
        self.bundle.robust_fit(&self.views, &self.unknowns);
        Ok(())
    }

    /// Median residual of each view, and the limit beyond which a view does not fit, px.
    fn misfits(&self) -> (Vec<f64>, f64) {
        let lengths = self.bundle.lengths(&self.views);
        let limit = (MISFIT_RATIO * median(lengths.concat())).max(MISFIT_PX);
        (lengths.into_iter().map(median).collect(), limit)
    }

    /// Makes two boards of each pair that does not fit.
    fn split_misfits(&mut self) -> Result<(), StereoError> {
        let (residuals, limit) = self.misfits();
        let worst_of = |views: &[BoardView], board: usize| {
            let of_board = views.iter().zip(&residuals).filter(|(view, _)| view.board == board);
            of_board.map(|(_, residual)| *residual).fold(0.0, f64::max)
        };
        for board in 0..self.pairs.len() {
            let worst = worst_of(&self.views, board);
            if worst > limit
                && let Some((name, _)) = self.pairs[board].take()
            {
                self.rejected_pairs.push(disagree(name, worst));
                let new = self.bundle.boards.len();
                for view in self.views.iter_mut().filter(|view| view.board == board) {
                    let pose = self.bundle.camera_poses[view.camera] * view.own_pose;
                    if view.camera == 0 {
                        self.bundle.boards[board] = pose;
                    } else {
                        self.bundle.boards.push(pose);
                        self.pairs.push(None);
                        view.board = new;
                    }
                }
            }
        }
        let agree = self.pairs.iter().flatten().count();
        let pairs = agree + self.rejected_pairs.iter().filter(|pair| pair.reason == PairReason::Disagree).count();
        if agree < MIN_PAIRS || 2 * agree <= pairs {
            return Err(StereoError::PairsDisagree { agree, pairs, rejected: self.rejected_pairs.clone() });
        }
        Ok(())
    }

    /// Rejects single views that do not fit.
    fn reject_misfits(&mut self) {
        let (residuals, limit) = self.misfits();
        let keep: Vec<bool> = self
            .views
            .iter()
            .zip(&residuals)
            .map(|(view, residual)| *residual <= limit || self.pairs[view.board].is_some())
            .collect();
        for ((view, residual), _) in self.views.iter().zip(&residuals).zip(&keep).filter(|(_, keep)| !**keep) {
            self.rejected_views[view.camera].push(RejectedView {
                view: view.name.clone(),
                reason: ViewReason::NotTheCamera,
                residual_px: Some(*residual).filter(|residual| residual.is_finite()),
            });
        }
        let mut keep = keep.into_iter();
        self.views.retain(|_| keep.next().unwrap_or(true));
        let used: HashSet<usize> = self.views.iter().map(|view| view.board).collect();
        let (bundle, views) = part_of(&self.bundle, &self.views, |board| used.contains(&board));
        let mut board = 0..;
        self.pairs.retain(|_| board.next().is_some_and(|board| used.contains(&board)));
        (self.bundle, self.views) = (bundle, views);
    }

    /// Where the degree is not known: the lowest that predicts boards held out of the fit as well as any.
    fn choose_degree(&mut self) {
        if self.choose == [false; 2] {
            return;
        }
        let limit = GATE_SIGMAS * self.bundle.sigma(&self.views);
        let mut trials = Vec::new();
        for degree in WATER_DEGREES {
            let (mut bundle, mut unknowns) = (self.bundle.clone(), self.unknowns.clone());
            for camera in (0..2).filter(|camera| self.choose[*camera]) {
                unknowns.cameras[camera] = Unknowns::of_degree(degree, unknowns.cameras[camera].tangential);
            }
            bundle.robust_fit(&self.views, &unknowns);
            let holdout = holdout(&bundle, &self.views, &unknowns, limit);
            trials.extend(holdout.map(|rms| (rms, degree, bundle, unknowns)));
        }
        let best = trials.iter().map(|(rms, ..)| *rms).fold(f64::INFINITY, f64::min);
        let by_degree: Vec<(usize, f64)> = trials.iter().map(|(rms, degree, ..)| (*degree, *rms)).collect();
        if let Some((_, _, bundle, unknowns)) = trials.into_iter().find(|(rms, ..)| *rms <= (1.0 + DEGREE_GAIN) * best)
        {
            (self.bundle, self.unknowns) = (bundle, unknowns);
        }
        for camera in (0..2).filter(|camera| self.choose[*camera]) {
            self.degrees[camera].clone_from(&by_degree);
        }
    }
}

fn free_terms(known: &TubeKnowledge) -> Vec<FreeTerm> {
    let quantities = [
        (known.offset_mm, 1.0, vec![TubeTerm::Offset(0), TubeTerm::Offset(1)]),
        (known.tilt_mrad, 1e-3, vec![TubeTerm::Tilt(0), TubeTerm::Tilt(1)]),
        (known.inner_radius_mm, 1.0, vec![TubeTerm::InnerRadius]),
        (known.wall_mm, 1.0, vec![TubeTerm::Wall]),
        (known.wall_index, 1.0, vec![TubeTerm::WallIndex]),
        (known.water_index, 1.0, vec![TubeTerm::WaterIndex]),
    ];
    let mut free = Vec::new();
    for (known, unit, terms) in quantities {
        let prior = match known {
            Known::Exactly => continue,
            Known::Within(sigma) => Some(unit * sigma),
            Known::NotAtAll => None,
        };
        free.extend(terms.into_iter().map(|term| FreeTerm { term, prior }));
    }
    free
}

/// The boards to keep and their views.
fn part_of(bundle: &Bundle, views: &[BoardView], keep: impl Fn(usize) -> bool) -> (Bundle, Vec<BoardView>) {
    let kept: Vec<usize> = (0..bundle.boards.len()).filter(|board| keep(*board)).collect();
    let place: HashMap<usize, usize> = kept.iter().enumerate().map(|(place, board)| (*board, place)).collect();
    let boards = kept.iter().map(|board| bundle.boards[*board]).collect();
    let views = views.iter().filter_map(|view| Some(BoardView { board: *place.get(&view.board)?, ..view.clone() }));
    (Bundle { boards, ..bundle.clone() }, views.collect())
}

/// RMS residual on boards that nothing was fitted to: of each, the pose comes from every other corner and the rest is
/// measured, both ways. Residuals count up to `limit_px`. None: too few boards.
pub(super) fn holdout(bundle: &Bundle, views: &[BoardView], unknowns: &JointUnknowns, limit_px: f64) -> Option<f64> {
    let boards = bundle.boards.len();
    if boards < 2 * FOLDS {
        return None;
    }
    let sigma = bundle.sigma(views);
    let loss = Loss::final_of(sigma);
    let (mut sum, mut count) = (0.0, 0);
    for fold in 0..FOLDS {
        let (mut fitted, fitted_views) = part_of(bundle, views, |board| board % FOLDS != fold);
        fitted.refine(&fitted_views, unknowns, loss, sigma);
        for board in (fold..boards).step_by(FOLDS) {
            let start = Bundle { boards: bundle.boards.clone(), ..fitted.clone() };
            for half in 0..2 {
                let (mut held, held_views) = part_of(&start, views, |other| other == board);
                let part = |half: usize| -> Vec<BoardView> {
                    let corners = |view: &BoardView| view.corners.iter().copied().skip(half).step_by(2).collect();
                    held_views.iter().map(|view| BoardView { corners: corners(view), ..view.clone() }).collect()
                };
                held.refine(&part(half), &JointUnknowns::default(), loss, sigma);
                for length in held.lengths(&part(1 - half)).concat() {
                    let residual = length.min(limit_px).min(1e3);
                    sum += residual * residual;
                    count += 1;
                }
            }
        }
    }
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}
