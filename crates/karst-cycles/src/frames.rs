//! Frames of both cameras through the model of the whole IP.

use karst_core::{ConfigError, DetectorConfig};

use crate::stream::{Beat, Pixels, rows_of};
use crate::top::{Reconstruction, Top, TopGenerics};

/// Clocks of a pair of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameClocks {
    /// The first pixel of either camera.
    pub first_pixel: u64,
    /// The last pixel of the later camera.
    pub last_pixel: u64,
    /// The last point.
    pub points: u64,
    /// The interrupt: results are ready.
    pub results: u64,
    /// Clocks in which a pixel of the frame had to wait, of both cameras.
    pub waits: u64,
}

/// Both cameras in step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Camera {
    /// Idle clocks after each row.
    pub row_blanking: u32,
    /// And after each frame.
    pub frame_blanking: u32,
}

/// Clocks after a frame within which its results come, in any case.
const MOST_CLOCKS: u64 = 1_000_000;

/// What becomes of `count` times the same pair of pictures, R, G, B of each pixel: when the IP gets as many frames as it
/// can take.
pub fn frames<const LASERS: usize>(
    generics: &TopGenerics,
    configs: [&DetectorConfig<LASERS>; 2],
    reconstruction: Reconstruction,
    pictures: [&[u8]; 2],
    camera: Camera,
    count: usize,
) -> Result<Vec<FrameClocks>, ConfigError> {
    let pixels_per_clock = generics.detector.pixels_per_clock;
    let mut streams = Vec::new();
    for (config, picture) in configs.iter().zip(pictures) {
        let row_bytes = 3 * usize::from(config.width);
        let pixels = |(row, rgb)| Pixels { rgb, start: row == 0, last: true };
        streams.push(rows_of(config, picture.chunks_exact(row_bytes).enumerate().map(pixels))?);
    }
    let mut sources = streams.iter().map(|rows| {
        let blanking = move |row: usize, beat: &Beat| match (beat.last, row + 1 == rows.len()) {
            (false, _) => 0,
            (true, false) => camera.row_blanking,
            (true, true) => camera.frame_blanking,
        };
        let frame = move || {
            rows.iter().enumerate().flat_map(move |(number, row)| {
                row.beats(pixels_per_clock).map(move |beat| (beat, blanking(number, &beat), number + 1 == rows.len()))
            })
        };
        (0..count).flat_map(move |_| frame()).peekable()
    });
    let (Some(first), Some(second)) = (sources.next(), sources.next()) else { return Ok(Vec::new()) };
    let mut sources = [first, second];

    let mut top = Top::new(generics, configs, reconstruction);
    let mut frames = vec![FrameClocks::default(); count];
    let mut started = [0; 2];
    let mut idle = [0_u32; 2];
    let (mut points, mut results, mut last) = (0, 0, 0);
    for clock in 0.. {
        if results == count || clock > last + MOST_CLOCKS {
            break;
        }
        if top.point() == Some(true) {
            frames[points].points = clock;
            points += 1;
        }
        if top.is_interrupt() {
            frames[results].results = clock;
            results += 1;
        }
        let mut beats = [None; 2];
        for (camera, source) in sources.iter_mut().enumerate() {
            beats[camera] = source.peek().filter(|_| idle[camera] == 0).copied();
            idle[camera] = idle[camera].saturating_sub(1);
        }
        let offered = beats.each_ref().map(|beat| beat.as_ref().map(|(beat, _, _)| beat));
        let taken = top.takes(offered);
        top.clock(offered);
        for (camera, beat) in beats.iter().enumerate() {
            let Some((beat, blanking, is_last_row)) = beat else { continue };
            last = clock;
            if !taken[camera] {
                let frame = started[camera] - usize::from(!beat.start);
                frames[frame.min(count - 1)].waits += 1;
                continue;
            }
            sources[camera].next();
            idle[camera] = *blanking;
            if beat.start {
                if started[1 - camera] <= started[camera] {
                    frames[started[camera]].first_pixel = clock;
                }
                started[camera] += 1;
            }
            if beat.last && *is_last_row {
                let frame = &mut frames[started[camera] - 1];
                frame.last_pixel = frame.last_pixel.max(clock);
            }
        }
    }
    Ok(frames)
}
