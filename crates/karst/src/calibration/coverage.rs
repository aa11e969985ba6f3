//! Which parts of the picture the corners of the boards cover.

use karst_rig::Camera;
use serde::{Deserialize, Serialize};

/// Rings between inner and mirror radius.
const RINGS: usize = 4;
/// Sectors of each ring.
const SECTORS: usize = 8;
/// Fewest corners for which a cell counts as covered.
const FEW: usize = 4;

/// Corners per cell of a camera's picture: rings of equal width between inner and mirror radius, and sectors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    /// Limits of the rings, px from the image centre.
    pub radii_px: Vec<f64>,
    /// Corners per ring and sector; sectors from x towards y (as seen in the picture: clockwise from the right).
    pub corners: Vec<[usize; SECTORS]>,
}

impl Coverage {
    /// Counts the corners (px) around the image centre (px) of a camera.
    pub fn new(camera: &Camera, centre_px: [f64; 2], corners: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let (inner, width) =
            (camera.inner_radius_px, (camera.mirror_radius_px - camera.inner_radius_px) / RINGS as f64);
        let mut counts = vec![[0; SECTORS]; RINGS];
        for corner in corners {
            let [x, y] = [0, 1].map(|axis| corner[axis] - centre_px[axis]);
            let ring = ((x.hypot(y) - inner) / width).floor();
            let turn = y.atan2(x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
            let sector = (turn * SECTORS as f64) as usize % SECTORS;
            if (0.0..RINGS as f64).contains(&ring) {
                counts[ring as usize][sector] += 1;
            }
        }
        Self { radii_px: (0..=RINGS).map(|i| inner + width * i as f64).collect(), corners: counts }
    }

    /// Share of the cells that are covered, 0 to 1.
    pub fn share(&self) -> f64 {
        let covered = self.corners.iter().flatten().filter(|&&count| count >= FEW).count();
        covered as f64 / (RINGS * SECTORS) as f64
    }

    /// The cells without enough corners, in words: for each ring its sectors.
    pub fn gaps(&self) -> Vec<String> {
        let ring = |(i, sectors): (usize, &[usize; SECTORS])| {
            let empty: Vec<usize> = (0..SECTORS).filter(|&sector| sectors[sector] < FEW).collect();
            let [inner, outer] = [self.radii_px[i], self.radii_px[i + 1]];
            let place = format!("{inner:.0} to {outer:.0} px from the centre");
            match empty.len() {
                0 => None,
                SECTORS => Some(format!("{place}, all around")),
                _ => {
                    let degrees = |sector: usize| format!("{}°", (2 * sector + 1) * 180 / SECTORS);
                    let around = empty.into_iter().map(degrees).collect::<Vec<_>>().join(", ");
                    Some(format!("{place}, around {around} (from the picture's right, clockwise)"))
                }
            }
        };
        self.corners.iter().enumerate().filter_map(ring).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use karst_rig::Rig;

    fn coverage(corners: &[[f64; 2]]) -> Coverage {
        Coverage::new(&Rig::ideal().cameras[0], [500.0, 400.0], corners.iter().copied())
    }

    #[test]
    fn corners_count_in_their_ring_and_sector() {
        // Rings of 63.75 px from 105 px on
        let coverage = coverage(&[[610.0, 405.0], [500.0, 760.0], [500.0, 40.0], [500.0, 410.0], [900.0, 400.0]]);
        assert_eq!(coverage.corners[0], [1, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(coverage.corners[3][2] + coverage.corners[3][6], 0, "the rim itself is outside");
        assert_eq!(coverage.corners.iter().flatten().sum::<usize>(), 1);
    }

    #[test]
    fn gaps_are_named_until_all_cells_have_corners() {
        assert_eq!(coverage(&[]).gaps()[0], "105 to 169 px from the centre, all around");
        let mut corners = Vec::new();
        for radius in [120.0, 180.0, 250.0, 320.0] {
            for degrees in (0..360).step_by(10) {
                let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
                corners.push([500.0 + radius * cos, 400.0 + radius * sin]);
            }
        }
        assert_eq!((coverage(&corners).gaps().len(), coverage(&corners).share()), (0, 1.0));
        corners.retain(|[x, y]| *x < 700.0 || *y < 400.0);
        assert_eq!(coverage(&corners).gaps().len(), 2);
        assert!(coverage(&corners).gaps()[1].contains("around 22°"), "{:?}", coverage(&corners).gaps());
    }
}
