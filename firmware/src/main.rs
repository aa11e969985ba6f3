//! What the firmware is made for, printed on a PC: memory map, register map, and what it does until it is told otherwise.

use std::io::{self, Write};

use karst_firmware::{LASERS, PROGRAM, SPOTS, WATCHDOG_US};
use karst_link::{Hello, Settings};

/// As the SoC's and the IP's descriptions have it.
const MEMORY_MAP: &str = include_str!("../../hw-ip/rtl/soc/generated/memory_map.md");
const REGISTER_MAP: &str = include_str!("../../hw-ip/rtl/regs/generated/register_map.md");

fn main() -> io::Result<()> {
    let mut out = io::stdout().lock();
    for map in [MEMORY_MAP, REGISTER_MAP] {
        // Without the note on how it was made
        let lines = map.lines().skip_while(|line| !line.starts_with('#'));
        lines.into_iter().try_for_each(|line| writeln!(out, "{line}"))?;
        writeln!(out)?;
    }
    let [major, minor, patch] = PROGRAM;
    let hello = Hello::new(PROGRAM, LASERS as u16);
    let Settings { mode, method, spots, lasers, trigger_period_us } = Settings::default();
    let on = |is_on| if is_on { "on" } else { "off" };
    let trigger = match trigger_period_us {
        0 => "cameras run on their own".to_owned(),
        period => format!("a trigger every {period} us"),
    };
    writeln!(out, "# Defaults\n")?;
    writeln!(
        out,
        "* firmware {major}.{minor}.{patch}, protocols {} to {}",
        hello.oldest_protocol, hello.newest_protocol
    )?;
    writeln!(out, "* up to {LASERS} lasers and {SPOTS} spots per camera and frame")?;
    writeln!(out, "* mode {mode:?}, method {method:?}, lasers {}, spots sent {}, {trigger}", on(lasers), on(spots))?;
    writeln!(out, "* no calibration: no points; the watchdog bites after {} ms", WATCHDOG_US / 1000)
}
