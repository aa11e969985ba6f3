//! What an instrument is in: air on the bench, water at work.

use crate::Rig;

/// What the instrument is surrounded by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Medium {
    /// Air: the cameras without their tube, as they are calibrated on the bench.
    Air,
    /// Water: the whole instrument.
    Water,
}

impl Medium {
    /// The rig in this medium. In air it has neither a tube nor models of cameras in the water.
    pub fn rig(self, rig: &Rig) -> Rig {
        let mut rig = rig.clone();
        if self == Medium::Air {
            rig.tube = None;
            for camera in &mut rig.cameras {
                camera.water = None;
            }
        }
        rig
    }
}
