//! The named columns of a file: which of them are channels, and what is told of the others.

use eha_monitor::channel::{Channel, ChannelInfo};

use super::ReadOptions;
use super::error::{MOST_LISTED, Problem, SHOWN_OF_NAME, listed, printable};
use super::mapping::{Found, suggestion};

/// The columns of a file that has them by name.
pub(super) struct Header {
    /// Every name, in order.
    pub(super) names: Vec<String>,
    /// Those that are channels; the source is the place among the names.
    pub(super) columns: Vec<Found<usize>>,
}

impl Header {
    /// Finds the channels among the names.
    ///
    /// # Errors
    ///
    /// A channel that is missing, or one whose name is there twice: then with place and name of the second.
    pub(super) fn new(
        names: Vec<String>,
        options: &ReadOptions,
    ) -> Result<Self, (Problem, Option<(usize, String)>)> {
        let mut twice = None;
        let columns = options.columns.resolve(
            |info| options.wanted(info),
            &names,
            || names.clone(),
            |name| {
                let exact = names.iter().any(|other| other == name);
                let is_it =
                    |other: &String| if exact { other == name } else { closed_up(other) == closed_up(name) };
                let mut places = (0..names.len()).filter(|&index| is_it(&names[index]));
                let first = places.next()?;
                twice = twice.or(places.next().map(|second| (first, second)));
                Some(first)
            },
        );
        if let Some((first, second)) = twice {
            return Err((Problem::Duplicate { first: first + 1 }, Some((second, names[second].clone()))));
        }
        let columns = columns.map_err(|problem| (problem, None))?;
        Ok(Self { names, columns })
    }

    /// A warning about the columns that no channel takes.
    pub(super) fn unused(&self, options: &ReadOptions) -> Option<String> {
        // With a rate, no other time is asked for.
        let is_asked_for =
            |info: &ChannelInfo| info.channel != Channel::Time || options.sample_rate_hz.is_none();
        let is_unused = |index: usize| self.columns.iter().all(|column| column.source != index);
        let named = self.names.iter().enumerate().filter(|(_, name)| !name.is_empty());
        let unused = named.filter(|(index, _)| is_unused(*index)).map(|(_, name)| {
            let shown = printable(name, SHOWN_OF_NAME);
            match suggestion(name, is_asked_for) {
                Some(hint) => (true, format!("`{shown}` ({hint})")),
                None => (false, format!("`{shown}`")),
            }
        });
        let mut unused: Vec<(bool, String)> = unused.collect();
        // Of more than are listed, those that may be meant come first.
        if unused.len() > MOST_LISTED {
            unused.sort_by_key(|(is_meant, _)| !is_meant);
        }
        let listed = listed(unused.iter().map(|(_, text)| text.clone()));
        (!unused.is_empty()).then(|| format!("columns not used: {listed}"))
    }
}

/// A name without the spaces before its unit in brackets.
fn closed_up(name: &str) -> String {
    match name.rsplit_once('[') {
        Some((name, unit)) => format!("{}[{unit}", name.trim_end()),
        None => name.to_owned(),
    }
}
