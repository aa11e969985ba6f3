//! The scene: walls, water, light, lasers and sensor.

use crate::{PlacedBoard, SceneError, Shape};
use karst_rig::Pose;

/// Everything that is rendered, except the instrument itself.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The walls.
    pub shape: Shape,
    /// A calibration board in front of the walls.
    pub board: Option<PlacedBoard>,
    /// Where the instrument is: from the rig frame to the frame of the shape.
    pub instrument: Pose,
    /// The water.
    pub water: WaterOptics,
    /// The surface of the walls.
    pub walls: Walls,
    /// Light other than the lasers.
    pub light: Light,
    /// The lasers. None: switched off.
    pub lasers: Option<Lasers>,
    /// Particles of 0.3 to 3 mm per cubic metre.
    pub snow_per_m3: f64,
    /// The two cameras' sensors.
    pub sensor: Sensor,
}

/// Attenuation and scattering of the water.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaterOptics {
    /// Beam attenuation coefficient in the R, G and B channels, 1/m. G holds for the lasers, too.
    pub attenuation_per_m: [f64; 3],
    /// Backscattering coefficient (scattering into the hemisphere back to the source), 1/m.
    pub backscatter_per_m: f64,
}

/// Surface of the walls: Lambertian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walls {
    /// Mean albedo, 0 to 1.
    pub albedo: f64,
    /// Contrast of the texture, 0 (even) to 1: the albedo varies by up to this fraction of its mean.
    pub contrast: f64,
}

/// Light other than the lasers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Even irradiance of the walls and the water, W/m².
    pub ambient_w_m2: f64,
    /// Irradiance by the lamp at the instrument, 1 m in front of it, W/m².
    pub lamp_w_m2: f64,
    /// Relative strength of both in the R, G and B channels.
    pub colour: [f64; 3],
}

/// The lasers of the belt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lasers {
    /// Power of each beam as it enters the water, mW.
    pub power_mw: f64,
    /// Diameter of the beam at the tube, between the points of 1/e² of the peak, mm.
    pub diameter_mm: f64,
    /// Full divergence in the water, between the same points, mrad.
    pub divergence_mrad: f64,
    /// Whether the actual beams deviate from the rig file: by normal errors with the standard uncertainties that the
    /// rig file gives, drawn from the seed.
    pub errors: bool,
    /// Fraction of the beam that each surface of the tube scatters diffusely: the false spots near the image centre.
    /// 0: no reflections.
    pub tube_scatter: f64,
}

/// The sensors and the lenses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Exposure: grey levels per radiance, DN/(W m⁻² sr⁻¹).
    pub gain: f64,
    /// Standard deviation of the core of the point spread function, px.
    pub blur_px: f64,
    /// Fraction of the light in the halo of the point spread function (stray light and forward scatter).
    pub halo: f64,
    /// Standard deviation of the halo, px.
    pub halo_px: f64,
    /// Exponent of the response curve: DN = 255 (linear / 255)^(1 / gamma).
    pub gamma: f64,
    /// Noise. None: quantisation only.
    pub noise: Option<Noise>,
}

/// Noise of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Electrons per grey level: the shot noise of n DN is sqrt(n / this) DN.
    pub electrons_per_dn: f64,
    /// Standard deviation of the read noise, DN.
    pub read_dn: f64,
}

impl Scene {
    /// A scene with default water, light, lasers and sensor: clear water with some haze, grey rock, few particles,
    /// errors, reflections and noise on. The instrument is at the origin, its axis along z.
    pub fn new(shape: Shape) -> Self {
        Self {
            shape,
            board: None,
            instrument: Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] },
            water: WaterOptics::default(),
            walls: Walls::default(),
            light: Light::default(),
            lasers: Some(Lasers::default()),
            snow_per_m3: 40.0,
            sensor: Sensor::default(),
        }
    }

    /// The scene seen from one pose after the other: a survey.
    pub fn along(&self, poses: impl IntoIterator<Item = Pose>) -> impl Iterator<Item = Scene> {
        poses.into_iter().map(|instrument| Scene { instrument, ..self.clone() })
    }

    /// Refuses what has no physical meaning.
    pub(crate) fn check(&self) -> Result<(), SceneError> {
        let not_negative = |name, value| within(name, value, 0.0, f64::MAX, "zero or positive");
        let positive = |name, value| within(name, value, f64::MIN_POSITIVE, f64::MAX, "positive");
        let fraction = |name, value| within(name, value, 0.0, 1.0, "between 0 and 1");
        for value in self.instrument.position_mm.into_iter().chain(self.instrument.rotation_deg) {
            within("instrument", value, f64::MIN, f64::MAX, "finite")?;
        }
        match &self.shape {
            Shape::HexagonalPool { across_flats_mm: size } => positive("across_flats_mm", *size)?,
            Shape::Square { side_mm: size } => positive("side_mm", *size)?,
            Shape::RoundTube { radius_mm: size } => positive("radius_mm", *size)?,
            Shape::IrregularGallery(gallery) => {
                let [min, max] = gallery.bounds_mm();
                positive("min_mm", min)?;
                within("max_mm", max, min, f64::MAX, "at least the smallest radius")?;
            }
            Shape::Mesh(_) => {}
        }
        if let Some(board) = &self.board {
            board.check()?;
        }
        for attenuation in self.water.attenuation_per_m {
            not_negative("attenuation_per_m", attenuation)?;
        }
        not_negative("backscatter_per_m", self.water.backscatter_per_m)?;
        fraction("albedo", self.walls.albedo)?;
        fraction("contrast", self.walls.contrast)?;
        not_negative("ambient_w_m2", self.light.ambient_w_m2)?;
        not_negative("lamp_w_m2", self.light.lamp_w_m2)?;
        for part in self.light.colour {
            not_negative("colour", part)?;
        }
        if let Some(lasers) = &self.lasers {
            not_negative("power_mw", lasers.power_mw)?;
            positive("diameter_mm", lasers.diameter_mm)?;
            not_negative("divergence_mrad", lasers.divergence_mrad)?;
            fraction("tube_scatter", lasers.tube_scatter)?;
        }
        within("snow_per_m3", self.snow_per_m3, 0.0, 1e5, "between 0 and 100000")?;
        positive("gain", self.sensor.gain)?;
        within("blur_px", self.sensor.blur_px, 0.1, 20.0, "between 0.1 and 20")?;
        fraction("halo", self.sensor.halo)?;
        within("halo_px", self.sensor.halo_px, 0.1, 50.0, "between 0.1 and 50")?;
        within("gamma", self.sensor.gamma, 0.2, 5.0, "between 0.2 and 5")?;
        if let Some(noise) = &self.sensor.noise {
            positive("electrons_per_dn", noise.electrons_per_dn)?;
            not_negative("read_dn", noise.read_dn)?;
        }
        Ok(())
    }
}

/// Refuses a value out of its range, or not a number.
pub(crate) fn within(
    name: &'static str,
    value: f64,
    min: f64,
    max: f64,
    expected: &'static str,
) -> Result<(), SceneError> {
    if (min..=max).contains(&value) { Ok(()) } else { Err(SceneError::Parameter { name, value, expected }) }
}

/// `count` poses at equal steps from one pose to another, both included.
pub fn straight_path(from: Pose, to: Pose, count: usize) -> impl Iterator<Item = Pose> {
    let mix = |a: [f64; 3], b: [f64; 3], t: f64| std::array::from_fn(|i| a[i] + t * (b[i] - a[i]));
    (0..count).map(move |i| {
        let t = i as f64 / count.saturating_sub(1).max(1) as f64;
        Pose {
            position_mm: mix(from.position_mm, to.position_mm, t),
            rotation_deg: mix(from.rotation_deg, to.rotation_deg, t),
        }
    })
}

impl Default for WaterOptics {
    /// Clear spring water with some haze.
    fn default() -> Self {
        Self { attenuation_per_m: [0.25, 0.1, 0.12], backscatter_per_m: 0.005 }
    }
}

impl Default for Walls {
    /// Grey limestone.
    fn default() -> Self {
        Self { albedo: 0.4, contrast: 0.5 }
    }
}

impl Default for Light {
    /// A weak, slightly blue-green lamp.
    fn default() -> Self {
        Self { ambient_w_m2: 0.4, lamp_w_m2: 0.8, colour: [0.9, 1.0, 0.98] }
    }
}

impl Default for Lasers {
    /// 5 mW, 3 mm.
    fn default() -> Self {
        Self { power_mw: 5.0, diameter_mm: 3.0, divergence_mrad: 0.5, errors: true, tube_scatter: 0.01 }
    }
}

impl Default for Sensor {
    /// Exposed so that a spot on grey rock 4.8 m away has a peak of about 90 DN.
    fn default() -> Self {
        Self {
            gain: 700.0,
            blur_px: 1.1,
            halo: 0.03,
            halo_px: 5.0,
            gamma: 1.0,
            noise: Some(Noise { electrons_per_dn: 40.0, read_dn: 1.0 }),
        }
    }
}
