//! One camera of the instrument as it works: pixel to ray in the water and back, and what does not depend on the scene.

use crate::SceneError;
use karst_rig::{Camera, CameraModel, CameraOptics, Ray, Rig};
use nalgebra::{Point3, Vector2, Vector3};

/// Distance between the rays that carry the background, px. Texture is evaluated at every pixel.
pub(crate) const GRID_PX: usize = 4;
/// Most pixels of an image.
const MAX_PIXELS: u64 = 1 << 26;

/// A camera ready to render.
#[derive(Debug, Clone)]
pub(crate) struct View {
    optics: CameraOptics,
    /// The camera in air, with which it sees the tube itself.
    air: Option<CameraModel>,
    pub size: [usize; 2],
    pub centre: Vector2<f64>,
    pub inner_radius_px: f64,
    pub mirror_radius_px: f64,
    /// Rays through every `GRID_PX`-th pixel, row by row.
    pub grid: Vec<Option<Ray>>,
    pub grid_columns: usize,
    /// Per pixel: the lens's and mirror's transmission.
    pub transmission: Vec<f32>,
    /// Per pixel: how much of the scene the camera's own reflection at the image centre leaves.
    pub open: Vec<f32>,
    /// Per pixel: brightness of housing, mirror rim and the camera's own reflection, relative to a white wall.
    pub housing: Vec<f32>,
}

/// How a camera sees a point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look {
    pub pixel: Vector2<f64>,
    /// Where the ray enters the water, or the viewpoint.
    pub from: Point3<f64>,
    /// From the point to the camera, unit.
    pub to_camera: Vector3<f64>,
    /// Length of the ray in the water, mm.
    pub distance_mm: f64,
    /// Area that one pixel covers at the point across the ray, mm².
    pub pixel_mm2: f64,
}

impl View {
    pub fn new(rig: &Rig, index: usize) -> Result<Self, SceneError> {
        let camera: &Camera = &rig.cameras[index];
        let [width, height] = camera.image_size_px;
        if !(1..=MAX_PIXELS).contains(&(u64::from(width) * u64::from(height))) {
            return Err(SceneError::ImageSize { camera: index, width, height });
        }
        let optics = rig.camera_optics(index).ok_or(SceneError::NoModel(index))?;
        let mut view = Self {
            centre: Vector2::from(optics.model().centre_px),
            optics,
            air: rig.tube.and(camera.air.clone()),
            size: [width as usize, height as usize],
            inner_radius_px: camera.inner_radius_px,
            mirror_radius_px: camera.mirror_radius_px,
            grid: Vec::new(),
            grid_columns: (width as usize - 1).div_ceil(GRID_PX) + 1,
            transmission: Vec::new(),
            open: Vec::new(),
            housing: Vec::new(),
        };
        view.trace_grid();
        view.draw_instrument();
        Ok(view)
    }

    fn trace_grid(&mut self) {
        let rows = (self.size[1] - 1).div_ceil(GRID_PX) + 1;
        self.grid = (0..rows)
            .flat_map(|row| (0..self.grid_columns).map(move |column| (column, row)))
            .map(|(column, row)| {
                let pixel = Vector2::new((column * GRID_PX) as f64, (row * GRID_PX) as f64);
                if self.may_see(pixel) { self.ray(pixel) } else { None }
            })
            .collect();
    }

    /// Whether a pixel is in the mirror's image or so near to it that its light matters there.
    pub fn may_see(&self, pixel: Vector2<f64>) -> bool {
        (pixel - self.centre).norm() <= self.mirror_radius_px + 2.0 * GRID_PX as f64
    }

    fn draw_instrument(&mut self) {
        let [width, height] = self.size;
        for row in 0..height {
            for column in 0..width {
                let offset = Vector2::new(column as f64, row as f64) - self.centre;
                let (radius, azimuth) = (offset.norm(), offset.y.atan2(offset.x));
                let rim = radius - self.mirror_radius_px;
                let inside = ramp(-rim, -1.0, 1.0);
                let vignetting = 1.0 - 0.3 * (radius / self.mirror_radius_px).min(1.0).powi(4);
                let q = radius / self.inner_radius_px.max(1.0);
                self.transmission.push((inside * vignetting) as f32);
                self.open.push(ramp(q, 0.70, 0.80) as f32);
                // The polished edge of the mirror catches some light, unevenly; the housing behind is nearly black.
                let edge = (-((rim - 3.0) / 2.0).powi(2)).exp() * (0.05 + 0.03 * (azimuth - 0.7).cos());
                let housing = 0.012 * ramp(rim, 0.0, 3.0) * (1.0 - 0.5 * ramp(rim, 0.0, 120.0));
                self.housing.push((edge + housing + own_reflection(q, azimuth)) as f32);
            }
        }
    }

    /// Ray in the water through a pixel, rig frame.
    pub fn ray(&self, pixel: Vector2<f64>) -> Option<Ray> {
        self.optics.ray(pixel)
    }

    /// Image of a point in the water, rig frame.
    pub fn project(&self, point: Point3<f64>) -> Option<Vector2<f64>> {
        self.optics.project(point)
    }

    /// How the camera sees a point in the water, rig frame.
    pub fn look(&self, point: Point3<f64>) -> Option<Look> {
        let pixel = self.project(point)?;
        look(point, pixel, |p| self.ray(p))
    }

    /// How the camera sees a point on the inside of the tube: straight, without water.
    pub fn look_at_tube(&self, point: Point3<f64>) -> Option<Look> {
        let air = self.air.as_ref()?;
        look(point, air.project(point, self.mirror_radius_px)?, |p| Some(air.ray(p)))
    }

    /// Whether a pixel is in the ring of the image that the rig uses, by a margin.
    pub fn in_field(&self, pixel: Vector2<f64>, margin_px: f64) -> bool {
        let radius = (pixel - self.centre).norm();
        radius >= self.inner_radius_px + margin_px && radius <= self.mirror_radius_px - margin_px
    }
}

/// The area of a pixel follows from the rays half a pixel around: that holds with and without a single viewpoint.
fn look(point: Point3<f64>, pixel: Vector2<f64>, ray: impl Fn(Vector2<f64>) -> Option<Ray>) -> Option<Look> {
    let centre = ray(pixel)?;
    let across = |step: Vector2<f64>| {
        let ray = ray(pixel + step)?;
        let t = (point - ray.origin).dot(&centre.direction) / ray.direction.dot(&centre.direction);
        Some(ray.origin + t * ray.direction - point)
    };
    let half = 0.5;
    let u = across(Vector2::new(half, 0.0))? - across(Vector2::new(-half, 0.0))?;
    let v = across(Vector2::new(0.0, half))? - across(Vector2::new(0.0, -half))?;
    let pixel_mm2 = u.cross(&v).norm();
    (pixel_mm2 > 0.0).then(|| Look {
        pixel,
        from: centre.origin,
        to_camera: -centre.direction,
        distance_mm: (point - centre.origin).norm(),
        pixel_mm2,
    })
}

/// 0 below `from`, 1 above `to`, smooth between.
fn ramp(x: f64, from: f64, to: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The camera in its own mirror: lens, barrel, front plate with struts; q in units of the inner radius.
fn own_reflection(q: f64, azimuth: f64) -> f64 {
    let ring = |from, to| ramp(q, from - 0.01, from + 0.01) * (1.0 - ramp(q, to - 0.01, to + 0.01));
    let struts = (1.5 * azimuth + 0.4).sin().powi(2).powi(24);
    let glint = (-((q * azimuth.cos() - 0.05).powi(2) + (q * azimuth.sin() + 0.06).powi(2)) / 0.0006).exp();
    0.5 * glint
        + 0.09 * ring(0.13, 0.16)
        + 0.035 * ring(0.16, 0.26)
        + 0.06 * ring(0.29, 0.31)
        + 0.02 * ring(0.31, 0.52)
        + 0.05 * struts * ring(0.31, 0.66)
        + 0.08 * ring(0.62, 0.66)
        + 0.004 * (1.0 - ramp(q, 0.72, 0.8))
}
