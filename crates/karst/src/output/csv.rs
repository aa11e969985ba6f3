//! CSV table: one row per laser and frame, with or without a point.

use super::OutputError;
use crate::result::{LaserResult, Section};
use serde::Serialize;
use std::io::Write;

/// One row. The order of the fields is the order of the columns: append, never reorder. Empty cells are unknown values.
#[derive(Serialize)]
struct Row<'a> {
    frame: usize,
    frame_name: &'a str,
    laser: usize,
    status: &'a str,
    x_mm: Option<f64>,
    y_mm: Option<f64>,
    z_mm: Option<f64>,
    range_mm: Option<f64>,
    sigma_mm: Option<f64>,
    chi2: Option<f64>,
    camera1_laser_mm: Option<f64>,
    camera2_laser_mm: Option<f64>,
    stereo_mm: Option<f64>,
    camera1_x_px: Option<f64>,
    camera1_y_px: Option<f64>,
    camera1_sigma_px: Option<f64>,
    camera1_pixels: Option<u32>,
    camera1_saturated_pixels: Option<u32>,
    camera2_x_px: Option<f64>,
    camera2_y_px: Option<f64>,
    camera2_sigma_px: Option<f64>,
    camera2_pixels: Option<u32>,
    camera2_saturated_pixels: Option<u32>,
    truth_x_mm: Option<f64>,
    truth_y_mm: Option<f64>,
    truth_z_mm: Option<f64>,
    truth_range_mm: Option<f64>,
    range_error_mm: Option<f64>,
}

impl<'a> Row<'a> {
    fn new(frame: usize, name: &'a str, laser: &'a LaserResult) -> Self {
        let point = laser.point.as_ref();
        let [spot1, spot2] = laser.spots.each_ref().map(Option::as_ref);
        let truth = laser.truth.as_ref();
        let truth_position = truth.and_then(|t| t.position_mm);
        Self {
            frame,
            frame_name: name,
            laser: laser.laser,
            status: &laser.status,
            x_mm: point.map(|p| p.position_mm[0]),
            y_mm: point.map(|p| p.position_mm[1]),
            z_mm: point.map(|p| p.position_mm[2]),
            range_mm: point.map(|p| p.range_mm),
            sigma_mm: point.and_then(|p| p.sigma_mm),
            chi2: point.and_then(|p| p.chi2),
            camera1_laser_mm: point.and_then(|p| p.estimates_mm[0]),
            camera2_laser_mm: point.and_then(|p| p.estimates_mm[1]),
            stereo_mm: point.and_then(|p| p.estimates_mm[2]),
            camera1_x_px: spot1.map(|s| s.pixel[0]),
            camera1_y_px: spot1.map(|s| s.pixel[1]),
            camera1_sigma_px: spot1.map(|s| s.sigma_px),
            camera1_pixels: spot1.map(|s| s.pixels),
            camera1_saturated_pixels: spot1.map(|s| s.saturated),
            camera2_x_px: spot2.map(|s| s.pixel[0]),
            camera2_y_px: spot2.map(|s| s.pixel[1]),
            camera2_sigma_px: spot2.map(|s| s.sigma_px),
            camera2_pixels: spot2.map(|s| s.pixels),
            camera2_saturated_pixels: spot2.map(|s| s.saturated),
            truth_x_mm: truth_position.map(|p| p[0]),
            truth_y_mm: truth_position.map(|p| p[1]),
            truth_z_mm: truth_position.map(|p| p[2]),
            truth_range_mm: truth.and_then(|t| t.range_mm),
            range_error_mm: super::summary::range_error_mm(laser),
        }
    }
}

/// Writes the sections as CSV with a header row. `frame` counts from 0; units are in the column names.
pub fn write(sections: &[Section], out: impl Write) -> Result<(), OutputError> {
    let mut writer = ::csv::Writer::from_writer(out);
    for (frame, section) in sections.iter().enumerate() {
        for laser in &section.lasers {
            writer.serialize(Row::new(frame, &section.frame, laser))?;
        }
    }
    writer.flush()?;
    Ok(())
}
