//! A report as one self-contained HTML page: styles and pictures are inside, no script, nothing is fetched.

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("page.css");

/// The parts of a page.
#[derive(Debug)]
pub struct Page<'a> {
    /// Headline.
    pub title: &'a str,
    /// Facts below the headline, name and value.
    pub facts: Vec<(&'static str, String)>,
    /// The page itself.
    pub main: Markup,
    /// What the figures mean.
    pub footer: Markup,
}

impl Page<'_> {
    /// The page as HTML.
    pub fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    title { (self.title) }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    header {
                        h1 { (self.title) }
                        p .facts {
                            @for (name, value) in &self.facts { span { b { (name) } " " (value) } }
                            span { b { "karst" } " " (env!("CARGO_PKG_VERSION")) }
                        }
                    }
                    main { (self.main) }
                    footer { p { (self.footer) } }
                }
            }
        };
        page.into_string()
    }
}

/// A box with one figure.
pub fn card(name: &str, value: &str, note: &str) -> Markup {
    html! { div .card { div .name { (name) } div .value { (value) } div .note { (note) } } }
}
