//! Logic behind clock enables.
//!
//! GHDL's synthesis writes a register with a clock enable as one that takes either the new value or its own, and all logic as
//! wires, which a simulator evaluates at every clock. Here the registers of an enable become one process that does nothing
//! without it, and the wires that nothing else reads become variables of that process. The logic stays what it is.

use std::collections::{HashMap, HashSet};

/// Moves the logic of all modules of GHDL's Verilog behind its enables.
pub fn gather(verilog: &str) -> String {
    verilog.split_inclusive("\nendmodule\n").map(|module| Module::of(module).gathered()).collect()
}

/// Who reads a net.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Reader<'a> {
    /// Registers with this enable, when it is on.
    Enabled(&'a str),
    /// Whatever reads this wire.
    Wire(&'a str),
    /// Anything else.
    Other,
}

/// A register that takes a wire at every clock.
struct Register<'a> {
    name: &'a str,
    next: &'a str,
    /// Line of its process, which has two.
    line: usize,
}

/// A register that holds its value without its enable.
struct Enabled<'a> {
    register: Register<'a>,
    enable: &'a str,
    value: &'a str,
}

/// The parts of a module that matter here, by line.
struct Module<'a> {
    lines: Vec<&'a str>,
    /// Line and value of what a continuous assignment drives.
    assignments: HashMap<&'a str, (usize, &'a str)>,
    /// Lines that declare a wire that is no port.
    wires: HashMap<&'a str, usize>,
    registers: Vec<Register<'a>>,
    /// Names in all other lines, ports among them.
    others: HashSet<&'a str>,
}

impl<'a> Module<'a> {
    fn of(module: &'a str) -> Self {
        let lines: Vec<&str> = module.lines().collect();
        let mut result = Self {
            lines: Vec::new(),
            assignments: HashMap::new(),
            wires: HashMap::new(),
            registers: Vec::new(),
            others: HashSet::new(),
        };
        let mut number = 0;
        while let Some(&line) = lines.get(number) {
            let register = if line.trim() == "always @(posedge clk)" { lines.get(number + 1) } else { None };
            if let Some((name, value)) = assignment(line) {
                result.assignments.insert(name, (number, value));
            } else if let Some((name, next)) = register.and_then(|line| transfer(line)) {
                result.registers.push(Register { name, next, line: number });
                number += 1;
            } else if let Some(name) = wire(line) {
                result.wires.insert(name, number);
            } else if !line.trim_start().starts_with("/*") {
                // A register's declaration has its name, too, which does not read it
                let is_register = line.trim_start().starts_with("reg ") && !line.contains("memory");
                let read = if is_register { line.split_once('=').map_or("", |(_, value)| value) } else { line };
                result.others.extend(names(read));
            }
            number += 1;
        }
        result.lines = lines;
        result
    }

    fn gathered(mut self) -> String {
        let dropped = self.drop_unread();
        let enabled = self.take_enabled();
        let readers = self.readers(&enabled);
        let mut enables: Vec<&str> = Vec::new();
        for register in &enabled {
            if !enables.contains(&register.enable) {
                enables.push(register.enable);
            }
        }

        let mut places = HashMap::new();
        for &name in self.assignments.keys() {
            self.place(name, &readers, &mut places);
        }
        let mut removed = dropped;
        let mut variables = HashSet::new();
        let mut processes = String::new();
        for enable in enables {
            processes.push_str(&format!("  always @(posedge clk)\n    if ({enable}) begin\n"));
            let mut done = HashSet::new();
            let here = |name: &str| places.get(name).copied().flatten() == Some(enable);
            let mine = enabled.iter().filter(|register| register.enable == enable);
            for Enabled { register, value, .. } in mine.clone() {
                for name in names(value) {
                    self.evaluate(name, &here, &mut done, &mut processes);
                }
                removed.extend([register.line, register.line + 1, self.assignments[register.next].0]);
            }
            for Enabled { register, value, .. } in mine {
                processes.push_str(&format!("      {} <= {value};\n", register.name));
            }
            processes.push_str("    end\n");
            removed.extend(done.iter().map(|name| self.assignments[name].0));
            variables.extend(done.iter().map(|name| self.wires[name]));
        }

        let mut result = String::new();
        for (number, line) in self.lines.iter().enumerate().filter(|(number, _)| !removed.contains(number)) {
            if *line == "endmodule" {
                result.push_str(&processes);
            }
            if variables.contains(&number) {
                result.push_str(&line.replacen("wire", "reg", 1));
            } else {
                result.push_str(line);
            }
            result.push('\n');
        }
        result
    }

    /// Forgets wires and registers that nothing but each other reads; gives their lines.
    fn drop_unread(&mut self) -> HashSet<usize> {
        let next: HashMap<&str, &str> = self.registers.iter().map(|register| (register.name, register.next)).collect();
        let mut read = HashSet::new();
        let mut to_do: Vec<&str> = self.others.iter().copied().collect();
        while let Some(name) = to_do.pop() {
            if read.insert(name) {
                to_do.extend(self.assignments.get(name).into_iter().flat_map(|&(_, value)| names(value)));
                to_do.extend(next.get(name));
            }
        }
        let mut lines = HashSet::new();
        self.assignments.retain(|name, (line, _)| read.contains(name) || !lines.insert(*line));
        self.registers.retain(|register| {
            read.contains(register.name) || !(lines.insert(register.line) | lines.insert(register.line + 1))
        });
        lines
    }

    /// Takes the registers with an enable out of the others.
    fn take_enabled(&mut self) -> Vec<Enabled<'a>> {
        let mut reads: HashMap<&str, u32> = HashMap::new();
        let values = self.assignments.values().flat_map(|&(_, value)| names(value));
        for name in values.chain(self.registers.iter().map(|register| register.next)).chain(self.others.iter().copied())
        {
            *reads.entry(name).or_default() += 1;
        }
        let mut enabled = Vec::new();
        for register in std::mem::take(&mut self.registers) {
            let choice = self.assignments.get(register.next).and_then(|&(_, value)| choice(value));
            match choice {
                Some((enable, value, held)) if reads[register.next] == 1 && self.is_same(held, register.name) => {
                    enabled.push(Enabled { register, enable, value });
                }
                _ => self.registers.push(register),
            }
        }
        enabled
    }

    /// Whether a wire is nothing but a register.
    fn is_same(&self, mut wire: &'a str, register: &str) -> bool {
        while let Some(&(_, value)) = self.assignments.get(wire)
            && value.chars().all(is_name)
        {
            wire = value;
        }
        wire == register
    }

    fn readers(&self, enabled: &[Enabled<'a>]) -> HashMap<&'a str, Vec<Reader<'a>>> {
        let mut readers: HashMap<&str, Vec<Reader>> = HashMap::new();
        let mut add = |name, reader| readers.entry(name).or_default().push(reader);
        self.others.iter().for_each(|&name| add(name, Reader::Other));
        self.registers.iter().for_each(|register| add(register.next, Reader::Other));
        let choices: HashSet<&str> = enabled.iter().map(|enabled| enabled.register.next).collect();
        for (&wire, &(_, value)) in self.assignments.iter().filter(|(wire, _)| !choices.contains(*wire)) {
            names(value).for_each(|name| add(name, Reader::Wire(wire)));
        }
        for &Enabled { enable, value, .. } in enabled {
            add(enable, Reader::Other);
            names(value).for_each(|name| add(name, Reader::Enabled(enable)));
        }
        readers
    }

    /// The enable without which nothing reads a wire, if there is one.
    fn place(
        &self,
        wire: &'a str,
        readers: &HashMap<&'a str, Vec<Reader<'a>>>,
        places: &mut HashMap<&'a str, Option<&'a str>>,
    ) -> Option<&'a str> {
        if let Some(&place) = places.get(wire) {
            return place;
        }
        // Until it is known, for a wire that depends on itself
        places.insert(wire, None);
        if !self.wires.contains_key(wire) {
            return None;
        }
        let mut found = None;
        for reader in readers.get(wire)? {
            let enable = match *reader {
                Reader::Enabled(enable) => enable,
                Reader::Wire(reader) => self.place(reader, readers, places)?,
                Reader::Other => return None,
            };
            if *found.get_or_insert(enable) != enable {
                return None;
            }
        }
        places.insert(wire, found);
        found
    }

    /// Appends the assignment to a variable, after those that it depends on.
    fn evaluate(
        &self,
        name: &'a str,
        is_variable: &impl Fn(&str) -> bool,
        done: &mut HashSet<&'a str>,
        process: &mut String,
    ) {
        if !is_variable(name) || !done.insert(name) {
            return;
        }
        let (_, value) = self.assignments[name];
        for name in names(value) {
            self.evaluate(name, is_variable, done, process);
        }
        process.push_str(&format!("      {name} = {value};\n"));
    }
}

fn is_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// Names in an expression; constants are none.
pub(super) fn names(expression: &str) -> impl Iterator<Item = &str> {
    expression
        .split(|c: char| !is_name(c) && c != '\'' && c != '$')
        .filter(|word| word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_'))
}

/// Left and right side of a continuous assignment.
pub(super) fn assignment(line: &str) -> Option<(&str, &str)> {
    let (name, value) = line.strip_prefix("  assign ")?.split_once(" = ")?;
    Some((name, value.split_once(';')?.0))
}

/// Register and wire of a clocked assignment without more.
fn transfer(line: &str) -> Option<(&str, &str)> {
    let (name, next) = line.trim().strip_suffix(';')?.split_once(" <= ")?;
    (name.chars().all(is_name) && next.chars().all(is_name)).then_some((name, next))
}

/// Name of the wire that a line declares.
fn wire(line: &str) -> Option<&str> {
    let line = line.strip_prefix("  wire ")?.strip_suffix(';')?;
    let name = line.rsplit(' ').next()?;
    name.chars().all(is_name).then_some(name)
}

/// Condition and both values of a choice whose condition and second value are plain names.
fn choice(value: &str) -> Option<(&str, &str, &str)> {
    let (condition, values) = value.split_once(" ? ")?;
    let (one, other) = values.rsplit_once(" : ")?;
    (condition.chars().all(is_name) && other.chars().all(is_name)).then_some((condition, one, other))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "module a\n  (input  clk,\n   input  on,\n   input  [3:0] b,\n   output [3:0] c);\n";

    fn module(rest: &str) -> String {
        format!("{HEAD}{rest}endmodule\n")
    }

    #[test]
    fn logic_that_only_an_enabled_register_reads_goes_behind_the_enable() {
        let before = "  wire [3:0] sum;\n  wire [3:0] next;\n  reg [3:0] q;\n  assign c = q;\n  assign sum = b + q;\n  \
                      assign next = on ? sum : q;\n  always @(posedge clk)\n    q <= next;\n";
        let after = "  reg [3:0] sum;\n  wire [3:0] next;\n  reg [3:0] q;\n  assign c = q;\n  always @(posedge clk)\n    \
                     if (on) begin\n      sum = b + q;\n      q <= sum;\n    end\n";
        assert_eq!(gather(&module(before)), module(after));
    }

    #[test]
    fn logic_that_something_else_reads_stays() {
        let before = "  wire [3:0] sum;\n  wire [3:0] next;\n  reg [3:0] q;\n  assign c = sum;\n  assign sum = b + q;\n  \
                      assign next = on ? sum : q;\n  always @(posedge clk)\n    q <= next;\n";
        let after = "  wire [3:0] sum;\n  wire [3:0] next;\n  reg [3:0] q;\n  assign c = sum;\n  assign sum = b + q;\n  \
                     always @(posedge clk)\n    if (on) begin\n      q <= sum;\n    end\n";
        assert_eq!(gather(&module(before)), module(after));
    }

    #[test]
    fn logic_of_two_enables_and_the_enable_itself_stay() {
        let text = "  wire go;\n  wire [3:0] sum;\n  wire [3:0] next;\n  wire [3:0] other;\n  reg [3:0] q;\n  reg [3:0] r;\n  \
                    assign c = q & r;\n  assign go = b[0] & on;\n  assign sum = b + q;\n  assign next = go ? sum : q;\n  \
                    assign other = on ? sum : r;\n  always @(posedge clk)\n    q <= next;\n  always @(posedge clk)\n    r <= other;\n";
        let gathered = gather(&module(text));
        assert!(gathered.contains("  assign sum = b + q;\n"));
        assert!(gathered.contains("  assign go = b[0] & on;\n"));
        assert!(gathered.contains("    if (go) begin\n      q <= sum;\n    end\n"));
        assert!(gathered.contains("    if (on) begin\n      r <= sum;\n    end\n"));
    }

    #[test]
    fn what_a_variable_depends_on_comes_before_it() {
        let text = "  wire [3:0] late;\n  wire [3:0] early;\n  wire [3:0] next;\n  reg [3:0] q;\n  assign c = q;\n  \
                    assign late = ~early;\n  assign early = b + q;\n  assign next = on ? late : q;\n  \
                    always @(posedge clk)\n    q <= next;\n";
        assert!(gather(&module(text)).contains("      early = b + q;\n      late = ~early;\n      q <= late;\n"));
    }

    #[test]
    fn a_register_that_takes_another_value_without_the_enable_stays() {
        let text = "  wire [3:0] next;\n  reg [3:0] q;\n  assign c = q;\n  assign next = on ? q : b;\n  \
                    always @(posedge clk)\n    q <= next;\n";
        assert_eq!(gather(&module(text)), module(text));
    }

    #[test]
    fn what_nothing_reads_is_dropped() {
        let unread =
            "  reg [3:0] q;\n  assign c = b;\n  assign next = on ? b : q;\n  always @(posedge clk)\n    q <= next;\n";
        assert_eq!(gather(&module(unread)), module("  reg [3:0] q;\n  assign c = b;\n"));
    }
}
