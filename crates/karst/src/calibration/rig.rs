//! From calibrated parts to a rig.

use karst_calib::{
    BoardSet, CalibratedBelt, CalibratedStereo, CameraSettings, Known, StereoError, StereoSettings, TubeKnowledge,
    TubeSettings, calibrate_stereo,
};
use karst_rig::{Camera, Medium, Pose, Rig};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{BeltResult, CamerasResult, Manifest};

/// Calibrates the cameras of a drawn rig, and the tube around them, from the corners of boards.
pub fn calibrate_cameras(
    manifest: &Manifest,
    drawing: &Rig,
    sets: &[BoardSet],
) -> Result<CalibratedStereo, StereoError> {
    let camera = |camera: &Camera| CameraSettings {
        image_size_px: camera.image_size_px,
        degree: manifest.camera.degree,
        tangential: manifest.camera.tangential,
    };
    let within = |sigma: Option<f64>| sigma.map_or(Known::Exactly, Known::Within);
    let sigma = manifest.tube_sigma;
    let known = TubeKnowledge {
        inner_radius_mm: within(sigma.inner_radius_mm),
        wall_mm: within(sigma.wall_mm),
        wall_index: within(sigma.index),
        ..TubeKnowledge::default()
    };
    let settings = StereoSettings {
        cameras: drawing.cameras.each_ref().map(camera),
        board: Some(manifest.board),
        first_pose: drawing
            .camera_optics(0)
            .map_or(Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] }, |optics| optics.model().pose),
        tube: drawing.tube.map(|tube| TubeSettings { tube, water_index: drawing.water.index(), known }),
    };
    let in_water = sets.iter().any(|set| set.medium == Medium::Water);
    calibrate_stereo(sets, &StereoSettings { tube: settings.tube.filter(|_| in_water), ..settings })
}

/// The drawn rig with its cameras, and its tube where boards were in water, as calibrated.
pub fn with_cameras(drawing: &Rig, stereo: &CalibratedStereo) -> Rig {
    let mut rig = drawing.clone();
    for (camera, found) in rig.cameras.iter_mut().zip(&stereo.cameras) {
        camera.air = Some(found.model.clone());
        camera.water = None;
    }
    if let Some((tube, _)) = stereo.tube {
        rig.tube = Some(tube);
    }
    rig
}

/// The drawn rig with cameras and tube of an earlier calibration.
pub fn with_cameras_of(drawing: &Rig, earlier: &Rig) -> Rig {
    let mut rig = Rig { tube: earlier.tube, ..drawing.clone() };
    for (camera, found) in rig.cameras.iter_mut().zip(&earlier.cameras) {
        camera.air = found.air.clone();
        camera.water = None;
    }
    rig
}

/// What the cameras are calibrated with besides the corners.
pub fn inputs(manifest: &Manifest, drawing: &Rig) -> String {
    format!("{:?}, {:?}, {:?}, {:?}", manifest.board, manifest.tube_sigma, drawing.tube, drawing.water)
}

/// A rig with its belt as calibrated, in the frame of its own parts: z through the viewpoints, the origin where the beams
/// pass this axis, and the first laser at its azimuth in the drawing.
pub fn with_belt(rig: &Rig, belt: &CalibratedBelt) -> Rig {
    let mut rig = rig.clone();
    let azimuth = rig.lasers.first().map_or(0.0, |laser| laser.azimuth_deg.to_radians());
    rig.lasers = belt.lasers.iter().map(|laser| laser.laser).collect();
    rig.detector.sigma_floor_px = belt.sigma_floor_px;
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_axis_angle(&Vector3::z_axis(), azimuth));
    let turn = Isometry3::from_parts(Translation3::identity(), turn);
    let rig = match rig.own_frame() {
        Some(frame) => rig.in_frame(&(turn * frame.inverse())),
        None => rig,
    };
    rounded(rig)
}

/// Values to a fraction of what can be known of them.
fn rounded(mut rig: Rig) -> Rig {
    // Adding zero turns -0 into 0
    let to = |digits: i32| {
        move |value: &mut f64| *value = (*value * 10_f64.powi(digits)).round() / 10_f64.powi(digits) + 0.0
    };
    let pose = |pose: &mut Pose| {
        pose.position_mm.iter_mut().for_each(to(5));
        pose.rotation_deg.iter_mut().for_each(to(7));
    };
    for model in rig.cameras.iter_mut().filter_map(|camera| camera.air.as_mut()) {
        pose(&mut model.pose);
        model.centre_px.iter_mut().for_each(to(5));
        model.affine.iter_mut().chain(&mut model.tangential).chain(&mut model.polynomial).for_each(to(10));
    }
    if let Some(tube) = &mut rig.tube {
        pose(&mut tube.pose);
        [&mut tube.inner_radius_mm, &mut tube.wall_mm, &mut tube.index].into_iter().for_each(to(6));
    }
    for laser in &mut rig.lasers {
        laser.origin_mm.iter_mut().for_each(to(5));
        [&mut laser.azimuth_deg, &mut laser.elevation_deg].into_iter().for_each(to(7));
        [&mut laser.origin_sigma_mm, &mut laser.direction_sigma_mrad].into_iter().for_each(to(5));
    }
    to(5)(&mut rig.detector.sigma_floor_px);
    rig
}

/// The rig file, with the standard deviations of cameras and tube as comments; those of the lasers are fields of the file.
pub fn rig_file(rig: &Rig, cameras: &CamerasResult, belt: &BeltResult) -> String {
    let mut text = format!(
        "# Calibrated with {} pairs of pictures of boards ({:.3} px rms) and {} of laser spots ({:.3} px rms).\n#\n# Standard \
         deviations, in the frame of camera 1:\n",
        cameras.pairs_used, cameras.rms_inliers_px, belt.pictures, belt.rms_px
    );
    for parameter in &cameras.parameters {
        text += format!("#   {} {:.6} {}", parameter.name, parameter.sigma, parameter.unit).trim_end();
        text += "\n";
    }
    text + "\n" + &rig.to_toml()
}
