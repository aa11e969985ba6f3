//! Pictures, plots and reports: what they show, and that no result makes them fail.

mod output_common;

use image::{Rgb, RgbImage};
use karst::output::report::{Report, ReportFrame, html};
use karst::output::{csv, mcap, overlay, plot, ply};
use karst::result::Section;
use karst_rig::Rig;
use output_common::{DARK, REJECTED, image, outline_mm, section};
use roxmltree::Document;
use std::io::Cursor;
use std::time::{Duration, SystemTime};

const ACCEPTED: Rgb<u8> = Rgb([86, 180, 233]);
const ORANGE: Rgb<u8> = Rgb([230, 159, 0]);

fn report<'a>(rig: &'a Rig, frames: &'a [ReportFrame<'a>], problems: &'a [String]) -> Report<'a> {
    let created = SystemTime::UNIX_EPOCH + Duration::from_secs(1_800_000_000);
    Report { title: "Gallery <north> & sump", created, rig, frames, problems }
}

/// Pixels of a colour within 30 px of a place.
fn count_near(picture: &RgbImage, [x, y]: [f64; 2], colour: Rgb<u8>) -> usize {
    picture
        .enumerate_pixels()
        .filter(|(i, j, pixel)| **pixel == colour && (f64::from(*i) - x).hypot(f64::from(*j) - y) < 30.0)
        .count()
}

#[test]
fn overlay_marks_points_blue_and_rejected_spots_orange_and_leaves_the_spots_uncovered() {
    let section = section(0);
    let original = image(&section, 0);
    let picture = overlay::draw(&original, &section, 0, Some(&overlay::Guides::new(&Rig::ideal())[0]));
    for laser in &section.lasers {
        let Some(spot) = &laser.spots[0] else { continue };
        let (expected, other) = if laser.laser == REJECTED { (ORANGE, ACCEPTED) } else { (ACCEPTED, ORANGE) };
        assert!(count_near(&picture, spot.pixel, expected) > 50, "laser {}", laser.laser);
        assert_eq!(count_near(&picture, spot.pixel, other), 0, "laser {}", laser.laser);
    }
    let picture = overlay::draw(&original, &section, 0, None);
    for laser in &section.lasers {
        let Some(spot) = &laser.spots[0] else { continue };
        let [x, y] = spot.pixel.map(|v| v.round() as u32);
        for (dx, dy) in [(0, 0), (4, 0), (0, 4), (3, 3)] {
            assert_eq!(picture.get_pixel(x + dx, y + dy), original.get_pixel(x + dx, y + dy));
        }
    }
}

#[test]
fn a_spot_crop_magnifies_8_times_and_marks_found_and_true_centre() {
    let section = section(0);
    let original = RgbImage::from_fn(1024, 768, |x, y| Rgb([255, x as u8, y as u8]));
    let laser = &section.lasers[REJECTED];
    let crop = overlay::spot_crop(&original, laser, 1).unwrap();
    assert_eq!(crop.dimensions(), (200, 200));
    let found = laser.spots[1].as_ref().unwrap().pixel;
    let first = found.map(|v| v.round() as u32 - 12);
    for (x, y) in [(0, 0), (7, 7), (8, 0), (199, 199), (0, 199)] {
        assert_eq!(crop.get_pixel(x, y), original.get_pixel(first[0] + x / 8, first[1] + y / 8));
    }
    let truth = laser.truth.as_ref().unwrap().pixels[1].unwrap();
    let place = |p: [f64; 2]| [0, 1].map(|i| (p[i] - f64::from(first[i])) * 8.0 + 3.5);
    assert!(count_near(&crop, place(found), ORANGE) > 20);
    assert!(count_near(&crop, place(truth), Rgb([240, 130, 190])) > 20);
}

#[test]
fn a_laser_without_a_spot_shows_its_true_place() {
    let section = section(0);
    assert!(overlay::spot_crop(&image(&section, 0), &section.lasers[DARK], 0).is_some());
}

/// Number of points drawn with the symbol of a measured point.
fn dots(svg: &Document) -> usize {
    let is_dot = |n: &roxmltree::Node| {
        n.has_tag_name(("http://www.w3.org/2000/svg", "circle"))
            && n.attribute("fill") == Some("#0072B2")
            && n.attribute("r") == Some("7")
    };
    svg.descendants().filter(is_dot).count()
}

#[test]
fn section_plot_shows_every_point_and_explains_itself() {
    let section = section(0);
    let svg = plot::section_plot(&section, &outline_mm(0)).unwrap();
    let document = Document::parse(&svg).unwrap();
    assert_eq!(dots(&document), 10 + 1, "points and legend");
    for text in ["x (m)", "y (m)", "1 m", "10 of 12 lasers gave a point", "true cross-section", "not measured"] {
        assert!(svg.contains(text), "{text}");
    }
    // Without truth nothing speaks of truth.
    let mut blind = section;
    blind.lasers.iter_mut().for_each(|laser| laser.truth = None);
    assert!(!plot::section_plot(&blind, &[]).unwrap().contains("true"));
}

#[test]
fn error_plot_shows_every_point_with_a_known_truth() {
    let sections = [section(0), section(1)];
    let svg = plot::error_plot(&[&sections[0], &sections[1]]).unwrap().unwrap();
    assert_eq!(dots(&Document::parse(&svg).unwrap()), 20 + 1, "points and legend");
    let mut blind = section(0);
    blind.lasers.iter_mut().for_each(|laser| laser.truth = None);
    assert_eq!(plot::error_plot(&[&blind]).unwrap(), None);
}

#[test]
fn sequence_plot_shows_every_point_of_every_frame() {
    let sections = [section(0), section(1), section(2)];
    let svg = plot::sequence_plot(&sections.each_ref()).unwrap();
    let document = Document::parse(&svg).unwrap();
    let dots = document.descendants().filter(|n| n.tag_name().name() == "circle" && n.attribute("r") == Some("4"));
    assert_eq!(dots.count(), 30);
    assert!(svg.contains("gallery_0000") && svg.contains("gallery_0002"));
    plot::sequence_plot(&[]).unwrap();
}

#[test]
fn rig_plot_names_baseline_tube_water_and_every_laser() {
    let svg = plot::rig_plot(&Rig::ideal()).unwrap();
    let document = Document::parse(&svg).unwrap();
    for text in ["baseline B = 500.0 mm", "radius 75 mm, wall 5 mm", "12 laser beams", "camera 2", "532 nm"] {
        assert!(svg.contains(text), "{text}");
    }
    let texts: Vec<_> = document.descendants().filter_map(|n| n.text()).map(str::trim).collect();
    assert!((0..12).all(|laser| texts.contains(&laser.to_string().as_str())));
}

#[test]
fn report_is_self_contained_and_escapes_every_string() {
    let rig = Rig { name: "<script>rig</script>".into(), ..Rig::ideal() };
    let mut section = section(0);
    section.frame = "<script>frame</script>".into();
    section.method = "<script>method</script>".into();
    section.lasers[REJECTED].status = "<script>status</script>".into();
    let images = [image(&section, 0), image(&section, 1)];
    let frames = [ReportFrame { section: &section, images: Some(images.each_ref()), outline_mm: &[] }];
    let page = html(&report(&rig, &frames, &["<script>problem</script>".into()])).unwrap();
    for name in ["rig", "frame", "method", "status", "problem"] {
        assert!(page.contains(&format!("&lt;script&gt;{name}&lt;/script&gt;")), "{name}");
    }
    assert!(page.contains("<h1>Gallery &lt;north&gt; &amp; sump</h1>"));
    assert!(page.contains("2027-01-15T08:00:00Z"));
    assert!(!page.contains("<script"));
    let outside = page.replace("http://www.w3.org/2000/svg", "");
    for reference in ["http:", "https:", "url(", "@import", "<link"] {
        assert!(!outside.contains(reference), "{reference}");
    }
    let sources: Vec<_> = page.split("src=\"").skip(1).collect();
    assert_eq!(sources.len(), 2 + 2 * 12);
    assert!(sources.iter().all(|source| source.starts_with("data:image/")));
}

#[test]
fn report_of_a_sequence_folds_its_frames_and_of_one_frame_does_not() {
    let rig = Rig::ideal();
    let sections = [section(0), section(1), section(2)];
    let frames = sections.each_ref().map(|section| ReportFrame { section, images: None, outline_mm: &[] });
    let page = html(&report(&rig, &frames, &[])).unwrap();
    assert_eq!(page.matches("<details>").count(), 3);
    assert!(page.contains("30 of 36") && !page.contains("<img"));
    let page = html(&report(&rig, &frames[..1], &[])).unwrap();
    assert_eq!(page.matches("<details>").count(), 0);
    assert!(page.contains("10 of 12"));
}

#[test]
fn no_result_makes_an_output_fail() {
    let spoilt = |value: f64| {
        let mut section = section(0);
        for laser in &mut section.lasers {
            if let Some(point) = &mut laser.point {
                point.position_mm = [value, -value, value];
                point.range_mm = value;
                point.sigma_mm = Some(value);
                point.chi2 = Some(value);
            }
            for spot in laser.spots.iter_mut().flatten() {
                spot.pixel = [value, -value];
                spot.bounds = [9, 9, 3, 3];
            }
            if let Some(truth) = &mut laser.truth {
                truth.position_mm = Some([value; 3]);
                truth.range_mm = Some(value);
                truth.pixels = [Some([value; 2]); 2];
            }
        }
        section
    };
    let empty = Section { lasers: Vec::new(), timing: None, ..section(0) };
    let rig = Rig::default();
    let values = [0.0, 1e-30, 1e30, f64::MAX, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
    for section in values.map(spoilt).into_iter().chain([empty]) {
        let images = [RgbImage::new(40, 30), RgbImage::new(1, 1)];
        let outline_mm = [[f64::NAN, 1.0], [f64::INFINITY, 2.0]];
        for outline_mm in [&outline_mm[..], &[]] {
            let frames = [ReportFrame { section: &section, images: Some(images.each_ref()), outline_mm }];
            html(&report(&rig, &frames, &[])).unwrap();
        }
        for laser in &section.lasers {
            overlay::spot_crop(&images[0], laser, 0);
        }
        overlay::draw(&images[0], &section, 7, None);
        plot::sequence_plot(&[&section, &section]).unwrap();
        let sections = [section];
        ply::write(&sections, Vec::new()).unwrap();
        csv::write(&sections, Vec::new()).unwrap();
        mcap::write(&sections, Cursor::new(Vec::new())).unwrap();
    }
    html(&report(&rig, &[], &[])).unwrap();
}

#[test]
fn no_rig_makes_its_plot_fail() {
    let values = [0.0, 1e-30, 1e30, f64::MAX, f64::INFINITY, f64::NAN];
    for value in values {
        let mut rig = Rig::default();
        rig.cameras[0].mirror_radius_px = value;
        rig.lasers[0].origin_mm = [value; 3];
        rig.lasers[1].azimuth_deg = value;
        rig.reconstruction.range_mm = [value; 2];
        if let Some(tube) = &mut rig.tube {
            tube.inner_radius_mm = value;
        }
        for model in rig.cameras.iter_mut().flat_map(|c| [&mut c.water, &mut c.air]).flatten() {
            model.pose.position_mm = [value; 3];
        }
        plot::rig_plot(&rig).unwrap();
    }
    let mut rig = Rig::default();
    rig.lasers.clear();
    rig.tube = None;
    rig.cameras.iter_mut().for_each(|camera| (camera.air, camera.water) = (None, None));
    plot::rig_plot(&rig).unwrap();
    overlay::Guides::new(&rig);
}
