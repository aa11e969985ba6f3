//! Slices of concatenations, read at their source.
//!
//! GHDL's synthesis writes an array of signals, such as the stages of a pipeline, as one wide wire that a concatenation
//! drives, and every stage as a slice of it. To a simulator that orders whole wires, each stage then depends on all of them:
//! a loop, evaluated again and again until nothing changes. Here every constant slice of such a wire becomes the part of the
//! concatenation that it is. The logic stays what it is.

use std::borrow::Cow;
use std::collections::HashMap;

/// A part of a concatenation: a net, or a binary constant with its width.
type Part<'a> = &'a str;

/// Widths of a module's nets, and the concatenations among them, their high part first.
#[derive(Default)]
struct Nets<'a> {
    widths: HashMap<&'a str, usize>,
    concatenations: HashMap<&'a str, Vec<Part<'a>>>,
}

/// Forwards the slices in all modules of GHDL's Verilog.
pub fn forward(verilog: &str) -> String {
    let mut forwarded = String::with_capacity(verilog.len());
    for module in verilog.split_inclusive("\nendmodule\n") {
        let nets = Nets::of(module);
        for line in module.lines() {
            let is_logic = line.contains('=') || line.trim_start().starts_with('.');
            forwarded.push_str(&if is_logic { nets.forward(line) } else { Cow::Borrowed(line) });
            forwarded.push('\n');
        }
    }
    forwarded
}

impl<'a> Nets<'a> {
    fn of(module: &'a str) -> Self {
        let mut nets = Self::default();
        nets.widths.extend(module.lines().filter_map(declaration));
        for line in module.lines() {
            let Some((name, value)) = line.trim().strip_prefix("assign ").and_then(|line| line.split_once(" = "))
            else {
                continue;
            };
            let Some((value, _)) = value.split_once(';') else { continue };
            let parts: Vec<Part> = match value.strip_prefix('{').and_then(|value| value.strip_suffix('}')) {
                Some(parts) => parts.split(", ").collect(),
                None => vec![value],
            };
            let width: Option<usize> = parts.iter().map(|part| nets.width(part)).sum();
            if width.is_some() && width == nets.width(name) {
                nets.concatenations.insert(name, parts);
            }
        }
        nets
    }

    /// Width of a net or of a constant; none of anything else.
    fn width(&self, part: &str) -> Option<usize> {
        match part.split_once("'b") {
            // A calculation may begin with a constant, too
            Some((width, digits)) => {
                width.parse().ok().filter(|_| digits.bytes().all(|digit| matches!(digit, b'0' | b'1')))
            }
            None => self.widths.get(part).copied(),
        }
    }

    /// A line in which every slice is read at its source.
    fn forward<'line>(&self, line: &'line str) -> Cow<'line, str> {
        let mut forwarded = String::new();
        // Where the part that is not copied yet begins
        let mut rest = 0;
        for (open, _) in line.match_indices('[') {
            let before = &line[..open];
            let name = &before[before.rfind(|c: char| !is_name(c)).map_or(0, |place| place + 1)..];
            let Some(close) = line[open..].find(']').map(|close| open + close) else { continue };
            let Some((high, low)) = range(&line[open + 1..close]) else { continue };
            if !self.concatenations.contains_key(name) {
                continue;
            }
            let mut sources = Vec::new();
            self.sources(name, high, low, &mut sources);
            forwarded.push_str(&line[rest..open - name.len()]);
            match sources.as_slice() {
                [source] => forwarded.push_str(source),
                sources => forwarded.push_str(&format!("{{{}}}", sources.join(", "))),
            }
            rest = close + 1;
        }
        if rest == 0 {
            return Cow::Borrowed(line);
        }
        forwarded.push_str(&line[rest..]);
        Cow::Owned(forwarded)
    }

    /// Appends where the bits of a part come from, the high ones first.
    fn sources(&self, part: &str, high: usize, low: usize, sources: &mut Vec<String>) {
        let width = self.width(part).unwrap_or(0);
        if let Some((_, digits)) = part.split_once("'b") {
            // Leading zeros may be missing
            let digits = format!("{digits:0>width$}");
            sources.push(format!("{}'b{}", high - low + 1, &digits[width - 1 - high..width - low]));
            return;
        }
        let Some(parts) = self.concatenations.get(part) else {
            sources.push(match (high, low) {
                _ if (high + 1, low) == (width, 0) => part.to_owned(),
                _ if high == low => format!("{part}[{high}]"),
                _ => format!("{part}[{high}:{low}]"),
            });
            return;
        };
        let mut end = width;
        for part in parts {
            let start = end - self.width(part).unwrap_or(0);
            if start <= high && low < end {
                self.sources(part, high.min(end - 1) - start, low.max(start) - start, sources);
            }
            end = start;
        }
    }
}

fn is_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// Ends of a constant slice, or the only bit twice.
fn range(text: &str) -> Option<(usize, usize)> {
    let (high, low) = text.split_once(':').unwrap_or((text, text));
    Some((high.parse().ok()?, low.parse().ok()?))
}

/// Name and width of the net that a line declares; memories are none.
fn declaration(line: &str) -> Option<(&str, usize)> {
    let line = line.trim_start_matches([' ', '(']);
    let line = ["wire ", "reg ", "input ", "output "].iter().find_map(|kind| line.strip_prefix(kind))?.trim_start();
    let (width, name) = match line.strip_prefix('[') {
        Some(ranged) => {
            let (ends, name) = ranged.split_once(']')?;
            (range(ends)?.0 + 1, name.trim_start())
        }
        None => (1, line),
    };
    let (name, rest) = name.split_at(name.find(|c: char| !is_name(c))?);
    (!rest.starts_with('[')).then_some((name, width))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn module(lines: &str) -> String {
        format!(
            "module a\n  (input  clk,\n   output [3:0] b);\n  wire [11:0] line;\n  wire [3:0] n1_o;\n  reg [3:0] n2_q;\n  \
             wire [11:0] n3_o;\n  assign line = n3_o; // (signal)\n{lines}  assign n3_o = {{n1_o, n2_q, 4'b110}};\nendmodule\n"
        )
    }

    fn check(line: &str, expected: &str) {
        assert_eq!(forward(&module(&format!("{line}\n"))), module(&format!("{expected}\n")));
    }

    #[test]
    fn a_slice_becomes_the_part_that_it_is() {
        check("  assign b = line[11:8];", "  assign b = n1_o;");
        check("  assign b = ~line[6];", "  assign b = ~n2_q[2];");
        check("    .b(line[6:5]),", "    .b(n2_q[2:1]),");
    }

    #[test]
    fn a_slice_across_parts_becomes_a_concatenation() {
        check("  assign b = line[8:7] & line[1];", "  assign b = {n1_o[0], n2_q[3]} & 1'b1;");
        check("  assign b = line[4:2];", "  assign b = {n2_q[0], 2'b01};");
    }

    #[test]
    fn a_part_that_is_a_concatenation_is_followed() {
        let nested =
            "  wire [1:0] n4_o;\n  wire [5:0] n5_o;\n  assign n4_o = n5_o[4:3];\n  assign n5_o = {n4_o, n1_o};\n";
        let followed = nested.replace("n5_o[4:3]", "{n4_o[0], n1_o[3]}");
        assert_eq!(forward(&module(nested)), module(&followed));
    }

    #[test]
    fn what_is_no_concatenation_of_nets_stays() {
        for line in [
            "  assign b = n2_q[3:1];",
            "  assign b = n1_o[n2_q];",
            "  reg [3:0] line[11:0] ; // memory",
            "  wire [7:0] n6_o;\n  assign n6_o = {{4{n1_o[3]}}, n1_o}; // sext\n  assign b = n6_o[3:0];",
            "  wire [3:0] n6_o;\n  assign n6_o = 4'b0000 - n1_o;\n  assign b = n6_o[2:1];",
        ] {
            check(line, line);
        }
    }
}
