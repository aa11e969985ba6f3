//! The linker's view of the SoC's memory against the one description of it.

use karst_regs::soc::{DATA_BASE, DATA_BYTES, KARST_BASE, PERIPHERALS_BASE, PROGRAM_BASE, PROGRAM_BYTES};

/// Address and size of a region of memory.x.
fn region(name: &str) -> (u32, u32) {
    let script = include_str!("../../../memory.x");
    let line = script.lines().find(|line| line.trim_start().starts_with(&format!("{name} :"))).expect(name);
    let (_, origin) = line.split_once("ORIGIN = 0x").expect(line);
    let (origin, length) = origin.split_once(", LENGTH = ").expect(line);
    let kib = length.trim().strip_suffix('K').expect("a length in KiB");
    (u32::from_str_radix(origin, 16).expect(origin), 1024 * kib.parse::<u32>().expect(kib))
}

#[test]
fn the_linker_sees_the_memory_of_the_soc() {
    assert_eq!(region("FLASH"), (PROGRAM_BASE, PROGRAM_BYTES));
    assert_eq!(region("RAM"), (DATA_BASE, DATA_BYTES));
}

/// VexRiscv caches data below 0x8000_0000 and nothing else.
#[test]
fn memory_is_cached_and_registers_are_not() {
    const { assert!(DATA_BASE + DATA_BYTES <= 1 << 31) };
    const { assert!(KARST_BASE >= 1 << 31 && PERIPHERALS_BASE >= 1 << 31) };
}
