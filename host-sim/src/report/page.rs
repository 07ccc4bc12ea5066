//! The page around the figures: one HTML file that needs nothing else.

use super::scale::shown;
use crate::cli;
use eha_monitor::channel::CHANNELS;
use eha_monitor::parameter::Parameter;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::Value;

/// The style sheet, part of every page.
const STYLE: &str = include_str!("style.css");

/// A headline figure.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    /// What it is.
    pub(super) name: String,
    /// Its value.
    pub(super) value: String,
    /// What belongs to it.
    pub(super) detail: String,
}

impl Tile {
    /// A headline figure.
    pub(super) fn new(name: impl Into<String>, value: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { name: name.into(), value: value.into(), detail: detail.into() }
    }
}

/// A report.
pub(super) struct Page<'a> {
    /// Kind of result.
    pub(super) title: &'a str,
    /// Verdict and its class in the style sheet.
    pub(super) badge: Option<(&'a str, &'a str)>,
    /// What the result says, in a sentence.
    pub(super) summary: String,
    /// Headline figures.
    pub(super) tiles: Vec<Tile>,
    /// Headings and what stands under them.
    pub(super) sections: Vec<(&'a str, Markup)>,
    /// The resolved configuration.
    pub(super) config: &'a Value,
}

impl Page<'_> {
    /// The file.
    pub(super) fn render(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    meta name="generator" content=(format!("host-sim {}", env!("CARGO_PKG_VERSION")));
                    title { (self.title) @if let Some((_, verdict)) = self.badge { ": " (verdict) } }
                    link rel="icon" href="data:,";
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    header {
                        h1 { (self.title) @if let Some((class, verdict)) = self.badge { span.badge.(class) { (verdict) } } }
                        p.summary { (self.summary) }
                    }
                    @if !self.tiles.is_empty() {
                        div.tiles { @for tile in &self.tiles {
                            div.tile {
                                div.name { (tile.name) } div.value { (tile.value) } div.detail { (tile.detail) }
                            }
                        } }
                    }
                    main {
                        @for (heading, content) in &self.sections {
                            section { h2 { (heading) } div.grid { (content) } }
                        }
                        section {
                            h2 { "Configuration" }
                            div.grid { div.card.wide { (configuration(self.config)) } }
                        }
                    }
                    footer { "host-sim " (env!("CARGO_PKG_VERSION")) }
                }
            }
        };
        page.into_string()
    }
}

/// A table as a card; columns of numbers are aligned to the right.
pub(super) fn table(title: &str, note: &str, header: &[&str], rows: &[Vec<String>], wide: bool) -> Markup {
    let is_number =
        |cell: &str| cell.trim_start_matches(['-', '−', '+']).starts_with(|c: char| c.is_ascii_digit());
    let is_text = |column: usize| {
        let mut cells = rows.iter().filter_map(|row| row.get(column)).filter(|cell| *cell != "-").peekable();
        cells.peek().is_some() && !cells.any(|cell| is_number(cell))
    };
    let text: Vec<bool> = (0..header.len()).map(is_text).collect();
    html! {
        figure.card .wide[wide] {
            figcaption { span.title { (title) } }
            div.scroll { table {
                thead { tr { @for (name, &text) in header.iter().zip(&text) { th.text[text] { (name) } } } }
                tbody { @for row in rows { tr { @for (cell, &text) in row.iter().zip(&text) { td.text[text] { (cell) } } } } }
            } }
            @if !note.is_empty() { p.note { (note) } }
        }
    }
}

/// Sentences as a card.
pub(super) fn remarks(title: &str, remarks: &[String]) -> Markup {
    html! {
        div.card.wide { h3 { (title) } ul { @for remark in remarks { li { (remark) } } } }
    }
}

fn configuration(config: &Value) -> Markup {
    let command_line = Value::String(cli::command_line());
    let entries = config.as_object().into_iter().flatten().map(|(name, value)| (name.as_str(), value));
    html! {
        dl.configuration { @for (name, value) in [("command line", &command_line)].into_iter().chain(entries) {
            @if !value.is_null() { dt { (name.replace('_', " ")) } dd { (in_words(value)) } }
        } }
    }
}

/// The value of a parameter with its unit; of anything else, the value.
fn with_unit(name: &str, value: &Value) -> String {
    match (Parameter::named(name), value.as_f64()) {
        (Some(parameter), Some(value)) => shown(value, parameter.info().unit),
        _ => in_words(value),
    }
}

/// A name as a rig file spells it: its own entries with hyphens, parameters and channels as they are.
fn spelled(name: &str) -> String {
    if Parameter::named(name).is_some() || CHANNELS.iter().any(|row| row.column == name) {
        name.to_owned()
    } else {
        name.replace('_', "-")
    }
}

/// A JSON value without the marks of the notation.
fn in_words(value: &Value) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(entries) if entries.is_empty() => "none".to_owned(),
        Value::Array(entries) => {
            let separator = if entries.iter().any(Value::is_object) { "; " } else { ", " };
            entries.iter().map(in_words).collect::<Vec<_>>().join(separator)
        }
        Value::Object(members) if members.contains_key("lower") && members.contains_key("upper") => {
            let name = in_words(&value["name"]);
            let [lower, upper] = ["lower", "upper"].map(|end| with_unit(&name, &value[end]));
            format!("{name} {lower} to {upper}")
        }
        Value::Object(members) => {
            let known = members.iter().filter(|(_, value)| !value.is_null());
            let words: Vec<String> = known
                .map(|(name, value)| format!("{} = {}", spelled(name), with_unit(name, value)))
                .collect();
            if words.is_empty() { "none".to_owned() } else { words.join(", ") }
        }
        other => other.to_string(),
    }
}
