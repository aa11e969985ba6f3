//! PLY point cloud: ASCII header, binary little-endian data. Opens in MeshLab, CloudCompare and Open3D.

use super::{OutputError, viridis};
use crate::result::Section;
use std::io::Write;

/// Writes the points of all sections, in the rig frame, mm. Colour shows the range, from the nearest point of the file
/// (dark) to the farthest (bright). `sigma` is NaN where the method gives none; `frame` counts from 0.
pub fn write(sections: &[Section], mut out: impl Write) -> Result<(), OutputError> {
    let points = || {
        sections.iter().enumerate().flat_map(|(frame, section)| {
            section.lasers.iter().filter_map(move |l| Some((frame, l.laser, l.point.as_ref()?)))
        })
    };
    let (near, far) = points().fold((f64::INFINITY, f64::NEG_INFINITY), |(near, far), (_, _, point)| {
        (near.min(point.range_mm), far.max(point.range_mm))
    });

    write!(
        out,
        "ply\n\
         format binary_little_endian 1.0\n\
         comment karst: points in the rig frame\n\
         comment x, y, z and sigma in millimetres; sigma is the standard deviation along the beam\n\
         element vertex {}\n\
         property float x\n\
         property float y\n\
         property float z\n\
         property float sigma\n\
         property ushort laser\n\
         property uint frame\n\
         property uchar red\n\
         property uchar green\n\
         property uchar blue\n\
         end_header\n",
        points().count()
    )?;
    for (frame, laser, point) in points() {
        let laser = u16::try_from(laser).map_err(|_| OutputError::TooLarge {
            what: "laser",
            value: laser,
            max: u16::MAX.into(),
        })?;
        let frame = u32::try_from(frame).map_err(|_| OutputError::TooLarge {
            what: "frame",
            value: frame,
            max: u32::MAX as usize,
        })?;
        for value in point.position_mm.into_iter().chain([point.sigma_mm.unwrap_or(f64::NAN)]) {
            out.write_all(&(value as f32).to_le_bytes())?;
        }
        out.write_all(&laser.to_le_bytes())?;
        out.write_all(&frame.to_le_bytes())?;
        out.write_all(&viridis((point.range_mm - near) / (far - near)))?;
    }
    out.flush()?;
    Ok(())
}
