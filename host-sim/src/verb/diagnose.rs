//! `diagnose`: what does the model lack?

use super::files::{Files, common_samples};
use super::{DEFAULT_RIG, InputOptions};
use crate::cli::Common;
use crate::diagnose::{
    Case, Diagnosis, Doubt, EFFORT_BOUNDS_S, EFFORT_PER_SECOND, Early, Found, Reached, Score, Side, diagnose,
};
use crate::failure::Failure;
use crate::fit::{self, Bounds, Estimate, FitSettings, LoopScore, Prepared};
use crate::interrupt;
use crate::output::{self, SCHEMA, Time, effects_in_words};
use crate::record::Record;
use crate::report::{self, Diagnosed, OfParts, REPORT_FILE};
use crate::rig::{self, Rig};
use crate::table_file::table_path;
use crate::trace::Trace;
use eha_monitor::channel::Channel;
use eha_monitor::effect::EffectInfo;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::slice;
use std::time::Instant;

/// Names of the rig and of the result in the directory of `--out`.
const RIG_FILE: &str = "rig.toml";
const RESULT_FILE: &str = "diagnose.json";

/// What a diagnosis writes into the directory of `--out`.
pub(super) const WRITES: [&str; 3] = [RIG_FILE, RESULT_FILE, REPORT_FILE];

/// Options of `diagnose`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Records to fit, together. `FILE@FROM..TO` is a segment of one, in s.
    #[arg(required = true, value_name = "REC")]
    records: Vec<PathBuf>,
    /// Record that is only predicted, to validate what was found; best with another command. `FILE@FROM..TO` is a segment
    /// of one, such as the other half of a fitted record.
    #[arg(long, value_name = "REC")]
    holdout: Vec<PathBuf>,
    #[command(flatten)]
    input: InputOptions,
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = effort, help = effort_help())]
    effort: Option<f64>,
    /// Where to write the final model's prediction of the (first) held-out record (CSV, or Parquet if it ends so).
    #[arg(long, value_name = "FILE.csv|.parquet", requires = "holdout", value_parser = table_path())]
    prediction: Option<PathBuf>,
    /// Where to write what was measured, predicted and left of the fitted records, sample by sample (CSV, or Parquet if
    /// it ends so); `trace.csv` in the directory of `--out` by default.
    #[arg(long, value_name = "FILE.csv|.parquet", value_parser = table_path())]
    trace: Option<PathBuf>,
}

fn effort_help() -> String {
    let [least, most] = EFFORT_BOUNDS_S;
    format!(
        "Work of the search after which nothing more is begun, s of one core of the machine that a step of the simulation was \
         timed on: steps are counted, and nothing beside them, so that a result repeats on any machine; the time itself may be \
         twice as long and more. What is begun is ended, and the fit of the declared faults, a first round of effects and the \
         tests of what was found are made in any case: of short records that is most of the work. What was found by then is \
         the result; the exit code is then 4 if this option is given. \
         [default: {EFFORT_PER_SECOND} for each second of the fitted records, {least} to {most}]"
    )
}

fn effort(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|effort| *effort > 0.0).ok_or_else(|| "expected more than 0".to_owned())
}

/// Runs the verb.
///
/// # Errors
/// Usage, bad data, or a search that ended early.
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    let trace = super::trace_path(common, options.trace.as_deref());
    Files::new(common)
        .reads(&options.records)
        .reads(&options.holdout)
        .writes_in_out(&WRITES)
        .writes(options.prediction.clone())
        .writes(trace.clone())
        .check()?;
    let rig = super::rig(common, DEFAULT_RIG)?;
    let (train, mut record_notes) = options.input.read_for_fit(common, &options.records, &rig)?;
    let (holdout, notes) = options.input.read_for_fit(common, &options.holdout, &rig)?;
    record_notes.extend(notes);
    let given: Vec<_> =
        options.records.iter().chain(&options.holdout).zip(train.iter().chain(&holdout)).collect();
    record_notes.extend(common_samples(common, &given, train.len())?);
    let names =
        options.records.iter().chain(&options.holdout).map(|path| path.display().to_string()).collect();
    interrupt::watch(common)?;
    let mut job = Job { common, rig, train, holdout, record_notes, names, effort_s: options.effort };
    let mut answer = job.run()?;
    answer.result["config"]["reading"] = options.input.json();
    let saved = job
        .save(&answer, options.prediction.as_deref())
        .and_then(|()| super::save_trace(common, trace.as_deref(), || job.trace(&answer.diagnosis)));
    if common.json {
        output::print_json(&answer.result)?;
    } else {
        output::print(job.text(&answer).trim_end())?;
    }
    saved?;
    job.check(&answer)
}

/// A search that needs more effort than a user allows has not converged. What was found within the usual effort is a result
/// like any other, and says that it was used up.
fn check_effort(allowed_s: Option<f64>, early: Option<Early>) -> Result<(), Failure> {
    if allowed_s.is_some() && early == Some(Early::OutOfEffort) {
        return Err(Failure::convergence(
            "the search used up its effort: the result is what was found by then; allow more with --effort",
        ));
    }
    Ok(())
}

/// A parameter that the rig may have wrong.
fn doubt_json(doubt: &Doubt) -> Value {
    let mut json = output::estimate_json(&doubt.estimate);
    json["stated"] = output::number(doubt.stated);
    json
}

/// What the rig may have wrong; none where nothing is in doubt.
fn doubts_in_words(doubts: &[Doubt]) -> Option<String> {
    let instead = |doubt: &Doubt| {
        let Doubt { stated, estimate } = doubt;
        let q = output::in_digits_of(estimate);
        let [lower, upper] = estimate.ci95.map(&q);
        let name = estimate.parameter.info().name;
        format!("{name} = {} ({lower} to {upper}) in place of {}", q(estimate.value), q(*stated))
    };
    (!doubts.is_empty()).then(|| {
        format!(
            "or the rig is wrong: without any effect, all records are explained by {}; `calibrate` on healthy records tells",
            doubts.iter().map(instead).collect::<Vec<_>>().join(", or by ")
        )
    })
}

/// What is said where held-out records chose what was added, which is then no name: an error on records that a model was chosen
/// by is too small.
fn chosen_by_held_out(is_any: bool, are_named: impl IntoIterator<Item = bool>) -> Option<&'static str> {
    let has_terms = are_named.into_iter().any(|is_named| !is_named);
    (is_any && has_terms)
        .then_some("the held-out records chose these terms: their error is no estimate for others")
}

/// A diagnosis of records that were read.
pub(super) struct Job<'a> {
    pub(super) common: &'a Common,
    pub(super) rig: Rig,
    pub(super) train: Vec<Record>,
    pub(super) holdout: Vec<Record>,
    /// What the user should know of the records.
    pub(super) record_notes: Vec<String>,
    pub(super) names: Vec<String>,
    /// Most work of the search, s of one core, where the user says it.
    pub(super) effort_s: Option<f64>,
}

/// What a diagnosis gave.
pub(super) struct Answer {
    pub(super) diagnosis: Diagnosis,
    /// Errors of an axis whose controller is known, before and after, of the fitted and the held-out records.
    pub(super) loops: OfParts<LoopScore>,
    /// All of it as JSON.
    pub(super) result: Value,
}

impl Job<'_> {
    /// A result of a search that the user ended, or that needs more effort than the user allows, is no success.
    pub(super) fn check(&self, answer: &Answer) -> Result<(), Failure> {
        check_effort(self.effort_s, answer.diagnosis.early)?;
        interrupt::check()
    }

    /// The records that are fitted, then those that are held out.
    pub(super) fn records(&self) -> impl Iterator<Item = &Record> {
        self.train.iter().chain(&self.holdout)
    }

    /// Name of a fitted record: its file, where it has one.
    pub(super) fn fitted_name(&self, index: usize) -> &str {
        self.names.get(index).map_or_else(|| self.train[index].name(), String::as_str)
    }

    /// Diagnoses, and takes the command on the path that it is found to be on.
    pub(super) fn run(&mut self) -> Result<Answer, Failure> {
        let started = Instant::now();
        let mut records: Vec<Prepared> =
            self.records().map(|record| fit::prepare(&self.rig, record)).collect();
        fit::share_account(&mut records);
        if self.rig.faults.is_empty() && self.rig.free.is_empty() {
            return Err(Failure::usage(
                "the rig declares no fault and no free parameter: there is nothing to fit",
            ));
        }
        let mut case = Case::new(&self.rig, &records, self.train.len());
        let effort_s = self.effort_s.unwrap_or(case.effort_s);
        case.effort_s = effort_s;
        let settings = FitSettings { seed: self.common.seed, ..FitSettings::default() };
        let bar = output::bar(self.common, 100, "diagnosing", Time::Gone);
        let mut diagnosis = diagnose(&case, &settings, &|stage| output::show_stage(&bar, stage));
        if diagnosis.is_unexplained()
            && diagnosis.early.is_none()
            && fit::is_command_late(
                &self.rig,
                &self.rig.declared(),
                &self.train,
                &settings,
                &mut diagnosis.before,
            )
        {
            self.record_notes.push(output::LATE_COMMAND.to_owned());
        }
        if interrupt::requested() && diagnosis.interrupted_at().is_none() {
            diagnosis.early = Some(Early::Interrupted(Reached::Answer));
        }
        bar.finish_and_clear();
        self.rig = self.rig.with_spool_of(&diagnosis.rig);
        self.rig.command_path = diagnosis.rig.command_path;
        for (record, jumps) in self.records().zip(diagnosis.jumps.iter_mut().flatten()) {
            for time in jumps {
                *time += record.start_time_s();
            }
        }
        if let Some(left) = &mut diagnosis.left {
            left.active = left.active.map(|since_start| self.train[left.record].start_time_s() + since_start);
        }
        let loops = self.loop_scores(&diagnosis);
        let result = self.json(&diagnosis, &loops, effort_s, started.elapsed().as_secs_f64());
        Ok(Answer { diagnosis, loops, result })
    }

    /// Errors in closed loop and over open windows, before and after, of the fitted and the held-out records; none
    /// where the controller is not known.
    fn loop_scores(&self, diagnosis: &Diagnosis) -> OfParts<LoopScore> {
        let before = diagnosis.before.applied(&self.rig);
        [&self.train, &self.holdout].map(|records| {
            let score = |rig: &Rig| fit::loop_score(rig, records);
            Some([score(&before)?, score(&diagnosis.foretelling)?])
        })
    }

    fn json(&self, diagnosis: &Diagnosis, loops: &OfParts<LoopScore>, effort_s: f64, seconds: f64) -> Value {
        let pair = |scores: &[Score; 2]| json!({ "before_rms_m": output::number(scores[0].position_rms()), "after_rms_m": output::number(scores[1].position_rms()) });
        let channels: Vec<Value> = diagnosis
            .channels()
            .map(|(channel, info, noise)| {
                let pair = |scores: &[Score; 2]| {
                    let [before, after] = scores.map(|score| output::number(score.rms[channel]));
                    json!({ "before_rms": before, "after_rms": after })
                };
                json!({
                    "name": info.column,
                    "unit": info.unit,
                    "noise_rms": output::number(noise),
                    "train": pair(&diagnosis.train),
                    "holdout": diagnosis.holdout.as_ref().map(pair),
                })
            })
            .collect();
        let estimates =
            |estimates: &[Estimate]| estimates.iter().map(output::estimate_json).collect::<Vec<_>>();
        let (faults_before, free_before) = diagnosis.before.estimates.split_at(diagnosis.faults.len());
        let found = |named: bool| -> Vec<Value> {
            diagnosis
                .found
                .iter()
                .filter(|found| found.named == named)
                .map(|found| {
                    json!({
                        "name": found.effect.name,
                        "class": found.class.iter().map(|effect| effect.name).collect::<Vec<_>>(),
                        "evidence": output::number(found.evidence),
                        "equation": found.effect.equation,
                        "port": found.effect.port.name(),
                        "parameters": estimates(&found.estimates),
                    })
                })
                .collect()
        };
        let faults: Vec<Value> = diagnosis
            .faults
            .iter()
            .map(|fault| {
                let mut row = output::estimate_json(&fault.estimate);
                row["confounded_with"] = fault.confounded_with.iter().map(|effect| effect.name).collect();
                row
            })
            .collect();
        let mut config = output::config_json(self.common, &self.rig, &self.rig.declared(), &self.names);
        let FitSettings { population, budget, .. } = FitSettings::default();
        config["search"] = json!({ "population": population, "budget": budget, "effort_s": effort_s });
        json!({
            "schema": SCHEMA,
            "verdict": diagnosis.verdict.name(),
            "interrupted": diagnosis.interrupted_at().is_some(),
            "effort_s": output::number(diagnosis.effort_s()),
            "out_of_effort": diagnosis.early == Some(Early::OutOfEffort),
            "faults_before": estimates(faults_before),
            "faults": faults,
            "free_before": estimates(free_before),
            "free": estimates(&diagnosis.free),
            "correlation": {
                "parameters": diagnosis.correlation.parameters.iter().map(|of| of.info().name).collect::<Vec<_>>(),
                "matrix": diagnosis.correlation.json(),
            },
            "effects": found(true),
            "empirical_terms": found(false),
            "error": {
                "noise_rms_m": output::number(diagnosis.noise[0]),
                "train": pair(&diagnosis.train),
                "holdout": diagnosis.holdout.as_ref().map(pair),
                "channels": channels,
            },
            "closed_loop": self.rig.controller.map(|_| {
                let rows = ["train", "holdout"].into_iter().zip(loops).filter_map(|(name, scores)| {
                    let [before, after] = (*scores)?;
                    let rms = |score: LoopScore| score.open_loop_rms.map(output::number);
                    Some((name.to_owned(), json!({
                        "before_force_error": output::number(before.force_error),
                        "after_force_error": output::number(after.force_error),
                        "before_open_loop_rms_m": rms(before),
                        "after_open_loop_rms_m": rms(after),
                    })))
                });
                rows.collect::<serde_json::Map<_, _>>()
            }),
            "left": diagnosis.left.as_ref().map(|left| json!({
                "record": self.fitted_name(left.record),
                "follows": left.follows.map(|(name, correlation)| json!({ "quantity": name, "correlation": correlation })),
                "acts_on": diagnosis.acts.map(Side::name),
                "active_s": left.active,
                "tone": left.tone.map(|(frequency, share)| json!({ "frequency_Hz": frequency, "share": share })),
            })),
            "doubts": diagnosis.doubts.iter().map(doubt_json).collect::<Vec<_>>(),
            "command_jumps_s": diagnosis.jumps,
            "next_experiment": next_experiment(self, diagnosis),
            "warnings": self.warnings(diagnosis),
            "seconds": seconds,
            "seed": self.common.seed,
            "config": config,
        })
    }

    /// What the user should know of a diagnosis.
    fn warnings(&self, diagnosis: &Diagnosis) -> Vec<String> {
        let mut warnings = self.record_notes.clone();
        let sample_period = self.train[0].sample_period_s();
        let is_explained = !diagnosis.is_unexplained();
        if let Some(early) = diagnosis.early {
            let more = if early == Early::OutOfEffort { "; --effort allows more" } else { "" };
            let early = early.in_words();
            warnings.push(format!("{early}: effects that were not tried yet are not ruled out{more}"));
        }
        let reached = diagnosis.interrupted_at();
        warnings.extend(reached.and_then(Reached::left_out).map(str::to_owned));
        if !is_explained && !diagnosis.faults.is_empty() {
            let left = if reached.is_some() {
                "more than noise is left"
            } else {
                "something is left that no effect explains"
            };
            warnings.push(format!("{left}: what it does to the faults is not in their intervals"));
        }
        warnings.extend(doubts_in_words(&diagnosis.doubts));
        if diagnosis.holdout.is_none() && !diagnosis.found.is_empty() {
            warnings.push("no held-out record: what was found is not validated".to_owned());
        }
        let are_named = diagnosis.found.iter().map(|found| found.named);
        warnings.extend(chosen_by_held_out(diagnosis.holdout.is_some(), are_named).map(str::to_owned));
        if diagnosis.is_open {
            warnings.push(
                "the fitted records leave so much open that the held-out ones are predicted worse than their noise; \
                 one model explains them all together, and what is given is what all of them say"
                    .to_owned(),
            );
        }
        warnings.extend(output::reading_notes(&diagnosis.rig, is_explained));
        let doubt = if is_explained { "" } else { ", unless that is a part of what is left" };
        for (name, jumps) in self.names.iter().zip(diagnosis.jumps.iter().flatten()) {
            let times: Vec<String> = jumps.iter().map(|time| format!("{time:.5}")).collect();
            if !times.is_empty() {
                warnings.push(format!(
                    "{name}: the command jumps between samples, as the answer to each jump tells: at {} s{doubt}",
                    times.join(", ")
                ));
            }
        }
        for (channel, colour) in
            Channel::MEASURED.into_iter().zip(diagnosis.colour).filter(|(_, colour)| *colour > 0.0)
        {
            warnings.push(format!(
                "neighbouring samples of {} share {:.0} % of their noise, as behind a filter of {}",
                channel.info().column,
                100.0 * colour,
                output::quantity(-sample_period / colour.ln(), "s"),
            ));
        }
        let declared = diagnosis.faults.iter().map(|fault| &fault.estimate).chain(&diagnosis.free);
        if reached != Some(Reached::Search) {
            warnings.extend(fit::remarks(declared, &self.rig.declared(), Bounds::Rig));
        }
        for fault in &diagnosis.faults {
            if !fault.confounded_with.is_empty() {
                let (name, names) =
                    (fault.estimate.parameter.info().name, effects_in_words(&fault.confounded_with));
                warnings.push(format!("{name} holds only if none of these is present: {names}"));
            }
        }
        warnings
    }

    /// The final model as a rig file. A fault of which the records say nothing stays what it was.
    fn rig_text(&self, diagnosis: &Diagnosis) -> String {
        let effects: Vec<&str> = diagnosis.rig.effects.iter().map(|effect| effect.name).collect();
        let mut comments = vec![
            format!("diagnosed on {} by host-sim {}", self.names.join(", "), env!("CARGO_PKG_VERSION")),
            format!(
                "verdict {}, added effects: {}",
                diagnosis.verdict_in_words(),
                if effects.is_empty() { "none".to_owned() } else { effects.join(", ") }
            ),
        ];
        let mut rig = diagnosis.rig.clone();
        for (fault, range) in diagnosis.faults.iter().zip(&self.rig.faults) {
            if !fit::is_told(&fault.estimate, range) {
                let parameter = range.parameter;
                rig.parameters.set(parameter, self.rig.parameters.get(parameter));
                comments
                    .push(format!("{} as it was: the records say nothing about it", parameter.info().name));
            }
        }
        rig::write(&rig, &comments)
    }

    pub(super) fn save(&self, answer: &Answer, prediction: Option<&Path>) -> Result<(), Failure> {
        let Answer { diagnosis, loops, result } = answer;
        if diagnosis.interrupted_at().is_some() {
            super::log_no_rig(self.common, RIG_FILE);
        } else {
            output::save(self.common, RIG_FILE, || Ok(self.rig_text(diagnosis)))?;
        }
        output::save_result(self.common, RESULT_FILE, result, || {
            report::diagnosis(&Diagnosed {
                rig: &self.rig,
                train: &self.train,
                holdout: &self.holdout,
                names: &self.names,
                diagnosis,
                loops,
                result,
            })
        })?;
        if let (Some(path), Some(record)) = (prediction, self.holdout.first()) {
            let compared = &diagnosis.records[self.train.len()];
            let predicted = fit::predict(&diagnosis.foretelling, slice::from_ref(compared)).concat();
            Trace::of_prediction(record, &predicted).save(path)?;
        }
        Ok(())
    }

    /// The fitted records against the model before and after.
    fn trace(&self, diagnosis: &Diagnosis) -> Trace {
        let models: [(&str, &[_]); 2] =
            [("before", &diagnosis.before.predictions), ("after", &diagnosis.predictions)];
        Trace::new(&self.train, &diagnosis.records[..self.train.len()], &models)
    }
}

/// What to measure so that what is open now is settled; nothing where the user ended the search: it may have settled that.
fn next_experiment(job: &Job<'_>, diagnosis: &Diagnosis) -> String {
    if diagnosis.interrupted_at().is_some() {
        return String::new();
    }
    // What is one and the same to every channel, no measurement tells apart.
    let twin_of = |found: &Found| {
        let twin = found.effect.twin(&diagnosis.rig.parameters, &job.rig.parameters)?;
        Some(twin.0).filter(|twin| found.class.contains(twin))
    };
    let apart = |found: &Found| -> Vec<&'static EffectInfo> {
        let twin = twin_of(found);
        found.class[1..].iter().copied().filter(|other| Some(*other) != twin).collect()
    };
    let effects = diagnosis
        .found
        .iter()
        .map(|found| (found.effect.name, apart(found)))
        .filter(|(_, others)| !others.is_empty());
    let faults = diagnosis
        .faults
        .iter()
        .filter(|fault| !fault.confounded_with.is_empty())
        .map(|fault| (fault.estimate.parameter.info().name, fault.confounded_with.clone()));
    let open: Vec<String> = effects
        .chain(faults)
        .map(|(name, others)| format!("{name} from {}", effects_in_words(&others)))
        .collect();
    let absent: Vec<&str> = job
        .rig
        .measurable()
        .iter()
        .filter(|&&channel| job.train.iter().all(|record| record.channel(channel).is_none()))
        .map(|channel| channel.info().column)
        .collect();
    let open = open.join("; ");
    if !open.is_empty() && !absent.is_empty() {
        format!("measure {} as well: the channels of these records do not tell {open}", absent.join(", "))
    } else if !open.is_empty() {
        format!(
            "fly a command with more reversals at low amplitude, and one at high velocity: these records do not tell {open}"
        )
    } else if diagnosis.is_unexplained() {
        let repeat =
            "repeat the same command: what repeats with it is in the actuator, what does not is outside";
        let is_placed = diagnosis.acts.is_some_and(|side| side != Side::Loop);
        if is_placed || absent.is_empty() {
            repeat.to_owned()
        } else {
            let absent = absent.join(", ");
            format!(
                "measure {absent} as well: they tell whether it acts as a force, in the drive or on the sensor; {repeat}"
            )
        }
    } else if let Some((found, twin)) =
        diagnosis.found.iter().find_map(|found| Some((found, twin_of(found)?)))
    {
        format!(
            "nothing that is measured here tells {} from {}: every channel shows them alike",
            found.effect.name, twin.name
        )
    } else {
        String::new()
    }
}

#[cfg(test)]
mod tests {
    use super::{Early, Reached, check_effort, chosen_by_held_out};
    use crate::failure::FailureKind;

    #[test]
    fn only_an_effort_that_a_user_allows_can_be_too_small() {
        let kind = |allowed_s, early| check_effort(allowed_s, early).err().map(|failure| failure.kind);
        assert_eq!(kind(Some(1.0), Some(Early::OutOfEffort)), Some(FailureKind::Convergence));
        assert_eq!(kind(None, Some(Early::OutOfEffort)), None);
        assert_eq!(kind(Some(1.0), Some(Early::Interrupted(Reached::Answer))), None);
        assert_eq!(kind(Some(1.0), None), None);
    }

    #[test]
    fn the_error_of_records_that_chose_terms_is_said_to_be_no_estimate() {
        assert!(
            chosen_by_held_out(true, [false]).is_some() && chosen_by_held_out(true, [true, false]).is_some()
        );
        // Names are kept by what all records say, and where nothing is held out nothing is claimed.
        assert_eq!(chosen_by_held_out(true, [true]), None);
        assert_eq!(chosen_by_held_out(true, []), None);
        assert_eq!(chosen_by_held_out(false, [false]), None);
    }
}
