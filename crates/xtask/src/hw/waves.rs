//! What a viewer needs of waves.

use anyhow::{Context, ensure};

/// Length of a clock in the waves.
const CLOCK_NS: u64 = 10;

/// Whether a VCD file has the waves of so many clocks from that one on, of all that is in the SoC.
pub fn check(vcd: &str, from: u64, clocks: u64) -> anyhow::Result<()> {
    let (header, changes) = vcd.split_once("$enddefinitions $end").context("the waves have no end of their header")?;
    let words = |line| str::split_whitespace(line).collect::<Vec<_>>();
    let scale = header.lines().map(words).find(|words| words.first() == Some(&"$timescale"));
    ensure!(scale.is_some_and(|words| words.concat().contains("1ns")), "the waves' time is not in ns");
    // $scope module NAME $end, $var KIND BITS CODE NAME [RANGE] $end
    let mut scopes = Vec::new();
    let mut signals = Vec::new();
    for line in header.lines().map(words) {
        match line[..] {
            ["$scope", _, name, "$end"] => scopes.push(name),
            ["$upscope", "$end"] => drop(scopes.pop()),
            ["$var", _, _, code, name, ..] => signals.push((format!("{}.{name}", scopes.join(".")), code)),
            _ => {}
        }
    }
    let code = |path: &str| {
        let found = signals.iter().find(|(name, _)| name == path || name.ends_with(&format!(".{path}")));
        found.map(|(_, code)| *code).with_context(|| format!("the waves have no signal {path}"))
    };
    for path in ["soc_i.uart_tx", "processor_i.dBusWishbone_ADR", "karst_i.results_done", "time_i.clocks_per_us"] {
        code(path)?;
    }
    let rises = format!("1{}", code("soc_i.clk")?);
    let mut time = None;
    let mut edges = Vec::new();
    for line in changes.lines() {
        if let Some(stamp) = line.strip_prefix('#') {
            time = Some(stamp.trim().parse::<u64>().context("a time in the waves is no number")?);
        } else if line == rises {
            edges.extend(time);
        }
    }
    let expected: Vec<u64> = (from..from + clocks).filter(|&clock| clock > 0).map(|clock| clock * CLOCK_NS).collect();
    ensure!(edges == expected, "the waves have {} clocks {:?}..{:?}", edges.len(), edges.first(), edges.last());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(clocks: std::ops::Range<u64>) -> String {
        let mut text = String::from("$timescale   1ns $end\n$scope module TOP $end\n$scope module soc_i $end\n");
        text.push_str("$var wire 1 a clk $end\n$var wire 1 b uart_tx $end\n");
        for (scope, name) in
            [("processor_i", "dBusWishbone_ADR"), ("karst_i", "results_done"), ("time_i", "clocks_per_us")]
        {
            text.push_str(&format!("$scope module {scope} $end\n$var wire 30 c {name} [29:0] $end\n$upscope $end\n"));
        }
        text.push_str("$upscope $end\n$upscope $end\n$enddefinitions $end\n");
        for clock in clocks {
            text.push_str(&format!("#{}\n1a\n#{}\n0a\n", 10 * clock, 10 * clock + 5));
        }
        text
    }

    #[test]
    fn waves_of_the_clocks_asked_for_are_right_and_others_are_not() {
        check(&waves(100..120), 100, 20).unwrap();
        for wrong in [waves(100..119), waves(101..121), waves(0..0)] {
            assert!(check(&wrong, 100, 20).is_err());
        }
        let without = waves(100..120).replace("uart_tx", "other");
        assert!(check(&without, 100, 20).unwrap_err().to_string().contains("no signal soc_i.uart_tx"));
    }
}
