//! Pictures of what the detector found: markers over the camera image, and magnified crops of the spots.
//!
//! Colours tell apart without red and green: sky blue for a spot that made a point, orange for one that did not, pink
//! for the truth.

use crate::result::{LaserResult, Section};
use image::{Rgb, RgbImage};
use karst_rig::{Camera, CameraModel, Rig};
use nalgebra::{Point3, Vector2};

/// Magnification of the spot crops.
pub const CROP_SCALE: u32 = 8;
/// Width and height of the image area in a spot crop, px.
pub const CROP_SIZE_PX: u32 = 25;
/// Width and height of a spot crop, px.
pub const TILE_SIZE_PX: u32 = CROP_SIZE_PX * CROP_SCALE;

const ACCEPTED: [u8; 3] = [86, 180, 233];
const REJECTED: [u8; 3] = [230, 159, 0];
const TRUTH: [u8; 3] = [240, 130, 190];
const GUIDE: [u8; 3] = [150, 150, 150];
const BEAM: [u8; 3] = [120, 200, 160];

/// Height of the laser numbers, px.
const LABEL_HEIGHT: f64 = 20.0;
/// Points of a beam that its image is drawn through.
const BEAM_STEPS: usize = 24;

/// What the rig says about an image, to be drawn faintly under the spots.
#[derive(Debug, Clone, PartialEq)]
pub struct Guides {
    /// Centre of the mirror's image, px.
    pub centre_px: [f64; 2],
    /// Outer and inner radius of the usable image, px.
    pub radii_px: [f64; 2],
    /// Images of the beams over the working range, near end first, px.
    pub beams_px: Vec<Vec<[f64; 2]>>,
    /// Half width of the sector around each beam, degrees.
    pub sector_half_width_deg: f64,
}

impl Guides {
    /// The guides of both cameras.
    pub fn new(rig: &Rig) -> [Self; 2] {
        [0, 1].map(|index| {
            let camera = &rig.cameras[index];
            let centre_px = model(camera).map_or([0.0; 2], |m| m.centre_px);
            let traced = rig.traced_camera(index);
            let project = |point| match &camera.water {
                Some(water) => water.project(point, camera.mirror_radius_px),
                None => traced.as_ref()?.project(point),
            };
            let [near, far] = rig.reconstruction.range_mm;
            let beams_px = rig.lasers.iter().map(|laser| {
                let (origin, direction) = (Point3::from(laser.origin_mm), laser.direction());
                (0..=BEAM_STEPS)
                    .filter_map(|i| {
                        // Equal steps of 1 / range are about equal steps in the image.
                        let weight = i as f64 / BEAM_STEPS as f64;
                        let range = 1.0 / ((1.0 - weight) / near + weight / far);
                        project(origin + range * direction).map(|p: Vector2<f64>| p.into())
                    })
                    .collect()
            });
            Self {
                centre_px,
                radii_px: [camera.mirror_radius_px, camera.inner_radius_px],
                beams_px: beams_px.collect(),
                sector_half_width_deg: rig.detector.sector_half_width_deg,
            }
        })
    }
}

fn model(camera: &Camera) -> Option<&CameraModel> {
    camera.water.as_ref().or(camera.air.as_ref())
}

/// A copy of the image of camera `camera` (0 or 1) with a numbered marker around every spot of the section: sky blue
/// for spots that made a point, orange for spots that did not; pink for places where the truth says that a spot is
/// visible and none was found. A cross marks the sub-pixel position, the circle leaves the spot itself uncovered.
pub fn draw(image: &RgbImage, section: &Section, camera: usize, guides: Option<&Guides>) -> RgbImage {
    let mut canvas = Canvas(image.clone());
    let centre = match guides {
        Some(guides) => {
            draw_guides(&mut canvas, guides);
            guides.centre_px
        }
        None => [f64::from(image.width()) / 2.0, f64::from(image.height()) / 2.0],
    };
    for laser in &section.lasers {
        let Some((position, colour)) = marked(laser, camera) else { continue };
        let pen = Pen { colour, alpha: 1.0, width: 2.0 };
        let size = spot(laser, camera).map_or(0, |s| {
            let [x_min, y_min, x_max, y_max] = s.bounds;
            x_max.saturating_sub(x_min).max(y_max.saturating_sub(y_min))
        });
        let radius = 8.0 + 0.75 * f64::from(size);
        canvas.outlined(&pen, |canvas, pen| {
            canvas.circle(position, radius, pen);
            canvas.cross(position, radius - 3.0, radius + 5.0, pen);
        });
        // Outwards, where no other spot of this laser can be.
        let outwards = direction(centre, position);
        let offset = radius + 8.0 + 0.8 * LABEL_HEIGHT;
        let label = [position[0] + offset * outwards[0], position[1] + offset * outwards[1]];
        canvas.outlined(&pen, |canvas, pen| canvas.number(laser.laser, label, LABEL_HEIGHT, pen));
    }
    canvas.0
}

/// One magnified spot of camera `camera` (0 or 1): the found position as a cross, the true one, if known, as a pink
/// diamond. Dark crops are brightened up to four times. None: nothing was found and no truth is known.
pub fn spot_crop(image: &RgbImage, laser: &LaserResult, camera: usize) -> Option<RgbImage> {
    let (centre, colour) = marked(laser, camera)?;
    let half = i64::from(CROP_SIZE_PX / 2);
    let origin = centre.map(|c| (c.round() as i64).saturating_sub(half));
    let pixel = |x: u32, y: u32| {
        let [x, y] = [origin[0].checked_add(x.into())?, origin[1].checked_add(y.into())?];
        image.get_pixel_checked(u32::try_from(x).ok()?, u32::try_from(y).ok()?)
    };
    let sides = || (0..CROP_SIZE_PX).flat_map(|y| (0..CROP_SIZE_PX).map(move |x| (x, y)));
    let brightest = sides().filter_map(|(x, y)| pixel(x, y)?.0.into_iter().max()).max().unwrap_or(0);
    let gain = (255.0 / f64::from(brightest.max(1))).min(4.0);
    let crop = RgbImage::from_fn(TILE_SIZE_PX, TILE_SIZE_PX, |x, y| match pixel(x / CROP_SCALE, y / CROP_SCALE) {
        Some(Rgb(channels)) => Rgb(channels.map(|c| (f64::from(c) * gain) as u8)),
        None => Rgb([40; 3]), // beyond the edge of the image
    });

    let mut canvas = Canvas(crop);
    let scale = f64::from(CROP_SCALE);
    let to_tile = |p: [f64; 2]| [0, 1].map(|i| (p[i] - origin[i] as f64 + 0.5) * scale - 0.5);
    if let Some(truth) = truth_pixel(laser, camera) {
        let pen = Pen { colour: TRUTH, alpha: 1.0, width: 2.0 };
        canvas.outlined(&pen, |canvas, pen| canvas.diamond(to_tile(truth), 8.0, pen));
    }
    if let Some(spot) = spot(laser, camera) {
        let pen = Pen { colour, alpha: 1.0, width: 2.0 };
        canvas.outlined(&pen, |canvas, pen| canvas.cross(to_tile(spot.pixel), 14.0, 34.0, pen));
    }
    Some(canvas.0)
}

fn spot(laser: &LaserResult, camera: usize) -> Option<&crate::result::SpotResult> {
    laser.spots.get(camera)?.as_ref()
}

fn truth_pixel(laser: &LaserResult, camera: usize) -> Option<[f64; 2]> {
    let truth = laser.truth.as_ref()?;
    truth.visible.get(camera)?.then_some(*truth.pixels.get(camera)?)?
}

/// Place and colour of the marker: the spot, or the true place of a spot that should be there.
fn marked(laser: &LaserResult, camera: usize) -> Option<([f64; 2], [u8; 3])> {
    match spot(laser, camera) {
        Some(spot) => Some((spot.pixel, if laser.point.is_some() { ACCEPTED } else { REJECTED })),
        None => Some((truth_pixel(laser, camera)?, TRUTH)),
    }
}

fn draw_guides(canvas: &mut Canvas, guides: &Guides) {
    let faint = Pen { colour: GUIDE, alpha: 0.4, width: 1.2 };
    let beam_pen = Pen { colour: BEAM, alpha: 0.45, width: 1.2 };
    let [outer, inner] = guides.radii_px;
    for radius in guides.radii_px {
        canvas.circle(guides.centre_px, radius, &faint);
    }
    for beam in &guides.beams_px {
        for pair in beam.windows(2) {
            canvas.segment(pair[0], pair[1], &beam_pen);
        }
        let Some(&middle) = beam.get(beam.len() / 2) else { continue };
        let along = direction(guides.centre_px, middle);
        for side in [-1.0, 1.0] {
            let (sin, cos) = (side * guides.sector_half_width_deg).to_radians().sin_cos();
            let edge = [along[0] * cos - along[1] * sin, along[0] * sin + along[1] * cos];
            let at = |radius: f64| [0, 1].map(|i| guides.centre_px[i] + radius * edge[i]);
            canvas.segment(at(inner), at(outer), &faint);
        }
    }
}

/// Unit vector between two points; to the right where they coincide.
fn direction(from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    let [x, y] = [to[0] - from[0], to[1] - from[1]];
    let length = x.hypot(y);
    if length > 0.0 { [x / length, y / length] } else { [1.0, 0.0] }
}

/// How a line is drawn.
#[derive(Clone, Copy)]
struct Pen {
    colour: [u8; 3],
    alpha: f64,
    width: f64,
}

/// An image with smooth, sub-pixel drawing. Whole-number coordinates are pixel centres.
struct Canvas(RgbImage);

impl Canvas {
    /// Draws twice: a dark rim first, so that the lines stand out from any background.
    fn outlined(&mut self, pen: &Pen, draw: impl Fn(&mut Self, &Pen)) {
        draw(self, &Pen { colour: [0; 3], alpha: 0.6, width: pen.width + 2.5 });
        draw(self, pen);
    }

    /// Covers the pixels whose distance from a curve is within half the pen's width, fading over one pixel. The curve
    /// lies in the box from `low` to `high`.
    fn stroke(&mut self, low: [f64; 2], high: [f64; 2], pen: &Pen, distance: impl Fn(f64, f64) -> f64) {
        let margin = pen.width / 2.0 + 1.0;
        let size = [self.0.width(), self.0.height()];
        // Float to integer saturates, so positions far outside the image cost nothing.
        let start = low.map(|v| (v - margin).max(0.0) as u32);
        let end = [0, 1].map(|i| ((high[i] + margin + 1.0).max(0.0) as u32).min(size[i]));
        for y in start[1]..end[1] {
            for x in start[0]..end[0] {
                let cover = (pen.width / 2.0 + 0.5 - distance(x.into(), y.into())).clamp(0.0, 1.0) * pen.alpha;
                if cover > 0.0 {
                    let Rgb(pixel) = self.0.get_pixel_mut(x, y);
                    for (channel, target) in pixel.iter_mut().zip(pen.colour) {
                        let mixed = f64::from(*channel) * (1.0 - cover) + f64::from(target) * cover;
                        *channel = mixed.round() as u8;
                    }
                }
            }
        }
    }

    fn circle(&mut self, centre: [f64; 2], radius: f64, pen: &Pen) {
        self.stroke(centre.map(|c| c - radius), centre.map(|c| c + radius), pen, |x, y| {
            ((x - centre[0]).hypot(y - centre[1]) - radius).abs()
        });
    }

    fn segment(&mut self, from: [f64; 2], to: [f64; 2], pen: &Pen) {
        let span = [to[0] - from[0], to[1] - from[1]];
        let square = (span[0] * span[0] + span[1] * span[1]).max(f64::MIN_POSITIVE);
        let low = [0, 1].map(|i| from[i].min(to[i]));
        let high = [0, 1].map(|i| from[i].max(to[i]));
        self.stroke(low, high, pen, |x, y| {
            let [dx, dy] = [x - from[0], y - from[1]];
            let along = ((dx * span[0] + dy * span[1]) / square).clamp(0.0, 1.0);
            (dx - along * span[0]).hypot(dy - along * span[1])
        });
    }

    /// Four strokes around a free centre.
    fn cross(&mut self, centre: [f64; 2], inner: f64, outer: f64, pen: &Pen) {
        for [x, y] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
            let at = |radius: f64| [centre[0] + radius * x, centre[1] + radius * y];
            self.segment(at(inner), at(outer), pen);
        }
    }

    fn diamond(&mut self, centre: [f64; 2], radius: f64, pen: &Pen) {
        let corners = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]
            .map(|[x, y]| [centre[0] + radius * x, centre[1] + radius * y]);
        for i in 0..4 {
            self.segment(corners[i], corners[(i + 1) % 4], pen);
        }
    }

    /// A number in strokes, centred at a point.
    fn number(&mut self, number: usize, centre: [f64; 2], height: f64, pen: &Pen) {
        let unit = height / 4.0;
        let digits = number.to_string();
        let left = centre[0] - unit * (3.0 * digits.len() as f64 - 1.0) / 2.0;
        for (i, digit) in digits.bytes().enumerate() {
            let place = |&(x, y): &(f64, f64)| [left + unit * (3.0 * i as f64 + x), centre[1] + unit * (y - 2.0)];
            for pair in DIGITS[usize::from(digit - b'0')].windows(2) {
                self.segment(place(&pair[0]), place(&pair[1]), pen);
            }
        }
    }
}

/// The digits as lines on a grid 2 wide and 4 high, y downwards: no font needed for ten characters.
const DIGITS: [&[(f64, f64)]; 10] = [
    &[(0.6, 0.0), (1.4, 0.0), (2.0, 0.6), (2.0, 3.4), (1.4, 4.0), (0.6, 4.0), (0.0, 3.4), (0.0, 0.6), (0.6, 0.0)],
    &[(0.3, 0.9), (1.2, 0.0), (1.2, 4.0)],
    &[(0.0, 0.8), (0.6, 0.0), (1.4, 0.0), (2.0, 0.7), (2.0, 1.4), (0.0, 4.0), (2.0, 4.0)],
    &[(0.0, 0.0), (2.0, 0.0), (1.0, 1.6), (1.5, 1.6), (2.0, 2.2), (2.0, 3.4), (1.4, 4.0), (0.5, 4.0), (0.0, 3.5)],
    &[(1.5, 4.0), (1.5, 0.0), (0.0, 2.8), (2.0, 2.8)],
    &[(2.0, 0.0), (0.2, 0.0), (0.0, 1.8), (1.4, 1.6), (2.0, 2.2), (2.0, 3.4), (1.4, 4.0), (0.5, 4.0), (0.0, 3.6)],
    &[
        (1.7, 0.0),
        (0.8, 0.4),
        (0.0, 1.8),
        (0.0, 3.4),
        (0.6, 4.0),
        (1.4, 4.0),
        (2.0, 3.4),
        (2.0, 2.4),
        (1.4, 1.8),
        (0.0, 2.2),
    ],
    &[(0.0, 0.0), (2.0, 0.0), (0.7, 4.0)],
    &[
        (0.6, 1.9),
        (0.1, 1.3),
        (0.1, 0.6),
        (0.6, 0.0),
        (1.4, 0.0),
        (1.9, 0.6),
        (1.9, 1.3),
        (1.4, 1.9),
        (0.6, 1.9),
        (0.0, 2.6),
        (0.0, 3.4),
        (0.6, 4.0),
        (1.4, 4.0),
        (2.0, 3.4),
        (2.0, 2.6),
        (1.4, 1.9),
    ],
    &[
        (0.3, 4.0),
        (1.2, 3.6),
        (2.0, 2.2),
        (2.0, 0.6),
        (1.4, 0.0),
        (0.6, 0.0),
        (0.0, 0.6),
        (0.0, 1.6),
        (0.6, 2.2),
        (2.0, 1.8),
    ],
];
