//! Figures over all lasers of all frames.

use crate::result::{LaserResult, Section, Timing};

/// Measured minus true range, mm, where both are known.
pub fn range_error_mm(laser: &LaserResult) -> Option<f64> {
    Some(laser.point.as_ref()?.range_mm - laser.truth.as_ref()?.range_mm?)
}

/// chi squared over its degrees of freedom: three with two cameras, one with a single one.
fn chi2_per_dof(laser: &LaserResult) -> Option<f64> {
    let both = laser.spots.iter().all(Option::is_some);
    Some(laser.point.as_ref()?.chi2? / if both { 3.0 } else { 1.0 })
}

/// Summary of a sequence of sections. Means are none where nothing contributes to them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Number of frames.
    pub frames: usize,
    /// Lasers times frames.
    pub lasers: usize,
    /// Points among them.
    pub points: usize,
    /// Lasers whose true spot both cameras see; none: the truth is unknown.
    pub visible: Option<usize>,
    /// Lasers without a point although both cameras see the true spot; none: the truth is unknown.
    pub missed: Option<usize>,
    /// Mean range from the rig axis, mm.
    pub mean_range_mm: Option<f64>,
    /// Mean standard deviation, mm.
    pub mean_sigma_mm: Option<f64>,
    /// Mean chi squared per degree of freedom.
    pub mean_chi2_per_dof: Option<f64>,
    /// Mean range error, mm.
    pub bias_mm: Option<f64>,
    /// Root mean square of the range error, mm.
    pub rms_error_mm: Option<f64>,
    /// Mean of |range error| / true range, per cent.
    pub mean_error_percent: Option<f64>,
    /// Largest |range error|, mm.
    pub worst_error_mm: Option<f64>,
    /// Mean times of the frames that have them.
    pub timing: Option<Timing>,
}

impl Summary {
    /// Summarises the sections.
    pub fn new(sections: &[&Section]) -> Self {
        let lasers = || sections.iter().flat_map(|s| &s.lasers);
        let points = || lasers().filter_map(|l| l.point.as_ref());
        let errors = || lasers().filter_map(range_error_mm);
        let truth_known = lasers().any(|l| l.truth.is_some());
        let visible = |l: &&LaserResult| l.truth.as_ref().is_some_and(|t| t.visible == [true; 2]);
        let timings = || sections.iter().filter_map(|s| s.timing);
        Self {
            frames: sections.len(),
            lasers: lasers().count(),
            points: points().count(),
            visible: truth_known.then(|| lasers().filter(visible).count()),
            missed: truth_known.then(|| lasers().filter(visible).filter(|l| l.point.is_none()).count()),
            mean_range_mm: mean(points().map(|p| p.range_mm)),
            mean_sigma_mm: mean(points().filter_map(|p| p.sigma_mm)),
            mean_chi2_per_dof: mean(lasers().filter_map(chi2_per_dof)),
            bias_mm: mean(errors()),
            rms_error_mm: mean(errors().map(|e| e * e)).map(f64::sqrt),
            mean_error_percent: mean(lasers().filter_map(|l| {
                let range = l.truth.as_ref()?.range_mm.filter(|&r| r > 0.0)?;
                Some(100.0 * range_error_mm(l)?.abs() / range)
            })),
            worst_error_mm: errors().map(f64::abs).reduce(f64::max),
            timing: mean(timings().map(|t| t.detect_ms))
                .zip(mean(timings().map(|t| t.reconstruct_ms)))
                .map(|(detect_ms, reconstruct_ms)| Timing { detect_ms, reconstruct_ms }),
        }
    }
}

/// Mean; none of no values.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / count as f64)
}
