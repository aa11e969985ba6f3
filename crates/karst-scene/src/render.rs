//! The renderer.

use crate::board::Panel;
use crate::geometry::leave_cylinder;
use crate::optics::{GRID_PX, Look, View};
use crate::psf::{Plane, reach};
use crate::sensor::FULL_DN;
use crate::{FrameTruth, Hit, LaserTruth, Lasers, Scene, SceneError, Shape, SpotTruth, TargetTruth};
use crate::{snow, texture};
use image::{Rgb, Rgb32FImage, RgbImage};
use karst_rig::{Laser, Ray, Rig, Tube};
use nalgebra::{Isometry3, Point3, Unit, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;

/// Response of R, G and B to the laser, relative to G: at 532 nm the other two colour filters leak.
pub const LASER_RGB: [f64; 3] = [0.15, 1.0, 0.25];
/// Excess of a visible pixel over the detector's threshold, in standard deviations of the noise of 2G-R-B.
pub const VISIBLE_SIGMAS: f64 = 4.0;
/// Distance of a visible spot from the borders of the used ring of the image, px.
pub const FIELD_MARGIN_PX: f64 = 6.0;

/// Points per axis at which a beam's cross-section is sampled, and its half width in standard deviations.
const BEAM_SAMPLES: i32 = 15;
const BEAM_SIGMAS: f64 = 3.2;
/// Points along a beam at which its scattering in the water is sampled.
const STREAK_SAMPLES: u32 = 300;
/// Length of a beam that meets no wall, mm.
const BEAM_END_MM: f64 = 20_000.0;
/// Offset that frees a point on a wall from the wall itself, mm.
const CLEAR_MM: f64 = 0.01;

/// Independent random sequences of one seed.
#[derive(Clone, Copy)]
pub(crate) enum Stream {
    Lasers,
    Snow,
    SnowInBeams,
    Noise,
    BoardPoses,
}

/// A rendered stereo pair with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The images of both cameras.
    pub images: [RgbImage; 2],
    /// What they show.
    pub truth: FrameTruth,
}

/// A stereo pair before the sensor: no noise, clipping or quantisation.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearFrame {
    /// The images of both cameras, linear DN.
    pub images: [Rgb32FImage; 2],
    /// What they show.
    pub truth: FrameTruth,
}

/// Renders scenes as one instrument sees them. What does not depend on the scene is computed once.
#[derive(Debug, Clone)]
pub struct Renderer {
    pub(crate) views: [View; 2],
    tube: Option<Tube>,
    lasers: Vec<Laser>,
    excess_min: f64,
    min_pixels: u32,
}

/// Renders one stereo pair. For more than one pair of the same rig, keep a [`Renderer`].
pub fn render(rig: &Rig, scene: &Scene, seed: u64) -> Result<Frame, SceneError> {
    Renderer::new(rig)?.render(scene, seed)
}

impl Renderer {
    /// A renderer for a rig. The cameras are traced through tube and water where the rig has a tube and the camera an air
    /// model; without a tube the air model is used as it is, without an air model the water model.
    pub fn new(rig: &Rig) -> Result<Self, SceneError> {
        Ok(Self {
            views: [View::new(rig, 0)?, View::new(rig, 1)?],
            tube: rig.tube,
            lasers: rig.lasers.clone(),
            excess_min: f64::from(rig.detector.excess_min[0]),
            min_pixels: u32::from(rig.detector.min_pixels),
        })
    }

    /// Renders a stereo pair. The same seed gives the same bytes.
    pub fn render(&self, scene: &Scene, seed: u64) -> Result<Frame, SceneError> {
        let LinearFrame { images: [first, second], truth } = self.render_linear(scene, seed)?;
        // One stream for both sensors would make the second depend on the size of the first.
        let noise = |camera| random(seed, Stream::Noise, camera);
        let images = [scene.sensor.expose(&first, noise(0)), scene.sensor.expose(&second, noise(1))];
        Ok(Frame { images, truth })
    }

    /// Renders a stereo pair as light on the sensors, in linear grey levels without noise.
    pub fn render_linear(&self, scene: &Scene, seed: u64) -> Result<LinearFrame, SceneError> {
        scene.check()?;
        let stage = Stage::new(scene);
        if !scene.shape.contains(stage.to_world * Point3::origin()) {
            return Err(SceneError::Outside);
        }
        let beams = scene.lasers.map_or(Vec::new(), |lasers| self.beams(&stage, &lasers, seed));
        let clear_radius_mm = self.tube.map_or(0.0, |t| t.inner_radius_mm + t.wall_mm) + 5.0;
        let particles = snow::around(scene.snow_per_m3, clear_radius_mm, &mut random(seed, Stream::Snow, 0));

        let mut spots = Vec::new();
        let images = self.views.each_ref().map(|view| {
            let mut image = stage.background(view);
            stage.add_snow(view, &particles, &mut image);
            spots.push(self.add_beams(&stage, view, &beams, &mut image));
            image
        });
        let lasers = beams.iter().enumerate().map(|(i, beam)| LaserTruth {
            laser: i,
            origin_mm: beam.origin.coords.into(),
            direction: beam.direction.into_inner().into(),
            target: beam
                .target
                .map(|hit| TargetTruth { point_mm: hit.point.coords.into(), range_mm: hit.point.x.hypot(hit.point.y) }),
            spots: [spots[0][i], spots[1][i]],
        });
        let truth = FrameTruth {
            seed,
            instrument: scene.instrument,
            lasers: lasers.collect(),
            board: stage.board_truth(&self.views),
        };
        Ok(LinearFrame { images, truth })
    }

    /// The actual beams.
    fn beams(&self, stage: &Stage, lasers: &Lasers, seed: u64) -> Vec<Beam> {
        let (mut errors, mut snow_random) = (random(seed, Stream::Lasers, 0), random(seed, Stream::SnowInBeams, 0));
        self.lasers
            .iter()
            .map(|laser| {
                let (mut origin, mut direction) =
                    (Point3::from(laser.origin_mm), Unit::new_normalize(laser.direction()));
                for axis in snow::transverse(direction) {
                    let [shift, tilt]: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut errors));
                    if lasers.errors {
                        origin += shift * laser.origin_sigma_mm * axis;
                        direction = Unit::new_normalize(*direction + tilt * 1e-3 * laser.direction_sigma_mrad * axis);
                    }
                }
                let ray = Ray { origin, direction: direction.into_inner() };
                let target = stage.intersect(&ray).map(|(hit, _)| hit);
                let tube_mm = self.tube.map(|tube| {
                    [tube.inner_radius_mm, tube.inner_radius_mm + tube.wall_mm]
                        .map(|radius| in_frame_of(&tube, &ray, radius).unwrap_or(0.0))
                });
                let start_mm = tube_mm.map_or(0.0, |t| t[1]);
                let length_mm = target.map_or(BEAM_END_MM, |hit| hit.t_mm) - start_mm;
                let particles = snow::in_beam(
                    stage.scene.snow_per_m3,
                    ray.origin + start_mm * ray.direction,
                    direction,
                    length_mm.clamp(0.0, 6000.0),
                    lasers.diameter_mm / 2.0,
                    &mut snow_random,
                );
                Beam { origin, direction, target, tube_mm, start_mm, particles }
            })
            .collect()
    }

    /// Adds all laser light to an image and returns the truth of the spots.
    fn add_beams(&self, stage: &Stage, view: &View, beams: &[Beam], image: &mut Rgb32FImage) -> Vec<Option<SpotTruth>> {
        let Some(lasers) = stage.scene.lasers else {
            return Vec::new();
        };
        let mut light = Plane::within([0.0; 2], view.size.map(|n| n as f64), view.size);
        let mut patches = Vec::new();
        for beam in beams {
            stage.add_streak(view, &lasers, beam, &mut light);
            stage.add_particles(view, &lasers, beam, &mut light);
            if let Some(tube) = &self.tube {
                stage.add_tube_reflections(view, &lasers, beam, tube, &mut light);
            }
            patches.push(stage.spot(view, &lasers, beam));
        }
        // The truth of a spot counts against the background without the other spots, but with streaks and particles.
        add_green(view, &light, image);
        let spots = patches.iter().map(|spot| spot.as_ref().map(|s| self.spot_truth(stage, view, s, image))).collect();
        for (_, patch) in patches.iter().flatten() {
            add_green(view, patch, image);
        }
        spots
    }

    fn spot_truth(&self, stage: &Stage, view: &View, (seen, patch): &(Seen, Plane), image: &Rgb32FImage) -> SpotTruth {
        let sensor = &stage.scene.sensor;
        let (mut peak_dn, mut green_pixels, mut saturated) = (0f64, 0, false);
        for (x, y, dn) in lit_pixels(view, patch) {
            peak_dn = peak_dn.max(dn);
            let Rgb(behind) = image.get_pixel(x as u32, y as u32);
            let linear: [f64; 3] = std::array::from_fn(|c| f64::from(behind[c]) + dn * LASER_RGB[c]);
            let [r, g, b] = linear.map(|dn| sensor.response(dn).min(FULL_DN));
            let [var_r, var_g, var_b] = linear.map(|dn| sensor.variance(dn));
            let sigma = (4.0 * var_g + var_r + var_b).sqrt();
            saturated |= g >= FULL_DN;
            green_pixels += u32::from(2.0 * g - r - b >= self.excess_min + VISIBLE_SIGMAS * sigma);
        }
        let visible = seen.unhidden && view.in_field(seen.pixel, FIELD_MARGIN_PX) && green_pixels >= self.min_pixels;
        SpotTruth { position_px: seen.pixel.into(), peak_dn, saturated, green_pixels, visible }
    }
}

/// One laser beam as it is, rig frame.
struct Beam {
    origin: Point3<f64>,
    direction: Unit<Vector3<f64>>,
    /// Where it meets the wall.
    target: Option<Hit>,
    /// Where it crosses the inner and the outer surface of the tube, mm from the origin.
    tube_mm: Option<[f64; 2]>,
    /// Where it enters the water, mm from the origin.
    start_mm: f64,
    /// Particles in the beam with the fraction of the power that each takes.
    particles: Vec<(snow::Particle, f64)>,
}

/// The target of a beam as one camera sees it.
struct Seen {
    pixel: Vector2<f64>,
    /// The wall faces the camera and nothing is in between.
    unhidden: bool,
}

/// What a ray meets.
enum Surface<'a> {
    Wall,
    Board(Panel<'a>),
}

/// The scene in the rig frame.
pub(crate) struct Stage<'a> {
    pub scene: &'a Scene,
    to_world: Isometry3<f64>,
}

impl<'a> Stage<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        Self { scene, to_world: scene.instrument.isometry() }
    }

    /// First meeting of a ray with wall or board.
    fn intersect(&self, ray: &Ray) -> Option<(Hit, Surface<'a>)> {
        let wall = self.intersect_wall(ray).map(|hit| (hit, Surface::Wall));
        let board = self.scene.board.as_ref().map(Panel::new);
        let board = board.and_then(|panel| Some((panel.intersect(ray)?, Surface::Board(panel))));
        [wall, board].into_iter().flatten().min_by(|(a, _), (b, _)| a.t_mm.total_cmp(&b.t_mm))
    }

    fn intersect_wall(&self, ray: &Ray) -> Option<Hit> {
        let world = Ray { origin: self.to_world * ray.origin, direction: self.to_world * ray.direction };
        let hit = self.scene.shape.intersect(&world)?;
        Some(Hit {
            point: ray.origin + hit.t_mm * ray.direction,
            normal: self.to_world.inverse_transform_vector(&hit.normal),
            t_mm: hit.t_mm,
        })
    }

    /// Whether a point is not in the open space between the walls.
    pub fn is_in_wall(&self, point: Point3<f64>) -> bool {
        !self.scene.shape.contains(self.to_world * point)
    }

    /// Whether a wall or the board is between a point and the place from which it is looked at.
    pub fn is_hidden(&self, point: Point3<f64>, from: Point3<f64>) -> bool {
        if self.is_behind_board(point, from) {
            return true;
        }
        if matches!(self.scene.shape, Shape::HexagonalPool { .. } | Shape::Square { .. } | Shape::RoundTube { .. }) {
            return false;
        }
        let sight = point - from;
        let distance = sight.norm();
        self.intersect_wall(&Ray { origin: from, direction: sight / distance })
            .is_some_and(|hit| hit.t_mm < distance - CLEAR_MM)
    }

    /// Whether the board is between a point and the place from which it is looked at.
    fn is_behind_board(&self, point: Point3<f64>, from: Point3<f64>) -> bool {
        let sight = point - from;
        let distance = sight.norm();
        let ray = Ray { origin: from, direction: sight / distance };
        self.scene
            .board
            .as_ref()
            .and_then(|board| Panel::new(board).intersect(&ray))
            .is_some_and(|hit| hit.t_mm < distance - CLEAR_MM)
    }

    /// Share of light that a length of water leaves, in one channel.
    pub fn transmission(&self, channel: usize, length_mm: f64) -> f64 {
        (-self.scene.water.attenuation_per_m[channel] * length_mm * 1e-3).exp()
    }

    /// Albedo where a ray from a place meets a surface.
    fn albedo(&self, point: Point3<f64>, surface: &Surface, from: Point3<f64>) -> f64 {
        match surface {
            Surface::Board(panel) => panel.albedo(point, from),
            Surface::Wall => {
                let world = self.to_world * point;
                // A spot shows the finest layers of the texture.
                let texture = texture::rock(world.coords.map(|c| c as f32).into(), 1.0);
                self.scene.walls.albedo * (1.0 + self.scene.walls.contrast * f64::from(texture))
            }
        }
    }

    /// Walls, board, haze and the instrument's own parts in the light that does not come from the lasers.
    fn background(&self, view: &View) -> Rgb32FImage {
        let nodes: Vec<Node> = view.grid.iter().map(|ray| ray.map_or(Node::default(), |ray| self.node(&ray))).collect();
        let white = self.scene.light.ambient_w_m2 + self.scene.light.lamp_w_m2;
        let housing_dn = self.scene.light.colour.map(|c| (self.scene.sensor.gain * white * c / PI) as f32);
        let contrast = self.scene.walls.contrast as f32;
        let board = self.board_layer(view);
        let mut image = Rgb32FImage::new(view.size[0] as u32, view.size[1] as u32);
        for (i, Rgb(out)) in image.pixels_mut().enumerate() {
            let (x, y) = (i % view.size[0], i / view.size[0]);
            let open = view.open[i] * view.transmission[i];
            let housing = view.housing[i];
            if open > 0.0 {
                let corner = y / GRID_PX * view.grid_columns + x / GRID_PX;
                // The last row and column of nodes lie on or beyond the image's border.
                let [right, below] = [1, view.grid_columns].map(|step| (corner + step).min(nodes.len() - 1));
                let diagonal = (below + 1).min(nodes.len() - 1);
                let [u, v] = [x, y].map(|p| (p % GRID_PX) as f32 / GRID_PX as f32);
                let node = Node::mix([&nodes[corner], &nodes[right], &nodes[below], &nodes[diagonal]], u, v);
                let texture = texture::rock(node.place, node.pixel_mm);
                let mut light: [f32; 3] =
                    std::array::from_fn(|c| node.wall_dn[c] * (1.0 + contrast * texture) + node.haze_dn[c]);
                if let Some(board) = &board {
                    board.cover(x, y, &mut light);
                }
                *out = light.map(|dn| open * dn);
            }
            for (out, dn) in out.iter_mut().zip(housing_dn) {
                *out += housing * dn;
            }
        }
        image
    }

    fn node(&self, ray: &Ray) -> Node {
        let hit = self.intersect_wall(ray);
        let distance_mm = hit.map_or(BEAM_END_MM, |hit| hit.t_mm);
        let mut node = Node { pixel_mm: 0.005 * distance_mm as f32, ..Node::default() };
        if let Some(hit) = hit {
            node.place = (self.to_world * hit.point).coords.map(|c| c as f32).into();
            node.wall_dn = self.reflected_dn(hit.point, hit.normal, self.scene.walls.albedo, distance_mm);
        }
        node.haze_dn = self.haze_dn(distance_mm);
        node
    }

    /// Light of a surface, seen from a distance in the water.
    pub fn reflected_dn(&self, point: Point3<f64>, normal: Vector3<f64>, albedo: f64, distance_mm: f64) -> [f32; 3] {
        let irradiance = self.lamp_and_ambient(point, Some(normal));
        std::array::from_fn(|c| {
            let radiance = albedo / PI * irradiance[c] * self.transmission(c, distance_mm);
            (self.scene.sensor.gain * radiance) as f32
        })
    }

    /// Light scattered by the water in front of a surface.
    pub fn haze_dn(&self, distance_mm: f64) -> [f32; 3] {
        let Scene { water, light, sensor, .. } = self.scene;
        std::array::from_fn(|c| {
            // Even light scattered back along the line of sight: the integral of b/(2 pi) E exp(-c s) ds.
            let depth_m = match water.attenuation_per_m[c] {
                0.0 => distance_mm * 1e-3,
                attenuation => (1.0 - self.transmission(c, distance_mm)) / attenuation,
            };
            let radiance = water.backscatter_per_m / (2.0 * PI) * light.ambient_w_m2 * light.colour[c] * depth_m;
            (sensor.gain * radiance) as f32
        })
    }

    /// Irradiance of a wall, or of a particle that is lit from all sides, in each channel, W/m².
    pub fn lamp_and_ambient(&self, point: Point3<f64>, normal: Option<Vector3<f64>>) -> [f64; 3] {
        let light = &self.scene.light;
        // The lamp is as large as the instrument: it is never nearer than that.
        let distance_mm = point.coords.norm().max(150.0);
        let facing = normal.map_or(1.0, |n| (-n.dot(&point.coords) / distance_mm).max(0.0));
        // Some shading of the even light, too: walls of one orientation are a little darker.
        let even = normal.map_or(1.0, |n| 0.8 + 0.2 * n.dot(&Vector3::new(0.48, 0.6, 0.64)));
        std::array::from_fn(|c| {
            let lamp = light.lamp_w_m2 * facing * self.transmission(c, distance_mm) / (distance_mm * 1e-3).powi(2);
            light.colour[c] * (light.ambient_w_m2 * even + lamp)
        })
    }

    fn add_snow(&self, view: &View, particles: &[snow::Particle], image: &mut Rgb32FImage) {
        let mut plane = Plane::within([0.0; 2], view.size.map(|n| n as f64), view.size);
        for particle in particles {
            let Some(look) = self.look_if_inside(view, particle.position) else {
                continue;
            };
            // The light's colour and the short path through the water hardly differ between the channels.
            let irradiance = self.lamp_and_ambient(particle.position, None)[1];
            let area_m2 = PI / 4.0 * particle.diameter_mm.powi(2) * 1e-6;
            let intensity = snow::ALBEDO / PI * irradiance * area_m2 * self.transmission(1, look.distance_mm);
            plane.splat(look.pixel.into(), self.flux(&look, intensity), self.blur(&look, particle.diameter_mm / 4.0));
        }
        for (x, y, dn) in lit_pixels(view, &plane) {
            for (out, colour) in image.get_pixel_mut(x as u32, y as u32).0.iter_mut().zip(self.scene.light.colour) {
                *out += (dn * colour) as f32;
            }
        }
    }

    fn look_if_inside(&self, view: &View, point: Point3<f64>) -> Option<Look> {
        let look = self.scene.shape.contains(self.to_world * point).then(|| view.look(point))??;
        (!self.is_hidden(point, look.from)).then_some(look)
    }

    /// Light on the sensor (DN px) from a source of a radiant intensity (W/sr).
    fn flux(&self, look: &Look, intensity: f64) -> f64 {
        self.scene.sensor.gain * intensity / (look.pixel_mm2 * 1e-6)
    }

    /// Standard deviation of the image of an object with a standard deviation, px.
    fn blur(&self, look: &Look, sigma_mm: f64) -> f64 {
        self.scene.sensor.blur_px.hypot(sigma_mm / look.pixel_mm2.sqrt())
    }

    /// Power of a beam at a distance from its origin, W.
    fn power(&self, lasers: &Lasers, beam: &Beam, t_mm: f64) -> f64 {
        lasers.power_mw * 1e-3 * self.transmission(1, (t_mm - beam.start_mm).max(0.0))
    }

    /// Radius of a beam (1/e²) at a distance from its origin, mm.
    fn beam_radius_mm(&self, lasers: &Lasers, beam: &Beam, t_mm: f64) -> f64 {
        lasers.diameter_mm / 2.0 + lasers.divergence_mrad * 0.5e-3 * (t_mm - beam.start_mm).max(0.0)
    }

    /// Light of the beam scattered back by the water itself.
    fn add_streak(&self, view: &View, lasers: &Lasers, beam: &Beam, plane: &mut Plane) {
        let per_sr_m = self.scene.water.backscatter_per_m / (2.0 * PI);
        let end_mm = beam.target.map_or(BEAM_END_MM, |hit| hit.t_mm);
        let near_mm = beam.start_mm.max(30.0) + 1.0;
        if per_sr_m == 0.0 || end_mm <= near_mm {
            return;
        }
        // Equal steps of 1/t are about equal steps in the image.
        let at = |i: f64| 1.0 / (1.0 / near_mm + (1.0 / end_mm - 1.0 / near_mm) * i / f64::from(STREAK_SAMPLES));
        for i in 0..STREAK_SAMPLES {
            let (t, step_mm) = (at(f64::from(i) + 0.5), at(f64::from(i) + 1.0) - at(f64::from(i)));
            let point = beam.origin + t * *beam.direction;
            let Some(look) = view.look(point).filter(|look| !self.is_behind_board(point, look.from)) else {
                continue;
            };
            let intensity =
                self.power(lasers, beam, t) * per_sr_m * step_mm * 1e-3 * self.transmission(1, look.distance_mm);
            let sigma = self.blur(&look, self.beam_radius_mm(lasers, beam, t) / 2.0);
            plane.splat(look.pixel.into(), self.flux(&look, intensity), sigma);
        }
    }

    /// Particles in the beam: false spots nearer than the wall.
    fn add_particles(&self, view: &View, lasers: &Lasers, beam: &Beam, plane: &mut Plane) {
        for (particle, fraction) in &beam.particles {
            let Some(look) = self.look_if_inside(view, particle.position) else {
                continue;
            };
            let power = self.power(lasers, beam, (particle.position - beam.origin).norm()) * fraction;
            let intensity = snow::ALBEDO * power / (4.0 * PI) * self.transmission(1, look.distance_mm);
            self.splat_with_halo(
                plane,
                look.pixel,
                self.flux(&look, intensity),
                self.blur(&look, particle.diameter_mm / 4.0),
            );
        }
    }

    /// Where the beam crosses the tube both surfaces scatter; what the outer one reflects crosses the far side again.
    fn add_tube_reflections(&self, view: &View, lasers: &Lasers, beam: &Beam, tube: &Tube, plane: &mut Plane) {
        let Some([inner_mm, outer_mm]) = beam.tube_mm else {
            return;
        };
        let reflected = ((tube.index - 1.0) / (tube.index + 1.0)).powi(2);
        let far_mm = in_frame_of(tube, &Ray { origin: beam.origin, direction: -*beam.direction }, tube.inner_radius_mm);
        let crossings = [(inner_mm, 1.0), (outer_mm, 1.0), (-far_mm.unwrap_or(0.0), reflected)];
        for (t, share) in crossings {
            let Some(look) = view.look_at_tube(beam.origin + t * *beam.direction) else {
                continue;
            };
            let intensity =
                lasers.power_mw * 1e-3 * share * lasers.tube_scatter / PI * beam.direction.dot(&look.to_camera).abs();
            self.splat_with_halo(
                plane,
                look.pixel,
                self.flux(&look, intensity),
                self.blur(&look, lasers.diameter_mm / 4.0),
            );
        }
    }

    fn splat_with_halo(&self, plane: &mut Plane, pixel: Vector2<f64>, flux: f64, sigma_px: f64) {
        let sensor = &self.scene.sensor;
        plane.splat(pixel.into(), flux * (1.0 - sensor.halo), sigma_px);
        plane.splat(pixel.into(), flux * sensor.halo, sensor.halo_px);
    }

    /// The spot on the wall: the beam's cross-section is sampled, and each sample followed to the wall and to the image.
    fn spot(&self, view: &View, lasers: &Lasers, beam: &Beam) -> Option<(Seen, Plane)> {
        let target = beam.target?;
        let centre = view.look(target.point)?;
        let sensor = &self.scene.sensor;
        let power =
            self.power(lasers, beam, target.t_mm) * beam.particles.iter().map(|(_, f)| 1.0 - f).product::<f64>();
        let sigma_mm = self.beam_radius_mm(lasers, beam, target.t_mm) / 2.0;
        let [u, v] = snow::transverse(beam.direction);
        // A regular grid over a smooth density converges faster than any power of its step.
        let steps = -(BEAM_SAMPLES / 2)..=BEAM_SAMPLES / 2;
        let step = BEAM_SIGMAS / f64::from(BEAM_SAMPLES / 2);
        let (mut samples, mut weights) = (Vec::new(), 0.0);
        for (i, j) in steps.clone().flat_map(|i| steps.clone().map(move |j| (i, j))) {
            let (a, b) = (step * f64::from(i), step * f64::from(j));
            let weight = (-0.5 * (a * a + b * b)).exp();
            weights += weight;
            let origin = beam.origin + sigma_mm * (a * u + b * v);
            let Some((hit, surface)) = self.intersect(&Ray { origin, direction: *beam.direction }) else {
                continue;
            };
            let sight = centre.from - hit.point;
            let distance_mm = sight.norm();
            let facing = hit.normal.dot(&sight) / distance_mm;
            if facing <= 0.0 || self.is_hidden(hit.point, centre.from) {
                continue;
            }
            let Some(pixel) = view.project(hit.point) else {
                continue;
            };
            let albedo = self.albedo(hit.point, &surface, centre.from);
            let intensity = albedo / PI * power * weight * facing * self.transmission(1, distance_mm);
            // The area of a pixel is that of the target's, scaled to the sample's distance.
            let nearness = (centre.distance_mm / distance_mm).powi(2);
            samples.push((pixel, self.flux(&centre, intensity) * nearness));
        }
        for (_, flux) in &mut samples {
            *flux /= weights;
        }
        let total: f64 = samples.iter().map(|(_, flux)| flux).sum();
        let middle = samples.iter().fold(Vector2::zeros(), |sum, (pixel, flux)| sum + pixel * (flux / total));
        // One halo for the whole spot: it is much wider.
        let halo_reach = reach(total * sensor.halo, sensor.halo_px);
        let (mut min, mut max) = (middle.add_scalar(-halo_reach), middle.add_scalar(halo_reach));
        for (pixel, flux) in &samples {
            let core_reach = reach(*flux, sensor.blur_px);
            min = min.inf(&pixel.add_scalar(-core_reach));
            max = max.sup(&pixel.add_scalar(core_reach));
        }
        let mut patch = Plane::within(min.into(), max.into(), view.size);
        if total > 0.0 {
            patch.splat(middle.into(), total * sensor.halo, sensor.halo_px);
            for (pixel, flux) in samples {
                patch.splat(pixel.into(), flux * (1.0 - sensor.halo), sensor.blur_px);
            }
        }
        let unhidden = target.normal.dot(&centre.to_camera) > 0.0 && !self.is_hidden(target.point, centre.from);
        Some((Seen { pixel: centre.pixel, unhidden }, patch))
    }
}

/// What the background needs at a grid point; linear between grid points.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    /// Point on the wall, frame of the shape, mm.
    place: [f32; 3],
    /// Size of a pixel there, mm.
    pixel_mm: f32,
    /// Light of a wall of mean albedo.
    wall_dn: [f32; 3],
    /// Light scattered by the water in front of it.
    haze_dn: [f32; 3],
}

impl Node {
    fn mix([a, b, c, d]: [&Node; 4], u: f32, v: f32) -> Node {
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let sum = |part: fn(&Node, usize) -> f32, i| {
            weights[0] * part(a, i) + weights[1] * part(b, i) + weights[2] * part(c, i) + weights[3] * part(d, i)
        };
        Node {
            place: std::array::from_fn(|i| sum(|n, i| n.place[i], i)),
            pixel_mm: sum(|n, _| n.pixel_mm, 0),
            wall_dn: std::array::from_fn(|i| sum(|n, i| n.wall_dn[i], i)),
            haze_dn: std::array::from_fn(|i| sum(|n, i| n.haze_dn[i], i)),
        }
    }
}

/// Pixels of a plane that are not dark, with the light that the lens passes.
fn lit_pixels<'a>(view: &'a View, plane: &'a Plane) -> impl Iterator<Item = (usize, usize, f64)> + 'a {
    plane.dn.iter().enumerate().filter(|(_, dn)| **dn > 0.0).map(|(i, dn)| {
        let (x, y) = (plane.x0 + i % plane.width, plane.y0 + i / plane.width);
        (x, y, f64::from(dn * view.transmission[y * view.size[0] + x]))
    })
}

fn add_green(view: &View, plane: &Plane, image: &mut Rgb32FImage) {
    for (x, y, dn) in lit_pixels(view, plane) {
        for (out, response) in image.get_pixel_mut(x as u32, y as u32).0.iter_mut().zip(LASER_RGB) {
            *out += (dn * response) as f32;
        }
    }
}

/// Distance at which a ray from inside reaches a radius around the tube's axis, mm.
fn in_frame_of(tube: &Tube, ray: &Ray, radius_mm: f64) -> Option<f64> {
    let frame = tube.pose.isometry();
    let origin = frame.inverse_transform_point(&ray.origin);
    leave_cylinder(&Ray { origin, direction: frame.inverse_transform_vector(&ray.direction) }, radius_mm)
}

pub(crate) fn random(seed: u64, stream: Stream, index: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(((stream as u64) << 8) | index);
    rng
}
