//! The driver against the software model.

mod common;

use std::convert::Infallible;

use common::*;
use karst_core::{Method, Spot, reconstruct};
use karst_regs::model::Model;
use karst_regs::{Events, Karst, LoadError, ProbeError, ReadError, RegisterBus, SettingsError, map};

/// A configured IP that takes frames.
fn running(instrument: &Instrument) -> (Shared, Karst<Shared>) {
    let model = Shared::default();
    let mut karst = Karst::probe(model.clone()).unwrap();
    karst.load(&instrument.settings()).unwrap();
    karst.commit().unwrap();
    karst.set_enabled(true).unwrap();
    (model, karst)
}

/// Everything of a frame that is ready, compared with what it has to be.
fn assert_frame<B: RegisterBus<Error = Infallible>>(karst: &mut Karst<B>, expected: &Expected) {
    let mut frame = karst.frame().unwrap().expect("a frame is ready");
    for camera in 0..2 {
        let (found, status) = (frame.cameras[camera], &expected.status[camera]);
        assert_eq!((found.hits, found.outside, found.overflow), (status.hits, status.outside, status.overflow));
        assert_eq!(
            (found.rows, found.damaged_rows, found.truncated),
            (status.rows, status.damaged_rows, status.truncated)
        );
        let spots =
            expected.spots[camera].iter().enumerate().flat_map(|(laser, spots)| spots.iter().map(move |s| (laser, s)));
        let mut count = 0;
        for (laser, spot) in spots {
            let found = frame.spot(camera, count).unwrap();
            assert_eq!(
                (usize::from(found.laser), found.position, found.variance),
                (laser, spot.position, spot.variance)
            );
            let cluster = &spot.cluster;
            assert_eq!((found.pixels, found.saturated), (cluster.pixels, cluster.saturated));
            assert_eq!((found.bounds, found.r_max), (cluster.bounds, cluster.r_max()));
            count += 1;
        }
        assert_eq!(found.spots, count);
    }
    assert_eq!(frame.lasers as usize, expected.points.len());
    for (laser, point) in (0..).zip(&expected.points) {
        assert_eq!(frame.point(laser).unwrap(), *point, "laser {laser}");
    }
}

/// Row `y` of one camera; row 0 starts a frame.
fn send_row(model: &Shared, pictures: &[Vec<Vec<u8>>; 2], camera: usize, y: usize) {
    model.row(camera, y == 0, &pictures[camera][y]);
}

/// Both cameras' rows side by side.
fn send(model: &Shared, pictures: &[Vec<Vec<u8>>; 2]) {
    for (y, rows) in pictures[0].iter().zip(&pictures[1]).enumerate() {
        model.row(0, y == 0, rows.0);
        model.row(1, y == 0, rows.1);
    }
}

/// A bus whose accesses fail after the first `good` ones, or that reads something else at one address.
struct Broken {
    model: Model<LASERS>,
    good: usize,
    replaced: Option<(u32, u32)>,
}

impl Broken {
    fn new(good: usize, replaced: Option<(u32, u32)>) -> Self {
        Self { model: Model::new(), good, replaced }
    }

    fn access(&mut self) -> Result<(), &'static str> {
        self.good = self.good.checked_sub(1).ok_or("broken")?;
        Ok(())
    }
}

impl RegisterBus for Broken {
    type Error = &'static str;

    fn read32(&mut self, address: u32) -> Result<u32, &'static str> {
        self.access()?;
        let Ok(value) = self.model.read32(address);
        Ok(self.replaced.filter(|(at, _)| *at == address).map_or(value, |(_, value)| value))
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), &'static str> {
        self.access()?;
        let Ok(()) = self.model.write32(address, value);
        Ok(())
    }
}

#[test]
fn something_else_is_refused() {
    let found = Karst::probe(Broken::new(100, Some((map::MAGIC, 7)))).err();
    assert_eq!(found, Some(ProbeError::Magic { found: 7 }));
}

#[test]
fn another_register_map_is_refused() {
    let found = Karst::probe(Broken::new(100, Some((map::MAP_HASH, 7)))).err();
    assert_eq!(found, Some(ProbeError::Map { version: [0, 1, 0], found: 7 }));
}

#[test]
fn the_capacity_is_that_of_the_ip() {
    let capacity = Karst::probe(Model::<720>::new()).unwrap().capacity();
    assert_eq!((capacity.lasers, capacity.slots, capacity.pixels_per_clock), (720, 4, 1));
}

#[test]
fn every_failed_access_is_given_back() {
    let instrument = Instrument::new(250.0, Method::Weighted);
    let mut good = 0;
    loop {
        match Karst::probe(Broken::new(good, None)) {
            Err(error) => assert_eq!(error, ProbeError::Bus("broken")),
            Ok(mut karst) => match karst.load(&instrument.settings()) {
                Err(error) => assert_eq!(error, LoadError::Bus("broken")),
                Ok(()) => break,
            },
        }
        good += 1;
    }
    // Both cameras' words, the lasers', each written and read, and the probe
    assert!(good > 2 * (2 * 34 + 12 * 41), "{good}");
}

#[test]
fn a_memory_that_does_not_hold_is_found() {
    let instrument = Instrument::new(250.0, Method::Weighted);
    let address = map::settings_laser_axes(3, 4);
    let mut karst = Karst::probe(Broken::new(10_000, Some((address, 1)))).unwrap();
    let written = instrument.calibration.lasers[3].axes[1][1] as u32;
    assert_eq!(karst.load(&instrument.settings()), Err(LoadError::Verify { address, written, found: 1 }));
}

#[test]
fn settings_that_do_not_fit_are_refused() {
    let good = Instrument::new(250.0, Method::Weighted);
    let refused = |instrument: &Instrument| match Karst::probe(Model::<11>::new()).unwrap().load(&instrument.settings())
    {
        Err(LoadError::Settings(error)) => error,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&good), SettingsError::Lasers { found: 12, capacity: 11 });
    let mut fewer = good.clone();
    fewer.calibration.lasers.pop();
    assert_eq!(refused(&fewer), SettingsError::DetectorLasers { camera: 0, found: 12 });
    for detector in &mut fewer.detectors {
        detector.azimuths.clear();
        detector.azimuths.extend((0..11).map(|laser| (laser * 65536 / 11) as u16));
    }
    fewer.detectors[1].width = 0;
    assert!(matches!(refused(&fewer), SettingsError::Detector { camera: 1, .. }));
    let wide = Karst::probe(Broken::new(100, Some((map::CAPACITY, 12 | 4 << 12 | 8 << 16)))).unwrap().load(
        &{
            let mut odd = good.clone();
            odd.detectors[0].width = 190;
            odd
        }
        .settings(),
    );
    assert_eq!(wide, Err(LoadError::Settings(SettingsError::Width { camera: 0, found: 190 })));
}

#[test]
fn points_and_spots_are_those_of_karst_core_with_both_methods() {
    let mut some = ALL;
    (some[2], some[7]) = (None, Some(52));
    for method in [Method::Weighted, Method::Paper] {
        let instrument = Instrument::new(250.0, method);
        let (model, mut karst) = running(&instrument);
        for radii in [ALL, some, [None; LASERS]] {
            let pictures = pictures(&radii);
            send(&model, &pictures);
            let expected = instrument.expected(&pictures);
            assert_frame(&mut karst, &expected);
            karst.frame().unwrap().unwrap().acknowledge().unwrap();
            assert_eq!(expected.points.iter().all(Result::is_ok), radii == ALL);
        }
    }
}

#[test]
fn spots_read_from_the_ip_reconstruct_to_the_same_points() {
    for method in [Method::Weighted, Method::Paper] {
        let instrument = Instrument::new(250.0, method);
        let (model, mut karst) = running(&instrument);
        send(&model, &pictures(&ALL));
        let mut frame = karst.frame().unwrap().unwrap();
        for laser in 0..LASERS as u16 {
            let spots = [0, 1].map(|camera| {
                let records = (0..frame.cameras[camera].spots).map(|i| frame.spot(camera, i).unwrap());
                records.filter(|spot| spot.laser == laser).map(|spot| Spot::from(&spot)).collect::<Vec<_>>()
            });
            let spots = spots.each_ref().map(Vec::as_slice);
            let point = without_estimates(reconstruct(&instrument.calibration, laser.into(), spots, method));
            assert_eq!(frame.point(laser).unwrap(), point);
            assert!(point.is_ok());
        }
    }
}

#[test]
fn seven_hundred_and_twenty_lasers_are_loaded_and_read() {
    let one = Instrument::new(250.0, Method::Weighted);
    let calibration = karst_core::Calibration::<720> {
        cameras: one.calibration.cameras.clone(),
        lasers: (0..720).map(|laser| one.calibration.lasers[laser / 60]).collect(),
        settings: one.calibration.settings,
    };
    let detectors = one.detectors.each_ref().map(|config| karst_core::DetectorConfig::<720> {
        azimuths: (0..720_u32).map(|laser| (laser * 65536 / 720) as u16).collect(),
        width: config.width,
        height: config.height,
        thresholds: config.thresholds,
        centre: config.centre,
        mirror_radius: config.mirror_radius,
        inner_radius: config.inner_radius,
        cluster_gap: config.cluster_gap,
        min_pixels: config.min_pixels,
        clockwise: config.clockwise,
        sector_half_width: 45,
        noise: config.noise,
    });
    let mut karst = Karst::probe(Model::<720>::new()).unwrap();
    let settings = karst_regs::Settings {
        calibration: &calibration,
        detectors: [&detectors[0], &detectors[1]],
        method: Method::Weighted,
    };
    karst.load(&settings).unwrap();
    karst.commit().unwrap();
    karst.set_enabled(true).unwrap();
    let [first, second] = pictures(&ALL);
    for (y, (a, b)) in first.iter().zip(&second).enumerate() {
        karst.bus().row(0, y == 0, a);
        karst.bus().row(1, y == 0, b);
    }
    let mut frame = karst.frame().unwrap().unwrap();
    assert_eq!(frame.lasers, 720);
    for camera in 0..2 {
        assert!(frame.cameras[camera].spots >= 12);
        let last = frame.cameras[camera].spots - 1;
        assert!(frame.spot(camera, last).unwrap().laser > 600);
    }
    assert!(frame.point(0).unwrap().is_ok());
    assert!(frame.point(719).is_ok());
    assert_eq!(frame.point(720), Err(ReadError::Index { found: 720, count: 720 }));
}

#[test]
fn records_beyond_the_last_one_are_refused() {
    let (model, mut karst) = running(&Instrument::new(250.0, Method::Weighted));
    send(&model, &pictures(&ALL));
    let mut frame = karst.frame().unwrap().unwrap();
    let count = frame.cameras[1].spots;
    assert_eq!(frame.spot(1, count), Err(ReadError::Index { found: count, count }));
    assert_eq!(frame.point(12), Err(ReadError::Index { found: 12, count: 12 }));
}

#[test]
fn the_interrupt_follows_the_enabled_events_until_they_are_taken() {
    let (model, mut karst) = running(&Instrument::new(250.0, Method::Weighted));
    assert!(!model.0.borrow().interrupt(), "nothing is enabled");
    karst.set_interrupts(Events::ALL).unwrap();
    assert!(model.0.borrow().interrupt());
    let events = karst.take_events().unwrap();
    assert!(events.committed() && !events.ready() && !events.fault() && !model.0.borrow().interrupt());
    karst.set_interrupts(Events::READY).unwrap();
    model.row(0, false, &[]);
    assert!(!model.0.borrow().interrupt(), "a fault is not enabled");
    send(&model, &pictures(&ALL));
    assert!(model.0.borrow().interrupt());
    let events = karst.take_events().unwrap();
    assert!(events.ready() && events.fault() && !model.0.borrow().interrupt());
    assert!(karst.take_events().unwrap().is_empty());
}

#[test]
fn a_commit_waits_for_the_frames_under_way_and_refuses_writes_meanwhile() {
    let [old, new] = [250.0, 300.0].map(|half| Instrument::new(half, Method::Weighted));
    let pictures = pictures(&ALL);
    let (model, mut karst) = running(&old);
    let lead = 5;
    for y in 0..usize::from(HEIGHT) {
        send_row(&model, &pictures, 0, y);
        if y >= lead {
            send_row(&model, &pictures, 1, y - lead);
        }
        if y == 100 {
            karst.load(&new.settings()).unwrap();
            karst.commit().unwrap();
            assert!(karst.status().unwrap().committing);
            assert_eq!(karst.load(&new.settings()), Err(LoadError::Committing));
            karst.bus().write32(map::SETTINGS_INSTRUMENT_LASERS, 1).unwrap();
            assert!(karst.take_faults().unwrap().refused());
        }
    }
    // Camera 0 is done and starts its next frame, which is skipped: camera 1 still works with the old settings
    model.row(0, true, &pictures[0][0]);
    assert!(karst.status().unwrap().committing);
    for row in &pictures[1][usize::from(HEIGHT) - lead..] {
        model.row(1, false, row);
    }
    assert!(!karst.status().unwrap().committing);
    assert_eq!(karst.frame().unwrap().unwrap().settings, 1);
    assert_frame(&mut karst, &old.expected(&pictures));
    karst.frame().unwrap().unwrap().acknowledge().unwrap();
    // Its partner is skipped as well, and the next pair is measured with the new settings
    for y in 0..usize::from(HEIGHT) {
        if y > 0 {
            send_row(&model, &pictures, 0, y);
        }
        send_row(&model, &pictures, 1, y);
    }
    assert!(karst.frame().unwrap().is_none());
    assert_eq!(karst.counters().unwrap().skipped, 1);
    send(&model, &pictures);
    let frame = karst.frame().unwrap().unwrap();
    assert_eq!((frame.settings, frame.pair), (2, 2));
    assert_frame(&mut karst, &new.expected(&pictures));
    assert_ne!(new.expected(&pictures).points, old.expected(&pictures).points);
}

#[test]
fn a_frame_that_cuts_the_one_a_commit_waits_for_is_skipped() {
    let instrument = Instrument::new(250.0, Method::Weighted);
    let pictures = pictures(&ALL);
    let (model, mut karst) = running(&instrument);
    model.row(0, true, &pictures[0][0]);
    karst.commit().unwrap();
    assert!(karst.status().unwrap().committing);
    model.row(0, true, &pictures[0][0]);
    assert!(!karst.status().unwrap().committing);
    assert_eq!(karst.counters().unwrap().skipped, 1);
}

#[test]
fn results_stay_until_they_are_acknowledged_then_the_newest_complete_ones_come() {
    let instrument = Instrument::new(250.0, Method::Weighted);
    let (model, mut karst) = running(&instrument);
    let frames: Vec<_> = (0..4)
        .map(|i| {
            let mut radii = ALL;
            radii[i] = None;
            pictures(&radii)
        })
        .collect();
    for (i, frame) in frames.iter().take(3).enumerate() {
        send(&model, frame);
        assert_frame(&mut karst, &instrument.expected(&frames[0]));
        assert_eq!(usize::from(karst.counters().unwrap().missed), i.saturating_sub(1));
    }
    assert!(karst.take_faults().unwrap().missed());
    karst.frame().unwrap().unwrap().acknowledge().unwrap();
    assert_frame(&mut karst, &instrument.expected(&frames[2]));
    assert_eq!(karst.frame().unwrap().unwrap().pair, 3);
    karst.frame().unwrap().unwrap().acknowledge().unwrap();
    assert!(karst.frame().unwrap().is_none());
    assert_eq!(karst.bus().read32(map::RESULT_FRAME_PAIR), Ok(0));
    assert_eq!(karst.bus().read32(map::spots_camera_spot_column(1, 0)), Ok(0));
    send(&model, &frames[3]);
    assert_frame(&mut karst, &instrument.expected(&frames[3]));
    assert_eq!(karst.counters().unwrap().frames, 3);
}

#[test]
fn nothing_is_taken_before_the_first_commit_or_while_disabled() {
    let instrument = Instrument::new(250.0, Method::Weighted);
    let pictures = pictures(&ALL);
    let model = Shared::default();
    let mut karst = Karst::probe(model.clone()).unwrap();
    karst.set_enabled(true).unwrap();
    send(&model, &pictures);
    assert!(karst.frame().unwrap().is_none() && !karst.status().unwrap().configured);
    karst.load(&instrument.settings()).unwrap();
    send(&model, &pictures);
    assert!(karst.frame().unwrap().is_none(), "loaded, but not committed");
    karst.commit().unwrap();
    karst.set_enabled(false).unwrap();
    send(&model, &pictures);
    assert!(karst.frame().unwrap().is_none() && karst.status().unwrap().configured);
    karst.set_enabled(true).unwrap();
    send(&model, &pictures);
    assert_frame(&mut karst, &instrument.expected(&pictures));
    assert!(karst.take_faults().unwrap().is_empty());
}

#[test]
fn damaged_frames_are_told_counted_and_recovered_from() {
    let instrument = Instrument::new(250.0, Method::Weighted);
    let (model, mut karst) = running(&instrument);
    let mut damaged = pictures(&ALL);
    damaged[0][3].pop();
    damaged[1][4].extend([0; 3]);
    send(&model, &damaged);
    assert_frame(&mut karst, &instrument.expected(&damaged));
    karst.frame().unwrap().unwrap().acknowledge().unwrap();
    // A row too many for camera 0, then a frame of camera 1 that ends early
    model.row(0, false, &damaged[0][5]);
    let good = pictures(&ALL);
    for y in 0..50 {
        send_row(&model, &good, 1, y);
        send_row(&model, &good, 0, y);
    }
    model.row(1, true, &good[1][0]);
    for y in 50..usize::from(HEIGHT) {
        send_row(&model, &good, 0, y);
    }
    assert!(karst.frame().unwrap().unwrap().cameras[1].truncated);
    karst.frame().unwrap().unwrap().acknowledge().unwrap();
    let faults = karst.take_faults().unwrap();
    assert!(faults.short_row(0) && !faults.short_row(1));
    assert!(!faults.long_row(0) && faults.long_row(1));
    assert!(faults.stray_row(0) && !faults.stray_row(1));
    assert!(!faults.truncated(0) && faults.truncated(1));
    assert!(!faults.overflow(0) && !faults.missed() && !faults.unpaired());
    let counters = karst.counters().unwrap();
    assert_eq!((counters.short_rows, counters.long_rows), ([1, 0], [0, 1]));
    assert_eq!((counters.truncated, counters.stray_rows), ([0, 1], [1, 0]));
    assert_eq!(counters.frames, 2);
    karst.clear_counters().unwrap();
    assert_eq!(karst.counters().unwrap(), karst_regs::Counters::default());
    // Camera 1 ends what it began without a partner; then all is well again
    for row in &good[1][1..] {
        model.row(1, false, row);
    }
    assert!(karst.take_faults().unwrap().unpaired());
    send(&model, &good);
    assert_frame(&mut karst, &instrument.expected(&good));
}

#[test]
fn hits_lost_for_want_of_slots_are_told() {
    let mut instrument = Instrument::new(250.0, Method::Weighted);
    instrument.detectors[0].cluster_gap = 0;
    let (model, mut karst) = running(&instrument);
    let mut speckled = pictures(&ALL);
    for x in (150..190).step_by(4) {
        speckled[0][96][3 * x + 1] = 200;
        speckled[0][100][3 * x + 1] = 200;
    }
    send(&model, &speckled);
    let faults = karst.take_faults().unwrap();
    assert!(faults.overflow(0) && !faults.overflow(1));
    assert_frame(&mut karst, &instrument.expected(&speckled));
}

#[test]
fn a_frame_without_a_partner_gives_no_results() {
    let instrument = Instrument::new(250.0, Method::Weighted);
    let (model, mut karst) = running(&instrument);
    let pictures = pictures(&ALL);
    for _ in 0..2 {
        for (y, row) in pictures[0].iter().enumerate() {
            model.row(0, y == 0, row);
        }
    }
    assert!(karst.frame().unwrap().is_none());
    assert!(karst.take_faults().unwrap().unpaired());
    assert_eq!(karst.counters().unwrap().unpaired, 2);
    send(&model, &pictures);
    assert_frame(&mut karst, &instrument.expected(&pictures));
}

#[test]
fn a_reset_is_the_way_out_of_a_camera_that_stopped() {
    let [old, new] = [250.0, 300.0].map(|half| Instrument::new(half, Method::Weighted));
    let pictures = pictures(&ALL);
    let (model, mut karst) = running(&old);
    for y in 0..10 {
        send_row(&model, &pictures, 0, y);
        send_row(&model, &pictures, 1, y);
    }
    karst.load(&new.settings()).unwrap();
    karst.commit().unwrap();
    assert_eq!(karst.status().unwrap().in_frame, [true; 2]);
    assert!(karst.status().unwrap().committing);
    karst.reset().unwrap();
    let status = karst.status().unwrap();
    assert!(!status.committing && !status.ready && status.configured && status.in_frame == [false; 2]);
    send(&model, &pictures);
    assert_frame(&mut karst, &new.expected(&pictures));
    karst.reset().unwrap();
    assert!(karst.frame().unwrap().is_none(), "results are forgotten as well");
}
