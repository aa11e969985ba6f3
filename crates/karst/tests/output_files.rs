//! What is written can be read back by independent readers.

mod output_common;

use karst::output::{OutputError, csv, folder, mcap, ply, summary::Summary};
use karst::result::Section;
use output_common::{DARK, REJECTED, section};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use std::io::Cursor;

fn sections() -> Vec<Section> {
    (0..3).map(section).collect()
}

fn float(element: &DefaultElement, key: &str) -> f32 {
    match element[key] {
        Property::Float(value) => value,
        ref other => panic!("{key}: {other:?}"),
    }
}

#[test]
fn ply_holds_every_point_with_its_laser_and_frame() {
    let sections = sections();
    let mut file = Vec::new();
    ply::write(&sections, &mut file).unwrap();
    let cloud = Parser::<DefaultElement>::new().read_ply(&mut Cursor::new(file)).unwrap();
    let mut vertices = cloud.payload["vertex"].iter();
    for (frame, section) in sections.iter().enumerate() {
        for laser in &section.lasers {
            let Some(point) = &laser.point else { continue };
            let vertex = vertices.next().unwrap();
            for (key, value) in ["x", "y", "z"].iter().zip(point.position_mm) {
                assert_eq!(float(vertex, key), value as f32);
            }
            assert_eq!(float(vertex, "sigma"), point.sigma_mm.unwrap() as f32);
            assert!(matches!(vertex["laser"], Property::UShort(k) if usize::from(k) == laser.laser));
            assert!(matches!(vertex["frame"], Property::UInt(k) if k as usize == frame));
        }
    }
    assert!(vertices.next().is_none());
}

#[test]
fn ply_colours_run_from_the_nearest_to_the_farthest_point() {
    let sections = sections();
    let mut file = Vec::new();
    ply::write(&sections, &mut file).unwrap();
    let cloud = Parser::<DefaultElement>::new().read_ply(&mut Cursor::new(file)).unwrap();
    let by_range = |v: &&DefaultElement| (float(v, "x").hypot(float(v, "y")) * 1000.0) as i64;
    let red = |v: &DefaultElement| match v["red"] {
        Property::UChar(red) => red,
        ref other => panic!("{other:?}"),
    };
    let vertices = &cloud.payload["vertex"];
    assert_eq!(red(vertices.iter().min_by_key(by_range).unwrap()), 68);
    assert_eq!(red(vertices.iter().max_by_key(by_range).unwrap()), 253);
}

#[test]
fn ply_of_the_papers_method_has_no_sigma_and_an_empty_sequence_no_points() {
    let mut paper = section(0);
    for laser in &mut paper.lasers {
        if let Some(point) = &mut laser.point {
            point.sigma_mm = None;
        }
    }
    for (sections, count) in [(vec![paper], 10), (vec![], 0)] {
        let mut file = Vec::new();
        ply::write(&sections, &mut file).unwrap();
        let cloud = Parser::<DefaultElement>::new().read_ply(&mut Cursor::new(file)).unwrap();
        let vertices = cloud.payload.get("vertex").map(Vec::as_slice).unwrap_or_default();
        assert_eq!(vertices.len(), count);
        assert!(vertices.iter().all(|v| float(v, "sigma").is_nan()));
    }
}

#[test]
fn csv_has_a_row_per_laser_with_the_reason_where_there_is_no_point() {
    let sections = sections();
    let mut file = Vec::new();
    csv::write(&sections, &mut file).unwrap();
    let mut reader = ::csv::Reader::from_reader(file.as_slice());
    let header = reader.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    let rows: Vec<_> = reader.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 3 * 12);
    for (i, row) in rows.iter().enumerate() {
        let (frame, laser) = (i / 12, &sections[i / 12].lasers[i % 12]);
        assert_eq!(row[column("frame")], frame.to_string());
        assert_eq!(row[column("frame_name")], sections[frame].frame);
        assert_eq!(row[column("laser")], laser.laser.to_string());
        assert_eq!(row[column("status")], laser.status);
        // Numbers come back exactly.
        let point = laser.point.as_ref();
        assert_eq!(row[column("x_mm")].parse().ok(), point.map(|p| p.position_mm[0]));
        assert_eq!(row[column("sigma_mm")].parse().ok(), point.and_then(|p| p.sigma_mm));
        assert_eq!(row[column("camera2_laser_mm")].parse().ok(), point.and_then(|p| p.estimates_mm[1]));
        assert_eq!(row[column("camera1_y_px")].parse().ok(), laser.spots[0].as_ref().map(|s| s.pixel[1]));
    }
}

#[test]
fn csv_columns_are_stable() {
    let mut file = Vec::new();
    csv::write(&[section(0)], &mut file).unwrap();
    assert_eq!(
        String::from_utf8(file).unwrap().lines().next().unwrap(),
        "frame,frame_name,laser,status,x_mm,y_mm,z_mm,range_mm,sigma_mm,chi2,\
         camera1_laser_mm,camera2_laser_mm,stereo_mm,\
         camera1_x_px,camera1_y_px,camera1_sigma_px,camera1_pixels,camera1_saturated_pixels,\
         camera2_x_px,camera2_y_px,camera2_sigma_px,camera2_pixels,camera2_saturated_pixels,\
         truth_x_mm,truth_y_mm,truth_z_mm,truth_range_mm,range_error_mm"
    );
}

/// Reader of little-endian CDR, written from the specification: numbers aligned to their size from the end of the
/// encapsulation header.
struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
}

impl Cdr<'_> {
    fn u8(&mut self) -> u8 {
        self.at += 1;
        self.body[self.at - 1]
    }
    fn u32(&mut self) -> u32 {
        while !self.at.is_multiple_of(4) {
            assert_eq!(self.u8(), 0, "padding");
        }
        u32::from_le_bytes([self.u8(), self.u8(), self.u8(), self.u8()])
    }
    fn string(&mut self) -> String {
        let length = self.u32();
        let mut bytes: Vec<u8> = (0..length).map(|_| self.u8()).collect();
        assert_eq!(bytes.pop(), Some(0));
        String::from_utf8(bytes).unwrap()
    }
}

#[test]
fn mcap_holds_one_point_cloud_per_frame_in_metres() {
    let mut sections = sections();
    sections[1].lasers.iter_mut().for_each(|laser| laser.point = None);
    let mut file = Cursor::new(Vec::new());
    mcap::write(&sections, &mut file).unwrap();
    let file = file.into_inner();
    let messages: Vec<_> = ::mcap::read::MessageStream::new(&file).unwrap().map(Result::unwrap).collect();
    assert_eq!(messages.len(), 3);
    for (frame, message) in messages.iter().enumerate() {
        let time = frame as u64 * 1_000_000_000 / 30;
        assert_eq!((message.log_time, message.publish_time), (time, time));
        assert_eq!(message.channel.topic, "/points");
        assert_eq!(message.channel.message_encoding, "cdr");
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!((schema.name.as_str(), schema.encoding.as_str()), ("sensor_msgs/msg/PointCloud2", "ros2msg"));

        assert_eq!(message.data[..4], [0, 1, 0, 0]);
        let mut cdr = Cdr { body: &message.data[4..], at: 0 };
        assert_eq!(u64::from(cdr.u32()) * 1_000_000_000 + u64::from(cdr.u32()), time);
        assert_eq!(cdr.string(), "karst");
        let points: Vec<_> = sections[frame].lasers.iter().filter_map(|l| Some((l.laser, l.point.as_ref()?))).collect();
        assert_eq!([cdr.u32(), cdr.u32()], [1, points.len() as u32], "height and width");
        let fields: Vec<_> = (0..cdr.u32()).map(|_| (cdr.string(), cdr.u32(), cdr.u8(), cdr.u32())).collect();
        let field = |name: &str, offset, datatype| (name.to_owned(), offset, datatype, 1);
        assert_eq!(
            fields,
            [field("x", 0, 7), field("y", 4, 7), field("z", 8, 7), field("sigma", 12, 7), field("laser", 16, 4)]
        );
        assert_eq!(cdr.u8(), 0, "little endian");
        assert_eq!([cdr.u32(), cdr.u32()], [20, 20 * points.len() as u32], "point and row step");
        assert_eq!(cdr.u32(), 20 * points.len() as u32, "length of the data");
        let data = &cdr.body[cdr.at..][..20 * points.len()];
        for (bytes, (laser, point)) in data.chunks(20).zip(points) {
            let float = |i: usize| f32::from_le_bytes(bytes[4 * i..][..4].try_into().unwrap());
            for i in 0..3 {
                assert_eq!(float(i), (point.position_mm[i] / 1000.0) as f32);
            }
            assert_eq!(float(3), (point.sigma_mm.unwrap() / 1000.0) as f32);
            assert_eq!(usize::from(u16::from_le_bytes([bytes[16], bytes[17]])), laser);
        }
        cdr.at += data.len();
        assert_eq!(cdr.u8(), 1, "dense");
        assert_eq!(cdr.at, cdr.body.len(), "nothing after the last field");
    }
    let summary = ::mcap::Summary::read(&file).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count, 3);
}

#[test]
fn mcap_carries_the_ros2_profile() {
    let mut file = Cursor::new(Vec::new());
    mcap::write(&[section(0)], &mut file).unwrap();
    let file = file.into_inner();
    let header = ::mcap::read::LinearReader::new(&file).unwrap().next().unwrap().unwrap();
    assert!(matches!(header, ::mcap::records::Record::Header(header) if header.profile == "ros2"));
}

#[test]
fn a_laser_index_beyond_the_format_is_an_error() {
    let mut section = section(0);
    section.lasers[0].laser = 70_000;
    assert!(matches!(
        ply::write(&[section.clone()], Vec::new()),
        Err(OutputError::TooLarge { what: "laser", value: 70_000, .. })
    ));
    assert!(matches!(
        mcap::write(&[section], Cursor::new(Vec::new())),
        Err(OutputError::TooLarge { what: "laser", value: 70_000, .. })
    ));
}

#[test]
fn a_failing_stream_is_an_error() {
    struct Full;
    impl std::io::Write for Full {
        fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
            Err(std::io::ErrorKind::StorageFull.into())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    assert!(matches!(ply::write(&sections(), Full), Err(OutputError::Io(_))));
    assert!(csv::write(&sections(), Full).is_err());
}

#[test]
fn summary_counts_missed_lasers_and_averages_the_errors() {
    let mut section = section(0);
    for (i, laser) in section.lasers.iter_mut().enumerate() {
        let truth = laser.truth.as_mut().unwrap();
        truth.range_mm = Some(1000.0);
        if let Some(point) = &mut laser.point {
            point.range_mm = if i % 2 == 0 { 1003.0 } else { 999.0 };
            point.chi2 = Some(6.0);
        }
    }
    // Laser 4 and 9 have no point: five even and five odd ones are left.
    assert!(section.lasers[DARK].point.is_none() && section.lasers[REJECTED].point.is_none());
    section.lasers[DARK].truth.as_mut().unwrap().visible = [true, false];
    let summary = Summary::new(&[&section]);
    assert_eq!((summary.frames, summary.lasers, summary.points), (1, 12, 10));
    assert_eq!((summary.visible, summary.missed), (Some(11), Some(1)));
    assert_eq!(summary.bias_mm, Some(1.0));
    assert_eq!(summary.rms_error_mm, Some(5f64.sqrt()));
    assert_eq!(summary.worst_error_mm, Some(3.0));
    assert!((summary.mean_error_percent.unwrap() - 0.2).abs() < 1e-12);
    assert_eq!(summary.mean_chi2_per_dof, Some(2.0));
    assert_eq!(Summary::new(&[]).rms_error_mm, None);
}

#[test]
fn the_output_folder_is_created_with_its_parents() {
    let root = tempfile::tempdir().unwrap();
    let path = root.path().join("a/b");
    folder::prepare(&path).unwrap();
    folder::prepare(&path).unwrap();
    assert!(path.read_dir().unwrap().next().is_none(), "the check leaves nothing behind");
}

#[test]
fn an_output_folder_that_is_a_file_or_below_one_is_an_error() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let error = folder::prepare(file.path()).unwrap_err();
    assert!(matches!(error, folder::FolderError::NotAFolder(_)));
    assert!(error.to_string().contains("this is a file, expected a folder"));
    let below = file.path().join("out");
    let error = folder::prepare(&below).unwrap_err();
    assert!(matches!(error, folder::FolderError::Create { .. }));
    assert!(error.to_string().contains(&below.display().to_string()));
}

/// Holds for root, too: nobody creates files there.
#[cfg(target_os = "linux")]
#[test]
fn an_unwritable_output_folder_is_an_error() {
    let unwritable = folder::prepare("/proc".as_ref());
    assert!(matches!(unwritable, Err(folder::FolderError::NotWritable { .. })), "{unwritable:?}");
    let parent = folder::prepare("/proc/karst".as_ref());
    assert!(matches!(parent, Err(folder::FolderError::Create { .. })), "{parent:?}");
}
