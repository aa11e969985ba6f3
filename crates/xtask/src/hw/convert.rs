//! From VHDL to Verilog: GHDL's synthesis, and repairs of what GHDL 2.0 writes wrongly.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

use super::hw_ip;
use crate::{output, run};

/// GHDL with its own work folder.
pub struct Ghdl {
    folder: PathBuf,
}

impl Ghdl {
    /// The folder is there after the call.
    pub fn new(folder: PathBuf) -> anyhow::Result<Self> {
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        Ok(Self { folder })
    }

    /// A command that starts with `mode`, run in `hw-ip`.
    pub fn command(&self, mode: &str) -> Command {
        let mut ghdl = Command::new("ghdl");
        ghdl.arg(mode).arg("--std=08").arg(format!("--workdir={}", self.folder.display())).current_dir(hw_ip());
        ghdl
    }
}

/// The analysed gateware.
pub struct Library {
    ghdl: Ghdl,
    /// Memories that say of themselves that no word is read while it is written: file and signal.
    free_of_collisions: Vec<(String, String)>,
}

impl Library {
    /// Analyses everything of `files.txt`, then `more` (both within `hw-ip`), into a folder.
    pub fn new(folder: PathBuf, more: &[&str]) -> anyhow::Result<Self> {
        let list = std::fs::read_to_string(hw_ip().join("files.txt")).context("cannot read hw-ip/files.txt")?;
        for file in list.lines() {
            let source = std::fs::read_to_string(hw_ip().join(file)).with_context(|| format!("cannot read {file}"))?;
            check_source(&source).with_context(|| format!("{file} does not survive the conversion"))?;
        }
        let files: Vec<&Path> = list.lines().chain(more.iter().copied()).map(Path::new).collect();
        Self::of(folder, &files)
    }

    /// Analyses some files (within `hw-ip`, or absolute) into a folder.
    pub fn of(folder: PathBuf, files: &[&Path]) -> anyhow::Result<Self> {
        let ghdl = Ghdl::new(folder)?;
        let mut analyse = ghdl.command("-a");
        analyse.args(files);
        run(analyse)?;
        let mut free_of_collisions = Vec::new();
        for file in files {
            let source = std::fs::read_to_string(hw_ip().join(file)).context("a source has gone")?;
            let signals = source.lines().filter_map(|line| {
                line.trim().strip_prefix("attribute no_rw_check of ")?.strip_suffix(" : signal is true;")
            });
            free_of_collisions.extend(signals.map(|signal| (file.display().to_string(), signal.to_owned())));
        }
        Ok(Self { ghdl, free_of_collisions })
    }

    /// Runs a bench.
    pub fn simulate(&self, entity: &str, generics: &[String]) -> anyhow::Result<()> {
        let mut simulate = self.ghdl.command("-r");
        // Unknown values that run idle through a pipeline are no news
        simulate.arg(entity).arg("--ieee-asserts=disable");
        // The function that gives a memory its first content holds it all
        simulate.arg("--max-stack-alloc=1024").args(generics.iter().map(|generic| format!("-g{generic}")));
        run(simulate)
    }

    /// Writes `entity` as Verilog.
    pub fn convert(&self, entity: &str, generics: &[String], verilog: &Path) -> anyhow::Result<()> {
        let mut synth = self.ghdl.command("--synth");
        synth.arg("--out=verilog").args(generics.iter().map(|generic| format!("-g{generic}"))).arg(entity);
        let converted = output(synth)?;
        let repaired = repair(&converted).with_context(|| format!("the conversion of {entity} is not usable"))?;
        let marked = mark_memories(&repaired, &self.free_of_collisions);
        std::fs::write(verilog, marked).with_context(|| format!("cannot write {}", verilog.display()))
    }
}

/// Refuses what GHDL 2.0 converts wrongly without a trace: the value of an `others` choice is lost.
fn check_source(source: &str) -> anyhow::Result<()> {
    let code = source.lines().map(|line| line.split("--").next().unwrap_or_default());
    for (number, line) in code.enumerate() {
        ensure!(!line.contains("when others"), "line {}: list all choices or use if instead of `others`", number + 1);
    }
    Ok(())
}

/// Repairs Verilog of GHDL 2.0:
///
/// * constants of more than 32 bits are strings of ones and zeros: they become numbers;
/// * a signed product is written as one of unsigned numbers that are as wide as the result: it becomes signed, so that yosys
///   sees the width of the factors and takes one multiplier instead of several;
/// * a `case` over all choices has no default, of which yosys would make latches: it gets one that never comes true;
/// * an arithmetic shift by a signal or a constant is written as a logical one: refused, to be avoided in the VHDL;
/// * VHDL's extended identifiers, which keep capitals, come with their backslashes: they are dropped;
/// * a component without an entity becomes a module of nothing: it is dropped, the real one comes from elsewhere.
fn repair(verilog: &str) -> anyhow::Result<String> {
    let verilog = without_empty_modules(&verilog.replace('\\', ""));
    let mut repaired = String::with_capacity(verilog.len());
    // Left side of the last choice of a case
    let mut assigned = None;
    for line in verilog.lines() {
        ensure!(!(line.contains("$signed(") && line.contains(" >> ")), "arithmetic shift became a logical one: {line}");
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            [choice, left, operator @ ("<=" | "="), ..] if choice.contains("'b") && choice.ends_with(':') => {
                assigned = Some((*left, *operator));
            }
            ["endcase"] => {
                if let Some((left, operator)) = assigned.take() {
                    repaired.push_str(&format!("      default: {left} {operator} 'bx;\n"));
                }
            }
            _ => {}
        }
        let line = signed_product(line);
        for (i, part) in line.split('"').enumerate() {
            let is_constant = i % 2 == 1 && !part.is_empty() && part.bytes().all(|byte| matches!(byte, b'0' | b'1'));
            if is_constant {
                repaired.push_str(&format!("{}'b{part}", part.len()));
            } else if i % 2 == 1 {
                repaired.push_str(&format!("\"{part}\""));
            } else {
                repaired.push_str(part);
            }
        }
        repaired.push('\n');
    }
    Ok(repaired)
}

/// The line, with signs if it is a signed product.
fn signed_product(line: &str) -> Cow<'_, str> {
    let product = line.strip_suffix("; // smul").and_then(|line| line.split_once(" = "));
    match product.and_then(|(left, right)| Some((left, right.split_once(" * ")?))) {
        Some((left, (a, b))) => format!("{left} = $signed({a}) * $signed({b}); // smul").into(),
        None => line.into(),
    }
}

/// Hands the attribute `no_rw_check` of memories on to yosys, which GHDL 2.0 drops.
///
/// Without it, yosys puts a bypass behind a block memory whose hardware gives no defined value for a word that is read
/// while it is written.
fn mark_memories(verilog: &str, free_of_collisions: &[(String, String)]) -> String {
    let mut marked = String::with_capacity(verilog.len());
    let mut file = "";
    for line in verilog.lines() {
        if let Some((place, _)) = line.trim().strip_prefix("/* ").and_then(|comment| comment.split_once(':')) {
            file = place;
        }
        if line.ends_with("; // memory") {
            let signal = line.rsplit_once('[').and_then(|(left, _)| left.split_whitespace().last());
            if free_of_collisions.iter().any(|(source, name)| source == file && Some(name.as_str()) == signal) {
                marked.push_str("  (* no_rw_check *)\n");
            }
        }
        marked.push_str(line);
        marked.push('\n');
    }
    marked
}

fn without_empty_modules(verilog: &str) -> String {
    let mut result = String::with_capacity(verilog.len());
    // Head of a module that may turn out to be empty
    let mut head = String::new();
    for line in verilog.lines() {
        let is_start = line.starts_with("module ");
        if !is_start && head.ends_with(");\n") {
            if line == "endmodule" {
                head.clear();
                continue;
            }
            result.push_str(&std::mem::take(&mut head));
        }
        let to = if is_start || !head.is_empty() { &mut head } else { &mut result };
        to.push_str(line);
        to.push('\n');
    }
    result + &head
}

/// Repairs Verilog with properties: assertions come as `$fatal`, assumptions as VHDL.
///
/// Refuses a memory that is never written: GHDL 2.0 makes such of one of which a property reads a fixed word.
pub fn formal(verilog: &str) -> anyhow::Result<String> {
    let repaired = repair(verilog)?;
    ensure!(!repaired.contains("= 1'b0; // posedge"), "a memory has lost its clock: no fixed word of it may be read");
    let lines: Vec<&str> = repaired.lines().collect();
    let mut result: Vec<String> = Vec::with_capacity(lines.len());
    for line in lines {
        if let Some(name) =
            line.trim().strip_prefix("$fatal(1, \"assertion failure ").and_then(|l| l.strip_suffix("\");"))
        {
            let condition =
                result.pop().and_then(|line| Some(line.trim().strip_prefix("if (!")?.strip_suffix(')')?.to_owned()));
            let condition = condition.with_context(|| format!("assertion {name} has no condition"))?;
            // In place of the `always @*` before the condition
            result.pop();
            result.push(format!("  always @* {name}: assert ({condition});"));
        } else if let Some((assertion, "assume")) = line.split_once("; --  ") {
            let words: Vec<&str> = assertion.split_whitespace().collect();
            let [name, "assert", condition, "=", "'1'", ..] = words.as_slice() else {
                bail!("unknown assumption: {line}");
            };
            result.push(format!("  always @* {name} assume ({condition});"));
        } else {
            result.push(line.to_owned());
        }
    }
    Ok(result.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wide_constants_become_numbers_and_other_strings_stay() {
        assert_eq!(repair("a = b + \"0101\"; // \"text\"").unwrap(), "a = b + 4'b0101; // \"text\"\n");
    }

    #[test]
    fn a_signed_product_gets_signs_and_others_none() {
        assert_eq!(repair("  assign c = a * b; // smul").unwrap(), "  assign c = $signed(a) * $signed(b); // smul\n");
        assert_eq!(repair("  assign c = a * b; // umul").unwrap(), "  assign c = a * b; // umul\n");
    }

    #[test]
    fn a_choice_of_others_is_refused_in_code_and_not_in_comments() {
        assert!(check_source("case a is\n  when others => b;\nend case;").is_err());
        assert!(check_source("-- no when others here").is_ok());
    }

    #[test]
    fn a_case_gets_a_default() {
        let case = "case (a)\n  2'b10: b <= c;\n  2'b01: b <= d;\nendcase\n";
        assert!(repair(case).unwrap().contains("2'b01: b <= d;\n      default: b <= 'bx;\nendcase"));
    }

    #[test]
    fn a_memory_without_collisions_is_marked_and_its_namesake_elsewhere_is_not() {
        let text = "  /* a.vhd:6:1  */\n  reg [3:0] words[7:0] ; // memory\n  /* b.vhd:7:1  */\n  reg [3:0] words[7:0] ; // memory\n";
        let marked = mark_memories(text, &[("a.vhd".to_owned(), "words".to_owned())]);
        assert_eq!(marked.matches("(* no_rw_check *)").count(), 1);
        assert!(marked.contains("a.vhd:6:1  */\n  (* no_rw_check *)\n  reg"));
    }

    #[test]
    fn properties_become_assertions_and_assumptions() {
        let text = "  always @*\n    if (!n1_o)\n      $fatal(1, \"assertion failure all_is_well\");\n  \
                    starts: assert n2_o = '1' severity warning; --  assume\n";
        let expected = "  always @* all_is_well: assert (n1_o);\n  always @* starts: assume (n2_o);";
        assert_eq!(formal(text).unwrap(), expected);
    }

    #[test]
    fn a_memory_without_clock_is_refused() {
        assert!(formal("  assign n1_o = 1'b0; // posedge").is_err());
        assert!(formal("  assign n1_o = 1'b0;").is_ok());
    }

    #[test]
    fn a_module_of_nothing_is_dropped_and_others_stay() {
        let empty = "module \\Cpu\\\n  (input  \\aB\\,\n   output c);\nendmodule\n";
        let other = "module soc\n  (input  clk);\n  Cpu i (\n    .aB(clk));\nendmodule\n";
        let with_backslashes = other.replace("Cpu", "\\Cpu\\").replace("aB", "\\aB\\");
        assert_eq!(repair(&format!("{empty}{with_backslashes}")).unwrap(), other);
    }

    #[test]
    fn a_logical_shift_of_a_signed_value_is_refused() {
        assert!(repair("assign a = $signed(b) >> 31'b0110;").is_err());
        assert!(repair("assign a = b >> 31'b0110;").is_ok());
    }
}
