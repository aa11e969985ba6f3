//! The program for a PC.

use std::process::Command;

use karst_regs::{map, soc};

#[test]
fn maps_and_defaults_are_those_the_firmware_is_made_with() {
    let output = Command::new(env!("CARGO_BIN_EXE_firmware")).output().unwrap();
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    for (base, bytes, name) in
        [(soc::PROGRAM_BASE, soc::PROGRAM_BYTES, "program"), (soc::DATA_BASE, soc::DATA_BYTES, "data")]
    {
        let line = format!("| {base:#010x} | {} | {name} |", bytes / 1024);
        assert!(text.contains(&line), "no {line}");
    }
    for (address, name) in [
        (map::MAGIC, "magic"),
        (map::settings_laser_azimuth(0), "settings_laser_azimuth"),
        (map::result_point_status(0), "result_point_status"),
    ] {
        assert!(
            text.lines().any(|line| line.starts_with(&format!("| {address:#07x}")) && line.contains(name)),
            "{name}"
        );
    }
    assert!(text.contains(&format!("Map hash {:#010x}", map::MAP_HASH_VALUE_RESET)));
    assert!(text.contains(&format!("up to {} lasers", karst_firmware::LASERS)));
    assert!(text.contains("mode Accelerated, method Weighted, lasers off"));
}
