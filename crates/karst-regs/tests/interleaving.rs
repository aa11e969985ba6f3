//! Whatever the order of rows, reads, writes and commits: no result mixes two frames or two calibrations.

mod common;

use std::sync::LazyLock;

use common::*;
use karst_core::Method;
use karst_regs::{Karst, LoadError};
use proptest::prelude::*;

/// What software does.
#[derive(Debug, Clone)]
enum Action {
    /// Load one of the instruments.
    Load(usize),
    /// Load half of one, and have second thoughts: what was meant to be there is loaded again before a commit.
    LoadHalf(usize),
    Commit,
    Enable(bool),
    /// Read a frame that is ready, and acknowledge it or not. Rows arrive between the reads.
    Read {
        rows: usize,
        acknowledge: bool,
    },
    Reset,
}

fn action() -> impl Strategy<Value = Action> {
    prop_oneof![
        4 => (0..INSTRUMENTS).prop_map(Action::Load),
        2 => (0..INSTRUMENTS).prop_map(Action::LoadHalf),
        8 => Just(Action::Commit),
        2 => prop::bool::weighted(0.8).prop_map(Action::Enable),
        16 => (0..40_usize, prop::bool::weighted(0.7))
            .prop_map(|(rows, acknowledge)| Action::Read { rows, acknowledge }),
        1 => Just(Action::Reset),
    ]
}

const INSTRUMENTS: usize = 3;
const FRAMES: usize = 8;

struct World {
    instruments: Vec<Instrument>,
    pictures: Vec<[Vec<Vec<u8>>; 2]>,
    /// By frame and instrument.
    expected: Vec<Vec<Expected>>,
}

static WORLD: LazyLock<World> = LazyLock::new(|| {
    let instruments: Vec<_> = [(250.0, Method::Weighted), (290.0, Method::Weighted), (270.0, Method::Paper)]
        .map(|(half_baseline, method)| Instrument::new(half_baseline, method))
        .into();
    let pictures: Vec<_> = (0..FRAMES)
        .map(|frame| {
            let mut radii = ALL;
            radii.rotate_left(frame);
            radii[frame] = None;
            pictures(&radii)
        })
        .collect();
    let expected = pictures.iter().map(|pictures| instruments.iter().map(|i| i.expected(pictures)).collect()).collect();
    World { instruments, pictures, expected }
});

/// The two cameras, and how far they are.
struct Cameras {
    model: Shared,
    /// Rows sent so far.
    at: [usize; 2],
}

impl Cameras {
    /// Sends rows of one camera, as many as leave the cameras less than half a frame apart.
    fn send(&mut self, camera: usize, rows: usize) {
        let height = usize::from(HEIGHT);
        for _ in 0..rows {
            if 2 * (self.at[camera] + 1) >= 2 * self.at[1 - camera] + height {
                return;
            }
            let (frame, y) = (self.at[camera] / height % FRAMES, self.at[camera] % height);
            self.model.row(camera, y == 0, &WORLD.pictures[frame][camera][y]);
            self.at[camera] += 1;
        }
    }
}

/// Reads everything that is ready, with rows in between, and gives the numbers of the frame and of the settings that it
/// is the result of.
fn read(
    karst: &mut Karst<Shared>,
    cameras: &mut Cameras,
    rows: usize,
    acknowledge: bool,
    committed: &[usize],
) -> Result<Option<u32>, TestCaseError> {
    let Some(mut frame) = karst.frame().unwrap() else { return Ok(None) };
    let mut points = Vec::new();
    for laser in 0..LASERS as u16 {
        cameras.send(usize::from(laser) % 2, rows);
        points.push(frame.point(laser).unwrap());
    }
    let instrument = committed[frame.settings as usize - 1];
    let same = |expected: &&Vec<Expected>| expected[instrument].points == points;
    let Some(expected) = WORLD.expected.iter().find(same) else {
        return Err(TestCaseError::fail(format!("no frame gives {points:?} with instrument {instrument}")));
    };
    for camera in 0..2 {
        let spots = expected[instrument].spots[camera].iter().flatten();
        for (index, spot) in (0..).zip(spots) {
            cameras.send(camera, rows / 4);
            prop_assert_eq!(frame.spot(camera, index).unwrap().position, spot.position);
        }
    }
    let pair = frame.pair;
    if acknowledge {
        frame.acknowledge().unwrap();
    }
    Ok(Some(pair))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn no_result_mixes_two_frames_or_two_calibrations(
        steps in prop::collection::vec((0..250_usize, 0..250_usize, action()), 5..60),
    ) {
        let model = Shared::default();
        let mut karst = Karst::probe(model.clone()).unwrap();
        let mut cameras = Cameras { model, at: [0; 2] };
        karst.set_enabled(true).unwrap();
        // The instrument in the settings memory, if it is one; those of the commits; the last pair read
        let (mut loaded, mut committed, mut last) = (None, Vec::new(), 0);
        for (first, second, action) in steps {
            cameras.send(0, first);
            cameras.send(1, second);
            match action {
                Action::Load(instrument) => match karst.load(&WORLD.instruments[instrument].settings()) {
                    Ok(()) => loaded = Some(instrument),
                    Err(error) => prop_assert_eq!(error, LoadError::Committing),
                },
                Action::LoadHalf(instrument) => {
                    if !karst.status().unwrap().committing {
                        let address = karst_regs::map::settings_camera_polynomial(instrument as u32 % 2, 0);
                        karst_regs::RegisterBus::write32(karst.bus(), address, 12345).unwrap();
                        loaded = None;
                    }
                }
                Action::Commit => {
                    if let Some(instrument) = loaded
                        && !karst.status().unwrap().committing
                    {
                        committed.push(instrument);
                        karst.commit().unwrap();
                    }
                }
                Action::Enable(enabled) => karst.set_enabled(enabled).unwrap(),
                Action::Read { rows, acknowledge } => {
                    if let Some(pair) = read(&mut karst, &mut cameras, rows, acknowledge, &committed)? {
                        prop_assert!(pair >= last, "pair {} after {}", pair, last);
                        last = pair;
                    }
                }
                Action::Reset => karst.reset().unwrap(),
            }
        }
        // Whatever has happened, the IP works: some frames later there is a result
        karst.set_enabled(true).unwrap();
        for _ in 0..12 * usize::from(HEIGHT) {
            cameras.send(0, 1);
            cameras.send(1, 1);
        }
        if !committed.is_empty() {
            prop_assert!(read(&mut karst, &mut cameras, 10, true, &committed)?.is_some());
        }
    }
}
