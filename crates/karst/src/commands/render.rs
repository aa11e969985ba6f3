//! `karst render`: pictures of the instrument under water, with truth.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, bail};
use clap::Args;
use karst::output::folder;
use karst_rig::{Board, Medium, Pose, Ray};
use karst_scene::{Gallery, Mesh, PlacedBoard, Renderer, Scene, Shape, belt_scenes, straight_path};
use nalgebra::{Point3, Vector3};
use serde::Serialize;

use super::{board, count, load_rig, not_negative, positive, print, print_json, progress, triple, write_text};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  karst render --out pool --shape hexagon --size 3000
  karst render --out survey --frames 20 --to 0,0,2000 --seed 3
  karst render --out cave --mesh cave.stl --mesh-unit-mm 1000 --position 0,0,500
  karst render --out boards --boards 20 --medium air
  karst render --out belt --belt")]
pub struct Render {
    /// Folder for the pictures (camera1, camera2), the truth and the rig file
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Rig file; the default rig without it
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Walls around the instrument
    #[arg(long, value_enum, default_value_t)]
    shape: ShapeName,
    /// Size of the shape, mm: distance of opposite walls, diameter of the tube, largest radius of the gallery
    #[arg(long, value_name = "MM", value_parser = positive, default_value = "3000", allow_negative_numbers = true)]
    size: f64,
    /// Triangle mesh (OBJ or STL) as walls instead of a shape
    #[arg(long, value_name = "FILE", conflicts_with_all = ["shape", "size"])]
    mesh: Option<PathBuf>,
    /// Millimetres per unit of the mesh file
    #[arg(
        long,
        value_name = "MM",
        value_parser = positive,
        default_value = "1000",
        allow_negative_numbers = true,
        requires = "mesh"
    )]
    mesh_unit_mm: f64,
    /// Position of the instrument in the shape, mm
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    position: [f64; 3],
    /// Rotation of the instrument about x, y and z, degrees
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    rotation: [f64; 3],
    /// Number of frames along the way from `position` to `to`
    #[arg(
        long,
        value_name = "COUNT",
        value_parser = clap::value_parser!(u32).range(1..),
        default_value_t = 1,
        allow_negative_numbers = true
    )]
    frames: u32,
    /// Position of the last frame, mm
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true, requires = "frames")]
    to: Option<[f64; 3]>,
    /// Instead of a survey, pictures of a calibration board in that many poses, lasers off, in a pool 5 m wide
    #[arg(
        long,
        value_name = "COUNT",
        value_parser = clap::value_parser!(u32).range(1..),
        allow_negative_numbers = true,
        conflicts_with_all = [
            "shape", "size", "mesh", "mesh_unit_mm", "position", "rotation", "frames", "to", "no_lasers"
        ]
    )]
    boards: Option<u32>,
    /// What surrounds the instrument; in air it is rendered without its tube
    #[arg(long, value_enum, default_value_t, requires = "boards")]
    medium: MediumName,
    /// Inner corners along both sides of the board and side of a square, mm
    #[arg(long, value_name = "COLUMNSxROWSxMM", value_parser = board, default_value = "9x6x60", requires = "boards")]
    board: Board,
    /// Instead of a survey, pictures to calibrate the belt with: twelve, in round tubes from narrow to wide
    #[arg(
        long,
        conflicts_with_all = [
            "shape", "size", "mesh", "mesh_unit_mm", "position", "rotation", "frames", "to", "no_lasers", "boards"
        ]
    )]
    belt: bool,
    /// Seed of gallery, board poses, noise, snow and laser errors; frame n uses seed + n
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Switch the lasers off
    #[arg(long)]
    no_lasers: bool,
    /// Backscattering coefficient of the water, 1/m
    #[arg(long, value_name = "PER_M", value_parser = not_negative, allow_negative_numbers = true)]
    haze: Option<f64>,
    /// Particles per cubic metre
    #[arg(long, value_name = "COUNT", value_parser = not_negative, allow_negative_numbers = true)]
    snow: Option<f64>,
    /// Print the truth as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, Default, clap::ValueEnum)]
enum ShapeName {
    /// Hexagonal pool
    Hexagon,
    /// Square gallery
    Square,
    /// Round tube
    Tube,
    /// Irregular cave gallery
    #[default]
    Gallery,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, clap::ValueEnum)]
enum MediumName {
    /// No tube, nothing attenuates light
    Air,
    /// Tube and water
    #[default]
    Water,
}

/// The truth of one frame as `--json` prints it.
#[derive(Serialize)]
struct RenderedFrame {
    frame: String,
    truth: karst_scene::FrameTruth,
}

impl Render {
    fn shape(&self) -> anyhow::Result<Shape> {
        if let Some(path) = &self.mesh {
            return Ok(Shape::Mesh(Arc::new(Mesh::load(path, self.mesh_unit_mm)?)));
        }
        Ok(match self.shape {
            ShapeName::Hexagon => Shape::HexagonalPool { across_flats_mm: self.size },
            ShapeName::Square => Shape::Square { side_mm: self.size },
            ShapeName::Tube => Shape::RoundTube { radius_mm: self.size / 2.0 },
            ShapeName::Gallery => Shape::IrregularGallery(Gallery::new(self.seed, self.size / 4.0, self.size)),
        })
    }

    fn medium(&self) -> anyhow::Result<Medium> {
        match self.medium {
            MediumName::Water => Ok(Medium::Water),
            MediumName::Air if self.haze.is_some() || self.snow.is_some() => {
                bail!("--haze and --snow need water, found --medium air")
            }
            MediumName::Air => Ok(Medium::Air),
        }
    }

    fn in_this_water(&self, mut scene: Scene) -> Scene {
        scene.water.backscatter_per_m = self.haze.unwrap_or(scene.water.backscatter_per_m);
        scene.snow_per_m3 = self.snow.unwrap_or(scene.snow_per_m3);
        scene
    }

    /// What to render, frame by frame.
    fn scenes(&self, renderer: &Renderer, medium: Medium) -> anyhow::Result<Vec<Scene>> {
        if let Some(count) = self.boards {
            let poses = renderer.board_poses(&self.board, count as usize, self.seed)?;
            let scene = |pose| self.in_this_water(Scene::calibration(PlacedBoard::new(self.board, pose), medium));
            return Ok(poses.into_iter().map(scene).collect());
        }
        if self.belt {
            return Ok(belt_scenes().into_iter().map(|named| self.in_this_water(named.scene)).collect());
        }
        let mut scene = self.in_this_water(Scene::new(self.shape()?));
        if self.no_lasers {
            scene.lasers = None;
        }
        let from = Pose { position_mm: self.position, rotation_deg: self.rotation };
        let to = Pose { position_mm: self.to.unwrap_or(self.position), ..from };
        Ok(scene.along(straight_path(from, to, self.frames as usize)).collect())
    }

    pub fn run(self) -> anyhow::Result<ExitCode> {
        let medium = self.medium()?;
        let rig = load_rig(self.rig.as_deref())?;
        if medium == Medium::Air
            && let Some(index) = rig.cameras.iter().position(|camera| camera.air.is_none())
        {
            let file = self.rig.as_deref().unwrap_or("default rig".as_ref()).display();
            bail!("{file}: camera {} has no air model, which --medium air needs", index + 1);
        }
        let rig = medium.rig(&rig);
        let renderer = Renderer::new(&rig)?;
        let scenes = self.scenes(&renderer, medium)?;
        folder::prepare(&self.out)?;
        for name in ["camera1", "camera2", "truth"] {
            folder::prepare(&self.out.join(name))?;
        }
        // Frames of an earlier, longer sequence would pass as frames of this one.
        let next = self.out.join("camera1").join(format!("{:04}.png", scenes.len() + 1));
        if next.exists() {
            let frames = count(scenes.len(), "frame");
            bail!("{}: found a frame of a longer sequence, expected at most {frames} to overwrite", next.display());
        }
        write_text(self.out.join("rig.toml"), &rig.to_toml())?;
        let bar = progress(scenes.len(), "rendering");
        let mut rendered = Vec::new();
        for (i, scene) in scenes.iter().enumerate() {
            let name = format!("{:04}", i + 1);
            let frame = renderer.render(scene, self.seed.wrapping_add(i as u64)).with_context(|| {
                let [x, y, z] = scene.instrument.position_mm;
                format!("frame {name} at ({x}, {y}, {z}) mm")
            })?;
            for (camera, image) in frame.images.iter().enumerate() {
                let path = self.out.join(format!("camera{}", camera + 1)).join(format!("{name}.png"));
                image.save(&path).with_context(|| format!("cannot write {}", path.display()))?;
            }
            let truth = serde_json::to_string_pretty(&frame.truth)?;
            write_text(self.out.join("truth").join(format!("{name}.json")), &truth)?;
            rendered.push(RenderedFrame { frame: name, truth: frame.truth });
            bar.inc(1);
        }
        bar.finish_and_clear();
        if self.json {
            print_json(&rendered)?;
        } else {
            let out = self.out.display();
            print(format_args!("{} in {out}", count(rendered.len(), "stereo pair")))?;
            print(match self.boards {
                Some(_) => format!("true corners in {out}/truth as board.corners, the rig in {out}/rig.toml"),
                None => format!(
                    "measure with: karst reconstruct --rig {out}/rig.toml {out}/camera1 {out}/camera2 --truth {out}/truth"
                ),
            })?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// The true wall in the belt plane as a closed line in the rig frame, mm; empty if it is not closed.
pub fn outline(scene: &Scene) -> Vec<[f64; 2]> {
    const STEPS: u32 = 720;
    let to_shape = scene.instrument.isometry();
    let points = (0..STEPS).map(|i| {
        let (y, x) = (std::f64::consts::TAU * f64::from(i) / f64::from(STEPS)).sin_cos();
        let ray = Ray { origin: to_shape * Point3::origin(), direction: to_shape * Vector3::new(x, y, 0.0) };
        let distance = scene.shape.intersect(&ray)?.t_mm;
        Some([x * distance, y * distance])
    });
    points.collect::<Option<Vec<_>>>().unwrap_or_default()
}
