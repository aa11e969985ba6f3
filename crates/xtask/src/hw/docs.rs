//! Datasheet pages: one per block, from the header and the ports of its file and from the table of sizes.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, ensure};

use super::{formal, hw_ip, synth};

/// Writes all pages.
pub fn write() -> anyhow::Result<()> {
    let folder = folder();
    if folder.exists() {
        std::fs::remove_dir_all(&folder).with_context(|| format!("cannot clear {}", folder.display()))?;
    }
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    for (name, text) in pages()? {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Fails if a page is not what the sources give.
pub fn check() -> anyhow::Result<()> {
    let pages = pages()?;
    for (name, text) in &pages {
        let path = folder().join(name);
        let is_current = std::fs::read_to_string(&path).is_ok_and(|found| found == *text);
        ensure!(is_current, "{} is not current: `cargo xtask hw docs` writes it", path.display());
    }
    let files = std::fs::read_dir(folder()).context("cannot list the pages")?.count();
    ensure!(files == pages.len(), "there are pages of blocks that have gone: `cargo xtask hw docs` removes them");
    Ok(())
}

fn folder() -> PathBuf {
    hw_ip().join("doc/blocks")
}

/// Names and texts.
fn pages() -> anyhow::Result<BTreeMap<String, String>> {
    let list = std::fs::read_to_string(hw_ip().join("files.txt")).context("cannot read hw-ip/files.txt")?;
    let mut pages = BTreeMap::new();
    let mut index = String::from("# Blocks\n\nOne page each, written by `cargo xtask hw docs` from the sources.\n");
    let mut group = "";
    // What others have generated has its own page
    for file in list.lines().filter(|file| !file.contains("/generated/")) {
        let source = std::fs::read_to_string(hw_ip().join(file)).with_context(|| format!("cannot read {file}"))?;
        let (folder, name) = file.rsplit_once('/').context("a file without a folder")?;
        let name = name.trim_end_matches(".vhd");
        let mut block = Block::read(&source).with_context(|| format!("{file} has no header to make a page of"))?;
        let proof = hw_ip().join(format!("formal/{name}.psl"));
        if proof.exists() {
            block.proof = proven(&std::fs::read_to_string(proof).context("cannot read a proof")?);
        }
        if folder != group {
            group = folder;
            index += &format!("\n## {folder}\n\n| block | purpose |\n|---|---|\n");
        }
        index += &format!("| [{name}]({name}.md) | {} |\n", block.summary.trim_end_matches('.'));
        pages.insert(format!("{name}.md"), block.page(name, file)?);
    }
    pages.insert("README.md".to_owned(), index);
    Ok(pages)
}

/// What a file says of its block.
#[derive(Default)]
struct Block {
    summary: String,
    /// Purpose, latency and so on, as the header has them.
    facts: Vec<(String, String)>,
    /// What is proven of it, and assumed for it.
    proof: Vec<(String, String)>,
    /// The rest of the header, as it stands there.
    rest: Vec<String>,
    generics: Vec<Entry>,
    ports: Vec<Entry>,
}

/// A generic, a port, or a heading between them (without a name).
#[derive(Default)]
struct Entry {
    name: String,
    kind: String,
    meaning: String,
}

/// The comment at the top of a file.
fn header(source: &str) -> Vec<&str> {
    source.lines().take_while(|line| line.starts_with("--")).collect()
}

/// A line of it without its dashes.
fn text(line: &&str) -> String {
    line.trim_start_matches("--").trim().to_owned()
}

/// Facts with their names: what follows without a name belongs to the one before.
fn facts(paragraph: &[&str]) -> Vec<(String, String)> {
    let mut facts: Vec<(String, String)> = Vec::new();
    for line in paragraph {
        let (key, fact) = line.split_at_checked(TEXT_COLUMN).unwrap_or((line, ""));
        match (text(&key).as_str(), facts.last_mut()) {
            ("", Some((_, before))) => *before += &format!(" {}", fact.trim()),
            (key, _) => facts.push((key.to_owned(), fact.trim().to_owned())),
        }
    }
    facts
}

/// The facts of a proof.
fn proven(source: &str) -> Vec<(String, String)> {
    header(source).split(|line| *line == "--").skip(2).flat_map(facts).collect()
}

/// Where the text of a fact begins in the header.
const TEXT_COLUMN: usize = 15;

impl Block {
    fn read(source: &str) -> anyhow::Result<Self> {
        let mut block = Self::default();
        let header = header(source);
        for paragraph in header.split(|line| *line == "--").filter(|paragraph| !paragraph.is_empty()) {
            if paragraph.iter().any(|line| line.starts_with("-- Purpose ")) {
                block.facts = facts(paragraph);
            } else if block.facts.is_empty() {
                let lines: Vec<String> = paragraph.iter().filter(|line| !line.contains("SPDX")).map(text).collect();
                block.summary += &lines.join(" ");
            } else {
                block.rest.extend(paragraph.iter().map(|line| line.trim_start_matches("--").to_owned()));
            }
        }
        let entity = source.split_once("\nentity ").and_then(|(_, rest)| rest.split_once("\nend entity"));
        let needed: &[&str] = match entity {
            Some(_) => &["Purpose", "Latency", "Resources", "Twin"],
            None => &["Purpose", "Twin"],
        };
        for fact in needed {
            ensure!(block.facts.iter().any(|(key, _)| key == fact), "no {fact}");
        }
        if let Some((entity, _)) = entity {
            block.generics = entries(entity, "  generic (");
            block.ports = entries(entity, "  port (");
        }
        Ok(block)
    }

    fn page(&self, name: &str, file: &str) -> anyhow::Result<String> {
        let mut page = format!("# {name}\n\n{} Source: [{file}](../../{file}).\n\n", self.summary);
        for (key, text) in self.facts.iter().filter(|(key, _)| key != "Resources") {
            page += &format!("* **{key}:** {text}\n");
        }
        let rows = synth::rows_of(name)?;
        if rows.is_empty() {
            for (key, text) in self.facts.iter().filter(|(key, _)| key == "Resources") {
                page += &format!("* **{key}:** {text}\n");
            }
        } else {
            page +=
                &format!("* **Resources** on a Virtex-6, clock rate on an ECP5-85F, speed 8:\n\n```text\n{rows}```\n");
            let share = synth::share_of_device(name)?;
            if !share.is_empty() {
                page += &format!("\n{share}\n");
            }
        }
        if !self.rest.is_empty() {
            page += &format!("\n```text\n{}\n```\n", self.rest.join("\n"));
        }
        if !self.proof.is_empty() {
            let size = match formal::size_of(name) {
                [] => String::new(),
                generics => format!(", with `{}`", generics.join(" ")),
            };
            page += &format!(
                "\n## Proven\n\nFor any length of time{size}, by `cargo xtask hw formal`: \
                 [formal/{name}.psl](../../formal/{name}.psl).\n\n"
            );
        }
        for (key, text) in &self.proof {
            page += &format!("* **{key}:** {text}\n");
        }
        for (title, first, entries) in [("Generics", "generic", &self.generics), ("Ports", "port", &self.ports)] {
            if !entries.is_empty() {
                page += &format!("\n## {title}\n\n| {first} | type | meaning |\n|---|---|---|\n");
            }
            for Entry { name, kind, meaning } in entries {
                page += &match name.as_str() {
                    "" => format!("| | | **{meaning}** |\n"),
                    name => format!("| `{name}` | `{kind}` | {meaning} |\n"),
                };
            }
        }
        Ok(page)
    }
}

/// The entries of a clause.
fn entries(entity: &str, clause: &str) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let lines = entity.lines().skip_while(|line| *line != clause).skip(1).take_while(|line| *line != "  );");
    for line in lines {
        let (code, comment) = line.split_once("--").unwrap_or((line, ""));
        let (code, comment) = (code.trim().trim_end_matches(';'), comment.trim().replace('|', "\\|"));
        if let Some((name, kind)) = code.split_once(':') {
            let kind = kind.split_whitespace().collect::<Vec<_>>().join(" ");
            entries.push(Entry { name: name.trim().to_owned(), kind, meaning: comment });
        } else if line.starts_with("    --") {
            entries.push(Entry { meaning: comment, ..Entry::default() });
        } else if let Some(entry) = entries.last_mut().filter(|_| !comment.is_empty()) {
            entry.meaning += &format!(" {comment}");
        }
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Does something.
--
-- Purpose     what it
--             is for
-- Latency     1
-- Resources   none
-- Twin        none
--
-- Result:     1  2
--             3  4

library ieee;

entity thing is
  generic (
    G_N : positive range 1 to 8 := 1  -- how many
  );
  port (
    clk   : in  std_ulogic;                        -- rising edge

    -- Results
    value : out std_ulogic_vector(G_N downto 0)    -- a value, that is
                                                   -- large
  );
end entity;
";

    #[test]
    fn a_page_has_what_the_source_says() {
        let page = Block::read(SOURCE).unwrap().page("thing", "rtl/thing.vhd").unwrap();
        let expected = "# thing

Does something. Source: [rtl/thing.vhd](../../rtl/thing.vhd).

* **Purpose:** what it is for
* **Latency:** 1
* **Twin:** none
* **Resources:** none

```text
 Result:     1  2
             3  4
```

## Generics

| generic | type | meaning |
|---|---|---|
| `G_N` | `positive range 1 to 8 := 1` | how many |

## Ports

| port | type | meaning |
|---|---|---|
| `clk` | `in std_ulogic` | rising edge |
| | | **Results** |
| `value` | `out std_ulogic_vector(G_N downto 0)` | a value, that is large |
";
        assert_eq!(page, expected);
    }

    #[test]
    fn a_page_has_what_is_proven_and_assumed() {
        let mut block = Block::read(SOURCE).unwrap();
        block.proof = proven(
            "-- SPDX-License-Identifier: MIT OR Apache-2.0\n--\n-- What is proven of thing.\n--\n\
             -- Assumed     nothing\n-- Proven      it does\n--             something\n\nvunit thing (thing(rtl)) {\n",
        );
        let page = block.page("thing", "rtl/thing.vhd").unwrap();
        let expected = "[formal/thing.psl](../../formal/thing.psl).\n\n* **Assumed:** nothing\n\
                        * **Proven:** it does something\n\n## Generics\n";
        assert!(page.contains(expected), "{page}");
    }

    #[test]
    fn a_header_without_a_fact_is_refused() {
        assert!(Block::read(&SOURCE.replace("-- Latency     1\n", "")).is_err());
        assert!(Block::read("--\n-- Something.\n\nlibrary ieee;\n").is_err());
    }
}
