//! Calibration of two cameras together, in air and through tube and water.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use karst_rig::{Board, CameraModel, NORMAL_RADIUS_PX, Pose, TracedCamera, Tube, fit_axial};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, SymmetricEigen, Translation3, UnitQuaternion, Vector3};

use crate::{
    BoardSet, CalibratedCamera, CalibratedStereo, CameraError, CameraSettings, CornerList, CornerResidual, Known,
    Medium, Pair, PairReason, Parameter, RejectedPair, RejectedView, StereoError, StereoSettings, StereoWarning,
    TubeKnowledge, TubeSettings, View, ViewReason, Warning,
    bundle::{BoardView, Bundle, FreeTerm, JointUnknowns, TubeAndWater, TubeTerm},
    calibrate_camera,
    camera::{
        DEGREE_GAIN, FOLDS, FittedView, GATE_SIGMAS, MIN_VIEWS, MISFIT_PART, MISFIT_PX, MISFIT_RATIO, check_corners,
        check_settings, extent, is_mirrored, observations, report, residual_lengths, rms, robust_fit,
    },
    initial::{board_pose, median},
    refine::{Loss, Observation, POSE, Projection, Scene, Unknowns, horner_with_derivative},
    result::MIN_CORNERS,
};

/// Fewest pairs: one determines the relative pose, the others confirm it.
const MIN_PAIRS: usize = 3;
/// Pairs agree when a board is where the other camera says within this part of the image width, before refinement: for
/// cameras calibrated in air.
const AGREE_PART: f64 = 0.03;
/// The same where a camera starts from boards in water, and its rays are rough.
const ROUGH_AGREE_PART: f64 = 0.08;
/// Corners of a view that the search for the relative pose looks at.
const AGREE_CORNERS: usize = 12;
/// Lists agree about the board within this part of its size.
const BOARD_PART: f64 = 1e-3;
/// Degrees that are tried when none is given and a camera was not calibrated in air.
const WATER_DEGREES: std::ops::RangeInclusive<usize> = 4..=6;
/// Degree of what a camera seen only in water starts from.
const START_DEGREE: usize = 4;
/// Radii at which a compact model in the water is turned into one in air.
const START_RADII: u32 = 32;
/// Radius from which the rays of a camera are followed to start with, px: nearer to the axis they hardly meet the tube.
const START_RADIUS_PX: f64 = 40.0;
/// Distances in which the model to start with holds, outer radii of the tube.
const START_RANGE: [f64; 2] = [2.0, 40.0];

/// Calibrates two cameras together from boards that both see, and the tube around them from boards in water.
///
/// Each camera is calibrated on its own to start with: from its boards in air or, where it has fewer than three of these,
/// from those in water, whose compact model Snell's law takes to air. Boards in water get their first poses behind a tube
/// around the camera's own axis. The first relative pose is the one that most pairs agree with. Then both cameras, the
/// relative pose, what is not known of tube and water, and the poses of all boards are refined together, rays traced
/// through the misaligned tube exactly.
///
/// No board tells where the rig frame is: camera 1 keeps the pose given.
pub fn calibrate_stereo(sets: &[BoardSet], settings: &StereoSettings) -> Result<CalibratedStereo, StereoError> {
    check_stereo_settings(sets, settings)?;
    check_lists(sets, settings)?;
    let starts = [start(sets, settings, 0)?, start(sets, settings, 1)?];
    for camera in 0..2 {
        if starts[camera].all_mirrored && !starts[1 - camera].all_mirrored {
            return Err(StereoError::MirroredOrder { camera: camera + 1 });
        }
    }
    let mut joint = Joint::new(sets, settings, starts)?;
    joint.fit()?;
    joint.result(settings)
}

fn check_stereo_settings(sets: &[BoardSet], settings: &StereoSettings) -> Result<(), StereoError> {
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
fn stem(name: &str) -> &str {
    let path = Path::new(name);
    let is_type = |extension: &std::ffi::OsStr| extension.to_string_lossy().contains(char::is_alphabetic);
    let part = if path.extension().is_some_and(is_type) { path.file_stem() } else { path.file_name() };
    part.and_then(|part| part.to_str()).unwrap_or(name)
}

/// Name of a view or pair with that of its set.
fn full_name(set: &BoardSet, name: &str) -> String {
    if set.name.is_empty() { name.to_owned() } else { format!("{}/{name}", set.name) }
}

/// The views of both cameras with the same name.
fn same_names(set: &BoardSet) -> impl Iterator<Item = [&View; 2]> {
    let [first, second] = &set.corners;
    let of_name: HashMap<&str, &View> = second.views.iter().map(|view| (stem(&view.name), view)).collect();
    first.views.iter().filter_map(move |view| Some([view, *of_name.get(stem(&view.name))?]))
}

fn check_lists(sets: &[BoardSet], settings: &StereoSettings) -> Result<(), StereoError> {
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
            let both: Vec<(usize, [f64; 2], [f64; 2])> =
                second.corners.iter().filter_map(|c| Some((c.index, *index_of.get(&c.index)?, c.board_mm))).collect();
            common += both.len();
            let size = |of: fn(&(usize, [f64; 2], [f64; 2])) -> [f64; 2]| extent(both.iter().map(|c| of(c).into()));
            let (first_size, second_size) = (size(|c| c.1), size(|c| c.2));
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

/// A view in use.
struct Picture {
    name: String,
    in_water: bool,
    corners: Vec<Observation>,
    /// Board frame to camera frame, to start with.
    pose: Isometry3<f64>,
}

/// A camera to start with.
struct Start {
    air: CameraModel,
    /// As it sees boards in water; that in air where there are none.
    water: CameraModel,
    /// Whether it was not calibrated in air.
    from_water: bool,
    /// None: still to be chosen.
    degree: Option<usize>,
    degrees: Vec<(usize, f64)>,
    pictures: Vec<Picture>,
    rejected: Vec<RejectedView>,
    all_mirrored: bool,
}

fn start(sets: &[BoardSet], settings: &StereoSettings, camera: usize) -> Result<Start, StereoError> {
    let own = &settings.cameras[camera];
    let views_in = |medium| {
        let sets = sets.iter().filter(move |set| set.medium == medium);
        let views = sets.flat_map(|set| {
            set.corners[camera].views.iter().map(|view| View { name: full_name(set, &view.name), ..view.clone() })
        });
        CornerList { views: views.collect(), image_size_px: None }
    };
    let (in_air, in_water) = (views_in(Medium::Air), views_in(Medium::Water));
    let from_water = in_air.views.len() < MIN_VIEWS && !in_water.views.is_empty();
    let calibrated = if from_water {
        calibrate_camera(&in_water, &CameraSettings { degree: Some(START_DEGREE), tangential: false, ..*own })
    } else {
        calibrate_camera(&in_air, own)
    };
    let calibrated = calibrated.map_err(|source| StereoError::Camera { camera: camera + 1, source })?;
    let degree = if from_water { own.degree } else { Some(calibrated.degree) };
    let mut air = calibrated.model.clone();
    if let (true, Some(tube)) = (from_water, &settings.tube) {
        air.polynomial = polynomial_in_air(&calibrated, &in_water, tube).ok_or(StereoError::Camera {
            camera: camera + 1,
            source: CameraError::Unobservable { quantity: "the polynomial in air" },
        })?;
    }
    let water = match &settings.tube {
        Some(tube) if !in_water.views.is_empty() => behind_coaxial_tube(&air, tube, &in_water)
            .map_err(|source| StereoError::Water { camera: camera + 1, source })?,
        _ => air.clone(),
    };
    let mut start = Start {
        air,
        water,
        from_water,
        degree,
        degrees: if from_water { Vec::new() } else { calibrated.degrees.clone() },
        pictures: Vec::new(),
        rejected: if from_water { Vec::new() } else { calibrated.rejected_views.clone() },
        all_mirrored: calibrated.warnings.contains(&Warning::AllMirrored),
    };
    if !from_water {
        let views: HashMap<&str, &View> = in_air.views.iter().map(|view| (view.name.as_str(), view)).collect();
        for used in &calibrated.views {
            let corners = observations(views[used.view.as_str()]);
            start.pictures.push(Picture { name: used.view.clone(), in_water: false, corners, pose: used.pose });
        }
    }
    let placed = if from_water { in_air.views.iter() } else { [].iter() };
    for (view, in_water) in placed.map(|view| (view, false)).chain(in_water.views.iter().map(|view| (view, true))) {
        start.place(view, in_water);
    }
    Ok(start)
}

/// The polynomial in air of a camera whose compact model was calibrated in water.
fn polynomial_in_air(compact: &CalibratedCamera, list: &CornerList, settings: &TubeSettings) -> Option<Vec<f64>> {
    // A compact model holds where its boards were.
    let poses: HashMap<&str, &Isometry3<f64>> =
        compact.views.iter().map(|view| (view.view.as_str(), &view.pose)).collect();
    let distances = list.views.iter().filter_map(|view| Some((view, *poses.get(view.name.as_str())?)));
    let distances = distances.flat_map(|(view, pose)| {
        observations(view).into_iter().map(move |corner| (pose * corner.board).coords.xy().norm())
    });
    let outer = settings.tube.inner_radius_mm + settings.tube.wall_mm;
    let distance = median(distances.collect()).max(START_RANGE[0] * outer);
    let powers: Vec<usize> = std::iter::once(0).chain(2..=START_DEGREE).collect();
    let mut rows = DMatrix::zeros(START_RADII as usize, powers.len());
    let mut right = DVector::zeros(START_RADII as usize);
    for i in 0..START_RADII {
        let [inner, outer] = compact.radius_px;
        let rho = inner + (outer - inner) * f64::from(i) / f64::from(START_RADII - 1);
        let s = rho.max(START_RADIUS_PX) / NORMAL_RADIUS_PX;
        let (f, _) = horner_with_derivative(&compact.model.polynomial, s);
        let slope = settings.tube.air_slope(settings.water_index, distance, distance * f / s);
        for (k, &power) in powers.iter().enumerate() {
            rows[(i as usize, k)] = s.powi(power as i32 - 1);
        }
        right[i as usize] = slope;
    }
    let solution = rows.svd(true, true).solve(&right, 1e-12).ok()?;
    let mut polynomial = vec![0.0; START_DEGREE + 1];
    for (&power, a) in powers.iter().zip(&solution) {
        polynomial[power] = *a;
    }
    polynomial.iter().all(|a| a.is_finite()).then_some(polynomial)
}

/// A camera as it sees boards in water if it is on the tube's axis.
fn behind_coaxial_tube(
    air: &CameraModel,
    settings: &TubeSettings,
    list: &CornerList,
) -> Result<CameraModel, karst_rig::FitError> {
    let radii =
        list.views.iter().flat_map(|view| &view.corners).map(|corner| air.corrected(corner.pixel.into()).norm());
    let [inner, outer] = radii.fold([f64::INFINITY, 0.0], |[least, most], r: f64| [least.min(r), most.max(r)]);
    let origin = Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] };
    let tube = Tube { pose: origin, ..settings.tube };
    let traced = TracedCamera {
        air: CameraModel { pose: origin, ..air.clone() },
        tube,
        water_index: settings.water_index,
        max_radius_px: outer,
    };
    let range_mm = START_RANGE.map(|radii| radii * (tube.inner_radius_mm + tube.wall_mm));
    let (model, _) = fit_axial(&traced, [inner.max(START_RADIUS_PX), outer], range_mm)?;
    Ok(model)
}

impl Start {
    fn model(&self, in_water: bool) -> &CameraModel {
        if in_water { &self.water } else { &self.air }
    }

    /// Uses or rejects a view whose pose is still unknown.
    fn place(&mut self, view: &View, in_water: bool) {
        let name = view.name.clone();
        let corners = observations(view);
        let mut reject =
            |reason, residual_px| self.rejected.push(RejectedView { view: name.clone(), reason, residual_px });
        if corners.len() < MIN_CORNERS {
            return reject(ViewReason::TooFewCorners, None);
        }
        let model = if in_water { &self.water } else { &self.air };
        let Some(pose) = board_pose(model, &corners) else { return reject(ViewReason::NotTheBoard, None) };
        let mut scene = Scene { model: model.clone(), poses: vec![pose] };
        let views = [corners];
        robust_fit(&mut scene, &views, &Unknowns { poses: true, ..Unknowns::default() });
        let residual = median(residual_lengths(&scene, &views).concat());
        let [corners] = views;
        let size = extent(corners.iter().map(|corner| corner.pixel));
        // Also true for NaN.
        if !(residual <= MISFIT_PX.max(MISFIT_PART * size)) {
            return reject(ViewReason::NotTheBoard, Some(residual).filter(|r| r.is_finite()));
        }
        let [pose] = scene.poses.as_slice() else { return };
        if is_mirrored(pose) != self.all_mirrored {
            return reject(ViewReason::Mirrored, Some(residual));
        }
        self.pictures.push(Picture { name, in_water, corners, pose: *pose });
    }
}

/// Half a turn of a board, from corner 0 to the last one.
fn half_turn(board: &Board) -> Isometry3<f64> {
    let [x, y] = board.corner_mm(board.corners() - 1);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    Isometry3::from_parts(Translation3::new(x, y, 0.0), turn)
}

/// Views of one board by both cameras, as places in the lists of pictures, and the name of the pair.
struct Candidate {
    name: String,
    pictures: [usize; 2],
}

/// What the pairs say about the relative pose.
struct Pairing {
    /// Frame of camera 2 to frame of camera 1.
    relative: Isometry3<f64>,
    /// The pairs that agree, and whether the view of camera 2 is numbered from the other end.
    agreed: Vec<(Candidate, bool)>,
    rejected: Vec<RejectedPair>,
}

fn pair_up(sets: &[BoardSet], settings: &StereoSettings, starts: &[Start; 2]) -> Result<Pairing, StereoError> {
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
    let rough = starts.iter().any(|start| start.from_water);
    let part = if rough { ROUGH_AGREE_PART } else { AGREE_PART };
    let limit = part * f64::from(settings.cameras[1].image_size_px[0]);
    let pictures = |candidate: &Candidate| {
        let [first, second] = candidate.pictures;
        (&starts[0].pictures[first], &starts[1].pictures[second])
    };
    // How far the view of camera 2 is from where camera 1 says, px, and the turn with which it is nearest.
    let misfit = |relative: &Isometry3<f64>, candidate: &Candidate| {
        let (first, second) = pictures(candidate);
        let model = starts[1].model(second.in_water);
        let of_turn = |(turned, turn): &(bool, Isometry3<f64>)| {
            let pose = relative.inverse() * first.pose * turn;
            let step = second.corners.len().div_ceil(AGREE_CORNERS);
            let lengths = second.corners.iter().step_by(step).map(|corner| {
                let seen = Projection::new(model, pose * corner.board, corner.pixel);
                seen.map_or(f64::INFINITY, |seen| (corner.pixel - seen.pixel).norm())
            });
            (median(lengths.collect()), *turned)
        };
        turns.iter().map(of_turn).fold((f64::INFINITY, false), |best, new| if new.0 < best.0 { new } else { best })
    };
    let trials = candidates.iter().flat_map(|candidate| {
        let (first, second) = pictures(candidate);
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

fn disagree(pair: String, residual: f64) -> RejectedPair {
    let residual_px = Some(residual).filter(|residual| residual.is_finite());
    RejectedPair { pair, reason: PairReason::Disagree, residual_px }
}

/// Everything in one fit.
struct Joint {
    bundle: Bundle,
    unknowns: JointUnknowns,
    views: Vec<BoardView>,
    /// For each board the name of the pair and whether its second view is numbered from the other end, if it is a pair.
    pairs: Vec<Option<(String, bool)>>,
    rejected_pairs: Vec<RejectedPair>,
    single_views: Vec<(usize, String)>,
    rejected_views: [Vec<RejectedView>; 2],
    degrees: [Vec<(usize, f64)>; 2],
    /// Whether the degree is still to be chosen.
    choose: [bool; 2],
    all_mirrored: bool,
}

impl Joint {
    fn new(sets: &[BoardSet], settings: &StereoSettings, starts: [Start; 2]) -> Result<Self, StereoError> {
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
        let paired: HashSet<String> = sets
            .iter()
            .flat_map(|set| same_names(set).flat_map(|views| views.map(|view| full_name(set, &view.name))))
            .collect();
        let mut rejected_views = [Vec::new(), Vec::new()];
        let mut degrees = [Vec::new(), Vec::new()];
        let choose = [0, 1].map(|camera| starts[camera].degree.is_none());
        let all_mirrored = starts[0].all_mirrored;
        let mut unknowns = JointUnknowns { relative: true, ..JointUnknowns::default() };
        let models = [0, 1].map(|camera| starts[camera].air.clone());
        for (camera, start) in starts.into_iter().enumerate() {
            let degree = start.degree.unwrap_or(*WATER_DEGREES.end());
            unknowns.cameras[camera] = Unknowns::of_degree(degree, settings.cameras[camera].tangential);
            rejected_views[camera] = start.rejected;
            degrees[camera] = start.degrees;
            for (picture, taken) in start.pictures.into_iter().zip(&taken[camera]) {
                let Picture { name, in_water, mut corners, pose } = picture;
                if !paired.contains(&name) {
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

    fn fit(&mut self) -> Result<(), StereoError> {
        self.bundle.robust_fit(&self.views, &self.unknowns);
        self.split_misfits()?;
        self.bundle.robust_fit(&self.views, &self.unknowns);
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
                unknowns.cameras[camera] =
                    Unknowns { tangential: unknowns.cameras[camera].tangential, ..Unknowns::of_degree(degree, false) };
                bundle.models[camera].polynomial.truncate(degree + 1);
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
fn holdout(bundle: &Bundle, views: &[BoardView], unknowns: &JointUnknowns, limit_px: f64) -> Option<f64> {
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

impl Joint {
    fn result(mut self, settings: &StereoSettings) -> Result<CalibratedStereo, StereoError> {
        let loss = self.bundle.final_fit(&self.views, &self.unknowns);
        let (bundle, views, unknowns) = (&self.bundle, &self.views, &self.unknowns);
        let sigma = bundle.sigma(views);
        let limit_px = GATE_SIGMAS * sigma;
        let covariance = bundle
            .covariance(views, unknowns, loss)
            .ok_or_else(|| StereoError::Unobservable { quantity: self.weakest(loss, sigma) })?;
        let lengths = bundle.lengths(views);
        let inliers: Vec<BoardView> = views
            .iter()
            .zip(&lengths)
            .map(|(view, lengths)| {
                let inliers = view.corners.iter().zip(lengths).filter(|(_, length)| **length <= limit_px);
                BoardView { corners: inliers.map(|(corner, _)| *corner).collect(), ..view.clone() }
            })
            .collect();
        let holdout_rms_px = holdout(bundle, &inliers, unknowns, f64::INFINITY);
        let camera = |camera: usize| {
            let fitted: Vec<FittedView> = views
                .iter()
                .zip(&lengths)
                .filter(|(view, _)| view.camera == camera)
                .map(|(view, lengths)| FittedView {
                    name: &view.name,
                    pose: bundle.camera_poses[camera].inv_mul(&bundle.boards[view.board]),
                    corners: &view.corners,
                    lengths: lengths.clone(),
                })
                .collect();
            let (from, terms) = (unknowns.camera_column(camera), &unknowns.cameras[camera]);
            let own = covariance.view((from, from), (terms.len(), terms.len())).into_owned();
            let model = CameraModel { pose: bundle.camera_poses[camera].into(), ..bundle.models[camera].clone() };
            let mut result = report(&model, &fitted, terms, &settings.cameras[camera], &own, limit_px)
                .map_err(|source| StereoError::Camera { camera: camera + 1, source })?;
            result.holdout_rms_px = holdout_rms_px;
            result.degrees.clone_from(&self.degrees[camera]);
            result.rejected_views.clone_from(&self.rejected_views[camera]);
            if self.all_mirrored {
                result.warnings.push(Warning::AllMirrored);
            }
            Ok(result)
        };
        let cameras = [camera(0)?, camera(1)?];

        let relative = bundle.camera_poses[0].inv_mul(&bundle.camera_poses[1]);
        let from = unknowns.relative_column();
        let in_rig: Matrix6<f64> = covariance.fixed_view::<POSE, POSE>(from, from).into_owned();
        let mut to_camera = Matrix6::zeros();
        let turn = bundle.camera_poses[0].rotation.inverse().to_rotation_matrix();
        for at in [0, 3] {
            to_camera.fixed_view_mut::<3, 3>(at, at).copy_from(turn.matrix());
        }
        let relative_covariance = to_camera * in_rig * to_camera.transpose();
        let baseline_mm = relative.translation.vector.norm();
        let along = relative.translation.vector / baseline_mm;
        let variance = along.dot(&(relative_covariance.fixed_view::<3, 3>(3, 3) * along));

        let globals = unknowns.len();
        let names = parameter_names(unknowns);
        let parameters: Vec<Parameter> = (names.into_iter().enumerate())
            .map(|(column, (name, unit))| Parameter { name, unit, sigma: covariance[(column, column)].sqrt() })
            .collect();
        let residuals = self.residuals(limit_px);
        let pairs = self.pairs.iter().enumerate().filter_map(|(board, pair)| {
            let (pair, turned) = pair.clone()?;
            let of_camera = |camera: usize| {
                let own = views.iter().zip(&lengths).filter(|(view, _)| view.board == board && view.camera == camera);
                rms(own.flat_map(|(_, lengths)| lengths.iter().copied()))
            };
            Some(Pair { pair, rms_px: [of_camera(0), of_camera(1)], turned })
        });
        let all = || lengths.iter().flatten().copied();
        let mut result = CalibratedStereo {
            relative,
            relative_covariance,
            baseline_mm,
            baseline_sigma_mm: variance.sqrt(),
            rotation_deg: Pose::from(relative).rotation_deg,
            tube: bundle.tube_and_water.map(|TubeAndWater { tube, water_index }| (tube, water_index)),
            parameters,
            covariance: covariance.view((0, 0), (globals, globals)).into_owned(),
            pairs: pairs.collect(),
            rejected_pairs: self.rejected_pairs.clone(),
            single_views: self.single_views.clone(),
            residuals,
            rms_px: rms(all()),
            rms_inliers_px: rms(all().filter(|length| *length <= limit_px)),
            holdout_rms_px,
            warnings: Vec::new(),
            cameras,
        };
        result.warnings = self.warnings(&result);
        Ok(result)
    }

    /// The unknown with most part in the combination of unknowns that is known least.
    fn weakest(&self, loss: Loss, sigma: f64) -> String {
        let (mut matrix, _) = self.bundle.normal_equations(&self.views, &self.unknowns, loss, sigma);
        matrix.fill_upper_triangle_with_lower_triangle();
        let scale = matrix.diagonal().map(|value| 1.0 / value.max(f64::MIN_POSITIVE).sqrt());
        let scaled = DMatrix::from_diagonal(&scale) * matrix * DMatrix::from_diagonal(&scale);
        let names = parameter_names(&self.unknowns);
        let part = SymmetricEigen::try_new(scaled, f64::EPSILON, 10_000).map(|eigen| {
            let weakest = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
            weakest.rows(0, names.len()).iamax()
        });
        part.and_then(|column| names.get(column)).map_or_else(|| "some quantity".to_owned(), |(name, _)| name.clone())
    }

    fn residuals(&self, limit_px: f64) -> Vec<CornerResidual> {
        let mut residuals = Vec::new();
        for (view, of_view) in self.views.iter().zip(self.bundle.residuals(&self.views)) {
            for (corner, residual) in view.corners.iter().zip(of_view) {
                residuals.push(CornerResidual {
                    view: view.name.clone(),
                    camera: view.camera + 1,
                    index: corner.index,
                    pixel: corner.pixel.into(),
                    residual_px: residual.map(Into::into),
                    inlier: residual.is_some_and(|residual| residual.norm() <= limit_px),
                });
            }
        }
        residuals
    }

    fn warnings(&self, result: &CalibratedStereo) -> Vec<StereoWarning> {
        const GOOD_PAIRS: usize = 6;
        const REJECTED_PART: f64 = 0.2;
        const SMALL_BASELINE_MM: f64 = 10.0;
        const BASELINE_PART: f64 = 1e-3;
        const TURN_RAD: f64 = 1e-3;
        /// Change against a prior, in its standard deviations.
        const IMPLAUSIBLE: f64 = 4.0;

        let mut warnings = Vec::new();
        for (camera, own) in (1..).zip(&result.cameras) {
            let own = own.warnings.iter().cloned();
            warnings.extend(own.map(|warning| StereoWarning::Camera { camera, warning }));
        }
        let (pairs, rejected) = (result.pairs.len(), result.rejected_pairs.len());
        if pairs < GOOD_PAIRS {
            warnings.push(StereoWarning::FewPairs { pairs, expected: GOOD_PAIRS });
        }
        if rejected as f64 > REJECTED_PART * (pairs + rejected) as f64 {
            warnings.push(StereoWarning::ManyRejected { rejected, pairs: pairs + rejected });
        }
        let baseline_mm = result.baseline_mm;
        if baseline_mm < SMALL_BASELINE_MM {
            warnings.push(StereoWarning::SmallBaseline { baseline_mm });
        }
        let mut check = |quantity, sigma: f64, limit: f64, unit| {
            // Also where there is no number.
            if !(sigma <= limit) {
                warnings.push(StereoWarning::Uncertain { quantity, sigma, limit, unit });
            }
        };
        check("the baseline", result.baseline_sigma_mm, BASELINE_PART * baseline_mm, "mm");
        let turn = (0..3).map(|axis| result.relative_covariance[(axis, axis)].sqrt()).fold(0.0, f64::max);
        check("the rotation of camera 2 against camera 1", turn, TURN_RAD, "rad");
        for (free, parameter) in self.unknowns.terms.iter().zip(&result.parameters[self.unknowns.terms_column()..]) {
            let (quantity, limit) = free.term.quantity_and_limit();
            check(quantity, parameter.sigma, limit, parameter.unit);
        }
        if let (Some(now), Some(nominal)) = (&self.bundle.tube_and_water, &self.unknowns.nominal) {
            for free in &self.unknowns.terms {
                let (change, unit) = (free.term.change(now, nominal), free.term.unit());
                if let Some(sigma) = free.prior.filter(|sigma| change.abs() > IMPLAUSIBLE * sigma) {
                    let (quantity, _) = free.term.quantity_and_limit();
                    warnings.push(StereoWarning::Implausible { quantity, change, sigma, unit });
                }
            }
        }
        warnings
    }
}

/// Name and unit of each unknown but for the poses of the boards.
fn parameter_names(unknowns: &JointUnknowns) -> Vec<(String, &'static str)> {
    let mut names = Vec::new();
    for (camera, terms) in (1..).zip(&unknowns.cameras) {
        let mut add = |name: String, unit| names.push((format!("camera{camera}.{name}"), unit));
        for power in &terms.powers {
            add(format!("polynomial[{power}]"), "");
        }
        for axis in 0..2 {
            add(format!("centre_px[{axis}]"), "px");
        }
        add("affine[0]".to_owned(), "");
        add("shear".to_owned(), "");
        if terms.tangential {
            add("tangential[0]".to_owned(), "");
            add("tangential[1]".to_owned(), "");
        }
    }
    for axis in 0..3 {
        names.push((format!("camera2.turn[{axis}]"), "rad"));
    }
    for axis in 0..3 {
        names.push((format!("camera2.position_mm[{axis}]"), "mm"));
    }
    names.extend(unknowns.terms.iter().map(|free| (free.term.name(), free.term.unit())));
    names
}
