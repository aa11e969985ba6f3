//! Hands each image the memory map of its machine.

use std::{env, fs, path::PathBuf};

/// Images for QEMU; the sensor's is for the SoC.
const VIRT: [&str; 3] = ["algorithm", "costs", "selftest"];

fn main() {
    if env::var_os("CARGO_FEATURE_IMAGES").is_none() {
        return;
    }
    let folder = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    for (from, to) in [("virt.x", "virt.x"), ("../memory.x", "sensor.x")] {
        fs::copy(from, folder.join(to)).expect("cannot copy the memory map");
        println!("cargo::rerun-if-changed={from}");
    }
    println!("cargo::rustc-link-search={}", folder.display());
    for image in VIRT {
        println!("cargo::rustc-link-arg-bin={image}=-Tvirt.x");
    }
    println!("cargo::rustc-link-arg-bin=sensor=-Tsensor.x");
    for image in VIRT.into_iter().chain(["sensor"]) {
        println!("cargo::rustc-link-arg-bin={image}=-Tlink.x");
    }
}
