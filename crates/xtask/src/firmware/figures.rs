//! Instructions and sizes, against the committed ones and against the limits.

use std::fmt::Write;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, ensure};
use object::{Object, ObjectSection, ObjectSymbol, SectionKind};

use super::image::Images;
use super::setup::RUSTC;
use super::{firmware, sim, stack};

/// The name of a figure, and the most it may be whatever the compiler. The limit on instructions keeps what has been
/// reached; `firmware/README.md` says what the target is.
const LIMITS: [(&str, u64); 5] = [
    ("24 rays and 12 points, weighted", 18_500),
    ("text of algorithm", 32 * 1024),
    ("text of sensor", 32 * 1024),
    ("text and constants of sensor", 32 * 1024),
    ("RAM of sensor", 16 * 1024),
];

/// Measures and writes the figures.
pub fn write(images: &Images) -> anyhow::Result<()> {
    let measured = measure(images)?;
    print!("{measured}");
    std::fs::write(file(), &measured).with_context(|| format!("cannot write {}", file().display()))?;
    within_limits(&measured)
}

/// Measures, and compares with the committed figures. Those of another compiler are others: then only the limits count.
pub fn check(images: &Images) -> anyhow::Result<()> {
    let measured = measure(images)?;
    let committed = std::fs::read_to_string(file()).with_context(|| format!("cannot read {}", file().display()))?;
    if measured.lines().next() == committed.lines().next() {
        let news: Vec<&str> = measured.lines().filter(|line| !committed.lines().any(|l| l == *line)).collect();
        ensure!(
            measured == committed,
            "figures have changed, `cargo xtask firmware figures` writes them:\n{}",
            news.join("\n")
        );
    } else {
        eprintln!("SKIPPED: comparison of instruction counts, which are those of another compiler.\n{measured}");
    }
    within_limits(&measured)
}

fn file() -> PathBuf {
    firmware().join("figures.toml")
}

/// All figures, as TOML: the compiler, then numbers by name.
fn measure(images: &Images) -> anyhow::Result<String> {
    let compiler = crate::output({
        let mut rustc = Command::new(RUSTC);
        rustc.arg("--version");
        rustc
    })?;
    let costs = String::from_utf8(sim::simulate(&images.get("costs"))?).context("the counts are not text")?;
    let mut figures = format!("compiler = \"{}\"\n\n[instructions]\n{costs}\n[bytes]\n", compiler.trim());
    for name in ["algorithm", "selftest", "sensor"] {
        let bytes = std::fs::read(images.get(name)).with_context(|| format!("cannot read the image {name}"))?;
        let image = object::File::parse(&*bytes)?;
        if name == "algorithm" {
            no_panics(&image)?;
        }
        let text: u64 = image.sections().filter(|s| s.kind() == SectionKind::Text).map(|s| s.size()).sum();
        writeln!(figures, "\"text of {name}\" = {text}")?;
        if name == "sensor" {
            figures += &memory(&image)?;
        }
    }
    Ok(figures)
}

/// What the sensor's image takes of the on-chip memory.
fn memory(image: &object::File) -> anyhow::Result<String> {
    let of = |kinds: &[SectionKind]| -> u64 {
        // The section of the stack is what is left
        let sections = image.sections().filter(|s| kinds.contains(&s.kind()) && s.name() != Ok(".stack"));
        sections.map(|s| s.size()).sum()
    };
    let constants = of(&[SectionKind::Text, SectionKind::ReadOnlyData, SectionKind::Data]);
    let variables = of(&[SectionKind::Data, SectionKind::UninitializedData]);
    let stack = stack::deepest(image, "main")?;
    let mut figures = String::new();
    writeln!(figures, "\"text and constants of sensor\" = {constants}")?;
    writeln!(figures, "\"variables of sensor\" = {variables}")?;
    writeln!(figures, "\"stack of sensor\" = {stack}")?;
    writeln!(figures, "\"RAM of sensor\" = {}", variables + stack)?;
    Ok(figures)
}

/// An image without panics has none of their machinery. It must have symbols, or there is nothing to see.
fn no_panics(image: &object::File) -> anyhow::Result<()> {
    let has = |part: &str| image.symbols().any(|s| s.name().is_ok_and(|name| name.contains(part)));
    ensure!(has("reconstruct") && has("SpotDetector"), "the image of the algorithm has no symbols of it");
    let panics: Vec<&str> = image.symbols().filter_map(|s| s.name().ok()).filter(|name| is_panic(name)).collect();
    ensure!(panics.is_empty(), "the algorithm can panic: {}", panics.join(", "));
    Ok(())
}

fn is_panic(symbol: &str) -> bool {
    ["panicking", "panic_fmt", "index_fail", "unwrap_failed", "expect_failed"].iter().any(|part| symbol.contains(part))
}

fn within_limits(figures: &str) -> anyhow::Result<()> {
    for (name, most) in LIMITS {
        let found = figures.lines().find_map(|line| line.strip_prefix(&format!("\"{name}\" = ")));
        let found: u64 = found.with_context(|| format!("no figure {name}"))?.parse()?;
        ensure!(found <= most, "{name}: {found}, the limit is {most}");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panic_machinery_is_recognised_by_its_symbols() {
        assert!(is_panic("_ZN4core9panicking9panic_fmt17h0123456789abcdefE"));
        assert!(is_panic("_RNvNtNtCs1_4core5slice5index16slice_index_fail"));
        assert!(is_panic("_ZN4core6option13unwrap_failed17h0123456789abcdefE"));
        assert!(!is_panic("_RNvCs95J1NAxCI1w_14karst_firmware12exit_failure"));
        assert!(!is_panic("_ZN10karst_core11reconstruct11reconstruct17h0123456789abcdefE"));
    }

    #[test]
    fn a_figure_above_its_limit_is_refused() {
        let figures = |figure: u64| LIMITS.map(|(name, _)| format!("\"{name}\" = {figure}\n")).concat();
        assert!(within_limits(&figures(16 * 1024)).is_ok());
        assert!(within_limits(&figures(16 * 1024 + 1)).is_err());
        assert!(within_limits("").is_err());
    }
}
