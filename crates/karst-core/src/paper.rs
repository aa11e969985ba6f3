//! The paper's method: the plain average of the three estimates (eqs. 4 to 8 as corrected).

use karst_math::{div_round, round_shift};

use crate::fusion::{BeamRay, mono, stereo};

/// The average of the estimates that exist, in the beam's frame (along, up, across), mm in Q.16; None without any.
pub(crate) fn average(rays: &[Option<BeamRay>; 2]) -> Option<[i64; 3]> {
    let mut sum = [0; 3];
    let mut count = 0;
    let mut add = |point: [i64; 3]| {
        sum = core::array::from_fn(|i| sum[i] + point[i]);
        count += 1;
    };
    for ray in rays.iter().flatten() {
        if let Some(c) = mono(ray) {
            add([c.along, 0, ray.across_at(c.along)]);
        }
    }
    if let [Some(a), Some(b)] = rays
        && let Some(c) = stereo(&[*a, *b])
    {
        // The rays' midpoint: they cross in the plane of along and up, and may pass each other across it
        let across = round_shift(a.across_at(c.along) + b.across_at(c.along), 1);
        add([c.along, round_shift(a.up_at(c.along), 4), across]);
    }
    (count > 0).then(|| sum.map(|s| div_round(s, count)))
}
