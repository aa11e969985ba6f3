//! A sensor's frame as text for a terminal: the points as a table, the section as a picture of dots, the line's and the
//! sensor's state.

use karst_link::{Errors, LinkCounters, Status};

use crate::result::{LaserResult, Section};
use crate::sensor::{FrameCounts, SensorFrame};

/// Columns of the table.
const TABLE_COLUMNS: usize = 52;
/// Fewer columns than this are no picture.
const FEWEST_PICTURE_COLUMNS: usize = 16;

/// What is shown of a sensor.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// Where the sensor is, and what it is set to.
    pub title: &'a str,
    /// The last frame.
    pub frame: Option<&'a SensorFrame>,
    /// Frames so far.
    pub counts: FrameCounts,
    /// What this end of the line has received.
    pub link: LinkCounters,
    /// The sensor's last status.
    pub status: Option<&'a Status>,
    /// The last things that happened, oldest first.
    pub events: &'a [String],
}

impl View<'_> {
    /// The lines of a page: no more than `rows`, none longer than `columns`.
    pub fn page(&self, columns: usize, rows: usize) -> Vec<String> {
        let mut below = vec![format!("frames: {}", counts_line(&self.counts)), link_line(&self.link)];
        below.extend(self.status.map(status_line));
        below.extend(self.events.iter().cloned());
        let mut page = vec![self.title.to_owned()];
        match self.frame {
            Some(frame) => {
                page.push(frame_line(frame));
                let room = rows.saturating_sub(page.len() + below.len());
                page.extend(side_by_side(&frame.section, columns, room));
            }
            None => page.push("no frame yet".to_owned()),
        }
        page.extend(below);
        page.truncate(rows);
        page.into_iter().map(|line| line.chars().take(columns).collect()).collect()
    }
}

/// Table and picture of a section: no more than `rows` lines, none longer than `columns`, but for a table without room.
pub fn side_by_side(section: &Section, columns: usize, rows: usize) -> Vec<String> {
    let mut left = table(section);
    if left.len() > rows {
        left.truncate(rows.saturating_sub(1));
        left.push(format!("... {} lasers", section.lasers.len()));
    }
    let width = columns.saturating_sub(TABLE_COLUMNS + 1).min(2 * rows);
    if width < FEWEST_PICTURE_COLUMNS {
        return left;
    }
    // A character is about twice as high as it is wide
    let right = picture(section, width, (width / 2).min(rows));
    (0..left.len().max(right.len()))
        .map(|i| {
            let [left, right] = [&left, &right].map(|lines| lines.get(i).map_or("", String::as_str));
            format!("{left:TABLE_COLUMNS$} {right}").trim_end().to_owned()
        })
        .collect()
}

/// `frame 7: 12 points of 12 lasers, range 812 to 2250 mm, sigma up to 1.20 mm`, and what was lost.
pub fn frame_line(frame: &SensorFrame) -> String {
    let lasers = &frame.section.lasers;
    let points = || lasers.iter().filter_map(|laser| laser.point.as_ref());
    let mut line = format!("frame {}: {} points of {} lasers", frame.number, points().count(), lasers.len());
    let ranges = points().map(|point| point.range_mm);
    let span =
        ranges.fold(None, |span: Option<(f64, f64)>, r| Some(span.map_or((r, r), |(a, b)| (a.min(r), b.max(r)))));
    if let Some((nearest, farthest)) = span {
        line += &format!(", range {nearest:.0} to {farthest:.0} mm");
    }
    if let Some(sigma) = points().filter_map(|point| point.sigma_mm).reduce(f64::max) {
        line += &format!(", sigma up to {sigma:.2} mm");
    }
    if !frame.complete {
        line += &format!(", INCOMPLETE: {} messages lost", frame.lost_messages);
    }
    line
}

/// How many frames came, and how.
pub fn counts_line(counts: &FrameCounts) -> String {
    let FrameCounts { complete, incomplete, missing } = counts;
    format!("{complete} complete, {incomplete} incomplete, {missing} missing")
}

fn link_line(link: &LinkCounters) -> String {
    format!(
        "line: {} messages, {} lost, {} corrupt, {} oversize, {} unknown",
        link.received, link.lost, link.corrupt, link.oversize, link.unknown
    )
}

fn status_line(status: &Status) -> String {
    let errors = error_names(&status.errors);
    format!(
        "sensor: up {} s, {} frames, {} dropped, {} commands lost, {}",
        status.uptime_ms / 1000,
        status.frames,
        status.dropped_frames,
        status.link.lost,
        if errors.is_empty() { "no errors".to_owned() } else { format!("errors: {}", errors.join(", ")) }
    )
}

/// The errors that happened, in words.
pub fn error_names(errors: &Errors) -> Vec<String> {
    let serde_json::Value::Object(flags) = serde_json::json!(errors) else { return Vec::new() };
    flags.into_iter().filter(|(_, happened)| *happened == true).map(|(name, _)| name.replace('_', " ")).collect()
}

/// One line per laser below a header, mm: what was measured, or why nothing was.
pub fn table(section: &Section) -> Vec<String> {
    let header =
        format!("{:>5} {:>8} {:>8} {:>8} {:>7} {:>5} {:>5}", "laser", "range mm", "X", "Y", "Z", "sigma", "chi2");
    [header].into_iter().chain(section.lasers.iter().map(row)).collect()
}

fn row(laser: &LaserResult) -> String {
    let Some(point) = &laser.point else { return format!("{:>5} {}", laser.laser, laser.status) };
    let [x, y, z] = point.position_mm;
    let decimals = |value: Option<f64>, places| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.places$}"));
    format!(
        "{:>5} {:>8.1} {x:>8.1} {y:>8.1} {z:>7.1} {:>5} {:>5}",
        laser.laser,
        point.range_mm,
        decimals(point.sigma_mm, 2),
        decimals(point.chi2, 1)
    )
}

/// The section seen along the axis from camera 2, X to the right and Y up: a dot per point, a line between neighbours, the
/// axis as a cross. The last line is the scale.
pub fn picture(section: &Section, columns: usize, rows: usize) -> Vec<String> {
    let places: Vec<Option<[f64; 2]>> = section
        .lasers
        .iter()
        .map(|laser| laser.point.as_ref().map(|point| [point.position_mm[0], point.position_mm[1]]))
        .collect();
    let farthest = places.iter().flatten().flatten().map(|value| value.abs()).fold(100.0, f64::max);
    let mut canvas = Canvas::new(columns, rows.saturating_sub(1));
    let unit = (canvas.width().min(canvas.height()) as f64 - 3.0) / (2.0 * farthest);
    let middle = [canvas.width() as f64 / 2.0, canvas.height() as f64 / 2.0];
    let dot = |[x, y]: [f64; 2]| [(middle[0] + unit * x).round() as i32, (middle[1] - unit * y).round() as i32];

    let axis = dot([0.0, 0.0]);
    canvas.cross(axis, 2);
    for (place, next) in places.iter().zip(places.iter().cycle().skip(1)) {
        let Some(place) = *place else { continue };
        canvas.cross(dot(place), 1);
        if let Some(next) = *next {
            canvas.line(dot(place), dot(next));
        }
    }
    let mut lines = canvas.lines();
    lines.push(format!("{:^columns$}", format!("{:.2} m across", farthest * 2.0 / 1000.0)).trim_end().to_owned());
    lines
}

/// Dots in Braille characters: two by four in each.
struct Canvas {
    columns: usize,
    cells: Vec<u8>,
}

impl Canvas {
    fn new(columns: usize, rows: usize) -> Self {
        Self { columns, cells: vec![0; columns * rows] }
    }

    fn width(&self) -> usize {
        2 * self.columns
    }

    fn height(&self) -> usize {
        4 * (self.cells.len() / self.columns.max(1))
    }

    fn set(&mut self, [x, y]: [i32; 2]) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x >= self.width() || y >= self.height() {
            return;
        }
        // The bits of a Braille character: three rows of the left column, of the right one, then the fourth row
        const BITS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];
        self.cells[y / 4 * self.columns + x / 2] |= BITS[y % 4][x % 2];
    }

    fn cross(&mut self, [x, y]: [i32; 2], arm: i32) {
        for i in -arm..=arm {
            self.set([x + i, y]);
            self.set([x, y + i]);
        }
    }

    /// Every other dot of a straight line.
    fn line(&mut self, from: [i32; 2], to: [i32; 2]) {
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
        for step in (0..steps).step_by(2) {
            let at = |i: usize| from[i] + ((to[i] - from[i]) * step) / steps;
            self.set([at(0), at(1)]);
        }
    }

    fn lines(&self) -> Vec<String> {
        let braille = |&bits: &u8| char::from_u32(0x2800 + u32::from(bits)).unwrap_or(' ');
        self.cells.chunks(self.columns.max(1)).map(|row| row.iter().map(braille).collect()).collect()
    }
}
