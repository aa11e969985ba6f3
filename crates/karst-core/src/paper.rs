//! The paper's method: the plain average of the three estimates (eqs. 4 to 8 as corrected).

use karst_math::{div_round, round_shift};

use crate::fusion::{BeamRay, Estimates, mono, stereo};

/// The average of the estimates that exist, in the beam's frame (along, up, across), mm in Q.16, and the estimates; None
/// without any.
pub(crate) fn average(rays: &[Option<BeamRay>; 2]) -> Option<([i32; 3], Estimates)> {
    let mut sum = [0; 3];
    let mut count = 0;
    let mut add = |point: [i32; 3]| {
        sum = core::array::from_fn(|i| sum[i] + i64::from(point[i]));
        count += 1;
    };
    let mut estimates = Estimates::default();
    for (ray, estimate) in rays.iter().zip(&mut estimates.mono) {
        if let Some(ray) = ray
            && let Some(c) = mono(ray)
        {
            add([c.along, 0, ray.across_at(c.along)]);
            *estimate = Some(c.estimate());
        }
    }
    if let [Some(a), Some(b)] = rays
        && let Some(c) = stereo([a, b])
    {
        // The rays' midpoint: they cross in the plane of along and up, and may pass each other across it
        let across = round_shift(i64::from(a.across_at(c.along)) + i64::from(b.across_at(c.along)), 1);
        add([c.along, a.up_at(c.along), across as i32]);
        estimates.stereo = Some(c.estimate());
    }
    // An average fits where each of its terms does
    (count > 0).then(|| (sum.map(|s| div_round(s, count) as i32), estimates))
}
