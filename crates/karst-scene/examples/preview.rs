//! Renders the standard scenes whose name contains the first argument ("demo" without one) into the current directory.

use karst_scene::{Renderer, demo_scene, evaluation_scenes, laser_free_scenes};
use std::{env, error::Error, time::Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let wanted = env::args().nth(1).unwrap_or("demo".into());
    let renderer = Renderer::new(&karst_rig::Rig::default())?;
    let mut scenes = evaluation_scenes();
    scenes.extend(laser_free_scenes());
    scenes.push(demo_scene());
    for named in scenes.iter().filter(|s| s.name.contains(&wanted)) {
        let start = Instant::now();
        let frame = renderer.render(&named.scene, named.seed)?;
        println!("{} in {:.2} s", named.name, start.elapsed().as_secs_f64());
        for laser in &frame.truth.lasers {
            let range_mm = laser.target.map_or(f64::NAN, |t| t.range_mm);
            print!("  laser {:2} {range_mm:7.1} mm", laser.laser);
            for spot in laser.spots.iter().flatten() {
                let [x, y] = spot.position_px;
                let state = if spot.visible { "visible" } else { "hidden" };
                print!("   ({x:6.1}, {y:6.1}) px {:8.1} DN {:3} px {state}", spot.peak_dn, spot.green_pixels);
            }
            println!();
        }
        for (image, camera) in frame.images.iter().zip(1..) {
            image.save(format!("{}-{camera}.png", named.name))?;
        }
    }
    Ok(())
}
