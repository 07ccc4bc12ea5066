//! Closing the loop: from a residual to a named missing effect, or to an honest "I cannot tell".
//!
//! ```text
//! fit the declared faults
//!        |
//!        v
//! look at every effect of the catalogue beside them (linear), fit the promising ones --> evidence
//!        |
//!        v
//! keep the best few hypotheses, grow each by another effect, until one leaves noise or nothing helps (up to five)
//!        |
//!        v
//! none leaves noise: any effect beside a first that explains nearly all? Each effect of the best beside the others?
//! Faults and one effect anew in all of their ranges (genetic)? Grow what is better
//!        |
//!        v
//! drop what does not earn its place beside the others: significant, matters, validates on the held-out records
//!        |
//!        v
//! which effects could stand in for each that is left? --> its class, or its place
//! residual noise? adequate or explained : unexplained, and what helps the held-out records is kept as empirical terms
//!        |
//!        v
//! not adequate: do commands that jump between samples explain it better? Then anew, with that
//!        |
//!        v
//! unexplained: is it noise if the noise is coloured? Then anew, with that
//!        |
//!        v
//! not adequate: does one parameter of the rig that no effect changes explain it as well? Then the rig is in doubt
//! ```

mod between;
mod candidate;
mod case;
mod conclusion;
pub mod description;
mod diagnosis;
mod doubt;
mod growth;
mod hypothesis;
mod jumps;
mod onset;
mod place;
pub mod progress;
mod readings;
pub mod residual;
mod ripple;
mod search;
mod side;
mod signature;
mod so_far;
mod timing;
mod trade;
mod weighing;

pub use case::{Case, EFFORT_BOUNDS_S, EFFORT_PER_SECOND};
pub use diagnosis::{Diagnosis, Early, Fault, Found, Reached, Score, Verdict, score};
pub use doubt::Doubt;
pub use side::Side;

use crate::fit::{self, Fit, FitSettings, Prepared};
use between::{Between, Jumping};
use progress::{Log, Progress, Watch};
use readings::{DECLARED, Declared, ROOT_SEEDS, diagnose_beside, diagnose_held, diagnose_in_noise};
use residual::MEASURED;
use so_far::SoFar;
use std::sync::atomic::{AtomicBool, Ordering};

/// Share of a diagnosis in which jumps between samples are timed first, and most of its effort that this may take.
const TIMING: f64 = 0.05;
const TIMING_EFFORT: f64 = 0.2;

/// Diagnoses a case, as far as its effort goes. `watch` is told where it stands.
pub fn diagnose(case: &Case<'_>, settings: &FitSettings, watch: Watch<'_>) -> Diagnosis {
    let log = Log::new(watch);
    let cut = AtomicBool::new(false);
    let case = Case { progress: Progress::of(&log), cut: Some(&cut), ..*case };
    case.progress.begin(DECLARED, [0.0, TIMING]);
    let declared = Declared::fit(&case, case.train(), settings, ROOT_SEEDS);
    let so_far = SoFar::new(declared.clone());
    let kept = Case { so_far: Some(&so_far), ..case.part([0.0, 1.0], "") };
    let ended = fit::unless_interrupted(case.records, || {
        let diagnosis = in_each_way(&kept, declared, settings);
        kept.keep_answer(&diagnosis);
        let doubts = if diagnosis.verdict == Verdict::Adequate {
            Vec::new()
        } else {
            case.progress.begin("looking at the rig's own parameters", [0.99, 1.0]);
            doubt::doubts(&case, &diagnosis)
        };
        let early = cut.load(Ordering::Relaxed).then_some(Early::OutOfEffort);
        Diagnosis { early, doubts, ..diagnosis }
    });
    ended.unwrap_or_else(|| so_far.concluded(&case))
}

/// Commands are taken to jump at samples, and noise for white, first. Jumps between two samples may be the truth; where
/// something is left, noise that is coloured, as its spectrum where no actuator follows tells. What explains more is the
/// answer.
fn in_each_way(case: &Case<'_>, declared: Fit, settings: &FitSettings) -> Diagnosis {
    let effort_s = fit::spent_s(case.records) + TIMING_EFFORT * case.effort_s;
    let timing = Case { effort_s, cut: None, ..case.part([0.0, TIMING], "").unkept() };
    let jumping = Jumping::of(&timing, settings);
    let rival = jumping.as_ref().and_then(|jumping| jumping.rival);
    let timed_first = if jumping.is_some() { TIMING } else { 0.0 };
    let suggested = jumping.as_ref().and_then(Jumping::suggested);
    let here = Case { rival, suggested, ..case.part([timed_first, 0.65], "") };
    let declared = Declared::of_fit(&here, declared, settings, ROOT_SEEDS);
    let answer = diagnose_beside(&here, declared, settings);
    if case.is_over() {
        return answer.diagnosis;
    }
    case.keep_answer(&answer.diagnosis);
    let case = &case.unkept();
    if let Some(held) = diagnose_held(&case.part([0.65, 0.7], ""), &answer, settings) {
        return held.diagnosis;
    }
    // What explains the records says how they are to be read.
    let rig =
        if answer.is_unexplained() { case.rig.clone() } else { case.rig.with_spool_of(&answer.model.rig) };
    let other = &case.under(&rig).part([0.7, 0.9], "");
    let jumping = if rig.has_sticking_spool() == case.rig.has_sticking_spool() {
        jumping
    } else {
        Jumping::of(other, settings)
    };
    let between = jumping.map_or(Between::No, |jumping| jumping.diagnose(other, &answer, settings));
    let is_unexplained = answer.is_unexplained();
    let mut diagnosis = answer.diagnosis;
    match between {
        Between::Found(other) if is_unexplained || !other.is_unexplained() => {
            diagnosis = *other;
        }
        Between::Open(estimates) if !is_unexplained => diagnosis.hold(&estimates),
        _ => {}
    }
    if !diagnosis.is_unexplained() || case.is_over() {
        return diagnosis;
    }
    let colour: [f64; MEASURED] = std::array::from_fn(|channel| {
        fit::colour_of(&residual::series(case.train(), &diagnosis.predictions, channel))
    });
    if colour == [0.0; MEASURED] {
        return diagnosis;
    }
    let is_known = case.known_noise.map(|noise| noise.is_some());
    // A filter shares less over a longer period.
    let period = case.train()[0].sample_period;
    let colour_at = |other: f64| colour.map(|shared| shared.powf(other / period));
    let records: Vec<Prepared> = case
        .records
        .iter()
        .map(|record| record.coloured(colour_at(record.sample_period), is_known))
        .collect();
    let known_noise = std::array::from_fn(|channel| {
        case.known_noise[channel].map(|noise| noise * fit::as_white(colour[channel]))
    });
    let coloured = Case { records: &records, known_noise, ..case.part([0.9, 1.0], ", coloured noise") };
    let other = diagnose_in_noise(&coloured.another(), settings);
    if other.is_unexplained() { diagnosis } else { other.diagnosis }
}
