//! A rig as words of the settings memory: in blocks, and back.

use heapless::Vec;
use karst_core::{
    Calibration, CameraCalibration, ConfigError, DetectorConfig, FixedRig, I18F14, LaserCalibration, LaserFrame,
    MAX_COEFFICIENTS, ReconstructionSettings, RigError, SpotNoise, Thresholds,
};

use crate::map;
use crate::settings::{first_edge, words_of};

/// Most words of a block.
pub const MAX_BLOCK_WORDS: usize = LASER_WORDS;

/// Blocks besides those of the lasers.
pub const OTHER_BLOCKS: u16 = 5;

const INSTRUMENT_WORDS: usize = 4;
const CAMERA_WORDS: usize = 8 + 2 * MAX_COEFFICIENTS;
const DETECTOR_WORDS: usize = 10;
const LASER_WORDS: usize = 41;

/// A rig as words of the settings memory, for up to `LASERS` lasers.
///
/// They come in blocks of neighbouring addresses: 0 the instrument, 1 and 2 the cameras' models, 3 and 4 the detectors,
/// 5 and on the lasers. How spots become points is not in them: [`crate::Karst::load_words`] adds it.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RigWords<const LASERS: usize> {
    instrument: [u32; INSTRUMENT_WORDS],
    cameras: [[u32; CAMERA_WORDS]; 2],
    detectors: [[u32; DETECTOR_WORDS]; 2],
    lasers: Vec<[u32; LASER_WORDS], LASERS>,
}

impl<const LASERS: usize> From<&FixedRig<LASERS>> for RigWords<LASERS> {
    fn from(rig: &FixedRig<LASERS>) -> Self {
        Self::new(&rig.calibration, rig.detectors.each_ref())
    }
}

impl<const LASERS: usize> RigWords<LASERS> {
    /// No lasers, and all words zero.
    pub const EMPTY: Self = Self {
        instrument: [0; INSTRUMENT_WORDS],
        cameras: [[0; CAMERA_WORDS]; 2],
        detectors: [[0; DETECTOR_WORDS]; 2],
        lasers: Vec::new(),
    };

    /// The words of a rig. A value beyond its field becomes the field's largest one: [`FixedRig::check`] refuses both.
    pub fn new(calibration: &Calibration<LASERS>, detectors: [&DetectorConfig<LASERS>; 2]) -> Self {
        let mut words = Self::EMPTY;
        words.clear(calibration.lasers.len() as u16);
        words_of(calibration, detectors, &mut |address, value| {
            if let Some(word) = words.word_mut(address) {
                *word = value;
            }
        });
        words
    }

    /// Sets all words to zero, with blocks for so many lasers: `LASERS` at most.
    pub fn clear(&mut self, lasers: u16) {
        self.instrument = Default::default();
        self.cameras = Default::default();
        self.detectors = Default::default();
        self.lasers.clear();
        // As many as there is room for
        let _ = self.lasers.resize(usize::from(lasers).min(LASERS), [0; LASER_WORDS]);
    }

    /// Takes over the words of another one.
    pub fn copy_from(&mut self, other: &Self) {
        self.clear(other.lasers());
        for number in 0..OTHER_BLOCKS + other.lasers() {
            if let (Some(to), Some(from)) = (self.block_mut(number), other.block(number)) {
                to.iter_mut().zip(from).for_each(|(to, word)| *to = *word);
            }
        }
    }

    /// How many lasers have a block.
    pub fn lasers(&self) -> u16 {
        self.lasers.len() as u16
    }

    /// Image width of a camera (0 or 1), px.
    pub(crate) fn width(&self, camera: usize) -> u16 {
        map::SETTINGS_CAMERA_DETECTOR_SIZE_WIDTH.get(self.detectors[camera][0]) as u16
    }

    /// A block. None: there is no such one.
    pub fn block(&self, number: u16) -> Option<&[u32]> {
        Some(match number {
            0 => &self.instrument,
            1 => &self.cameras[0],
            2 => &self.cameras[1],
            3 => &self.detectors[0],
            4 => &self.detectors[1],
            _ => self.lasers.get(usize::from(number - OTHER_BLOCKS))?,
        })
    }

    /// A block, to be filled.
    pub fn block_mut(&mut self, number: u16) -> Option<&mut [u32]> {
        Some(match number {
            0 => &mut self.instrument,
            1 => &mut self.cameras[0],
            2 => &mut self.cameras[1],
            3 => &mut self.detectors[0],
            4 => &mut self.detectors[1],
            _ => self.lasers.get_mut(usize::from(number - OTHER_BLOCKS))?,
        })
    }

    /// All blocks in the order of their numbers.
    pub fn blocks(&self) -> impl Iterator<Item = &[u32]> {
        (0..=u16::MAX).map_while(|number| self.block(number))
    }

    /// Address of a block's first word in the IP.
    pub fn address(number: u16) -> u32 {
        let number = u32::from(number);
        match number {
            0 => map::SETTINGS_INSTRUMENT_LASERS,
            1 | 2 => map::settings_camera_centre(number - 1, 0),
            3 | 4 => map::settings_camera_detector_size(number - 3),
            _ => map::settings_laser_azimuth(number - u32::from(OTHER_BLOCKS)),
        }
    }

    fn word_mut(&mut self, address: u32) -> Option<&mut u32> {
        let laser = |index| map::settings_laser_azimuth(index);
        let block = if address >= laser(0) {
            OTHER_BLOCKS + ((address - laser(0)) / (laser(1) - laser(0))) as u16
        } else {
            // Of the blocks that begin there or before, the one that begins last
            let begin_before = (0..OTHER_BLOCKS).filter(|&block| Self::address(block) <= address);
            begin_before.max_by_key(|&block| Self::address(block))?
        };
        self.block_mut(block)?.get_mut(((address - Self::address(block)) / 4) as usize)
    }

    /// The rig. Nothing is checked: see [`Self::check`].
    pub fn rig(&self) -> FixedRig<LASERS> {
        FixedRig {
            calibration: Calibration {
                cameras: self.cameras.each_ref().map(camera_of),
                lasers: self.lasers.iter().map(laser_of).collect(),
                settings: self.limits(),
            },
            detectors: [0, 1].map(|camera| self.detector(camera)),
        }
    }

    /// Whether the rig is one, by [`FixedRig::check`], and what the words say twice agrees.
    pub fn check(&self) -> Result<(), RigError> {
        // Part by part: a whole rig takes much of the sensor's memory
        self.limits().check()?;
        for (camera, words) in (0..).zip(&self.cameras) {
            camera_of(words).check(camera)?;
        }
        for (index, words) in (0..).zip(&self.lasers) {
            laser_of(words).check(index)?;
        }
        let told = map::SETTINGS_INSTRUMENT_LASERS_COUNT.get(self.instrument[0]);
        for (camera, [.., sector, _, _]) in (0..).zip(&self.detectors) {
            if told as usize != self.lasers.len() {
                return Err(RigError::DetectorLasers { camera });
            }
            self.detector(camera.into()).check().map_err(|error| RigError::Detector { camera, error })?;
            // The detector of the IP takes the edge as it is
            let found = map::SETTINGS_CAMERA_DETECTOR_SECTOR_FIRST_EDGE.get(*sector) as u16;
            if found != first_edge(self.azimuths(camera.into())) {
                return Err(RigError::Detector { camera, error: ConfigError::OutsideSector { laser: 0 } });
            }
        }
        Ok(())
    }

    /// What the reconstruction of one laser needs: a calibration of that laser alone. None: there is no such laser.
    pub fn of_laser(&self, index: u16) -> Option<Calibration<1>> {
        let mut lasers = Vec::new();
        // One fits
        let _ = lasers.push(laser_of(self.lasers.get(usize::from(index))?));
        Some(Calibration { cameras: self.cameras.each_ref().map(camera_of), lasers, settings: self.limits() })
    }

    fn limits(&self) -> ReconstructionSettings {
        let [lasers, min, max, chi2_max] = self.instrument;
        ReconstructionSettings {
            range: [q14(min), q14(max)],
            chi2_max: q14(chi2_max),
            single_camera: map::SETTINGS_INSTRUMENT_LASERS_SINGLE_CAMERA.is_set(lasers),
        }
    }

    fn detector(&self, camera: usize) -> DetectorConfig<LASERS> {
        let [size, green_min, excess_min, weight, centre, radius, cluster, sector, floor, noise] =
            self.detectors[camera];
        let sixteenths = |value: u32| q14(value << 10);
        DetectorConfig {
            width: map::SETTINGS_CAMERA_DETECTOR_SIZE_WIDTH.get(size) as u16,
            height: map::SETTINGS_CAMERA_DETECTOR_SIZE_HEIGHT.get(size) as u16,
            thresholds: Thresholds {
                green_min: [
                    map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_FIRST.get(green_min) as u8,
                    map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SECOND.get(green_min) as u8,
                ],
                excess_min: [
                    map::SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_FIRST.get(excess_min) as u16,
                    map::SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_SECOND.get(excess_min) as u16,
                ],
                saturation_min: map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SATURATION.get(green_min) as u8,
                clip_min: map::SETTINGS_CAMERA_DETECTOR_GREEN_MIN_CLIP.get(green_min) as u8,
                clipped_weight: map::SETTINGS_CAMERA_DETECTOR_WEIGHT_CLIPPED_WEIGHT.get(weight) as u16,
            },
            centre: [
                sixteenths(map::SETTINGS_CAMERA_DETECTOR_CENTRE_X.get(centre)),
                sixteenths(map::SETTINGS_CAMERA_DETECTOR_CENTRE_Y.get(centre)),
            ],
            mirror_radius: map::SETTINGS_CAMERA_DETECTOR_RADIUS_MIRROR.get(radius) as u16,
            inner_radius: map::SETTINGS_CAMERA_DETECTOR_RADIUS_INNER.get(radius) as u16,
            cluster_gap: map::SETTINGS_CAMERA_DETECTOR_CLUSTER_GAP.get(cluster) as u16,
            min_pixels: map::SETTINGS_CAMERA_DETECTOR_CLUSTER_MIN_PIXELS.get(cluster) as u16,
            clockwise: map::SETTINGS_CAMERA_DETECTOR_WEIGHT_CLOCKWISE.is_set(weight),
            azimuths: self.azimuths(camera).collect(),
            sector_half_width: map::SETTINGS_CAMERA_DETECTOR_SECTOR_HALF_WIDTH.get(sector) as u16,
            noise: SpotNoise { floor, noise },
        }
    }

    fn azimuths(&self, camera: usize) -> impl ExactSizeIterator<Item = u16> {
        let azimuth = [map::SETTINGS_LASER_AZIMUTH_CAMERA_1, map::SETTINGS_LASER_AZIMUTH_CAMERA_2][camera];
        self.lasers.iter().map(move |[azimuths, ..]| azimuth.get(*azimuths) as u16)
    }
}

fn q14(word: u32) -> I18F14 {
    I18F14::from_bits(word as i32)
}

fn camera_of(words: &[u32; CAMERA_WORDS]) -> CameraCalibration {
    let mut words = Words(words);
    CameraCalibration {
        centre: words.array(Words::q14),
        inverse_affine: words.array(Words::signed),
        decentring: words.array(Words::signed),
        polynomial: words.coefficients(),
        axial: words.coefficients(),
    }
}

fn laser_of(words: &[u32; LASER_WORDS]) -> LaserCalibration {
    let [_azimuths, words @ ..] = words;
    let mut words = Words(words);
    LaserCalibration {
        origin: words.array(Words::signed),
        axes: words.array(|words| words.array(Words::signed)),
        origin_variance: words.wide(),
        direction_variance: words.wide(),
        cameras: words.array(|words| LaserFrame {
            rotation: words.array(|words| words.array(Words::signed)),
            viewpoint: words.array(Words::signed),
        }),
    }
}

/// The words of a block, one after the other.
struct Words<'a>(&'a [u32]);

impl Words<'_> {
    fn next(&mut self) -> u32 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    fn signed(&mut self) -> i32 {
        self.next() as i32
    }

    fn q14(&mut self) -> I18F14 {
        q14(self.next())
    }

    /// The low word comes first.
    fn wide(&mut self) -> u64 {
        u64::from(self.next()) | u64::from(self.next()) << 32
    }

    fn array<T, const N: usize>(&mut self, mut item: impl FnMut(&mut Self) -> T) -> [T; N] {
        core::array::from_fn(|_| item(self))
    }

    /// Without those of zero at the end.
    fn coefficients(&mut self) -> Vec<i32, MAX_COEFFICIENTS> {
        let mut coefficients = Vec::from_array::<MAX_COEFFICIENTS>(self.array(Self::signed));
        while coefficients.last() == Some(&0) {
            coefficients.pop();
        }
        coefficients
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    prop_compose! {
        fn detectors()(
            [width, height] in [1..=2048_u16, 1..=2048_u16],
            green_min: [u8; 2],
            excess_min in [0..=510_u16, 0..=510_u16],
            [saturation_min, clip_min] in any::<[u8; 2]>(),
            clipped_weight in 1..=500_u16,
            centre in [0..=2048_i32 * 16, 0..=2048 * 16],
            [mirror_radius, inner_radius, min_pixels, sector_half_width] in any::<[u16; 4]>(),
            cluster_gap in 0..=2047_u16,
            clockwise: bool,
            azimuths: [u16; 2],
            [floor, noise] in any::<[u32; 2]>(),
        ) -> DetectorConfig<3> {
            DetectorConfig {
                width,
                height,
                thresholds: Thresholds { green_min, excess_min, saturation_min, clip_min, clipped_weight },
                centre: centre.map(|c| I18F14::from_bits(c << 10)),
                mirror_radius,
                inner_radius,
                cluster_gap,
                min_pixels,
                clockwise,
                azimuths: azimuths.into_iter().collect(),
                sector_half_width,
                noise: SpotNoise { floor, noise },
            }
        }
    }

    prop_compose! {
        fn cameras()(
            centre: [i32; 2],
            inverse_affine: [i32; 4],
            decentring: [i32; 2],
            polynomial: [i32; MAX_COEFFICIENTS],
            axial: [i32; MAX_COEFFICIENTS],
        ) -> CameraCalibration {
            CameraCalibration {
                centre: centre.map(I18F14::from_bits),
                inverse_affine,
                decentring,
                // A zero at the end is the same as none
                polynomial: polynomial.into_iter().map(|coefficient| coefficient | 1).collect(),
                axial: axial.into_iter().map(|coefficient| coefficient | 1).collect(),
            }
        }
    }

    prop_compose! {
        fn lasers()(
            origin: [i32; 3],
            axes: [[i32; 3]; 3],
            [origin_variance, direction_variance] in any::<[u64; 2]>(),
            rotations: [[[i32; 3]; 3]; 2],
            viewpoints: [[i32; 3]; 2],
        ) -> LaserCalibration {
            let cameras = [0, 1].map(|i| LaserFrame { rotation: rotations[i], viewpoint: viewpoints[i] });
            LaserCalibration { origin, axes, origin_variance, direction_variance, cameras }
        }
    }

    proptest! {
        #[test]
        fn every_setting_has_bits_of_its_own_and_all_of_them(
            detectors in [detectors(), detectors()],
            cameras in [cameras(), cameras()],
            lasers in [lasers(), lasers()],
            [least, most, chi2_max] in any::<[i32; 3]>(),
            single_camera: bool,
        ) {
            let calibration = Calibration::<3> {
                cameras,
                lasers: lasers.into_iter().collect(),
                settings: ReconstructionSettings {
                    range: [least, most].map(I18F14::from_bits),
                    chi2_max: I18F14::from_bits(chi2_max),
                    single_camera,
                },
            };
            let words = RigWords::new(&calibration, detectors.each_ref());
            prop_assert_eq!(words.rig(), FixedRig { calibration: calibration.clone(), detectors: detectors.clone() });
            // And each is where the register map says
            let mut memory = BTreeMap::new();
            for (number, block) in (0..).zip(words.blocks()) {
                for (address, &word) in (RigWords::<3>::address(number)..).step_by(4).zip(block) {
                    prop_assert_eq!(memory.insert(address, word), None, "{:#x} is there twice", address);
                }
            }
            words_of(&calibration, detectors.each_ref(), &mut |address, word| {
                assert_eq!(memory.remove(&address), Some(word), "{address:#x}");
            });
            prop_assert_eq!(memory, BTreeMap::new(), "words without a meaning");
        }

        #[test]
        fn what_does_not_fit_its_field_is_refused_all_the_same(which in 0..7_usize, beyond: u16, camera in 0..2_usize) {
            let mut rig = rig();
            prop_assert_eq!(RigWords::from(&rig).check(), Ok(()));
            let detector = &mut rig.detectors[camera];
            match which {
                0 => detector.width = beyond.max(2049),
                1 => detector.height = beyond.max(2049),
                2 => detector.centre[0] = I18F14::from_num(beyond.max(1025)),
                3 => detector.centre[1] = -I18F14::from_num(beyond.max(1)),
                4 => detector.thresholds.excess_min[0] = beyond.max(511),
                5 => detector.thresholds.excess_min[1] = beyond.max(511),
                _ => detector.centre[1] = I18F14::MAX,
            }
            let refused = RigWords::from(&rig).check();
            let camera_of = |error| if let RigError::Detector { camera, .. } = error { Some(camera.into()) } else { None };
            prop_assert_eq!(refused.map_err(camera_of), Err(Some(camera)));
        }
    }

    /// A rig that is one.
    fn rig() -> FixedRig<3> {
        let detector = || DetectorConfig {
            width: 1024,
            height: 768,
            thresholds: Thresholds::default(),
            centre: [I18F14::from_num(512), I18F14::from_num(384)],
            mirror_radius: 360 * 16,
            inner_radius: 100 * 16,
            cluster_gap: 3,
            min_pixels: 3,
            clockwise: false,
            azimuths: [100, 22_000, 44_000].into_iter().collect(),
            sector_half_width: 2000,
            noise: SpotNoise { floor: 2416, noise: 83443 },
        };
        let camera = || CameraCalibration {
            inverse_affine: [1 << 30, 0, 0, 1 << 30],
            polynomial: [1 << 20].into_iter().collect(),
            ..CameraCalibration::default()
        };
        let settings = ReconstructionSettings {
            range: [I18F14::from_num(300), I18F14::from_num(4800)],
            chi2_max: I18F14::from_num(30),
            single_camera: true,
        };
        let lasers = [LaserCalibration::default(); 3].into_iter().collect();
        let calibration = Calibration { cameras: [camera(), camera()], lasers, settings };
        FixedRig { calibration, detectors: [detector(), detector()] }
    }

    #[test]
    fn words_that_contradict_each_other_are_refused() {
        let words = RigWords::from(&rig());
        let sector = map::settings_camera_detector_sector(1);
        let mut other = words.clone();
        *other.word_mut(sector).unwrap() ^= 1 << 16;
        let edge = RigError::Detector { camera: 1, error: ConfigError::OutsideSector { laser: 0 } };
        assert_eq!(other.check(), Err(edge));
        let mut other = words.clone();
        *other.word_mut(map::SETTINGS_INSTRUMENT_LASERS).unwrap() -= 1;
        assert_eq!(other.check(), Err(RigError::DetectorLasers { camera: 0 }));
        let mut fewer = rig();
        fewer.detectors[1].azimuths.pop();
        assert_eq!(RigWords::from(&fewer).check(), Err(RigError::DetectorLasers { camera: 0 }));
    }

    #[test]
    fn a_laser_alone_has_the_calibration_of_the_whole() {
        let mut rig = rig();
        rig.calibration.lasers[1].origin = [1, -2, 3];
        let words = RigWords::from(&rig);
        let one = words.of_laser(1).unwrap();
        assert_eq!((&one.cameras, &one.settings), (&rig.calibration.cameras, &rig.calibration.settings));
        assert_eq!(one.lasers[..], rig.calibration.lasers[1..2]);
        assert_eq!(words.of_laser(3), None);
    }
}
