#![doc = include_str!("../README.md")]

mod board;
mod calibration;
mod error;
mod gallery;
mod geometry;
mod mesh;
mod optics;
mod psf;
mod render;
mod scene;
mod scenes;
mod sensor;
mod snow;
mod texture;
mod truth;

pub use board::{BOARD_BACK_ALBEDO, BOARD_MARGIN_SQUARES, PlacedBoard};
pub use error::{MeshError, SceneError};
pub use gallery::Gallery;
pub use geometry::{Hit, Shape};
pub use mesh::Mesh;
pub use render::{FIELD_MARGIN_PX, Frame, LASER_RGB, LinearFrame, Renderer, VISIBLE_SIGMAS, render};
pub use scene::{Lasers, Light, Noise, Scene, Sensor, Walls, WaterOptics, straight_path};
pub use scenes::{NamedScene, belt_scenes, demo_scene, evaluation_scenes, laser_free_scenes};
pub use truth::{BoardTruth, CornerTruth, FrameTruth, LaserTruth, SpotTruth, TargetTruth};
