//! Robust non-linear least squares over two cameras, the tube around them, the water and all boards.

use karst_rig::{CameraModel, TracedCamera, Tube};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix2, Matrix2x3, Point3, Vector2, Vector3};

use crate::refine::{
    self, Loss, Observation, POSE, Projection, UNSEEN_RESIDUAL_PX, Unknowns, by_pose, image_terms, levenberg_marquardt,
    moved_pose, sigma_px,
};

/// The optimisation ends when a step lowers the cost by less than this part: with some thousand residuals, steps then move
/// no unknown by more than some thousandths of its standard deviation.
const COST_TOLERANCE: f64 = 1e-9;
/// Step of the numeric derivative by a pixel, px.
const PIXEL_STEP_PX: f64 = 1e-3;
/// Step of the numeric derivative by a length, mm.
const LENGTH_STEP_MM: f64 = 1e-3;
/// Step of the numeric derivative by angles, indices and f / 512 px.
const RATIO_STEP: f64 = 1e-6;

/// One picture of one board.
#[derive(Debug, Clone)]
pub(crate) struct BoardView {
    /// 0 or 1.
    pub camera: usize,
    pub board: usize,
    pub in_water: bool,
    pub name: String,
    /// Board frame to camera frame by this view alone, to start with.
    pub own_pose: Isometry3<f64>,
    pub corners: Vec<Observation>,
}

/// What is between the cameras and boards under water.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TubeAndWater {
    pub tube: Tube,
    pub water_index: f64,
}

/// A term of tube and water that can be unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TubeTerm {
    /// Position across the tube's nominal axis, along its own x or y, mm.
    Offset(usize),
    /// Rotation about the tube's own x or y, rad.
    Tilt(usize),
    /// Inner radius, mm.
    InnerRadius,
    /// Wall thickness, mm.
    Wall,
    /// Refractive index of the wall.
    WallIndex,
    /// Refractive index of the water.
    WaterIndex,
}

impl TubeTerm {
    /// Field of the rig file.
    pub fn name(self) -> String {
        match self {
            Self::Offset(axis) => format!("tube.position_mm[{axis}]"),
            Self::Tilt(axis) => format!("tube.turn[{axis}]"),
            Self::InnerRadius => "tube.inner_radius_mm".to_owned(),
            Self::Wall => "tube.wall_mm".to_owned(),
            Self::WallIndex => "tube.index".to_owned(),
            Self::WaterIndex => "water.index".to_owned(),
        }
    }

    pub fn unit(self) -> &'static str {
        match self {
            Self::Offset(_) | Self::InnerRadius | Self::Wall => "mm",
            Self::Tilt(_) => "rad",
            Self::WallIndex | Self::WaterIndex => "",
        }
    }

    /// What messages call it, and the standard deviation that a usable calibration has.
    pub fn quantity_and_limit(self) -> (&'static str, f64) {
        match self {
            Self::Offset(_) => ("the tube's position across its axis", 1.0),
            Self::Tilt(_) => ("the direction of the tube's axis", 5e-3),
            Self::InnerRadius => ("the tube's inner radius", 1.0),
            Self::Wall => ("the tube's wall", 1.0),
            Self::WallIndex => ("the wall's refractive index", 0.02),
            Self::WaterIndex => ("the water's refractive index", 1e-3),
        }
    }

    fn step(self) -> f64 {
        match self {
            Self::Offset(_) | Self::InnerRadius | Self::Wall => LENGTH_STEP_MM,
            Self::Tilt(_) | Self::WallIndex | Self::WaterIndex => RATIO_STEP,
        }
    }

    fn moved(self, mut from: TubeAndWater, change: f64) -> TubeAndWater {
        let mut motion = [0.0; POSE];
        match self {
            Self::Offset(axis) => motion[3 + axis] = change,
            Self::Tilt(axis) => motion[axis] = change,
            Self::InnerRadius => from.tube.inner_radius_mm += change,
            Self::Wall => from.tube.wall_mm += change,
            Self::WallIndex => from.tube.index += change,
            Self::WaterIndex => from.water_index += change,
        }
        if motion != [0.0; POSE] {
            let pose = from.tube.pose.isometry();
            from.tube.pose = (pose * moved_pose(&Isometry3::identity(), &motion)).into();
        }
        from
    }

    /// How far the term is from its nominal value.
    pub fn change(self, now: &TubeAndWater, nominal: &TubeAndWater) -> f64 {
        let motion = || nominal.tube.pose.isometry().inv_mul(&now.tube.pose.isometry());
        match self {
            Self::Offset(axis) => motion().translation.vector[axis],
            Self::Tilt(axis) => motion().rotation.scaled_axis()[axis],
            Self::InnerRadius => now.tube.inner_radius_mm - nominal.tube.inner_radius_mm,
            Self::Wall => now.tube.wall_mm - nominal.tube.wall_mm,
            Self::WallIndex => now.tube.index - nominal.tube.index,
            Self::WaterIndex => now.water_index - nominal.water_index,
        }
    }
}

/// A term of tube and water as an unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FreeTerm {
    pub term: TubeTerm,
    /// Standard deviation of the nominal value, in the unit of the term. None: nothing is known.
    pub prior: Option<f64>,
}

/// What is unknown, in this order: the terms of camera 1, those of camera 2, the pose of camera 2, tube and water. After
/// these, always, the poses of the boards.
#[derive(Debug, Clone, Default)]
pub(crate) struct JointUnknowns {
    pub cameras: [Unknowns; 2],
    /// Pose of camera 2 in the rig frame: rotation, then position.
    pub relative: bool,
    pub terms: Vec<FreeTerm>,
    /// Where the priors are.
    pub nominal: Option<TubeAndWater>,
}

impl JointUnknowns {
    pub fn camera_column(&self, camera: usize) -> usize {
        if camera == 0 { 0 } else { self.cameras[0].len() }
    }

    pub fn relative_column(&self) -> usize {
        self.cameras[0].len() + self.cameras[1].len()
    }

    pub fn terms_column(&self) -> usize {
        self.relative_column() + if self.relative { POSE } else { 0 }
    }

    /// Number of unknowns but for the poses of the boards.
    pub fn len(&self) -> usize {
        self.terms_column() + self.terms.len()
    }
}

/// Two cameras and the boards in front of them.
#[derive(Debug, Clone)]
pub(crate) struct Bundle {
    /// The cameras in air; their own pose is not used.
    pub models: [CameraModel; 2],
    /// Camera frames to rig frame.
    pub camera_poses: [Isometry3<f64>; 2],
    /// None: there are no boards in water.
    pub tube_and_water: Option<TubeAndWater>,
    /// Board frames to rig frame.
    pub boards: Vec<Isometry3<f64>>,
}

/// A camera behind the tube with one thing changed a little.
struct Changed {
    traced: TracedCamera,
    step: f64,
    what: Change,
}

enum Change {
    /// f / 512 px, everywhere.
    Elevation,
    /// The unknown in this column.
    Unknown(usize),
}

/// A camera at one state of the bundle.
struct Eye<'a> {
    camera: usize,
    model: &'a CameraModel,
    pose: Isometry3<f64>,
    traced: Option<TracedCamera>,
}

impl Eye<'_> {
    /// Pixel of a point in the rig frame.
    fn see(&self, in_water: bool, point: Point3<f64>, near: Vector2<f64>) -> Option<Vector2<f64>> {
        if in_water {
            self.traced.as_ref()?.project_near(point, near)
        } else {
            let local = self.pose.inverse_transform_point(&point);
            Projection::new(self.model, local, near).map(|seen| seen.pixel)
        }
    }
}

impl Bundle {
    fn traced(&self, camera: usize) -> Option<TracedCamera> {
        let TubeAndWater { tube, water_index } = self.tube_and_water?;
        let air = CameraModel { pose: self.camera_poses[camera].into(), ..self.models[camera].clone() };
        Some(TracedCamera { air, tube, water_index, max_radius_px: f64::INFINITY })
    }

    fn eye(&self, camera: usize) -> Eye<'_> {
        let (model, pose) = (&self.models[camera], self.camera_poses[camera]);
        Eye { camera, model, pose, traced: self.traced(camera) }
    }

    /// Residuals of the corners of each view, observed minus expected, px. None: the camera does not see it.
    pub fn residuals(&self, views: &[BoardView]) -> Vec<Vec<Option<Vector2<f64>>>> {
        let eyes = [self.eye(0), self.eye(1)];
        let of_view = |view: &BoardView| {
            let residual = |corner: &Observation| {
                let point = self.boards[view.board] * corner.board;
                Some(corner.pixel - eyes[view.camera].see(view.in_water, point, corner.pixel)?)
            };
            view.corners.iter().map(residual).collect()
        };
        views.iter().map(of_view).collect()
    }

    /// Lengths of the residuals, px; infinite where the camera does not see the corner.
    pub fn lengths(&self, views: &[BoardView]) -> Vec<Vec<f64>> {
        let length = |residual: Option<Vector2<f64>>| residual.map_or(f64::INFINITY, |r| r.norm());
        self.residuals(views).into_iter().map(|view| view.into_iter().map(length).collect()).collect()
    }

    /// Standard deviation per axis, px.
    pub fn sigma(&self, views: &[BoardView]) -> f64 {
        sigma_px(self.lengths(views).concat())
    }

    /// Change of each term with a prior, standard deviation, and column.
    fn priors(&self, unknowns: &JointUnknowns) -> Vec<(usize, f64, f64)> {
        let (Some(now), Some(nominal)) = (&self.tube_and_water, &unknowns.nominal) else { return Vec::new() };
        let columns = unknowns.terms_column()..;
        let with_prior = columns.zip(&unknowns.terms).filter_map(|(column, free)| Some((column, free, free.prior?)));
        with_prior.map(|(column, free, sigma)| (column, free.term.change(now, nominal), sigma)).collect()
    }

    fn cost(&self, views: &[BoardView], unknowns: &JointUnknowns, loss: Loss, sigma: f64) -> f64 {
        let squares = self.residuals(views).into_iter().flatten().map(|residual| {
            let squared = residual.map_or(UNSEEN_RESIDUAL_PX.powi(2), |r| r.norm_squared());
            loss.of(squared).0
        });
        let priors = self.priors(unknowns).into_iter().map(|(_, change, prior)| (sigma * change / prior).powi(2));
        squares.sum::<f64>() + priors.sum::<f64>()
    }

    /// The cameras behind the tube with each unknown that only tracing can follow changed a little.
    fn changed(&self, camera: usize, unknowns: &JointUnknowns) -> Vec<Changed> {
        let (Some(now), Some(traced)) = (self.tube_and_water, self.traced(camera)) else { return Vec::new() };
        let mut changed = Vec::new();
        if unknowns.cameras[camera].len() > 0 {
            let mut moved = traced.clone();
            if let Some(constant) = moved.air.polynomial.first_mut() {
                *constant += RATIO_STEP;
            }
            changed.push(Changed { traced: moved, step: RATIO_STEP, what: Change::Elevation });
        }
        if unknowns.relative && camera == 1 {
            for axis in 0..POSE {
                let step = if axis < 3 { RATIO_STEP } else { LENGTH_STEP_MM };
                let mut motion = [0.0; POSE];
                motion[axis] = step;
                let mut moved = traced.clone();
                moved.air.pose = moved_pose(&self.camera_poses[1], &motion).into();
                let what = Change::Unknown(unknowns.relative_column() + axis);
                changed.push(Changed { traced: moved, step, what });
            }
        }
        for (column, free) in (unknowns.terms_column()..).zip(&unknowns.terms) {
            let step = free.term.step();
            let TubeAndWater { tube, water_index } = free.term.moved(now, step);
            let moved = TracedCamera { tube, water_index, ..traced.clone() };
            changed.push(Changed { traced: moved, step, what: Change::Unknown(column) });
        }
        changed
    }

    /// Normal matrix (lower triangle) and right-hand side. `sigma` is the standard deviation of corners, px per axis, that
    /// the priors are weighed against.
    pub fn normal_equations(
        &self,
        views: &[BoardView],
        unknowns: &JointUnknowns,
        loss: Loss,
        sigma: f64,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let size = unknowns.len() + POSE * self.boards.len();
        let mut matrix = DMatrix::zeros(size, size);
        let mut right = DVector::zeros(size);
        let eyes = [self.eye(0), self.eye(1)];
        let changed = [self.changed(0, unknowns), self.changed(1, unknowns)];
        let mut derivatives = Vec::new();
        for view in views {
            let eye = &eyes[view.camera];
            for corner in &view.corners {
                let turned = self.boards[view.board].rotation * corner.board.coords;
                let point = self.boards[view.board] * corner.board;
                derivatives.clear();
                let seen = if view.in_water {
                    eye.through_tube(point, corner.pixel, &changed[view.camera], &mut derivatives)
                } else {
                    eye.through_air(point, corner.pixel, unknowns, &mut derivatives)
                };
                let Some((projection, by_point)) = seen else { continue };
                let mut by_camera = Vec::new();
                unknowns.cameras[view.camera].derivatives(&projection, &mut by_camera);
                derivatives.extend((unknowns.camera_column(view.camera)..).zip(by_camera));
                let board = unknowns.len() + POSE * view.board;
                derivatives.extend((board..).zip(by_pose(&by_point, &turned)));

                let residual = corner.pixel - projection.pixel;
                let (_, weight) = loss.of(residual.norm_squared());
                for (i, by_i) in &derivatives {
                    right[*i] += weight * by_i.dot(&residual);
                    for (j, by_j) in derivatives.iter().filter(|(j, _)| j <= i) {
                        matrix[(*i, *j)] += weight * by_i.dot(by_j);
                    }
                }
            }
        }
        for (column, change, prior) in self.priors(unknowns) {
            let weight = (sigma / prior).powi(2);
            matrix[(column, column)] += weight;
            right[column] -= weight * change;
        }
        (matrix, right)
    }

    fn moved(&self, unknowns: &JointUnknowns, step: &[f64]) -> Self {
        let mut moved = self.clone();
        let (globals, boards) = step.split_at(unknowns.len());
        for camera in 0..2 {
            let from = unknowns.camera_column(camera);
            let terms = &unknowns.cameras[camera];
            terms.add(&mut moved.models[camera], &globals[from..from + terms.len()]);
        }
        if unknowns.relative {
            moved.camera_poses[1] = moved_pose(&self.camera_poses[1], &globals[unknowns.relative_column()..]);
        }
        for (free, change) in unknowns.terms.iter().zip(&globals[unknowns.terms_column()..]) {
            moved.tube_and_water = moved.tube_and_water.map(|now| free.term.moved(now, *change));
        }
        for (pose, step) in moved.boards.iter_mut().zip(boards.chunks_exact(POSE)) {
            *pose = moved_pose(pose, step);
        }
        moved
    }

    /// Lowers the cost of all residuals as far as it goes.
    pub fn refine(&mut self, views: &[BoardView], unknowns: &JointUnknowns, loss: Loss, sigma: f64) {
        levenberg_marquardt(
            self,
            |bundle| bundle.cost(views, unknowns, loss, sigma),
            |bundle| bundle.normal_equations(views, unknowns, loss, sigma),
            |bundle, step| bundle.moved(unknowns, step),
            COST_TOLERANCE,
        );
    }

    /// Robust refinement, its scale following the residuals down.
    pub fn robust_fit(&mut self, views: &[BoardView], unknowns: &JointUnknowns) {
        let refine = |bundle: &mut Self, loss, sigma| bundle.refine(views, unknowns, loss, sigma);
        refine::robust_fit(self, |bundle| bundle.sigma(views), refine);
    }

    /// The fit that counts.
    pub fn final_fit(&mut self, views: &[BoardView], unknowns: &JointUnknowns) -> Loss {
        let refine = |bundle: &mut Self, loss, sigma| bundle.refine(views, unknowns, loss, sigma);
        refine::final_fit(self, |bundle| bundle.sigma(views), refine)
    }

    /// Covariance of all unknowns. None: some combination of them does not follow from the residuals.
    pub fn covariance(&self, views: &[BoardView], unknowns: &JointUnknowns, loss: Loss) -> Option<DMatrix<f64>> {
        let (matrix, _) = self.normal_equations(views, unknowns, loss, self.sigma(views));
        refine::covariance(matrix, self.residuals(views).into_iter().flatten().flatten(), loss)
    }
}

impl Eye<'_> {
    /// Where a point in air is seen, and the derivative by the point in the rig frame; adds the derivatives by the pose of
    /// the camera.
    fn through_air(
        &self,
        point: Point3<f64>,
        near: Vector2<f64>,
        unknowns: &JointUnknowns,
        derivatives: &mut Vec<(usize, Vector2<f64>)>,
    ) -> Option<(Projection, Matrix2x3<f64>)> {
        let projection = Projection::new(self.model, self.pose.inverse_transform_point(&point), near)?;
        let by_point = projection.by_point * self.pose.rotation.inverse().to_rotation_matrix();
        if unknowns.relative && self.camera == 1 {
            // The camera turned about its own place is the point turned back about that.
            let arm = point.coords - self.pose.translation.vector;
            let by_camera = by_pose(&by_point, &arm).map(|by| -by);
            derivatives.extend((unknowns.relative_column()..).zip(by_camera));
        }
        Some((projection, by_point))
    }

    /// The same for a point in water: adds the derivatives by everything that is changed.
    ///
    /// The pixel is where the ray misses the point by nothing. How far it misses, in the plane across the ray, changes with
    /// each unknown and with the pixel: the quotient is what is wanted, and no second projection is needed for it.
    fn through_tube(
        &self,
        point: Point3<f64>,
        near: Vector2<f64>,
        changed: &[Changed],
        derivatives: &mut Vec<(usize, Vector2<f64>)>,
    ) -> Option<(Projection, Matrix2x3<f64>)> {
        let traced = self.traced.as_ref()?;
        let pixel = traced.project_near(point, near)?;
        let normal = traced.ray(pixel)?.direction;
        let across = normal.cross(&Vector3::ith_axis(normal.iamin())).normalize();
        let along = normal.cross(&across);
        let miss = |camera: &TracedCamera, pixel: Vector2<f64>| {
            let ray = camera.ray(pixel)?;
            let distance = (point - ray.origin).dot(&normal) / ray.direction.dot(&normal);
            let offset = ray.origin + distance * ray.direction - point;
            Some(Vector2::new(across.dot(&offset), along.dot(&offset)))
        };
        let by_pixel = |step: Vector2<f64>| {
            Some((miss(traced, pixel + step)? - miss(traced, pixel - step)?) / (2.0 * PIXEL_STEP_PX))
        };
        let misses =
            Matrix2::from_columns(&[by_pixel(Vector2::x() * PIXEL_STEP_PX)?, by_pixel(Vector2::y() * PIXEL_STEP_PX)?]);
        let by_miss = misses.try_inverse()?;
        let here = miss(traced, pixel)?;
        let mut by_f = Vector2::zeros();
        for Changed { traced, step, what } in changed {
            let by_change = -by_miss * (miss(traced, pixel)? - here) / *step;
            match what {
                Change::Elevation => by_f = by_change,
                Change::Unknown(column) => derivatives.push((*column, by_change)),
            }
        }
        let by_point = by_miss * Matrix2x3::from_rows(&[across.transpose(), along.transpose()]);
        let (ideal, by_corrected) = image_terms(self.model, pixel)?;
        let projection = Projection {
            pixel,
            s: self.model.corrected(pixel).norm() / karst_rig::NORMAL_RADIUS_PX,
            ideal,
            by_point: by_point * self.pose.rotation.to_rotation_matrix(),
            by_f,
            by_axial: Vector2::zeros(),
            by_corrected,
        };
        Some((projection, by_point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use karst_rig::Rig;
    use nalgebra::UnitQuaternion;

    /// Two boards, in air and in water, in front of the default rig's cameras.
    fn bundle() -> (Bundle, Vec<BoardView>) {
        let rig = Rig::default();
        let models = [0, 1].map(|camera| rig.cameras[camera].air.clone().unwrap());
        let pose =
            |x, y, z, turn| Isometry3::from_parts(Vector3::new(x, y, z).into(), UnitQuaternion::from_scaled_axis(turn));
        let bundle = Bundle {
            camera_poses: models.clone().map(|model| model.pose.isometry()),
            models,
            tube_and_water: rig.tube.map(|tube| TubeAndWater { tube, water_index: rig.water.index() }),
            boards: vec![
                pose(600.0, 200.0, -120.0, Vector3::new(0.2, 1.7, 0.1)),
                pose(-500.0, 300.0, 50.0, Vector3::new(0.3, -1.2, 0.4)),
            ],
        };
        let mut views = Vec::new();
        for (board, in_water) in [(0, false), (1, true)] {
            for camera in 0..2 {
                let corner = |index: usize| {
                    let board_mm = Point3::new((index % 4) as f64 * 60.0, (index / 4) as f64 * 60.0, 0.0);
                    let point = bundle.boards[board] * board_mm;
                    let pixel = if in_water {
                        rig.traced_camera(camera).unwrap().project(point).unwrap()
                    } else {
                        bundle.models[camera].project(point, 370.0).unwrap()
                    };
                    Observation { index, board: board_mm, pixel: pixel + Vector2::new(0.3, -0.2) }
                };
                let corners = (0..12).map(corner).collect();
                let own_pose = Isometry3::identity();
                views.push(BoardView { camera, board, in_water, name: String::new(), own_pose, corners });
            }
        }
        (bundle, views)
    }

    fn all_unknowns(bundle: &Bundle) -> JointUnknowns {
        use TubeTerm::*;
        let terms = [Offset(0), Offset(1), Tilt(0), Tilt(1), InnerRadius, Wall, WallIndex, WaterIndex];
        JointUnknowns {
            cameras: [Unknowns::of_degree(5, true), Unknowns::of_degree(4, true)],
            relative: true,
            terms: terms.into_iter().map(|term| FreeTerm { term, prior: Some(0.5) }).collect(),
            nominal: bundle.tube_and_water,
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_cost_for_every_unknown() {
        let (bundle, views) = bundle();
        let unknowns = all_unknowns(&bundle);
        let loss = Loss::Huber(1e3);
        let (matrix, right) = bundle.normal_equations(&views, &unknowns, loss, 0.1);
        for column in 0..right.len() {
            // A step that moves the corners by 0.01 px, together.
            let size = 0.01 / matrix[(column, column)].sqrt();
            let cost = |sign: f64| {
                let mut step = vec![0.0; right.len()];
                step[column] = sign * size;
                bundle.moved(&unknowns, &step).cost(&views, &unknowns, loss, 0.1)
            };
            let slope = (cost(1.0) - cost(-1.0)) / (2.0 * size);
            let error = (slope + 2.0 * right[column]) / matrix[(column, column)].sqrt();
            assert!(error.abs() < 1e-3, "unknown {column}: {slope}, {}", -2.0 * right[column]);
        }
    }
}
