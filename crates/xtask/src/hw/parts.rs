//! Parts of the simulated SoC that rest while nothing in them would change.
//!
//! Most of the gateware waits most of the time: for a hit, for a frame, for a write. A simulator evaluates it at every clock
//! nevertheless. Here such a part becomes a model of its own, and in its place within the SoC comes a stand-in that has the
//! model run a clock only if its last clock changed anything or an input has another value. `hw-ip/sim/part.h` tells why that
//! is the same.

use std::collections::HashMap;

use anyhow::{Context, ensure};

use super::enables::{assignment, names};
use super::wrap::{Port, ports};

/// A part as a model of its own: input `in`, output `out` and `clk`.
pub struct Part {
    /// The entity it is made of.
    pub entity: String,
    /// Its top module.
    pub module: String,
    /// Verilog of the top module, which has an instance of the converted one in it.
    pub verilog: String,
}

/// Takes entities out of GHDL's Verilog: what is left with stand-ins, and the parts.
///
/// An entity that is not there, or with different generics, is an error, and so is one with an output that follows an input
/// within a clock: the stand-in would be late.
pub fn take_out(verilog: &str, entities: &[&str]) -> anyhow::Result<(String, Vec<Part>)> {
    let mut rest = verilog.to_owned();
    let mut parts = Vec::new();
    let mut immediate = Immediate { verilog, known: HashMap::new() };
    for &entity in entities {
        let modules: Vec<&str> = verilog
            .lines()
            .filter_map(|line| line.strip_prefix("module "))
            .filter(|name| is_of(name, entity))
            .collect();
        let [name] = modules.as_slice() else {
            anyhow::bail!("{entity} is converted to {} modules, and not to one: {modules:?}", modules.len());
        };
        let ports = ports(verilog, name)?;
        let at_once = immediate.of(name)?;
        ensure!(at_once.is_empty(), "{entity} has outputs that follow inputs within a clock: {at_once:?}");
        let (_, body) = rest.split_once(&format!("module {name}\n")).context("a module has gone")?;
        let (head, body) = body.split_once(");\n").with_context(|| format!("{name} has no end of its ports"))?;
        let (body, _) = body.split_once("endmodule\n").with_context(|| format!("{name} has no end"))?;
        let all = format!("module {name}\n{head});\n{body}endmodule\n");
        rest = rest.replace(&all, &format!("module {name}\n{head});\n{}endmodule\n", stand_in(entity, &ports)?));
        let module = format!("part_{entity}");
        parts.push(Part { entity: entity.to_owned(), verilog: top(&module, name, &ports), module });
    }
    Ok((rest, parts))
}

/// GHDL puts generics behind the entity's name.
fn is_of(module: &str, entity: &str) -> bool {
    module.strip_prefix(entity).is_some_and(|generics| {
        generics.is_empty() || generics.strip_prefix('_').is_some_and(|g| g.starts_with(|c: char| c.is_ascii_digit()))
    })
}

/// Which outputs of modules follow inputs within a clock, with these inputs.
struct Immediate<'a> {
    verilog: &'a str,
    known: HashMap<&'a str, HashMap<&'a str, Vec<&'a str>>>,
}

impl<'a> Immediate<'a> {
    fn of(&mut self, module: &'a str) -> anyhow::Result<&HashMap<&'a str, Vec<&'a str>>> {
        if !self.known.contains_key(module) {
            let found = self.find(module)?;
            self.known.insert(module, found);
        }
        Ok(&self.known[module])
    }

    fn find(&mut self, module: &'a str) -> anyhow::Result<HashMap<&'a str, Vec<&'a str>>> {
        let sources = self.sources(module)?;
        let ports = ports(self.verilog, module)?;
        let port = |name: &str, is_input| ports.iter().any(|port| port.name == name && port.is_input == is_input);
        let mut found: HashMap<&str, Vec<&str>> = HashMap::new();
        for &output in sources.keys().filter(|name| port(name, false)) {
            let (mut seen, mut to_do) = (Vec::new(), vec![output]);
            while let Some(name) = to_do.pop() {
                if !seen.contains(&name) {
                    seen.push(name);
                    to_do.extend(sources.get(name).into_iter().flatten());
                }
            }
            seen.retain(|name| port(name, true));
            if !seen.is_empty() {
                found.insert(output, seen);
            }
        }
        Ok(found)
    }

    /// What each net of a module is made of, registers aside.
    fn sources(&mut self, module: &'a str) -> anyhow::Result<HashMap<&'a str, Vec<&'a str>>> {
        let (_, text) = self.verilog.split_once(&format!("module {module}\n")).context("a module has gone")?;
        let (text, _) = text.split_once("\nendmodule\n").with_context(|| format!("{module} has no end"))?;
        let mut sources: HashMap<&str, Vec<&str>> = HashMap::new();
        let mut add = |net: &'a str, value: &'a str| {
            let net = names(net).next().unwrap_or_default();
            sources.entry(net).or_default().extend(names(value));
        };
        let mut lines = text.lines();
        while let Some(line) = lines.next() {
            if let Some((net, value)) = assignment(line) {
                add(net, value);
            } else if line == "  always @*" {
                let choice = lines.next().unwrap_or_default();
                ensure!(choice.starts_with("    case ("), "{module} has an unknown process: {choice}");
                for (net, value) in lines.by_ref().take_while(|line| line.trim() != "endcase").filter_map(chosen) {
                    add(net, value);
                    add(net, choice.trim_start_matches("    case "));
                }
            } else if let Some((part, _)) = line.strip_prefix("  ").and_then(|line| line.split_once(' '))
                && line.ends_with(" (")
                && self.verilog.contains(&format!("module {part}\n"))
            {
                let mut nets: HashMap<&str, &str> = HashMap::new();
                for line in lines.by_ref() {
                    nets.extend(line.trim().trim_start_matches('.').split_once('('));
                    if line.ends_with(");") {
                        break;
                    }
                }
                let net = |port: &str| nets.get(port).copied().unwrap_or_default();
                for (output, inputs) in self.of(part)? {
                    inputs.iter().for_each(|input| add(net(output), net(input)));
                }
            } else {
                let is_known = !line.starts_with("  assign ") && !line.starts_with("  always @(*)");
                ensure!(is_known, "{module} has an unknown line: {line}");
            }
        }
        Ok(sources)
    }
}

/// Both sides of a line of a `case`.
fn chosen(line: &str) -> Option<(&str, &str)> {
    line.split_once(": ")?.1.split_once(" <= ")
}

/// C++ by which the stand-ins get at the models.
pub fn glue(parts: &[Part]) -> String {
    let mut glue = "#include \"part.h\"\n".to_owned();
    for Part { entity, .. } in parts {
        glue.push_str(&format!(
            "
#include \"V{entity}.h\"
#include \"V{entity}___024root.h\"
using {entity}_part = Part<V{entity}, V{entity}___024root>;
extern \"C\" void* new_{entity}() {{ return new {entity}_part; }}
extern \"C\" svBit clock_{entity}(void* part, const svBitVecVal* in, svBitVecVal* out) {{
    return static_cast<{entity}_part*>(part)->clock(in, out);
}}
"
        ));
    }
    glue
}

/// Inputs and outputs in the order of the ports, without the clock.
fn signals(ports: &[Port]) -> (Vec<&Port>, Vec<&Port>) {
    ports.iter().filter(|port| port.name != "clk").partition(|port| port.is_input)
}

/// Bits of a vector of all these ports: as many as the words of C++ have, and so many that Verilator takes words.
fn vector_bits(ports: &[&Port]) -> usize {
    let bits: usize = ports.iter().map(|port| port.bits).sum();
    bits.next_multiple_of(32).max(96)
}

/// The ports as one vector, the first one in the high bits.
fn joined(ports: &[&Port]) -> String {
    ports.iter().map(|port| port.name.as_str()).collect::<Vec<_>>().join(", ")
}

fn stand_in(entity: &str, ports: &[Port]) -> anyhow::Result<String> {
    ensure!(ports.iter().any(|port| port.name == "clk"), "{entity} has no clk");
    let (ins, outs) = signals(ports);
    ensure!(!ins.is_empty() && !outs.is_empty(), "{entity} has no inputs or no outputs");
    let each = |text: &dyn Fn(&Port) -> String| ins.iter().map(|port| text(port)).collect::<String>();
    Ok(format!(
        "  import \"DPI-C\" function chandle new_{entity}();
  import \"DPI-C\" function bit clock_{entity}(input chandle part, input bit [{in_bits}-1:0] in, output bit [{out_bits}-1:0] out);
  chandle part;
  initial part = new_{entity}();
  bit awake = 1;
  bit [{out_bits}-1:0] next;
  bit [{out_bits}-1:0] out;
{seen}  always @(posedge clk)
    if (awake{changed}) begin
      awake <= clock_{entity}(part, {in_bits}'({{{inputs}}}), next);
      out <= next;
{see}    end
  assign {{{outputs}}} = out;
",
        in_bits = vector_bits(&ins),
        out_bits = vector_bits(&outs),
        seen = each(&|port| format!("  bit [{}-1:0] seen_{};\n", port.bits, port.name)),
        changed = each(&|port| format!(" || seen_{0} != {0}", port.name)),
        inputs = joined(&ins),
        see = each(&|port| format!("      seen_{0} <= {0};\n", port.name)),
        outputs = joined(&outs),
    ))
}

fn top(module: &str, name: &str, ports: &[Port]) -> String {
    let (ins, outs) = signals(ports);
    let (in_bits, out_bits) = (vector_bits(&ins), vector_bits(&outs));
    let wires = |ports: &[&Port]| -> String {
        ports.iter().map(|port| format!("  wire [{}-1:0] {};\n", port.bits, port.name)).collect()
    };
    format!(
        "module {module}(input clk, input [{in_bits}-1:0] in, output [{out_bits}-1:0] out);
{}{}  assign {{{}}} = in;
  assign out = {out_bits}'({{{}}});
  {name} part_i (.*);
endmodule
",
        wires(&ins),
        wires(&outs),
        joined(&ins),
        joined(&outs)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOC: &str = "module clusters_4\n  (input  a,\n   output b,\n   output c);\n  assign b = a;\nendmodule\n\
        module cluster_10_4\n  (input  clk,\n   input  rst,\n   input  [6:0] word,\n   output valid,\n   output [32:0] sum);\n  \
        assign valid = n1_q;\nendmodule\nmodule soc\n  (input  clk);\n  cluster_10_4 cluster_i (\n    .clk(clk));\nendmodule\n";

    #[test]
    fn a_stand_in_comes_in_place_of_what_a_part_does_and_of_nothing_else() {
        let (rest, parts) = take_out(SOC, &["cluster"]).unwrap();
        assert!(
            !rest.contains("n1_q") && rest.contains("module soc\n") && rest.contains("module clusters_4\n"),
            "{rest}"
        );
        for text in [
            "if (awake || seen_rst != rst || seen_word != word) begin",
            "clock_cluster(part, 96'({rst, word}), next)",
            "bit [7-1:0] seen_word;",
            "assign {valid, sum} = out;",
        ] {
            assert!(rest.contains(text), "{text} is not in\n{rest}");
        }
        let [part] = parts.as_slice() else { panic!("not one part") };
        assert!(
            part.verilog.contains("cluster_10_4 part_i (.*);") && part.verilog.contains("assign {rst, word} = in;")
        );
        assert!(glue(&parts).contains("extern \"C\" svBit clock_cluster("));
    }

    #[test]
    fn an_output_that_follows_an_input_within_a_clock_is_refused() {
        for (body, refused) in [
            ("  assign n1_o = rst & n2_q;\n  assign valid = n1_o;\n", true),
            (
                "  assign valid = n2_q;\n  assign n1_o = rst & valid;\n  always @(posedge clk)\n    n2_q <= n1_o;\n",
                false,
            ),
            ("  always @*\n    case (word)\n      2'b01: n1_o <= n2_q;\n    endcase\n  assign valid = n1_o;\n", true),
            // What is not understood
            ("  assign valid = n2_q\n    & n3_q;\n", true),
            ("  clusters_4 i (\n    .a(rst),\n    .b(n1_o));\n  assign valid = n1_o;\n", true),
            ("  clusters_4 i (\n    .a(rst),\n    .c(n1_o));\n  assign valid = n1_o;\n", false),
        ] {
            let soc = SOC.replace("  assign valid = n1_q;\n", body);
            assert_eq!(take_out(&soc, &["cluster"]).is_err(), refused, "{body}");
        }
    }

    #[test]
    fn an_entity_that_is_not_there_and_one_with_different_generics_are_refused() {
        assert!(take_out(SOC, &["clus"]).is_err());
        let twice = format!("{SOC}{}", SOC.replace("cluster_10_4\n", "cluster_10_5\n"));
        let error = take_out(&twice, &["cluster"]).err().unwrap().to_string();
        assert!(error.contains("cluster is converted to 2 modules"), "{error}");
    }
}
