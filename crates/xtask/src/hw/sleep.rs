//! Parts of the gateware that a simulation passes over while nothing in them would change.
//!
//! A simulator evaluates all logic at every clock, even of a part that waits for its next hit or frame. Here a part becomes
//! one module, and most of its registers, with the logic that nothing else reads, one process. What that reads from elsewhere
//! is compared with what it was when the process ran last. If that is the same, and the registers took the values that they
//! had, another run would leave everything as it is, and there is none. The logic stays what it is.

use std::collections::{BTreeMap, HashMap, HashSet};

use anyhow::{Context, bail, ensure};

use super::enables::names;

/// A part, and what of it runs at every clock.
pub struct Sleeper {
    /// The entity that becomes one module.
    pub entity: &'static str,
    /// What sleeps together: paths of instances within it, with `__` between; an empty path is all that is in the entity.
    pub groups: &'static [&'static [&'static str]],
    /// What of these does not sleep.
    pub awake: &'static [&'static str],
}

impl Sleeper {
    /// The group of a register, which the longest path decides.
    fn group(&self, register: &str) -> Option<usize> {
        let groups =
            self.groups.iter().enumerate().flat_map(|(group, paths)| paths.iter().map(move |path| (path, Some(group))));
        let all = groups.chain(self.awake.iter().map(|path| (path, None)));
        let within = all.filter(|(path, _)| {
            path.is_empty() || register.strip_prefix(*path).is_some_and(|rest| rest.starts_with("__"))
        });
        within.max_by_key(|(path, _)| path.len()).and_then(|(_, group)| group)
    }
}

/// The registers are compared at one of so many runs, as a power of two.
const LOOK_BITS: usize = 4;

/// Lets the parts of GHDL's Verilog sleep.
///
/// # Errors
///
/// If there is no such part, or one holds what is not known here.
pub fn let_sleep(verilog: &str, parts: &[Sleeper]) -> anyhow::Result<String> {
    let modules: Vec<&str> = verilog.split_inclusive("\nendmodule\n").collect();
    let by_name: HashMap<&str, &str> = modules.iter().map(|&module| (name(module), module)).collect();
    let mut result = String::with_capacity(verilog.len());
    let mut found = 0;
    for module in &modules {
        match parts.iter().find(|part| is_of(name(module), part.entity)) {
            Some(part) => {
                found += 1;
                let context = || format!("module {} cannot sleep", name(module));
                let flat = Flat::of(&by_name, module).with_context(context)?;
                result.push_str(&flat.asleep(part).with_context(context)?);
            }
            None => result.push_str(module),
        }
    }
    ensure!(found == parts.len(), "{found} modules for {} parts that sleep", parts.len());
    Ok(result)
}

/// Whether a module is an entity, perhaps with the values of its generics in its name.
fn is_of(module: &str, entity: &str) -> bool {
    module.strip_prefix(entity).is_some_and(|generics| {
        generics.is_empty()
            || generics.strip_prefix('_').is_some_and(|value| value.starts_with(|c: char| c.is_ascii_digit()))
    })
}

fn name(module: &str) -> &str {
    module.lines().find_map(|line| line.strip_prefix("module ")).unwrap_or_default()
}

/// Logic that drives a net.
struct Logic {
    /// An expression, or a case whose choices assign to the net.
    text: String,
    is_case: bool,
}

impl Logic {
    /// What drives the net.
    fn reads<'a>(&'a self, net: &'a str) -> impl Iterator<Item = &'a str> {
        names(&self.text).filter(move |name| !is_keyword(name) && (!self.is_case || *name != net))
    }
}

/// What a clock does if the condition is met: to a register, to one that takes a word of a memory, or to such a word.
struct Write {
    condition: Option<String>,
    target: String,
    value: String,
}

impl Write {
    /// The register or the memory.
    fn net(&self) -> &str {
        base(&self.target)
    }

    /// All that is read, but for the memory that is written.
    fn reads(&self) -> impl Iterator<Item = &str> {
        let address = &self.target[self.net().len()..];
        names(address).chain(self.condition.iter().flat_map(|condition| names(condition))).chain(names(&self.value))
    }
}

/// A module and all within it.
#[derive(Default)]
struct Flat {
    head: String,
    outputs: Vec<String>,
    /// Kind, range and rest of a net's declaration.
    nets: HashMap<String, (&'static str, String, String)>,
    /// Nets in the order of their declaration.
    order: Vec<String>,
    constants: String,
    logic: BTreeMap<String, Logic>,
    writes: Vec<Write>,
    initials: String,
}

impl Flat {
    fn of(modules: &HashMap<&str, &str>, module: &str) -> anyhow::Result<Self> {
        let mut flat = Self::default();
        for line in module.lines() {
            flat.head.push_str(&format!("{line}\n"));
            if line.ends_with(");") {
                break;
            }
        }
        for (is_output, _, name) in ports(module) {
            if is_output {
                flat.outputs.push(name.to_owned());
            }
        }
        flat.add(modules, module, "")?;
        Ok(flat)
    }

    /// Adds what is in a module, with a prefix to its names.
    fn add(&mut self, modules: &HashMap<&str, &str>, module: &str, prefix: &str) -> anyhow::Result<()> {
        let named = |text: &str| renamed(text, prefix);
        let mut lines = module.lines();
        lines.by_ref().find(|line| line.ends_with(");"));
        while let Some(line) = lines.next() {
            let mut next = || lines.next().map(str::trim).context("the module has no end");
            let code = line.split("//").next().unwrap_or_default().trim();
            let words: Vec<&str> = code.split_whitespace().collect();
            match words.as_slice() {
                [] | ["/*" | "(*", ..] | ["endmodule"] => {}
                ["wire", declaration @ ..] => self.declare("wire", declaration, prefix)?,
                ["reg", declaration @ ..] => self.declare("reg", declaration, prefix)?,
                ["localparam", ..] => {
                    let (left, value) = code.split_once(" = ").context("a constant without value")?;
                    let (kind, name) = left.rsplit_once(' ').context("a constant without name")?;
                    self.constants.push_str(&format!("  {kind} {} = {value}\n", named(name)));
                }
                ["assign", name, "=", ..] => {
                    let value = code.split_once(" = ").and_then(|(_, value)| value.strip_suffix(';'));
                    let text = named(value.context("an assignment of several lines")?);
                    self.logic.insert(named(name), Logic { text, is_case: false });
                }
                ["always", "@*"] => {
                    let mut text = format!("      {}\n", named(next()?));
                    let mut target = None;
                    loop {
                        let line = next()?;
                        if line == "endcase" {
                            break;
                        }
                        let (choice, assignment) = line.split_once(": ").context("a case of another form")?;
                        let (left, value) = assignment
                            .split_once(" <= ")
                            .or_else(|| assignment.split_once(" = "))
                            .context("a choice of another form")?;
                        let choice = if choice == "default" { choice } else { &named(choice) };
                        text.push_str(&format!("        {choice}: {} = {}\n", named(left), named(value)));
                        target = Some(named(left));
                    }
                    text.push_str("      endcase\n");
                    self.logic.insert(target.context("an empty case")?, Logic { text, is_case: true });
                }
                ["always", "@(posedge", "clk)"] => {
                    let mut line = next()?;
                    let condition = line.strip_prefix("if (").and_then(|line| line.strip_suffix(')'));
                    if condition.is_some() {
                        line = next()?;
                    }
                    let (target, value) = line
                        .strip_suffix(';')
                        .and_then(|line| line.split_once(" <= "))
                        .with_context(|| format!("a process of another form: {line}"))?;
                    let condition = condition.filter(|condition| *condition != "1'b1").map(named);
                    self.writes.push(Write { condition, target: named(target), value: named(value) });
                }
                ["initial", "begin"] => {
                    self.initials.push_str("  initial begin\n");
                    loop {
                        let line = next()?;
                        if line == "end" {
                            break;
                        }
                        self.initials.push_str(&format!("    {}\n", named(line)));
                    }
                    self.initials.push_str("  end\n");
                }
                [entity, instance, "("] => {
                    let inner = *modules.get(entity).with_context(|| format!("there is no module {entity}"))?;
                    let inner_prefix = format!("{prefix}{instance}__");
                    let mut connections = HashMap::new();
                    loop {
                        let line = next()?;
                        let connection = line.trim_end_matches([',', ';']);
                        let is_last = line.ends_with(';');
                        let connection = if is_last { connection.strip_suffix(')') } else { Some(connection) };
                        let (port, net) = connection
                            .and_then(|connection| connection.strip_prefix('.')?.strip_suffix(')')?.split_once('('))
                            .with_context(|| format!("a connection of another form: {line}"))?;
                        connections.insert(port, net);
                        if is_last {
                            break;
                        }
                    }
                    for (is_output, range, port) in ports(inner) {
                        let net = connections.get(port).copied().unwrap_or_default();
                        let inside = format!("{inner_prefix}{port}");
                        if port == "clk" {
                            ensure!(net == "clk", "a clock of another name: {net}");
                            continue;
                        }
                        self.net("wire", range, &inside, "");
                        if is_output && !net.is_empty() {
                            self.logic.insert(named(net), Logic { text: inside, is_case: false });
                        } else if !is_output {
                            self.logic.insert(inside, Logic { text: named(net), is_case: false });
                        }
                    }
                    self.add(modules, inner, &inner_prefix)?;
                }
                _ => bail!("unknown: {line}"),
            }
        }
        Ok(())
    }

    fn declare(&mut self, kind: &'static str, declaration: &[&str], prefix: &str) -> anyhow::Result<()> {
        let (range, rest) = match declaration {
            [range, rest @ ..] if range.starts_with('[') => (*range, rest.concat()),
            rest => ("", rest.concat()),
        };
        let rest = rest.trim_end_matches(';');
        ensure!(!rest.contains('='), "a net with a first value: {rest}");
        let name = base(rest);
        self.net(kind, range, &format!("{prefix}{name}"), &rest[name.len()..]);
        Ok(())
    }

    fn net(&mut self, kind: &'static str, range: &str, name: &str, words: &str) {
        self.nets.insert(name.to_owned(), (kind, range.to_owned(), words.to_owned()));
        self.order.push(name.to_owned());
    }

    /// The module with a process for every group.
    fn asleep(&self, sleeper: &Sleeper) -> anyhow::Result<String> {
        let mut groups: Vec<Vec<&Write>> = sleeper.groups.iter().map(|_| Vec::new()).collect();
        let mut awake = Vec::new();
        for write in &self.writes {
            match sleeper.group(write.net()) {
                Some(group) => groups[group].push(write),
                None => awake.push(write),
            }
        }

        // The only group that reads a net, directly or not, or none
        let mut readers = HashMap::new();
        let outputs = self.outputs.iter().map(String::as_str);
        self.mark(outputs.chain(awake.iter().flat_map(|write| write.reads())), None, &mut readers);
        for (group, writes) in groups.iter().enumerate() {
            self.mark(writes.iter().flat_map(|write| write.reads()), Some(group), &mut readers);
        }

        let (mut declarations, mut processes) = (String::new(), String::new());
        let (mut variables, mut gone) = (HashSet::new(), HashSet::new());
        for (group, writes) in groups.iter().enumerate() {
            let process = Process::of(self, group, writes, &readers)?;
            process.write(writes, &mut declarations, &mut processes);
            for net in process.order {
                let is_variable = process.variables.contains(net);
                if is_variable { &mut variables } else { &mut gone }.insert(net);
            }
        }

        let mut module = self.head.clone();
        module.push_str(&self.constants);
        for net in self.order.iter().filter(|net| !self.outputs.contains(net) && !gone.contains(net.as_str())) {
            let (kind, range, words) = &self.nets[net];
            let kind = if variables.contains(net.as_str()) { "reg" } else { kind };
            if kind == "reg" || readers.contains_key(net.as_str()) {
                module.push_str(&format!("  {kind} {range} {net}{words};\n"));
            }
        }
        module.push_str(&declarations);
        module.push_str(&self.initials);
        let is_here = |net: &str| readers.contains_key(net) && !variables.contains(net) && !gone.contains(net);
        for (net, logic) in self.logic.iter().filter(|(net, _)| is_here(net)) {
            if logic.is_case {
                module.push_str(&format!("  always @*\n{}", logic.text));
            } else {
                module.push_str(&format!("  assign {net} = {};\n", logic.text));
            }
        }
        for Write { condition, target, value } in awake {
            module.push_str("  always @(posedge clk)\n");
            if let Some(condition) = condition {
                module.push_str(&format!("    if ({condition})\n"));
            }
            module.push_str(&format!("    {target} <= {value};\n"));
        }
        module.push_str(&processes);
        module.push_str("endmodule\n");
        Ok(module)
    }

    /// Notes a reader of nets, and of all that they follow from.
    fn mark<'a>(
        &'a self,
        nets: impl Iterator<Item = &'a str>,
        reader: Option<usize>,
        readers: &mut HashMap<&'a str, Option<usize>>,
    ) {
        let mut to_do: Vec<&str> = nets.collect();
        while let Some(net) = to_do.pop() {
            let known = readers.get(net).copied();
            let read_by = if known.is_none_or(|known| known == reader) { reader } else { None };
            if known != Some(read_by) {
                readers.insert(net, read_by);
                to_do.extend(self.logic.get(net).into_iter().flat_map(|logic| names(&logic.text)));
            }
        }
    }

    fn range(&self, net: &str) -> &str {
        match self.nets.get(net) {
            Some((_, range, _)) => range,
            // An input of the module
            None => ports(&self.head).find(|(_, _, name)| *name == net).map_or("", |(_, range, _)| range),
        }
    }

    fn is_memory(&self, net: &str) -> bool {
        self.nets.get(net).is_some_and(|(_, _, words)| !words.is_empty())
    }

    /// Whether a net follows from nothing but registers that sleep and constants.
    fn is_steady<'a>(&'a self, net: &'a str, held: &HashSet<&str>, known: &mut HashMap<&'a str, bool>) -> bool {
        if let Some(&is_steady) = known.get(net) {
            return is_steady;
        }
        // Until it is known, for logic that depends on itself
        known.insert(net, false);
        let is_steady = match self.logic.get(net) {
            Some(logic) => logic.reads(net).all(|name| self.is_steady(name, held, known)),
            None => held.contains(net) || self.is_constant(net),
        };
        known.insert(net, is_steady);
        is_steady
    }

    /// Whether a net is a constant, or a memory that nothing writes.
    fn is_constant(&self, net: &str) -> bool {
        self.constants.contains(&format!(" {net} = "))
            || self.is_memory(net) && !self.writes.iter().any(|write| write.net() == net)
    }
}

/// The process of a group.
struct Process<'a> {
    group: usize,
    /// Its logic, each net after what it depends on.
    order: Vec<&'a str>,
    /// Those of these nets that become variables.
    variables: HashSet<&'a str>,
    evaluation: String,
    /// What it reads from elsewhere, and the range of that.
    inputs: Vec<(&'a str, &'a str)>,
    /// Registers and memories that nothing else reads.
    own: HashSet<&'a str>,
}

impl<'a> Process<'a> {
    fn of(
        flat: &'a Flat,
        group: usize,
        writes: &[&'a Write],
        readers: &HashMap<&'a str, Option<usize>>,
    ) -> anyhow::Result<Self> {
        let held: HashSet<&str> = writes.iter().map(|write| write.net()).collect();
        let is_own = |net: &str| readers.get(net) == Some(&Some(group));
        let mut inside =
            Inside { flat, is_own, held: &held, done: HashMap::new(), order: Vec::new(), inputs: Vec::new() };
        for net in writes.iter().flat_map(|write| write.reads()) {
            ensure!(!held.contains(net) || flat.is_memory(net), "{net} is taken directly");
            inside.evaluate(net)?;
        }
        let Inside { order, mut inputs, .. } = inside;
        let mut known = HashMap::new();
        inputs.retain(|net| !flat.is_steady(net, &held, &mut known));
        let (evaluation, variables) = statements(flat, &order, writes);
        Ok(Self {
            group,
            order,
            variables,
            evaluation,
            inputs: inputs.into_iter().map(|net| (net, flat.range(net))).collect(),
            own: held.iter().copied().filter(|net| is_own(net)).collect(),
        })
    }

    fn write(&self, writes: &[&Write], declarations: &mut String, processes: &mut String) {
        let group = self.group;
        let (still, runs) = (format!("is_still_{group}"), format!("runs_{group}"));
        declarations.push_str(&format!("  reg {still};\n  reg [{}:0] {runs};\n", LOOK_BITS - 1));
        let (mut news, mut copies) = (String::new(), String::new());
        for (number, (net, range)) in self.inputs.iter().enumerate() {
            let then = format!("then_{group}_{number}");
            declarations.push_str(&format!("  reg {range} {then};\n"));
            news.push_str(&format!(" | {net} != {then}"));
            copies.push_str(&format!("      {then} = {net};\n"));
        }
        let evaluation = &self.evaluation;
        processes.push_str(&format!(
            "  always @(posedge clk)\n    if (!{still}{news}) begin\n{evaluation}      {runs} = {runs} + 1'b1;\n      \
             {still} = {runs} == 0;\n      if ({still}) begin\n"
        ));
        for Write { condition, target, value } in writes {
            let unmet = condition.as_ref().map_or(String::new(), |condition| format!("!{condition} | "));
            processes.push_str(&format!("        {still} = {still} & ({unmet}{target} == {value});\n"));
        }
        processes.push_str(&format!("      end\n{copies}"));
        // Words are read before they are written. Nothing else in the process reads a register from here on
        let (reads, others): (Vec<&Write>, Vec<&Write>) = writes.iter().partition(|write| write.value.contains('['));
        for Write { condition, target, value } in reads.into_iter().chain(others) {
            let condition = condition.as_ref().map_or(String::new(), |condition| format!("if ({condition}) "));
            let assignment = if self.own.contains(base(target)) { "=" } else { "<=" };
            processes.push_str(&format!("      {condition}{target} {assignment} {value};\n"));
        }
        processes.push_str("    end\n");
    }
}

/// What a process evaluates.
struct Inside<'a, 'b, F: Fn(&str) -> bool> {
    flat: &'a Flat,
    /// Whether nothing else reads a net.
    is_own: F,
    /// The registers and memories that the process writes.
    held: &'b HashSet<&'a str>,
    /// Nets in `order`, or, if it is not true, on their way there.
    done: HashMap<&'a str, bool>,
    order: Vec<&'a str>,
    inputs: Vec<&'a str>,
}

impl<'a, F: Fn(&str) -> bool> Inside<'a, '_, F> {
    fn evaluate(&mut self, net: &'a str) -> anyhow::Result<()> {
        let flat = self.flat;
        if is_keyword(net) || self.held.contains(net) || flat.is_constant(net) {
            return Ok(());
        }
        let logic = match flat.logic.get(net) {
            Some(logic) if (self.is_own)(net) => logic,
            _ => {
                ensure!(!flat.is_memory(net), "{net} does not sleep, but what reads it does");
                if !self.inputs.contains(&net) {
                    self.inputs.push(net);
                }
                return Ok(());
            }
        };
        match self.done.get(net) {
            Some(true) => return Ok(()),
            Some(false) => bail!("{net} depends on itself"),
            None => {}
        }
        self.done.insert(net, false);
        for name in logic.reads(net) {
            self.evaluate(name)?;
        }
        self.done.insert(net, true);
        self.order.push(net);
        Ok(())
    }
}

/// The statements of nets in their order, and those that are left. What is read in one place is put there.
fn statements<'a>(flat: &Flat, order: &[&'a str], writes: &[&Write]) -> (String, HashSet<&'a str>) {
    let mut reads: HashMap<&str, u32> = HashMap::new();
    let texts = order.iter().map(|net| flat.logic[*net].text.as_str());
    // No expression has an index, and a write's operands are read twice
    let twice = writes.iter().chain(writes).flat_map(|write| write.reads());
    for name in twice.chain(texts.clone().flat_map(names)).chain(texts.flat_map(indexed)) {
        *reads.entry(name).or_default() += 1;
    }
    let (mut moved, mut text, mut variables) = (HashMap::new(), String::new(), HashSet::new());
    for &net in order {
        let logic = &flat.logic[net];
        let value = replaced(&logic.text, |word| moved.get(word).cloned());
        // A product is wider than its factors
        if reads.get(net) == Some(&1) && !logic.is_case && !logic.text.contains(['*', '$']) {
            moved.insert(net, format!("{{{value}}}"));
            continue;
        }
        variables.insert(net);
        if logic.is_case {
            text.push_str(&value);
        } else {
            text.push_str(&format!("      {net} = {value};\n"));
        }
    }
    (text, variables)
}

/// The names that have an index.
fn indexed(text: &str) -> impl Iterator<Item = &str> {
    text.match_indices('[').filter_map(|(place, _)| names(&text[..place]).last())
}

/// The name before an index.
fn base(net: &str) -> &str {
    net.split('[').next().unwrap_or_default()
}

fn is_keyword(word: &str) -> bool {
    matches!(word, "case" | "endcase" | "default")
}

/// Whether it is an output, range, and name of a module's ports.
fn ports(module: &str) -> impl Iterator<Item = (bool, &str, &str)> {
    let mut is_over = false;
    module.lines().take_while(move |line| !std::mem::replace(&mut is_over, line.ends_with(");"))).filter_map(|line| {
        let port = line.trim_start_matches([' ', '(']).trim_end_matches([',', ')', ';']);
        let (direction, port) = port.split_once(' ')?;
        let (range, name) = port.trim().rsplit_once(' ').unwrap_or(("", port.trim()));
        matches!(direction, "input" | "output").then_some((direction == "output", range, name))
    })
}

/// The text with a prefix to all its names.
fn renamed(text: &str, prefix: &str) -> String {
    replaced(text, |name| Some(format!("{prefix}{name}")))
}

/// The text with other words for names.
fn replaced(text: &str, word_for: impl Fn(&str) -> Option<String>) -> String {
    let is_part = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '$' | '\'');
    let mut result = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(is_part) {
        let end = rest[start..].find(|c| !is_part(c)).map_or(rest.len(), |length| start + length);
        let word = &rest[start..end];
        result.push_str(&rest[..start]);
        let is_name = word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') && !is_keyword(word);
        match is_name.then(|| word_for(word)).flatten() {
            Some(other) => result.push_str(&other),
            None => result.push_str(word),
        }
        rest = &rest[end..];
    }
    result + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "module top\n  (input  clk,\n   input  on,\n   input  [3:0] b,\n   output [3:0] c);\n";
    const WHOLE: Sleeper = Sleeper { entity: "top", groups: &[&[""]], awake: &[] };

    fn asleep(rest: &str, sleeper: Sleeper) -> anyhow::Result<String> {
        let_sleep(&format!("{HEAD}{rest}endmodule\n"), &[sleeper])
    }

    #[test]
    fn a_process_runs_with_news_and_until_nothing_changes() {
        let text = "  wire [3:0] next;\n  reg [3:0] n1_q;\n  assign c = n1_q;\n  assign next = b;\n  \
                    always @(posedge clk)\n    n1_q <= next;\n";
        let after = "  reg [3:0] next;\n  reg [3:0] n1_q;\n  reg is_still_0;\n  reg [3:0] runs_0;\n  reg [3:0] then_0_0;\n  \
                     assign c = n1_q;\n  always @(posedge clk)\n    if (!is_still_0 | b != then_0_0) begin\n      \
                     next = b;\n      runs_0 = runs_0 + 1'b1;\n      is_still_0 = runs_0 == 0;\n      \
                     if (is_still_0) begin\n        is_still_0 = is_still_0 & (n1_q == next);\n      end\n      \
                     then_0_0 = b;\n      n1_q <= next;\n    end\nendmodule\n";
        assert_eq!(asleep(text, WHOLE).unwrap(), format!("{HEAD}{after}"));
    }

    #[test]
    fn all_within_a_part_becomes_one_module_and_other_modules_stay() {
        let low = "module low_3\n  (input  clk,\n   input  [3:0] d,\n   output [3:0] q);\n  reg [3:0] n1_q;\n  assign q = n1_q;\n  \
                   always @(posedge clk)\n    n1_q <= d;\nendmodule\n";
        let rest = "  wire [3:0] low_i_q;\n  assign c = low_i_q;\n  low_3 low_i (\n    .clk(clk),\n    .d(b),\n    \
                    .q(low_i_q));\n";
        let result = let_sleep(&format!("{low}{HEAD}{rest}endmodule\n"), &[WHOLE]).unwrap();
        assert!(result.starts_with(low));
        assert!(result.contains("      low_i__d = b;\n"));
        assert!(result.contains("      low_i__n1_q <= low_i__d;\n"));
        assert!(result.contains("  assign low_i_q = low_i__q;\n"));
        assert_eq!(result.matches("low_3").count(), 1);
    }

    /// Two registers, one after the other.
    const CHAIN: &str = "  wire [3:0] n1_o;\n  wire [3:0] n2_o;\n  reg [3:0] n1_q;\n  reg [3:0] n2_q;\n  assign c = n2_q;\n  \
                         assign n1_o = b;\n  assign n2_o = n1_q;\n  always @(posedge clk)\n    n1_q <= n1_o;\n  \
                         always @(posedge clk)\n    n2_q <= n2_o;\n";

    #[test]
    fn only_a_register_that_nothing_else_reads_changes_at_once() {
        let result = asleep(CHAIN, WHOLE).unwrap();
        assert!(result.contains("      n1_q = n1_o;\n      n2_q <= n2_o;\n"));
        let read_outside = CHAIN.replace("c = n2_q", "c = n2_q & n1_q");
        assert!(asleep(&read_outside, WHOLE).unwrap().contains("      n1_q <= n1_o;\n      n2_q <= n2_o;\n"));
    }

    #[test]
    fn what_follows_from_registers_that_sleep_alone_is_no_news() {
        let result = asleep(&CHAIN.replace("c = n2_q", "c = n2_o ^ n2_q"), WHOLE).unwrap();
        assert!(result.contains("  assign n2_o = n1_q;\n"));
        assert!(result.contains("if (!is_still_0 | b != then_0_0) begin\n"));
    }

    #[test]
    fn what_is_awake_runs_at_every_clock_and_is_news() {
        let inner = CHAIN.replace("n1_q", "a_i__n1_q").replace("n1_o", "a_i__n1_o");
        let sleeper = Sleeper { entity: "top", groups: &[&[""]], awake: &["a_i"] };
        let result = asleep(&inner, sleeper).unwrap();
        assert!(result.contains("  assign a_i__n1_o = b;\n"));
        assert!(result.contains("  always @(posedge clk)\n    a_i__n1_q <= a_i__n1_o;\n"));
        assert!(result.contains("if (!is_still_0 | a_i__n1_q != then_0_0) begin\n"));
    }

    #[test]
    fn groups_have_processes_of_their_own() {
        let inner = CHAIN.replace("n1_q", "a_i__n1_q").replace("n2_q", "b_i__n2_q");
        let sleeper = Sleeper { entity: "top", groups: &[&["a_i"], &["b_i"]], awake: &[] };
        let result = asleep(&inner, sleeper).unwrap();
        assert!(result.contains("if (!is_still_0 | b != then_0_0) begin\n"));
        assert!(result.contains("      a_i__n1_q <= n1_o;\n"));
        assert!(result.contains("if (!is_still_1 | a_i__n1_q != then_1_0) begin\n"));
    }

    #[test]
    fn words_are_compared_too_and_read_before_they_are_written() {
        let text = "  wire [3:0] n1_o;\n  reg [3:0] words[3:0] ; // memory\n  reg [3:0] n1_data; // mem_rd\n  \
                    assign c = n1_data;\n  assign n1_o = b;\n  always @(posedge clk)\n    if (on)\n      \
                    words[b] <= n1_o;\n  always @(posedge clk)\n    if (1'b1)\n      n1_data <= words[b];\n";
        let result = asleep(text, WHOLE).unwrap();
        assert!(result.contains("is_still_0 = is_still_0 & (!on | words[b] == n1_o);\n"));
        assert!(result.contains("is_still_0 = is_still_0 & (n1_data == words[b]);\n"));
        assert!(result.contains("      n1_data <= words[b];\n      if (on) words[b] = n1_o;\n"));
    }

    /// A register of what a wire makes of the sum or product of others.
    fn with_sum(sum: &str, next: &str) -> String {
        let text = format!(
            "  wire [3:0] sum;\n  wire [3:0] next;\n  reg [3:0] n1_q;\n  assign c = n1_q;\n  assign sum = {sum};\n  \
             assign next = {next};\n  always @(posedge clk)\n    n1_q <= next;\n"
        );
        asleep(&text, WHOLE).unwrap()
    }

    #[test]
    fn what_is_read_in_one_place_is_put_there_unless_its_width_would_change() {
        assert!(with_sum("b + n1_q", "~sum").contains("      next = ~{b + n1_q};\n"));
        assert!(with_sum("b + n1_q", "sum ^ sum").contains("      sum = b + n1_q;\n      next = sum ^ sum;\n"));
        assert!(with_sum("b + n1_q", "{sum[0], sum[3:1]}").contains("      sum = b + n1_q;\n"));
        assert!(with_sum("b + n1_q", "{3'b0, sum[0]}").contains("      sum = b + n1_q;\n"));
        assert!(with_sum("b * n1_q", "~sum").contains("      sum = b * n1_q;\n"));
    }

    #[test]
    fn a_case_becomes_one_of_the_process() {
        let text = "  reg [3:0] n1_o;\n  reg [3:0] n1_q;\n  assign c = n1_q;\n  always @*\n    case (on)\n      \
                    1'b1: n1_o <= b;\n      default: n1_o <= 'bx;\n    endcase\n  always @(posedge clk)\n    n1_q <= n1_o;\n";
        let case = "      case (on)\n        1'b1: n1_o = b;\n        default: n1_o = 'bx;\n      endcase\n";
        assert!(asleep(text, WHOLE).unwrap().contains(case));
    }

    #[test]
    fn what_cannot_sleep_is_refused() {
        assert!(asleep(&CHAIN.replace("n1_o = b", "n1_o = n1_o ^ b"), WHOLE).is_err());
        assert!(asleep(&CHAIN.replace("n2_q <= n2_o", "n2_q <= n1_q"), WHOLE).is_err());
        assert!(asleep(&CHAIN.replace("n2_q <= n2_o;", "begin"), WHOLE).is_err());
        assert!(asleep("  low_3 low_i (\n    .clk(clk));\n", WHOLE).is_err());
        assert!(asleep("  tri a;\n", WHOLE).is_err());
        assert!(asleep(CHAIN, Sleeper { entity: "to", ..WHOLE }).is_err());
    }
}
