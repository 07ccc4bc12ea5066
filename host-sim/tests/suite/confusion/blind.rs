//! Cases that nobody chose: drawn at random, and judged by the figures that matter to a user.

use super::cases::{
    CHANNEL_SETS, Case, ChannelSet, Diagnosed, OUTSIDE, OUTSIDE_DRAWN, Outcome, PERIOD, Presence, Program,
};
use super::floor::{self, Shape};
use crate::common::Rig as Truth;
use eha_monitor::effect::{EFFECTS, EffectInfo, Port};
use host_sim::diagnose::{self, Diagnosis};
use host_sim::fit;
use host_sim::record::save_csv;
use host_sim::rig::{CommandPath, Range, Rig};
use rayon::prelude::*;
use reference_plant::{Command, Gauss, Rule};
use std::fmt::Write as _;
use std::io;
use std::ops::Range as Between;
use std::path::Path;

/// Cases of the document: numbers that nobody had looked at when it was made.
const FIRST: u64 = 24_300;
const COUNT: u64 = 48;
/// Sizes of the effects, in their floors.
const FAINTEST: f64 = 2.0;
const STRONGEST: f64 = 10.0;
/// Least floor of an effect that is drawn, in its sizes: the steps of the plant do not follow a mount that is stiffer still.
const LEAST_FLOOR: f64 = 1e-4;
/// Coarsest steps of the positions, m: 12 bits over 80 mm.
const COARSEST: f64 = 20e-6;
/// Last digit of commands and positions in a file, m: steps are no whole number of it.
const LAST_DIGIT: f64 = 1e-9;
/// Sets of channels: each case has one.
static SETS: [&ChannelSet; 2] = [&CHANNEL_SETS[0], &CHANNEL_SETS[2]];
/// What the cases are, in turn.
const KINDS: [Kind; 12] = {
    use Kind::{Clean, Outside, Pair, Single};
    [Clean, Single, Outside, Single, Pair, Single, Clean, Single, Outside, Single, Pair, Single]
};

/// What a case is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Nothing but the faults.
    Clean,
    /// One effect of the catalogue.
    Single,
    /// Two effects of the catalogue.
    Pair,
    /// Something outside the catalogue.
    Outside,
}

/// A drawn case, and what became of it.
pub(crate) struct Blind {
    index: u64,
    kind: Kind,
    set: usize,
    what: String,
    outcome: Outcome,
    found: String,
    /// Misfit of the held-out position, as a multiple of what the true model reaches; none where no model is true.
    ratio: Option<f64>,
    /// Which of the effects the records show to who knows them.
    shown: Vec<bool>,
    /// For each fault: relative error of the estimate, and does its interval hold the truth?
    faults: Vec<(f64, bool)>,
    /// What the diagnosis took, s of one core.
    effort_s: f64,
}

/// A figure of the document.
struct Figure {
    name: &'static str,
    wanted: &'static str,
    value: fn(&[&Blind]) -> String,
}

const FIGURES: [Figure; 11] = [
    Figure {
        name: "clean records called adequate",
        wanted: "95 %",
        value: |cases| share_right(cases, Kind::Clean),
    },
    Figure {
        name: "one effect: named, or in a class",
        wanted: "90 % with the position, 95 % with all channels",
        value: |cases| share_right(cases, Kind::Single),
    },
    Figure {
        name: "two effects: both named, or in classes",
        wanted: "80 %",
        value: |cases| share_right(cases, Kind::Pair),
    },
    Figure {
        name: "outside the catalogue: unexplained, or modelled",
        wanted: "85 %",
        value: |cases| share_right(cases, Kind::Outside),
    },
    Figure {
        name: "in the catalogue, but called unexplained",
        wanted: "at most 5 %",
        value: |cases| {
            share(cases, |case| !case.is(Kind::Outside), |case| case.outcome == Outcome::Unexplained)
        },
    },
    Figure {
        name: "held-out error within 1.12 of the true model's",
        wanted: "-",
        value: |cases| {
            share(cases, |case| case.ratio.is_some(), |case| case.ratio.is_some_and(|ratio| ratio < 1.12))
        },
    },
    Figure { name: "median error of `bkl`", wanted: "0.5 %", value: |cases| median_error(cases, 0) },
    Figure { name: "median error of `fdj`", wanted: "1.5 %", value: |cases| median_error(cases, 1) },
    Figure {
        name: "intervals of faults that hold the truth",
        wanted: "90 %",
        value: |cases| {
            let faults: Vec<_> =
                cases.iter().filter(|case| !case.is(Kind::Outside)).flat_map(|case| &case.faults).collect();
            format!("{} of {}", faults.iter().filter(|(_, covered)| *covered).count(), faults.len())
        },
    },
    Figure {
        name: "effort in the catalogue, s of one core: median, most",
        wanted: "20 for two records of 1 s",
        value: |cases| efforts(cases, |case| !case.is(Kind::Outside)),
    },
    Figure {
        name: "effort outside it: median, most",
        wanted: "20 for two records of 1 s",
        value: |cases| efforts(cases, |case| case.is(Kind::Outside)),
    },
];

fn share(cases: &[&Blind], of: impl Fn(&Blind) -> bool, is: impl Fn(&Blind) -> bool) -> String {
    let of: Vec<_> = cases.iter().filter(|case| of(case)).collect();
    format!("{} of {}", of.iter().filter(|case| is(case)).count(), of.len())
}

fn share_right(cases: &[&Blind], kind: Kind) -> String {
    share(cases, |case| case.is(kind), Blind::is_right)
}

fn median_error(cases: &[&Blind], fault: usize) -> String {
    let mut errors: Vec<f64> =
        cases.iter().filter(|case| !case.is(Kind::Outside)).map(|case| case.faults[fault].0).collect();
    errors.sort_by(f64::total_cmp);
    errors.get(errors.len() / 2).map_or_else(|| "-".to_owned(), |error| format!("{:.2} %", 100.0 * error))
}

fn efforts(cases: &[&Blind], of: impl Fn(&Blind) -> bool) -> String {
    let mut efforts: Vec<f64> = cases.iter().filter(|case| of(case)).map(|case| case.effort_s).collect();
    efforts.sort_by(f64::total_cmp);
    let median = efforts.get(efforts.len() / 2).zip(efforts.last());
    median.map_or_else(|| "-".to_owned(), |(median, most)| format!("{median:.0}, {most:.0}"))
}

/// A number whose logarithm is as likely anywhere in a range.
fn log_uniform(random: &mut Gauss, range: Between<f64>) -> f64 {
    range.start * (range.end / range.start).powf(random.uniform())
}

fn one_of<'a, T>(random: &mut Gauss, of: &'a [T]) -> &'a T {
    &of[(random.uniform() * of.len() as f64) as usize]
}

impl Case {
    /// A drawn case, what it is, and the number of its set of channels.
    fn numbered(index: u64) -> (Kind, usize, Self) {
        let set = index as usize % SETS.len();
        let turn = index as usize / SETS.len();
        let kind = KINDS[turn % KINDS.len()];
        (kind, set, Self::drawn(kind, SETS[set], index.wrapping_mul(0x2545_f491_4f6c_dd1d)))
    }

    /// A case of which everything is drawn from a seed: faults, effects, their sizes, signs and shapes, noise,
    /// resolution, commands and durations.
    fn drawn(kind: Kind, set: &'static ChannelSet, seed: u64) -> Self {
        let mut random = Gauss::new(seed);
        let bkl = log_uniform(&mut random, 5e-5..1e-3);
        let fdj = log_uniform(&mut random, 200.0..3000.0);
        let position = log_uniform(&mut random, 1e-6..1e-5);
        let noise =
            [position, position, log_uniform(&mut random, 0.01..0.05), log_uniform(&mut random, 2e4..1e5)];
        let is_quantised = random.uniform() < 0.5;
        let quantum = (position * log_uniform(&mut random, 0.5..10.0)).min(COARSEST);
        let quantum = if is_quantised { quantum } else { 0.0 };
        let samples = (1000.0 * log_uniform(&mut random, 1.0..5.0)) as usize;
        let chirp = Command::Chirp { amplitude: log_uniform(&mut random, 3e-3..1e-2) };
        let [mixed, other] = if random.uniform() < 0.5 {
            [Command::Mixed, Command::MixedStep]
        } else {
            [Command::MixedStep, Command::Mixed]
        };
        let sine = Command::Sine {
            amplitude: log_uniform(&mut random, 2e-3..6e-3),
            frequency: log_uniform(&mut random, 1.0..5.0),
        };
        let held = one_of(&mut random, &[other, sine, Command::CHIRP_LOW]).clone();
        let held_samples = (1000.0 * log_uniform(&mut random, 1.0..2.0)) as usize;
        let of_valve: Vec<&'static EffectInfo> =
            EFFECTS.iter().filter(|effect| effect.port != Port::Drive).collect();
        let outside = (kind == Kind::Outside).then(|| {
            let all: Vec<_> = OUTSIDE.iter().chain(&OUTSIDE_DRAWN).collect();
            let outside = *one_of(&mut random, &all);
            (outside, [log_uniform(&mut random, 0.5..2.0), log_uniform(&mut random, 0.5..2.0)])
        });
        let mut case = Self {
            effects: Vec::new(),
            outside,
            set,
            seed,
            bkl,
            fdj,
            noise,
            quantum,
            train: [(chirp, samples), (mixed, samples)],
            held: (held, held_samples),
            program: Program::default(),
        };
        let count = match kind {
            Kind::Clean | Kind::Outside => 0,
            Kind::Single => 1,
            Kind::Pair => 2,
        };
        while case.effects.len() < count {
            let effect = *one_of(&mut random, &of_valve);
            let floors = log_uniform(&mut random, FAINTEST..STRONGEST);
            let reversed = random.uniform() < 0.5;
            let shape = Shape { reversed, stretch: log_uniform(&mut random, 0.5..2.0) };
            let is_there = case.effects.iter().any(|present| present.effect.name == effect.name);
            let floor = floor::of(effect, &shape, &case);
            let most = shape.most(effect) / floor;
            let is_followed = floor > LEAST_FLOOR * effect.sizes[0];
            if !is_there && is_followed && most > FAINTEST {
                case.effects.push(Presence { effect, floors: floors.min(most), shape });
            }
        }
        case.program = Program {
            path: *one_of(&mut random, &[CommandPath::Lines, CommandPath::Curve]),
            rule: *one_of(&mut random, &[Rule::Midpoint, Rule::SemiImplicitEuler]),
            is_exact: set.channels.len() > 1 && *one_of(&mut random, &[false, true]),
            later: if random.uniform() < 0.5 { PERIOD * random.uniform() } else { 0.0 },
            last_digit: LAST_DIGIT,
        };
        case
    }

    /// What is in the case, in words.
    fn what(&self) -> String {
        let effects = self.effects.iter().map(|present| {
            let sign = if present.shape.reversed { "reversed " } else { "" };
            format!("{sign}{} x{:.1}", present.effect.name, present.floors)
        });
        let outside = self.outside.iter().map(|(outside, [strength, pace])| {
            format!("{}, times {strength:.2}, {pace:.2} times as fast", outside.name)
        });
        let all: Vec<String> = effects.chain(outside).collect();
        let what = if all.is_empty() { "nothing".to_owned() } else { all.join(" and ") };
        let Program { path, later, rule, is_exact, .. } = self.program;
        let words = [
            (path == CommandPath::Curve, ", curve"),
            (later > 0.0, ", between"),
            (rule == Rule::SemiImplicitEuler, ", Euler"),
            (is_exact, ", exact"),
        ];
        what + &words.iter().filter(|(is_so, _)| *is_so).map(|(_, word)| *word).collect::<String>()
    }
}

/// What can be known of a case by who knows the truth.
struct Oracle {
    /// Root mean square of the held-out position that the model with the true effects leaves, m.
    held_out: f64,
    /// Which of the effects the records show: without it, the others kept, they fit worse by more than its price.
    shown: Vec<bool>,
}

impl Oracle {
    fn of(case: &Case, diagnosed: &Diagnosed) -> Self {
        let (train, held) = diagnosed.records.split_at(case.train.len());
        let all: Vec<&Presence> = case.effects.iter().collect();
        let fitted = |effects: &[&Presence], records| {
            let (rig, ranges, start) = true_model(effects, &diagnosed.truth);
            let fit = fit::polish(&rig, &ranges, &start, records).unwrap();
            (fit.applied(&rig, &ranges), fit.misfit)
        };
        let held_out = diagnose::score(&fitted(&all, train).0, held).position_rms();
        let with = fitted(&all, &diagnosed.records).1;
        let is_shown = |index: usize| {
            let mut others = all.clone();
            let effect = others.remove(index).effect;
            let rise = fitted(&others, &diagnosed.records).1.chi_square - with.chi_square;
            rise > floor::price(effect, with.count)
        };
        Self { held_out, shown: (0..all.len()).map(is_shown).collect() }
    }
}

/// The monitor's model with faults and effects as they are, what is free in it, and the true values.
fn true_model(effects: &[&Presence], truth: &Truth) -> (Rig, Vec<Range>, Vec<f64>) {
    let mut rig = Rig::load("eha").unwrap();
    rig.parameters.bkl = truth.parameters.bkl;
    rig.parameters.fdj = truth.parameters.fdj;
    let mut ranges = rig.faults.clone();
    for effect in effects.iter().map(|present| present.effect) {
        rig.effects.push(effect);
        for &parameter in effect.parameters {
            let (info, value) = (parameter.info(), truth.parameters.get(parameter));
            rig.parameters.set(parameter, value);
            // What is as it is without the effect has no width of its own, and is known.
            if value != info.default {
                ranges.push(Range::around(parameter, value, 2.0 * (value - info.default).abs()));
            }
        }
    }
    let start = ranges.iter().map(|range| truth.parameters.get(range.parameter)).collect();
    (rig, ranges, start)
}

/// What a diagnosis found, in words.
pub(crate) fn found(diagnosis: &Diagnosis) -> String {
    let of_one = |found: &diagnose::Found| {
        let class: Vec<&str> = found.class.iter().map(|effect| effect.name).collect();
        format!("{}{}", if found.named { "" } else { "term " }, class.join(" or "))
    };
    let all: Vec<String> = diagnosis.found.iter().map(of_one).collect();
    if all.is_empty() { "nothing".to_owned() } else { all.join("; ") }
}

/// Saves the records of drawn cases to a folder of each: two to fit, and one to hold out.
pub(crate) fn save(indices: &[u64], folder: &Path) -> io::Result<()> {
    for &index in indices {
        let (.., case) = Case::numbered(index);
        let folder = folder.join(index.to_string());
        std::fs::create_dir_all(&folder)?;
        let comments =
            [format!("case {index}: {}, bkl {:e} m, fdj {:.1} N", case.what(), case.bkl, case.fdj)];
        for (record, name) in case.records().iter().zip(["train-1", "train-2", "held-out"]) {
            save_csv(record, &comments, &folder.join(name).with_extension("csv"))?;
        }
    }
    Ok(())
}

impl Blind {
    /// Draws a case and diagnoses it.
    pub(crate) fn new(index: u64) -> Self {
        let (kind, set, case) = Case::numbered(index);
        let diagnosed = case.diagnosed();
        let oracle = Oracle::of(&case, &diagnosed);
        let holdout = diagnosed.diagnosis.holdout;
        let faults = diagnosed.diagnosis.faults.iter().zip([case.bkl, case.fdj]).map(|(fault, truth)| {
            let [lower, upper] = fault.estimate.ci95;
            ((fault.estimate.value / truth - 1.0).abs(), (lower..=upper).contains(&truth))
        });
        Self {
            index,
            kind,
            set,
            what: case.what(),
            outcome: case.outcome(&diagnosed.diagnosis, &oracle.shown),
            found: found(&diagnosed.diagnosis),
            ratio: holdout
                .filter(|_| kind != Kind::Outside)
                .map(|[_, after]| after.position_rms() / oracle.held_out),
            shown: oracle.shown,
            faults: faults.collect(),
            effort_s: diagnosed.diagnosis.effort_s(),
        }
    }

    fn is(&self, kind: Kind) -> bool {
        self.kind == kind
    }

    fn is_named(&self) -> bool {
        let unseen = self.outcome == Outcome::Adequate && !self.shown.contains(&true);
        unseen || matches!(self.outcome, Outcome::Named(_))
    }

    fn is_right(&self) -> bool {
        match self.kind {
            Kind::Clean => self.outcome == Outcome::Adequate,
            Kind::Single | Kind::Pair => self.is_named(),
            Kind::Outside => self.outcome.is_right_of_outside(),
        }
    }

    /// The row of the case.
    fn line(&self) -> String {
        let ratio = self.ratio.map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.2}"));
        let errors: Vec<String> = self
            .faults
            .iter()
            .map(|(error, covered)| {
                format!("{:.2} %{}", 100.0 * error, if *covered { "" } else { " (outside)" })
            })
            .collect();
        format!(
            "| {} | {} | {} | {} | {}{} | {ratio} | {} |",
            self.index,
            self.what,
            SETS[self.set].name,
            self.found,
            self.outcome.cell(),
            if self.is_right() { "" } else { " **(not right)**" },
            errors.join(", "),
        )
    }
}

/// The index of the case of a documented row.
pub(crate) fn documented(line: &str) -> Option<u64> {
    line.strip_prefix("| ")?.split(" | ").next()?.parse().ok()
}

/// Rows of drawn cases, made side by side, each shown as soon as it is made.
pub(crate) fn lines(indices: &[u64]) -> Vec<String> {
    drawn(indices).iter().map(Blind::line).collect()
}

fn drawn(indices: &[u64]) -> Vec<Blind> {
    indices
        .par_iter()
        .map(|&index| Blind::new(index))
        .inspect(|blind| eprintln!("{}", blind.line()))
        .collect()
}

/// The whole document.
pub(crate) fn document() -> String {
    let cases = drawn(&(FIRST..FIRST + COUNT).collect::<Vec<_>>());
    let mut text = format!(
        "# Records that nobody chose\n\n\
         Made by `cargo xtask blind`; do not edit. {COUNT} actuators of the independent plant (`tests/plant`), everything drawn \
         at random: faults (0.05 to 1 mm, 200 to 3000 N), effects of the catalogue at {FAINTEST} to {STRONGEST} times their floor \
         (see [confusion.md](confusion.md)) with either sign, or something outside it, half to twice as strong and as fast; \
         1 to 10 um of noise, half of the records in steps of half to ten times that (at most 20 um), all written to the nanometre; a chirp of 3 to 10 mm and a mixed \
         command of 1 to 5 s are fitted, 1 to 2 s of another command are held out; half of the actuators fly the commands in straight \
         lines between the samples of their records, half as the continuous functions (*curve*) that they are; half start their commands a part of a sample after the first one, so that \
         jumps and corners come *between* samples; half step as the \
         source does (*Euler*, 2 us), half at second order; half of those with all channels have noise in the user position \
         alone (*exact*). None of them was looked at before: development had used numbers below {FIRST}. `cargo xtask blind {FIRST}` makes case {FIRST} anew.\n\n\
         An effect counts where who knows the truth can see it: without it, the other true effects kept, the records fit worse by more than its price.\n\n"
    );
    let _ = writeln!(text, "| figure | wanted | {} | {} |\n|---|---|---|---|", SETS[0].name, SETS[1].name);
    for figure in FIGURES {
        let cells: Vec<String> = (0..SETS.len())
            .map(|set| (figure.value)(&cases.iter().filter(|case| case.set == set).collect::<Vec<_>>()))
            .collect();
        let _ = writeln!(text, "| {} | {} | {} |", figure.name, figure.wanted, cells.join(" | "));
    }
    text.push_str(
        "\n*held out*: what is left of the held-out position, as a multiple of what the model with the true effects leaves. \
         *faults*: errors of `bkl` and `fdj`; *outside*: the interval of 95 % does not hold the truth.\n\n\
         | case | what | channels | found | outcome | held out | faults |\n|---|---|---|---|---|---|---|\n",
    );
    for case in &cases {
        let _ = writeln!(text, "{}", case.line());
    }
    text
}
