//! The bars of the accuracy evaluation, and the table of the README. Refresh the table with `cargo xtask figures`.

use karst::eval::evaluate;
use karst_rig::Rig;

#[test]
fn the_evaluation_meets_its_bars_and_is_the_table_of_the_readme() {
    let evaluation = evaluate(&Rig::default(), None, || ()).unwrap();
    let f = &evaluation.figures;
    let table = evaluation.table();
    assert!(f.frames >= 40, "{table}");
    assert!(f.mean_abs_range_error_pct_to_3m.unwrap() <= 0.25, "{table}");
    assert!(f.mean_abs_range_error_pct_at_4_8m.unwrap() <= 0.6, "{table}");
    assert!(f.hexagon_mse_mm2.unwrap() <= 2.5, "{table}");
    assert!(f.spot_rms_px.unwrap() <= 0.05, "{table}");
    assert!(f.spots_found_pct.unwrap() >= 99.5, "{table}");
    assert_eq!(f.false_points, 0, "{table}");
    assert_eq!(f.decision_mismatches, 0, "{table}");
    assert!(f.fixed_vs_f64_max_mm.unwrap() <= 0.05, "{table}");
    assert!((0.9..=1.1).contains(&f.chi2_per_dof.unwrap()), "{table}");

    // Calibration notes: +9.4, +4.1, 0, -1.1, -2.3, -2.6, -2.9 % for a tube of 75 mm, calibrated at 0.7 m
    let expected = [9.4, 4.1, 0.0, -1.1, -2.3, -2.6, -2.9];
    for (bias, expected) in evaluation.model_bias.iter().zip(expected) {
        assert!((bias.compact_pct - expected).abs() < 0.1, "{bias:?}");
        assert!(bias.axial_pct.abs() < 0.05, "{bias:?}");
    }

    let json = serde_json::to_value(&evaluation).unwrap();
    let keys = [
        "mean_abs_range_error_pct_to_3m",
        "mean_abs_range_error_pct_at_4_8m",
        "paper_mean_abs_range_error_pct_to_3m",
        "hexagon_mse_mm2",
        "spot_rms_px",
        "spots_found_pct",
        "false_points",
        "fixed_vs_f64_max_mm",
        "chi2_per_dof",
        "frames",
    ];
    for key in keys {
        assert!(json[key].is_number(), "{key}");
        // A scene without lasers, or of another kind, has no such figure; the key is there all the same
        assert!(json["scenes"].as_array().unwrap().iter().all(|scene| scene.get(key).is_some()), "{key}");
    }
    assert_eq!(json["scenes"].as_array().unwrap().len(), f.frames);

    let readme = include_str!("../../../README.md");
    let printed = readme.split("<!-- accuracy -->\n").nth(1).and_then(|rest| rest.split("<!-- /accuracy -->").next());
    assert!(agree(printed.unwrap(), &table), "The README has another table than this:\n{table}");
}

/// Whether two texts have the same words, and numbers that differ by no more than another machine's mathematical
/// library explains.
fn agree(printed: &str, fresh: &str) -> bool {
    let words = |text: &str| text.split_whitespace().map(|word| word.replace('*', "")).collect::<Vec<_>>();
    let (printed, fresh) = (words(printed), words(fresh));
    printed.len() == fresh.len()
        && printed.iter().zip(&fresh).all(|(a, b)| match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(a), Ok(b)) => (a - b).abs() <= 0.05 * a.abs().max(b.abs()) + 0.011,
            _ => a == b,
        })
}

#[test]
fn a_table_with_another_figure_is_noticed() {
    assert!(agree("| mean | **0.014 %** |", "| mean | **0.015 %** |"));
    assert!(!agree("| mean | **0.014 %** |", "| mean | **0.045 %** |"));
    assert!(!agree("| mean | **0.014 %** |", "| mean square | **0.014 %** |"));
}
