//! Procedural texture of the wall: it belongs to the surface, so it moves with the geometry.

/// Wavelengths of the layers, mm, and their share of the contrast.
const LAYERS: [(f32, f32); 4] = [(900.0, 0.35), (260.0, 0.3), (75.0, 0.2), (24.0, 0.15)];

/// Noise in -1..1 at a point on the wall (mm). Layers finer than `pixel_mm`, the size of a pixel there, fade out.
pub(crate) fn rock(point_mm: [f32; 3], pixel_mm: f32) -> f32 {
    // Strata: stretched along the bedding plane, which is tilted against the axis of the passage.
    let [x, y, z] = point_mm;
    let bedded = [x * 0.7 + z * 0.2, y * 1.6 - x * 0.3, z * 0.7];
    LAYERS
        .iter()
        .filter(|(wavelength, _)| pixel_mm < *wavelength)
        .map(|(wavelength, share)| {
            let fade = (1.0 - pixel_mm / wavelength).min(0.5) * 2.0;
            share * fade * noise(bedded.map(|c| c / wavelength))
        })
        .sum()
}

/// Value noise in -1..1 with unit lattice.
fn noise([x, y, z]: [f32; 3]) -> f32 {
    let cell = [x.floor(), y.floor(), z.floor()];
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let [u, v, w] = [smooth(x - cell[0]), smooth(y - cell[1]), smooth(z - cell[2])];
    let [i, j, k] = cell.map(|c| c as i32);
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let edge = |dj, dk| {
        mix(
            lattice(i, j.wrapping_add(dj), k.wrapping_add(dk)),
            lattice(i.wrapping_add(1), j.wrapping_add(dj), k.wrapping_add(dk)),
            u,
        )
    };
    mix(mix(edge(0, 0), edge(1, 0), v), mix(edge(0, 1), edge(1, 1), v), w)
}

fn lattice(i: i32, j: i32, k: i32) -> f32 {
    let mut h = (i as u32).wrapping_mul(0x9E37_79B1)
        ^ (j as u32).wrapping_mul(0x85EB_CA77)
        ^ (k as u32).wrapping_mul(0xC2B2_AE3D);
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 13)).wrapping_mul(0x297A_2D39);
    ((h >> 8) as f32) / 8_388_608.0 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_stays_in_its_bounds_and_varies() {
        let values: Vec<f32> =
            (0..5000).map(|i| rock([i as f32 * 3.7, i as f32 * -1.3, i as f32 * 0.9], 1.0)).collect();
        assert!(values.iter().all(|v| v.abs() <= 1.0));
        let mean = values.iter().sum::<f32>() / 5000.0;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / 5000.0;
        assert!(variance.sqrt() > 0.1, "{variance}");
    }
}
