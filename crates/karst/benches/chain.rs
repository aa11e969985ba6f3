//! `cargo bench`: the chain on one 1024 x 768 stereo pair, on one core, against the same job done with imageproc.
//!
//! The peer job per image: mask of the pixels that pass eq. 2, connected components, centroid of each component.
//! Both run on the same rendered frames, one after the other in the same process; figures are medians.

use std::hint::black_box;
use std::time::Instant;

use image::{GrayImage, Luma, RgbImage};
use imageproc::region_labelling::{Connectivity, connected_components};
use karst::instrument::{Arithmetic, Instrument};
use karst_core::{Method, SpotDetector};
use karst_rig::Rig;
use karst_scene::{Renderer, demo_scene, evaluation_scenes};

/// The paper's time for one frame, on its FPGA, ms.
const BUDGET_MS: f64 = 2.86;

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Centroids of the connected green regions.
fn peer_detect(image: &RgbImage) -> Vec<[f64; 2]> {
    let mask = GrayImage::from_fn(image.width(), image.height(), |x, y| {
        let [r, g, b] = image.get_pixel(x, y).0.map(i32::from);
        Luma([if 2 * g - r - b > 70 { 255 } else { 0 }])
    });
    let labels = connected_components(&mask, Connectivity::Eight, Luma([0_u8]));
    let mut sums: Vec<[f64; 3]> = Vec::new();
    for (x, y, Luma([label])) in labels.enumerate_pixels() {
        if let Some(index) = (*label as usize).checked_sub(1) {
            if sums.len() <= index {
                sums.resize(index + 1, [0.0; 3]);
            }
            let sum = &mut sums[index];
            *sum = [sum[0] + f64::from(x), sum[1] + f64::from(y), sum[2] + 1.0];
        }
    }
    sums.into_iter().map(|[x, y, n]| [x / n, y / n]).collect()
}

fn main() -> anyhow::Result<()> {
    let rig = Rig::default();
    let renderer = Renderer::new(&rig)?;
    let mut instrument = Instrument::new(rig)?;
    println!("detector memory per camera, 12 lasers: {} bytes (target: at most 8192)", size_of::<SpotDetector<12>>());
    println!();
    println!("median ms per stereo pair      detect   pair to points   imageproc   times faster");
    let gallery = evaluation_scenes().into_iter().find(|scene| scene.kind == "gallery");
    for named in std::iter::once(demo_scene()).chain(gallery) {
        let frame = renderer.render(&named.scene, named.seed)?;
        // Detection is timed inside the whole chain, so that one cannot be slower than the other by chance
        let mut timings = Vec::new();
        for _ in 0..101 {
            let section = instrument.section("", black_box(&frame.images), Method::Weighted, Arithmetic::Fixed)?;
            timings.extend(black_box(section).timing);
        }
        let detect = median(timings.iter().map(|t| t.detect_ms).collect());
        let chain = median(timings.iter().map(|t| t.detect_ms + t.reconstruct_ms).collect());
        let peer_times = (0..21).map(|_| {
            let start = Instant::now();
            black_box(black_box(&frame.images).each_ref().map(peer_detect));
            start.elapsed().as_secs_f64() * 1e3
        });
        let peer = median(peer_times.collect());
        println!("{:<30} {detect:>6.3} {chain:>16.3} {peer:>11.3} {:>14.1}", named.name, peer / detect);
    }
    println!();
    println!(
        "target: detection, and the pair to points, in at most {BUDGET_MS} ms; at least 5 times faster than imageproc"
    );
    Ok(())
}
