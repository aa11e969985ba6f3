//! Calibration transfers over good and bad lines.

use karst_core::{FixedRig, I18F14, RigError};
use karst_link::*;
use proptest::prelude::*;

use crate::messages::{MOST_LASERS, decode, frame, rig};

/// Sends a calibration over a line that loses the frames `lost` says, and what the receiver misses again, until it is
/// complete; gives the frames that took.
fn transfer(
    rig: &FixedRig<MOST_LASERS>,
    receiver: &mut CalibrationReceiver<MOST_LASERS>,
    mut lost: impl FnMut() -> bool,
) -> usize {
    let sender = CalibrationSender::new(rig);
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
    let mut next: Vec<u16> = (0..sender.parts().count() as u16).collect();
    let mut frames = 0;
    loop {
        let mut reply = None;
        for number in next {
            let bytes = frame(&mut encoder, &Message::Calibration(sender.part(number).unwrap()));
            frames += 1;
            if lost() {
                continue;
            }
            for message in decode(&mut decoder, &bytes) {
                let Message::Calibration(part) = message else { panic!("{message:?}") };
                reply = Some(receiver.reply(&part).state);
            }
        }
        next = match reply {
            Some(TransferState::Complete) => return frames,
            Some(TransferState::Missing(missing)) => missing.to_vec(),
            Some(TransferState::Refused(error)) => panic!("{error}"),
            // Nothing came through: ask again, with any part
            None => vec![0],
        };
    }
}

#[test]
fn a_part_that_is_not_there_or_of_another_size_is_refused() {
    let mut receiver = CalibrationReceiver::<12>::new();
    let part = |lasers, number, words| {
        let words = std::iter::repeat_n(7, words).collect();
        CalibrationPart { crc: 1, lasers, number, words }
    };
    let too_many = TransferError::TooManyLasers { found: 13, capacity: 12 };
    assert_eq!(receiver.accept(&part(13, 5, 41)), Err(too_many));
    assert_eq!(receiver.accept(&part(12, 17, 41)), Err(TransferError::NoSuchPart));
    assert_eq!(receiver.accept(&part(12, u16::MAX, 41)), Err(TransferError::NoSuchPart));
    for (number, words) in [(0, 5), (1, 23), (4, 0), (16, 40)] {
        assert_eq!(receiver.accept(&part(12, number, words)), Err(TransferError::NoSuchPart));
    }
    assert_eq!(receiver.missing().count(), 17);
    assert_eq!(receiver.accept(&part(12, 16, 41)), Ok(Progress::Partial));
    assert_eq!(receiver.missing().count(), 16);
}

#[test]
fn nothing_is_missing_and_nothing_complete_before_the_first_part() {
    let receiver = CalibrationReceiver::<12>::new();
    assert_eq!(receiver.missing().count(), 0);
    assert_eq!(receiver.complete(), None);
}

/// The calibration that a receiver has.
fn complete(receiver: &CalibrationReceiver<MOST_LASERS>) -> Option<FixedRig<MOST_LASERS>> {
    receiver.complete().map(|(words, _)| words.rig())
}

/// What a receiver says to all parts of a rig.
fn received(rig: &FixedRig<MOST_LASERS>) -> Result<Progress, TransferError> {
    let mut receiver = CalibrationReceiver::<MOST_LASERS>::new();
    let sender = CalibrationSender::new(rig);
    sender.parts().map(|part| receiver.accept(&part)).last().unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn lost_parts_are_asked_for_until_the_calibration_is_complete(
        rig in rig(30),
        other in rig(3),
        mut losses in prop::collection::vec(any::<bool>(), 0..200),
    ) {
        let mut receiver = CalibrationReceiver::new();
        let kept = losses.iter().filter(|lost| !**lost).count();
        let lost = losses.len() - kept;
        let frames = transfer(&rig, &mut receiver, || losses.pop().unwrap_or(false));
        prop_assert_eq!(complete(&receiver), Some(rig.clone()));
        prop_assert!(frames <= rig.calibration.lasers.len() + 5 + 2 * lost + kept, "{} frames", frames);
        // Another one over it
        transfer(&other, &mut receiver, || false);
        prop_assert_eq!(complete(&receiver), Some(other));
    }

    #[test]
    fn parts_may_come_in_any_order_and_twice(
        rig in rig(12),
        order in prop::collection::vec(any::<prop::sample::Index>(), 0..40),
    ) {
        let parts: Vec<_> = CalibrationSender::new(&rig).parts().collect();
        let mut receiver = CalibrationReceiver::<MOST_LASERS>::new();
        for index in order {
            receiver.accept(index.get(&parts)).unwrap();
        }
        for part in parts.iter().rev() {
            receiver.accept(part).unwrap();
        }
        prop_assert_eq!(complete(&receiver), Some(rig.clone()));
    }

    #[test]
    fn a_part_of_another_calibration_with_the_same_name_is_noticed(
        rig in rig(4),
        laser in any::<prop::sample::Index>(),
        bit in 0..32,
    ) {
        let mut parts: Vec<_> = CalibrationSender::new(&rig).parts().collect();
        let index = laser.index(rig.calibration.lasers.len());
        parts[5 + index].words[1] ^= 1_u32 << bit;
        let mut receiver = CalibrationReceiver::<MOST_LASERS>::new();
        let last = parts.iter().map(|part| receiver.accept(part)).last();
        prop_assert!(matches!(last, Some(Err(TransferError::Checksum { .. }))), "{:?}", last);
        prop_assert_eq!(receiver.complete(), None);
    }

    #[test]
    fn a_value_out_of_its_range_is_refused(rig in rig(4), which in 0..7) {
        prop_assert_eq!(received(&rig), Ok(Progress::Complete));
        let mut wrong = rig;
        let laser = wrong.calibration.lasers.len() as u16 - 1;
        let last = &mut wrong.calibration.lasers[usize::from(laser)];
        let expected = match which {
            0 => {
                last.axes[2][1] = i32::MIN;
                RigError::Rotation { laser }
            }
            1 => {
                last.cameras[1].rotation[0][0] = (1 << 30) + 1;
                RigError::Rotation { laser }
            }
            2 => {
                last.direction_variance = u64::MAX;
                RigError::Uncertainty { laser }
            }
            3 => {
                wrong.calibration.settings.range[0] = wrong.calibration.settings.range[1];
                RigError::Range
            }
            4 => {
                wrong.calibration.settings.chi2_max = I18F14::ZERO;
                RigError::Chi2
            }
            5 => {
                wrong.calibration.cameras[1].polynomial.clear();
                RigError::Camera { camera: 1 }
            }
            _ => {
                wrong.detectors[1].noise.floor = 0;
                RigError::Detector { camera: 1, error: karst_core::ConfigError::NoiseFloor }
            }
        };
        prop_assert_eq!(received(&wrong), Err(TransferError::Rig(expected)));
    }
}
