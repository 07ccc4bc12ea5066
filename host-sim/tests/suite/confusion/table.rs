//! The document: rows of outcomes, and how they add up.

use super::cases::{CHANNEL_SETS, Case, ChannelSet, OUTSIDE, Outcome, Outside};
use eha_monitor::effect::{EFFECTS, Port};
use rayon::prelude::*;
use std::fmt::Write as _;

/// Sizes of an effect alone, in its floors.
const SIZES: [f64; 3] = [0.5, 1.0, 2.0];
/// Size of each of two effects, in their floors.
const PAIR_SIZE: f64 = 4.0;
/// Channels of the pairs, and of what is outside the catalogue.
static USUAL: &ChannelSet = &CHANNEL_SETS[1];
/// Clean actuators for each set of channels.
const CLEAN: u64 = 8;
/// Pairs that are studied: of different ports, of the same, one large against one small.
const PAIRS: [&str; 6] = [
    "turbulent-metering+spool-overlap",
    "constant-load+turbulent-metering",
    "sensor-lag+leakage",
    "torque-motor-hysteresis+viscous-friction",
    "spool-friction+supply-pressure",
    "load-mass+sensor-offset",
];

/// A row of the document.
pub(crate) struct Row {
    name: String,
    outcomes: Vec<Outcome>,
}

/// A table of the document.
pub(crate) struct Section {
    title: &'static str,
    columns: &'static [&'static str],
    rows: Vec<Row>,
    /// Is an outcome what is hoped for?
    is_right: fn(&Outcome) -> bool,
}

impl Row {
    fn of(name: &str, set: &ChannelSet, cases: impl IntoIterator<Item = Case>) -> Self {
        let outcome = |case: Case| case.outcome(&case.diagnosed().diagnosis, &vec![true; case.effects.len()]);
        Self {
            name: format!("{} | {}", name.replace('+', " and "), set.name),
            outcomes: cases.into_iter().map(outcome).collect(),
        }
    }

    /// An effect alone, at each size.
    pub(crate) fn single(name: &'static str, set: &'static ChannelSet) -> Self {
        Self::of(name, set, SIZES.map(|size| Case::new(name, size, set, 0)))
    }

    /// Clean actuators.
    pub(crate) fn clean(set: &'static ChannelSet) -> Self {
        Self::of("nothing", set, (0..CLEAN).map(|seed| Case::new("", 0.0, set, seed)))
    }

    /// The row as the document has it.
    pub(crate) fn line(&self) -> String {
        let cells: Vec<String> = self.outcomes.iter().map(Outcome::cell).collect();
        format!("| {} | {} |", self.name, cells.join(" | "))
    }
}

/// The effect and the channels of a documented row of a single effect.
pub(crate) fn documented_single(line: &str) -> Option<(&str, &'static str, &'static ChannelSet)> {
    let mut cells = line.split(" | ");
    let name = cells.next()?.strip_prefix("| ")?;
    let channels = cells.next()?;
    let effect = EFFECTS.iter().find(|effect| effect.name == name)?;
    let set = CHANNEL_SETS.iter().find(|set| set.name == channels)?;
    Some((line, effect.name, set))
}

impl Outcome {
    pub(crate) fn cell(&self) -> String {
        match self {
            Self::Adequate => "adequate".to_owned(),
            Self::Named(1) => "named".to_owned(),
            Self::Named(count) => format!("named, one of {count}"),
            Self::Surplus => "named, and more".to_owned(),
            Self::Wrong => "wrong name".to_owned(),
            Self::Unexplained => "unexplained".to_owned(),
            Self::Modelled => "modelled".to_owned(),
        }
    }
}

/// A row for each of some things, made side by side, each shown as soon as it is made.
fn rows<T: Sync>(of: &[T], row: impl Fn(&T) -> Row + Sync + Send) -> Vec<Row> {
    of.par_iter().map(row).inspect(|row| eprintln!("{}", row.line())).collect()
}

/// Runs every case.
pub(crate) fn sections() -> Vec<Section> {
    // A valve drives these actuators.
    let of_valve = || EFFECTS.iter().filter(|effect| effect.port != Port::Drive);
    let singles: Vec<(&'static str, &'static ChannelSet)> =
        CHANNEL_SETS.iter().flat_map(|set| of_valve().map(move |effect| (effect.name, set))).collect();
    vec![
        Section {
            title: "Clean actuators",
            columns: &["effect", "channels", "1", "2", "3", "4", "5", "6", "7", "8"],
            rows: rows(&CHANNEL_SETS.each_ref(), |set| Row::clean(set)),
            is_right: |outcome| *outcome == Outcome::Adequate,
        },
        Section {
            title: "One effect, at half, once and twice its floor",
            columns: &["effect", "channels", "half", "once", "twice"],
            rows: rows(&singles, |(name, set)| Row::single(name, set)),
            is_right: |outcome| matches!(outcome, Outcome::Named(_)),
        },
        Section {
            title: "Two effects, each at four times its floor",
            columns: &["effects", "channels", "outcome"],
            rows: rows(&PAIRS, |pair| Row::of(pair, USUAL, [Case::new(pair, PAIR_SIZE, USUAL, 0)])),
            is_right: |outcome| matches!(outcome, Outcome::Named(_)),
        },
        Section {
            title: "Outside the catalogue",
            columns: &["what", "channels", "outcome"],
            rows: rows(&OUTSIDE, |Outside { name, .. }| {
                Row::of(name, USUAL, [Case::new(name, 1.0, USUAL, 0)])
            }),
            is_right: Outcome::is_right_of_outside,
        },
    ]
}

impl Section {
    fn write(&self, text: &mut String) {
        let _ = writeln!(text, "\n## {}\n", self.title);
        let _ = writeln!(text, "| {} |\n|{}", self.columns.join(" | "), "---|".repeat(self.columns.len()));
        for row in &self.rows {
            let _ = writeln!(text, "{}", row.line());
        }
        let _ = writeln!(text);
        if self.columns[2] == "half" {
            for (column, name) in self.columns[2..].iter().enumerate() {
                self.sum(text, &format!("at {name}"), |row| row.outcomes[column..=column].iter());
            }
        } else {
            self.sum(text, "in all", |row| row.outcomes.iter());
        }
    }

    fn sum<'a, I: Iterator<Item = &'a Outcome>>(
        &'a self,
        text: &mut String,
        what: &str,
        pick: impl Fn(&'a Row) -> I,
    ) {
        let outcomes: Vec<&Outcome> = self.rows.iter().flat_map(&pick).collect();
        let count = |is: &dyn Fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| is(outcome)).count();
        let _ = writeln!(
            text,
            "- {what}: right {} of {}, adequate {}, unexplained {}, with a wrong name {}",
            count(&self.is_right),
            outcomes.len(),
            count(&|outcome| *outcome == Outcome::Adequate),
            count(&|outcome| *outcome == Outcome::Unexplained),
            count(&|outcome| matches!(outcome, Outcome::Wrong | Outcome::Surplus)),
        );
    }
}

/// The whole document.
pub(crate) fn document(sections: &[Section]) -> String {
    let mut text = String::from(
        "# What `diagnose` makes of what it is not told\n\n\
         Made by `cargo xtask confusion`; do not edit. Records of the independent plant (`tests/plant`): a chirp and the \
         mixed command of 1.5 s each are fitted, 1.2 s of another command are held out. Faults (0.05 to 0.35 mm, 300 to \
         1500 N), the noise of the position (1 to 10 um, one case in three quantised as well) and the held-out command \
         differ from row to row and are not told; the current has 0.02 mA of noise, the pressure 50 kPa.\n\n\
         The *floor* of an effect is the size at which, the faults refitted, it is expected to lower chi-square by the \
         price of claiming it and to change a channel by more than the model's own error (0.3 um, 3 uA, 3 kPa). At once \
         the floor half of the claims are a matter of luck; below it nothing should be claimed.\n\n\
         *named*: the effect is found, and no other. *one of 3*: in a class of three that the records cannot tell apart. *modelled*: \
         effects stand in for what is outside the catalogue, and bring the held-out record to 1.5 times its noise.\n",
    );
    for section in sections {
        section.write(&mut text);
    }
    text
}
