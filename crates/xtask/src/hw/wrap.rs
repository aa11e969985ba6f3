//! A block alone on an FPGA that has fewer pins than the block.

use anyhow::{Context, ensure};

/// A port of a converted block.
#[derive(Debug, PartialEq, Eq)]
pub struct Port {
    pub name: String,
    pub is_input: bool,
    pub bits: usize,
}

/// The ports as GHDL writes them.
pub fn ports(verilog: &str, block: &str) -> anyhow::Result<Vec<Port>> {
    let head = verilog
        .split_once(&format!("module {block}\n"))
        .and_then(|(_, rest)| rest.split_once(");"))
        .map(|(head, _)| head)
        .with_context(|| format!("no module {block}"))?;
    let mut ports = Vec::new();
    for line in head.split(',') {
        let words: Vec<&str> = line.split(|c: char| c.is_whitespace() || c == '(').filter(|w| !w.is_empty()).collect();
        let (direction, range, name) = match words.as_slice() {
            [direction, range, name] => (direction, range.strip_prefix('[').and_then(|r| r.strip_suffix(":0]")), name),
            [direction, name] => (direction, Some("0"), name),
            _ => anyhow::bail!("{block} has an unknown port: {line}"),
        };
        let highest: usize = range.context("a range does not end at 0")?.parse()?;
        ports.push(Port { name: (*name).to_owned(), is_input: *direction == "input", bits: highest + 1 });
    }
    Ok(ports)
}

/// Verilog of a module `wrapper` around the block that leaves three pins.
///
/// Inputs come from a shift register, outputs go to registers and from there into another shift register. So every path
/// is from register to register, and only what is in the block is long.
pub fn wrapper(verilog: &str, block: &str) -> anyhow::Result<String> {
    let ports = ports(verilog, block)?;
    let (mut ins, mut outs) = (0, 0);
    let mut connections = vec![".clk(clk)".to_owned()];
    ensure!(ports.iter().any(|port| port.name == "clk"), "{block} has no clk");
    for port in ports.iter().filter(|port| port.name != "clk") {
        let (signal, low) = if port.is_input { ("in", &mut ins) } else { ("out", &mut outs) };
        let high = *low + port.bits - 1;
        connections.push(format!(".{}({signal}[{high}:{low}])", port.name));
        *low += port.bits;
    }
    let connections = connections.join(",\n    ");
    Ok(format!(
        "module wrapper(input clk, input shift_in, output shift_out);
  reg [{ins}:0] in;
  wire [{outs}-1:0] out;
  reg [{outs}-1:0] sampled;
  reg [{outs}:0] shifted;
  always @(posedge clk) begin
    in <= {{in, shift_in}};
    sampled <= out;
    shifted <= {{shifted, shift_in}} ^ {{sampled, 1'b0}};
  end
  assign shift_out = shifted[{outs}];
  {block} block_i (
    {connections});
endmodule
"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLOCK: &str = "module other\n  (input  a);\nendmodule\n\
                         module block\n  (input  clk,\n   input  [7:0] word,\n   output [1:0] found,\n   output valid);\n";

    #[test]
    fn ports_are_those_of_the_block() {
        let ports: Vec<_> = ports(BLOCK, "block").unwrap().into_iter().map(|p| (p.name, p.is_input, p.bits)).collect();
        let expected = [("clk", true, 1), ("word", true, 8), ("found", false, 2), ("valid", false, 1)]
            .map(|(n, i, b)| (n.to_owned(), i, b));
        assert_eq!(ports, expected);
        assert!(super::ports(BLOCK, "bloc").is_err());
    }

    #[test]
    fn every_bit_of_the_block_has_a_register() {
        let wrapper = wrapper(BLOCK, "block").unwrap();
        for text in ["reg [8:0] in;", "reg [3-1:0] sampled;", ".word(in[7:0])", ".found(out[1:0])", ".valid(out[2:2])"]
        {
            assert!(wrapper.contains(text), "{text} is not in\n{wrapper}");
        }
    }
}
