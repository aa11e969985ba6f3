//! Faults for the simulated SoC: where `hw-ip/sim/soc_bench.sv` reaches into the converted Verilog.

use anyhow::ensure;

/// Module, signal, and the condition and value of the bench that come before what drives it.
const FAULTS: [(&str, &str, &str); 3] = [
    ("soc", "d_adr", "soc_bench.goes_astray ? 30'd0"),
    ("soc", "karst_stb", "soc_bench.hang_now ? 1'b0"),
    ("timer_watchdog_", "clocks_per_us", "soc_bench.is_fast ? soc_bench.clocks_now"),
];

/// Lets the bench take the place of the signals' drivers. A signal that is not there, or has no driver, is an error.
pub fn let_in(verilog: &str) -> anyhow::Result<String> {
    let mut current = "";
    let mut found = [0; FAULTS.len()];
    let mut lines = Vec::new();
    for line in verilog.lines() {
        if let Some(name) = line.strip_prefix("module ") {
            current = name.trim();
        }
        let driver = line.trim_start().strip_prefix("assign ").and_then(|assignment| assignment.split_once(" = "));
        let fault = driver.and_then(|(left, driver)| {
            let is_here = |module: &str| current == module || module.ends_with('_') && current.starts_with(module);
            let place = FAULTS.iter().position(|(module, signal, _)| is_here(module) && *signal == left)?;
            Some((place, left, driver))
        });
        lines.push(match fault {
            Some((place, left, driver)) => {
                found[place] += 1;
                format!("  assign {left} = {} : {driver}", FAULTS[place].2)
            }
            None => line.to_owned(),
        });
    }
    for ((module, signal, _), count) in FAULTS.iter().zip(found) {
        ensure!(count == 1, "{module}.{signal} has {count} drivers in the converted SoC: no place for a fault");
    }
    lines.push(String::new());
    Ok(lines.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOC: &str = "module timer_watchdog_100
  assign clocks_per_us = n5_q; // (signal)
endmodule
module soc
  assign d_adr = processor_i_adr; // (signal)
  assign karst_stb = bus_i_karst_stb; // (signal)
  assign d_ack = bus_i_ack; // (signal)
endmodule
";

    #[test]
    fn the_bench_comes_before_the_driver_of_its_signals_and_of_no_other() {
        let expected = SOC
            .replace("= n5_q", "= soc_bench.is_fast ? soc_bench.clocks_now : n5_q")
            .replace("= processor_i_adr", "= soc_bench.goes_astray ? 30'd0 : processor_i_adr")
            .replace("= bus_i_karst_stb", "= soc_bench.hang_now ? 1'b0 : bus_i_karst_stb");
        assert_eq!(let_in(SOC).unwrap(), expected);
    }

    #[test]
    fn a_signal_that_is_not_there_is_an_error() {
        for signal in ["clocks_per_us", "d_adr", "karst_stb"] {
            let without = SOC.replace(&format!("assign {signal} "), "assign other ");
            assert!(let_in(&without).unwrap_err().to_string().contains(signal));
        }
    }
}
