//! Each camera on its own: what the joint calibration starts from.

use std::collections::{HashMap, HashSet};

use karst_rig::{CameraModel, Medium, NORMAL_RADIUS_PX, Pose, Tube};
use nalgebra::{DMatrix, DVector, Isometry3};

use super::check::full_name;
use super::{BoardSet, StereoError, StereoSettings, TubeSettings};
use crate::{
    CalibratedCamera, CameraError, CameraSettings, CornerList, RejectedView, View, ViewReason, Warning,
    bundle::{BoardView, Bundle, JointUnknowns, TubeAndWater},
    calibrate_camera,
    camera::{MIN_VIEWS, MISFIT_PART, MISFIT_PX, extent, is_mirrored, observations},
    initial::{board_pose, board_pose_by, median},
    refine::{Observation, Unknowns, horner_with_derivative},
    result::MIN_CORNERS,
};

/// Degree of what a camera seen only in water starts from.
const START_DEGREE: usize = 4;
/// Radii at which a compact model in the water is turned into one in air.
const START_RADII: u32 = 32;
/// Radius from which the rays of a camera are followed to start with, px: nearer to the axis they hardly meet the tube.
const START_RADIUS_PX: f64 = 40.0;
/// Least distance of boards from the axis that is believed to start with, outer radii of the tube.
const START_DISTANCE: f64 = 2.0;

/// A view in use.
pub(super) struct Picture {
    pub name: String,
    pub in_water: bool,
    pub corners: Vec<Observation>,
    /// Board frame to camera frame, to start with.
    pub pose: Isometry3<f64>,
}

impl Picture {
    /// As the fit takes it.
    pub fn view(&self, camera: usize, board: usize) -> BoardView {
        let (name, corners) = (self.name.clone(), self.corners.clone());
        BoardView { camera, board, in_water: self.in_water, name, own_pose: self.pose, corners }
    }
}

/// A camera to start with.
pub(super) struct Start {
    pub air: CameraModel,
    /// Around the axis of the camera.
    tube_and_water: Option<TubeAndWater>,
    /// None: still to be chosen.
    pub degree: Option<usize>,
    pub degrees: Vec<(usize, f64)>,
    pub pictures: Vec<Picture>,
    pub rejected: Vec<RejectedView>,
    pub all_mirrored: bool,
}

impl Start {
    /// Camera 0 or 1 from its own views.
    pub fn new(sets: &[BoardSet], settings: &StereoSettings, camera: usize) -> Result<Self, StereoError> {
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
        let failed = |source| StereoError::Camera { camera: camera + 1, source };
        let calibrated = calibrated.map_err(failed)?;
        let mut air = calibrated.model.clone();
        let nominal = settings.tube.map(|TubeSettings { tube, water_index, .. }| {
            let pose = Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] };
            TubeAndWater { tube: Tube { pose, ..tube }, water_index }
        });
        if let (true, Some(nominal)) = (from_water, &nominal) {
            air.polynomial = polynomial_in_air(&calibrated, &in_water, nominal)
                .ok_or(failed(CameraError::Unobservable { quantity: "the polynomial in air" }))?;
        }
        let mut start = Self {
            air,
            tube_and_water: nominal,
            degree: if from_water { own.degree } else { Some(calibrated.degree) },
            degrees: Vec::new(),
            pictures: Vec::new(),
            rejected: Vec::new(),
            all_mirrored: calibrated.warnings.contains(&Warning::AllMirrored),
        };
        if !from_water {
            // What the compact model of a camera in water cannot follow, the traced one may.
            start.degrees = calibrated.degrees;
            start.rejected = calibrated.rejected_views;
        }
        let rejected: HashSet<String> = start.rejected.iter().map(|rejected| rejected.view.clone()).collect();
        let in_air = in_air.views.iter().filter(|view| !rejected.contains(&view.name)).map(|view| (view, false));
        let views: Vec<(&View, bool)> = in_air.chain(in_water.views.iter().map(|view| (view, true))).collect();
        if from_water {
            start.improve(&views);
        }
        for (view, in_water) in views {
            match start.place(view, in_water) {
                Ok(picture) => start.pictures.push(picture),
                Err(rejected) => start.rejected.push(rejected),
            }
        }
        Ok(start)
    }

    /// Fits a camera that starts from water to its own views, now through the tube.
    fn improve(&mut self, views: &[(&View, bool)]) {
        let placed = views.iter().filter_map(|(view, in_water)| self.place(view, *in_water).ok());
        let (mut views, mut boards) = (Vec::new(), Vec::new());
        for (board, picture) in placed.enumerate() {
            boards.push(picture.pose);
            views.push(picture.view(0, board));
        }
        let mut bundle = Bundle { boards, ..self.alone(Isometry3::identity()) };
        let own = Unknowns::of_degree(START_DEGREE, false);
        bundle.robust_fit(&views, &JointUnknowns { cameras: [own, Unknowns::default()], ..JointUnknowns::default() });
        let [air, _] = bundle.models;
        self.air = air;
    }

    /// The camera alone in its own frame, with a board.
    pub fn alone(&self, board: Isometry3<f64>) -> Bundle {
        Bundle {
            models: [self.air.clone(), self.air.clone()],
            camera_poses: [Isometry3::identity(); 2],
            tube_and_water: self.tube_and_water,
            boards: vec![board],
        }
    }

    /// Finds the pose of a view, or rejects it.
    fn place(&self, view: &View, in_water: bool) -> Result<Picture, RejectedView> {
        let name = view.name.clone();
        let rejected = |reason, residual_px| RejectedView { view: name.clone(), reason, residual_px };
        let corners = observations(view);
        if corners.len() < MIN_CORNERS {
            return Err(rejected(ViewReason::TooFewCorners, None));
        }
        let first = match &self.tube_and_water {
            Some(TubeAndWater { tube, water_index }) if in_water => {
                board_pose_by(&self.air, &corners, |slope, _, distance| {
                    tube.height_in_water(*water_index, slope, distance)
                })
            }
            _ => board_pose(&self.air, &corners),
        };
        let pose = first.ok_or_else(|| rejected(ViewReason::NotTheBoard, None))?;
        let picture = Picture { name: name.clone(), in_water, corners, pose };
        let views = [picture.view(0, 0)];
        let mut bundle = self.alone(pose);
        bundle.robust_fit(&views, &JointUnknowns::default());
        let residual = median(bundle.lengths(&views).concat());
        let size = extent(picture.corners.iter().map(|corner| corner.pixel));
        if residual.is_nan() || residual > MISFIT_PX.max(MISFIT_PART * size) {
            return Err(rejected(ViewReason::NotTheBoard, Some(residual).filter(|r| r.is_finite())));
        }
        let pose = bundle.boards.first().copied().unwrap_or(pose);
        if is_mirrored(&pose) != self.all_mirrored {
            return Err(rejected(ViewReason::Mirrored, Some(residual)));
        }
        Ok(Picture { pose, ..picture })
    }
}

/// The polynomial in air of a camera whose compact model was calibrated in water.
fn polynomial_in_air(compact: &CalibratedCamera, list: &CornerList, nominal: &TubeAndWater) -> Option<Vec<f64>> {
    // A compact model holds where its boards were.
    let poses: HashMap<&str, &Isometry3<f64>> =
        compact.views.iter().map(|view| (view.view.as_str(), &view.pose)).collect();
    let distances = list.views.iter().filter_map(|view| Some((view, *poses.get(view.name.as_str())?)));
    let distances = distances.flat_map(|(view, pose)| {
        observations(view).into_iter().map(move |corner| (pose * corner.board).coords.xy().norm())
    });
    let outer = nominal.tube.inner_radius_mm + nominal.tube.wall_mm;
    let distance = median(distances.collect()).max(START_DISTANCE * outer);
    let powers: Vec<usize> = std::iter::once(0).chain(2..=START_DEGREE).collect();
    let mut rows = DMatrix::zeros(START_RADII as usize, powers.len());
    let mut right = DVector::zeros(START_RADII as usize);
    for i in 0..START_RADII {
        let [inner, outer] = compact.radius_px;
        let rho = inner + (outer - inner) * f64::from(i) / f64::from(START_RADII - 1);
        let s = rho.max(START_RADIUS_PX) / NORMAL_RADIUS_PX;
        let (f, _) = horner_with_derivative(&compact.model.polynomial, s);
        let slope = nominal.tube.air_slope(nominal.water_index, distance, distance * f / s);
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
