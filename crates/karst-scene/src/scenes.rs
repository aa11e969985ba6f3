//! The standard scenes.

use crate::{Gallery, Light, Scene, Shape, WaterOptics};
use karst_rig::{Pose, Ray};
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

/// A scene with the name and the seed under which results are reported.
#[derive(Debug, Clone)]
pub struct NamedScene {
    /// Name, unique in its list: shape and number.
    pub name: String,
    /// Shape: scenes of one kind are evaluated together.
    pub kind: &'static str,
    /// Seed to render it with.
    pub seed: u64,
    /// The scene.
    pub scene: Scene,
}

/// The frames on which the accuracy is evaluated: 48, twelve each of a 3 m hexagonal pool, square galleries, round tubes
/// and irregular galleries. Noise, haze, snow, reflections and laser errors are on. In four of the round tubes all walls
/// are 4.6 to 4.9 m away.
pub fn evaluation_scenes() -> Vec<NamedScene> {
    let hexagons = PLACES.iter().map(|place| (Shape::HexagonalPool { across_flats_mm: 3000.0 }, scaled(*place, 850.0)));
    let squares = PLACES.iter().enumerate().map(|(i, place)| {
        let side_mm = 2000.0 + 180.0 * i as f64;
        (Shape::Square { side_mm }, scaled(*place, side_mm / 2.0 - 550.0))
    });
    let tubes = PLACES.iter().zip(TUBE_RADII_MM).map(|(place, radius_mm)| {
        // Far walls: hardly off the centre, so that they are far on all sides.
        let room: f64 = if radius_mm > 4500.0 { 80.0 } else { radius_mm - 420.0 };
        (Shape::RoundTube { radius_mm }, scaled(*place, room))
    });
    let galleries = PLACES.iter().enumerate().map(|(i, place)| {
        let shape = Shape::IrregularGallery(Gallery::new(100 + i as u64, 750.0, 4500.0));
        (shape, scaled(*place, 300.0))
    });
    named("hexagon", 1000, hexagons)
        .chain(named("square", 2000, squares))
        .chain(named("tube", 3000, tubes))
        .chain(named("gallery", 4000, galleries))
        .collect()
}

/// Frames without any laser light, on which every point is a false one: ten, with ever more snow, haze and light.
pub fn laser_free_scenes() -> Vec<NamedScene> {
    let shapes = PLACES.iter().take(10).enumerate().map(|(i, place)| {
        let shape = match i % 3 {
            0 => Shape::IrregularGallery(Gallery::new(200 + i as u64, 700.0, 4000.0)),
            1 => Shape::HexagonalPool { across_flats_mm: 3000.0 },
            _ => Shape::RoundTube { radius_mm: 900.0 },
        };
        (shape, scaled(*place, 250.0))
    });
    let mut scenes: Vec<_> = named("laser-free", 5000, shapes).collect();
    for (i, NamedScene { scene, .. }) in scenes.iter_mut().enumerate() {
        let i = i as f64;
        scene.lasers = None;
        scene.snow_per_m3 *= 1.0 + 3.0 * i;
        scene.water.backscatter_per_m *= 1.0 + i;
        scene.light.ambient_w_m2 *= 1.0 + 0.1 * i;
        scene.light.lamp_w_m2 *= 1.0 + 0.1 * i;
    }
    scenes
}

/// Pictures to calibrate the belt with: twelve, in round tubes with walls from 0.35 to 5.6 m away. The
/// beams are exactly where the rig has them.
pub fn belt_scenes() -> Vec<NamedScene> {
    const RADII_MM: [f64; 12] =
        [450.0, 600.0, 800.0, 1000.0, 1250.0, 1500.0, 1800.0, 2200.0, 2700.0, 3300.0, 4000.0, 4700.0];
    let shapes = PLACES
        .iter()
        .zip(RADII_MM)
        .map(|(place, radius_mm)| (Shape::RoundTube { radius_mm }, scaled(*place, 0.2 * radius_mm)));
    let mut scenes: Vec<_> = named("belt", 6000, shapes).collect();
    for lasers in scenes.iter_mut().filter_map(|named| named.scene.lasers.as_mut()) {
        lasers.errors = false;
    }
    scenes
}

/// A flooded cave gallery with the instrument off its middle and tilted.
pub fn demo_scene() -> NamedScene {
    let scene = Scene {
        instrument: Pose { position_mm: [120.0, -90.0, 0.0], rotation_deg: [4.0, -6.0, 17.0] },
        snow_per_m3: 60.0,
        water: WaterOptics { backscatter_per_m: 0.012, ..WaterOptics::default() },
        light: Light { ambient_w_m2: 0.6, lamp_w_m2: 1.2, ..Light::default() },
        ..Scene::new(Shape::IrregularGallery(Gallery::new(7, 700.0, 2800.0)))
    };
    NamedScene { name: "demo".into(), kind: "gallery", seed: 7, scene }
}

/// Positions off the axis of the shape, relative to the room there, and rotations in degrees.
const PLACES: [([f64; 2], [f64; 3]); 12] = [
    ([0.0, 0.0], [0.0, 0.0, 0.0]),
    ([0.4, 0.1], [0.0, 0.0, 15.0]),
    ([-0.3, 0.6], [2.0, -1.0, 40.0]),
    ([0.9, 0.2], [0.0, 3.0, 5.0]),
    ([-0.8, -0.5], [-4.0, 2.0, 70.0]),
    ([0.1, -0.9], [1.0, 1.0, 110.0]),
    ([0.5, 0.5], [5.0, -5.0, 33.0]),
    ([-0.2, -0.3], [-2.0, -6.0, 200.0]),
    ([0.95, -0.1], [0.0, 0.0, 261.0]),
    ([-0.6, 0.7], [8.0, 0.0, 300.0]),
    ([0.3, -0.6], [-3.0, 7.0, 147.0]),
    ([-0.9, 0.3], [0.5, -0.5, 333.0]),
];

/// Radii of the round tubes, one per place.
const TUBE_RADII_MM: [f64; 12] =
    [500.0, 700.0, 1000.0, 1300.0, 1600.0, 2000.0, 2500.0, 3000.0, 4800.0, 4780.0, 4750.0, 4720.0];

fn scaled(([x, y], rotation_deg): ([f64; 2], [f64; 3]), room_mm: f64) -> Pose {
    Pose { position_mm: [x * room_mm, y * room_mm, 0.0], rotation_deg }
}

fn named(
    kind: &'static str,
    first_seed: u64,
    places: impl Iterator<Item = (Shape, Pose)>,
) -> impl Iterator<Item = NamedScene> {
    places.enumerate().map(move |(i, (shape, instrument))| {
        let mut scene = Scene { instrument, ..Scene::new(shape) };
        // As an operator does, the lamp is dimmed in front of a near wall.
        let near_m = nearest_wall_mm(&scene) * 1e-3;
        scene.light.lamp_w_m2 *= (near_m * near_m).min(1.0);
        NamedScene { name: format!("{kind}-{i:02}"), kind, seed: first_seed + i as u64, scene }
    })
}

/// Distance of the nearest wall across the instrument's axis, mm.
fn nearest_wall_mm(scene: &Scene) -> f64 {
    let to_world = scene.instrument.isometry();
    (0..36)
        .filter_map(|i| {
            let (sin, cos) = (PI * f64::from(i) / 18.0).sin_cos();
            let ray = Ray { origin: to_world * Point3::origin(), direction: to_world * Vector3::new(cos, sin, 0.0) };
            scene.shape.intersect(&ray).map(|hit| hit.t_mm)
        })
        .fold(f64::INFINITY, f64::min)
}
