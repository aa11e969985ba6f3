//! Laser spots in the pictures of the belt.

use karst_calib::{BeltPicture, BeltSpot};

use crate::input::FramePairs;
use crate::instrument::Instrument;
use crate::instrument::spot_result;

/// Finds the spots in pairs of pictures with the detector of an instrument whose cameras are calibrated. Pairs that cannot be
/// read are named in the second list. `progress` is called after each pair.
pub fn find_spots(
    instrument: &mut Instrument,
    pictures: FramePairs,
    progress: impl Fn(),
) -> (Vec<BeltPicture>, Vec<String>) {
    let (mut found, mut failed) = (Vec::new(), Vec::new());
    for pair in pictures {
        progress();
        let pair = match pair {
            Ok(pair) => pair,
            Err(error) => {
                failed.push(error.to_string());
                continue;
            }
        };
        match instrument.detect(&pair.images) {
            Ok(detection) => {
                let spot = |spot| {
                    let result = spot_result(spot);
                    BeltSpot { pixel: result.pixel, sigma_px: result.sigma_px }
                };
                let spots =
                    detection.spots.iter().map(|cameras| cameras.each_ref().map(|c| c.iter().map(spot).collect()));
                found.push(BeltPicture { name: pair.name, spots: spots.collect() });
            }
            Err(error) => failed.push(format!("frame {}: {error}", pair.name)),
        }
    }
    (found, failed)
}
