//! How deep the stack of an image can become: the frames that the compiler tells (`-Zemit-stack-sizes`), along the calls
//! that the code makes. The program must not call itself, and not call through pointers.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, bail, ensure};
use object::{Object, ObjectSection, ObjectSymbol};

/// Bytes of stack below the entry of a function, at most.
pub fn deepest(image: &object::File, entry: &str) -> anyhow::Result<u64> {
    let program = Program::read(image)?;
    let (&entry, _) =
        program.functions.iter().find(|(_, function)| function.names.contains(entry)).context("no entry")?;
    program.depth(entry, &mut Vec::new(), &mut BTreeMap::new())
}

struct Function {
    names: BTreeSet<String>,
    /// Bytes of its own; None: the compiler has not made it.
    frame: Option<u64>,
    /// What it calls or goes on with.
    calls: BTreeSet<u64>,
    /// Whether it calls through a pointer.
    is_indirect: bool,
}

struct Program {
    /// By their addresses.
    functions: BTreeMap<u64, Function>,
}

impl Program {
    fn read(image: &object::File) -> anyhow::Result<Self> {
        let sizes = image.section_by_name(".stack_sizes").context("an image without stack sizes")?;
        let frames = frames(sizes.data()?)?;
        let text = image.section_by_name(".text").context("an image without code")?;
        let end = text.address() + text.size();
        let mut functions = BTreeMap::<u64, Function>::new();
        for symbol in image.symbols().filter(|symbol| (text.address()..end).contains(&symbol.address())) {
            let name = symbol.name().unwrap_or_default();
            // Labels of the assembler and marks of what is code
            if name.is_empty() || name.starts_with('$') || name.starts_with(".L") {
                continue;
            }
            let frame = frames.get(&symbol.address()).copied();
            let function = || Function { names: BTreeSet::new(), frame, calls: BTreeSet::new(), is_indirect: false };
            functions.entry(symbol.address()).or_insert_with(function).names.insert(name.to_owned());
        }
        let starts: Vec<u64> = functions.keys().copied().collect();
        let ends = starts.iter().skip(1).copied().chain([end]);
        let code = text.data()?;
        for (&start, end) in starts.iter().zip(ends) {
            let code = &code[(start - text.address()) as usize..(end - text.address()) as usize];
            let Some(function) = functions.get_mut(&start) else { continue };
            for jump in jumps(start, code) {
                match jump {
                    Jump::To(target) if (start..end).contains(&target) => {}
                    Jump::To(target) => _ = function.calls.insert(target),
                    Jump::ThroughPointer => function.is_indirect = true,
                }
            }
        }
        Ok(Self { functions })
    }

    /// `path` is how one comes here, `known` what has been found before.
    fn depth(&self, address: u64, path: &mut Vec<u64>, known: &mut BTreeMap<u64, u64>) -> anyhow::Result<u64> {
        if let Some(&depth) = known.get(&address) {
            return Ok(depth);
        }
        let function = self.functions.get(&address).with_context(|| format!("a call to {address:#x}: no function"))?;
        let name = || function.names.iter().cloned().collect::<Vec<_>>().join(", ");
        ensure!(!path.contains(&address), "{} calls itself", name());
        ensure!(!function.is_indirect, "{} calls through a pointer", name());
        let Some(frame) = function.frame else { bail!("{}: no stack size", name()) };
        path.push(address);
        let mut below = 0;
        for &call in &function.calls {
            below = below.max(self.depth(call, path, known)?);
        }
        path.pop();
        known.insert(address, frame + below);
        Ok(frame + below)
    }
}

/// Of `.stack_sizes`: an address of 32 bits and a number in LEB128 per function.
fn frames(mut section: &[u8]) -> anyhow::Result<BTreeMap<u64, u64>> {
    let mut frames = BTreeMap::new();
    while let Some((address, rest)) = section.split_first_chunk() {
        let length = 1 + rest.iter().position(|byte| byte & 0x80 == 0).context("a stack size without an end")?;
        let (bytes, rest) = rest.split_at(length);
        let size = bytes.iter().rev().fold(0, |size, byte| size << 7 | u64::from(byte & 0x7f));
        frames.insert(u32::from_le_bytes(*address).into(), size);
        section = rest;
    }
    Ok(frames)
}

#[derive(Debug, PartialEq, Eq)]
enum Jump {
    To(u64),
    ThroughPointer,
}

/// The jumps and calls in RV32IMAC code. Branches stay within their function, and so does a jump to an address from a
/// table. t0 holds the return address of pieces of code that several functions share.
fn jumps(address: u64, code: &[u8]) -> Vec<Jump> {
    let mut found = Vec::new();
    // Register and value of an auipc just before
    let mut upper = None;
    let mut place = 0;
    while let Some(&[low, high]) = code.get(place..place + 2) {
        let here = address + place as u64;
        let half = u32::from(u16::from_le_bytes([low, high]));
        let is_short = half & 3 != 3;
        let word = match code.get(place + 2..place + 4) {
            Some(&[low, high]) if !is_short => half | u32::from(u16::from_le_bytes([low, high])) << 16,
            _ => half,
        };
        let relative = |offset: i32| Jump::To(u64::from((here as u32).wrapping_add_signed(offset)));
        let register = word >> 7 & 31;
        let before = upper.take();
        if is_short {
            match (word & 3, word >> 13) {
                // c.jal, c.j
                (1, 1 | 5) => found.push(relative(short_offset(word))),
                // c.jalr; c.ebreak has register 0
                (2, 4) if word >> 12 == 9 && word >> 2 & 31 == 0 && register != 0 => found.push(Jump::ThroughPointer),
                _ => {}
            }
        } else {
            match word & 0x7f {
                // jal
                0x6f => found.push(relative(long_offset(word))),
                // auipc
                0x17 => upper = Some((register, (here as u32).wrapping_add(word & 0xffff_f000))),
                // jalr
                0x67 => match before {
                    Some((base, upper)) if base == word >> 15 & 31 => {
                        found.push(Jump::To(upper.wrapping_add_signed(word as i32 >> 20).into()));
                    }
                    _ if register != 0 => found.push(Jump::ThroughPointer),
                    _ => {}
                },
                _ => {}
            }
        }
        place += if is_short { 2 } else { 4 };
    }
    found
}

/// Bits `from` (a place per bit of the result, the lowest first, counted from bit 1) as a signed offset.
fn offset(word: u32, from: &[u32]) -> i32 {
    let value = from.iter().enumerate().fold(0, |value, (bit, place)| value | (word >> place & 1) << (bit + 1));
    let unused = 31 - from.len() as u32;
    (value << unused) as i32 >> unused
}

/// Of c.jal and c.j.
fn short_offset(word: u32) -> i32 {
    offset(word, &[3, 4, 5, 11, 2, 7, 6, 9, 10, 8, 12])
}

/// Of jal.
fn long_offset(word: u32) -> i32 {
    offset(word, &[21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 20, 12, 13, 14, 15, 16, 17, 18, 19, 31])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jumps_go_where_the_assembler_says() {
        // Encoded by LLVM: jal ra, +0x1234; c.j -6; c.jal +0x7fe; auipc ra, 0x12; jalr ra, -0x10(ra); c.jalr a1; ret; jr a5
        let code = [
            0xef, 0x10, 0x40, 0x23, 0xed, 0xbf, 0xfd, 0x2f, 0x97, 0x20, 0x01, 0x00, 0xe7, 0x80, 0x00, 0xff, 0x82, 0x95,
            0x82, 0x80, 0x82, 0x87,
        ];
        let base = 0x4000_0000;
        let expected = [
            Jump::To(base + 0x1234),
            Jump::To(base + 4 - 6),
            Jump::To(base + 6 + 0x7fe),
            Jump::To(base + 8 + 0x12000 - 0x10),
            Jump::ThroughPointer,
        ];
        assert_eq!(jumps(base, &code), expected);
    }

    #[test]
    fn stack_sizes_are_read() {
        let section = [0x10, 0, 0, 0x40, 0x30, 0x20, 0, 0, 0x40, 0xb0, 0x4a];
        assert_eq!(frames(&section).unwrap(), BTreeMap::from([(0x4000_0010, 48), (0x4000_0020, 9520)]));
        assert!(frames(&section[..10]).is_err());
    }

    fn program(functions: &[(u64, u64, &[u64])]) -> Program {
        let function = |&(address, frame, calls): &(u64, u64, &[u64])| {
            let calls = calls.iter().copied().collect();
            let names = BTreeSet::from([address.to_string()]);
            (address, Function { names, frame: Some(frame), calls, is_indirect: false })
        };
        Program { functions: functions.iter().map(function).collect() }
    }

    #[test]
    fn the_depth_is_that_of_the_deepest_way() {
        let depth = |program: &Program| program.depth(1, &mut Vec::new(), &mut BTreeMap::new());
        let tree = program(&[(1, 100, &[2, 3]), (2, 50, &[4]), (3, 60, &[]), (4, 20, &[])]);
        assert_eq!(depth(&tree).unwrap(), 170);
        let circle = program(&[(1, 100, &[2]), (2, 50, &[1])]);
        assert_eq!(depth(&circle).unwrap_err().to_string(), "1 calls itself");
        let mut pointer = program(&[(1, 100, &[2]), (2, 50, &[])]);
        pointer.functions.get_mut(&2).unwrap().is_indirect = true;
        assert_eq!(depth(&pointer).unwrap_err().to_string(), "2 calls through a pointer");
    }
}
