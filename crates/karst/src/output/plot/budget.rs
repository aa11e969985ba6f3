//! What takes how long in the sensor, and how long it may.

use super::*;
use karst_cycles::BudgetRow;

/// Shortest time on the scale, us.
const SHORTEST_US: f64 = 0.1;

/// The rows of a budget as bars over a logarithmic scale of time, each with its limit.
pub fn budget_plot(title: &str, rows: &[BudgetRow], clock_hz: f64) -> Result<String, OutputError> {
    let us = |clocks: u64| (clocks as f64 / clock_hz * 1e6).max(SHORTEST_US);
    let longest = rows.iter().map(|row| us(row.clocks.max(row.limit_clocks))).fold(10.0, f64::max);
    let mut legend = Legend::new(title);
    legend.add(Symbol::Line(BLUE), "predicted");
    if rows.iter().any(|row| !row.met()) {
        legend.add(Symbol::Line(VERMILION), "predicted, above its limit");
    }
    legend.add(Symbol::Line(INK), "limit");
    for row in rows {
        legend.text(&format!("{}: {}", row.name, row.limit));
    }

    const WIDTH: i32 = 1300;
    const ROW: i32 = 62;
    const LEGEND: i32 = COLUMN + 260;
    let height = (rows.len() as i32 * ROW + 150).max(rows.len() as i32 * LINE + 300);
    svg(WIDTH + LEGEND, height, |root| {
        let (plot, column) = root.split_horizontally(WIDTH);
        legend.draw(&column)?;
        let mut chart = ChartBuilder::on(&plot)
            .margin(20)
            .set_label_area_size(LabelAreaPosition::Left, 380)
            .set_label_area_size(LabelAreaPosition::Bottom, 80)
            .build_cartesian_2d(SHORTEST_US.log10()..longest.log10() + 0.1, rows.len() as f64..0.0)
            .map_err(failed)?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .disable_y_axis()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RULE)
            .axis_style(GREY)
            .label_style(("sans-serif", SMALL).into_font().color(&INK))
            .axis_desc_style(("sans-serif", TEXT).into_font().color(&INK))
            .x_desc("time")
            .x_labels(7)
            .x_label_formatter(&time)
            .draw()
            .map_err(failed)?;
        for (row, y) in rows.iter().zip(0..) {
            let y = f64::from(y);
            let [clocks, limit] = [row.clocks, row.limit_clocks].map(|clocks| us(clocks).log10());
            let colour = if row.met() { BLUE } else { VERMILION };
            let bar = Rectangle::new([(SHORTEST_US.log10(), y + 0.2), (clocks, y + 0.8)], colour.mix(0.8).filled());
            draw(&mut chart, [bar])?;
            draw(&mut chart, [PathElement::new([(limit, y + 0.08), (limit, y + 0.92)], INK.stroke_width(4))])?;
            label(&mut chart, format!("{}  ", row.name), (SHORTEST_US.log10(), y + 0.5), SMALL, INK, HPos::Right)?;
        }
        Ok(())
    })
}

/// A power of ten of microseconds.
fn time(exponent: &f64) -> String {
    let us = 10_f64.powf(*exponent);
    match us {
        _ if (exponent - exponent.round()).abs() > 1e-6 => String::new(),
        ..0.9999 => format!("{} ns", tick(&(us * 1e3))),
        ..999.9 => format!("{} µs", tick(&us)),
        _ => format!("{} ms", tick(&(us / 1e3))),
    }
}
