//! MCAP recording: one ROS 2 `sensor_msgs/msg/PointCloud2` per frame. Opens in Foxglove, ROS 2 and the Rerun viewer.

use super::OutputError;
use crate::result::Section;
use ::mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::{Seek, Write};

/// Topic of the points.
pub const TOPIC: &str = "/points";
/// Frame of reference of the points: the rig frame.
pub const FRAME_ID: &str = "karst";
/// Frame rate that time stamps are made from, 1/s.
pub const FRAME_RATE_HZ: u64 = 30;

/// Bytes per point: four `float32`, one `uint16`, two of padding that keep the floats aligned.
const POINT_STEP: usize = 20;
/// Name, byte offset and type code of the fields of a point, as `sensor_msgs/msg/PointField` defines them.
const FIELDS: [(&str, u32, u8); 5] =
    [("x", 0, FLOAT32), ("y", 4, FLOAT32), ("z", 8, FLOAT32), ("sigma", 12, FLOAT32), ("laser", 16, UINT16)];
const UINT16: u8 = 4;
const FLOAT32: u8 = 7;

/// The message definition with its dependencies, as the schema encoding `ros2msg` wants it.
const SCHEMA: &str = "\
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: sensor_msgs/PointField
uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count
";

/// Writes one message per section, also for sections without a point. Positions and `sigma` in metres, as ROS has it;
/// frame n (from 0) is stamped n / 30 s. `sigma` is NaN where the method gives none.
pub fn write(sections: &[Section], out: impl Write + Seek) -> Result<(), OutputError> {
    let mut writer = ::mcap::WriteOptions::new()
        .profile("ros2")
        .library(concat!("karst ", env!("CARGO_PKG_VERSION")))
        .compression(None)
        .create(out)?;
    let schema = writer.add_schema("sensor_msgs/msg/PointCloud2", "ros2msg", SCHEMA.as_bytes())?;
    let channel_id = writer.add_channel(schema, TOPIC, "cdr", &BTreeMap::new())?;
    for (frame, section) in sections.iter().enumerate() {
        let sequence = u32::try_from(frame).map_err(|_| OutputError::TooLarge {
            what: "frame",
            value: frame,
            max: u32::MAX as usize,
        })?;
        let time = u64::from(sequence) * 1_000_000_000 / FRAME_RATE_HZ;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &point_cloud(section, time)?)?;
    }
    writer.finish()?;
    Ok(())
}

/// The message of one section at a time in ns.
fn point_cloud(section: &Section, time: u64) -> Result<Vec<u8>, OutputError> {
    let mut data = Vec::new();
    for laser in &section.lasers {
        let Some(point) = &laser.point else { continue };
        let index = u16::try_from(laser.laser).map_err(|_| OutputError::TooLarge {
            what: "laser",
            value: laser.laser,
            max: u16::MAX.into(),
        })?;
        for millimetres in point.position_mm.into_iter().chain([point.sigma_mm.unwrap_or(f64::NAN)]) {
            data.extend(((millimetres / 1000.0) as f32).to_le_bytes());
        }
        data.extend(index.to_le_bytes());
        data.extend([0; 2]);
    }
    let width = (data.len() / POINT_STEP) as u32;

    let mut cdr = Cdr::new();
    // A u32 frame count at 30 Hz stays far below i32::MAX seconds.
    cdr.u32((time / 1_000_000_000) as u32);
    cdr.u32((time % 1_000_000_000) as u32);
    cdr.string(FRAME_ID);
    cdr.u32(1); // height: an unordered cloud is one row
    cdr.u32(width);
    cdr.u32(FIELDS.len() as u32);
    for (name, offset, datatype) in FIELDS {
        cdr.string(name);
        cdr.u32(offset);
        cdr.u8(datatype);
        cdr.u32(1);
    }
    cdr.u8(0); // is_bigendian
    cdr.u32(POINT_STEP as u32);
    cdr.u32(data.len() as u32);
    cdr.u32(data.len() as u32);
    cdr.0.extend(data);
    cdr.u8(1); // is_dense: no point has invalid coordinates
    Ok(cdr.0)
}

/// Writer of the plain little-endian CDR that ROS 2 uses: every number is aligned to its size, counted from the end of
/// the 4-byte encapsulation header.
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    fn u32(&mut self, value: u32) {
        // The header is 4 bytes long, so alignment to 4 is the same with and without it.
        self.0.resize(self.0.len().next_multiple_of(4), 0);
        self.0.extend(value.to_le_bytes());
    }

    fn string(&mut self, value: &str) {
        self.u32(value.len() as u32 + 1);
        self.0.extend(value.as_bytes());
        self.0.push(0);
    }
}
