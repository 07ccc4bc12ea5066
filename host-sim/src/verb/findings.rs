//! The source's findings about its search, put to ours.

use super::reproduce::{NOISE, record};
use crate::failure::Failure;
use crate::fit;
use crate::output;
use crate::rig::{BUILT_IN, Rig};
use crate::thesis::{BKL_BOUNDS, CASES, Case};
use eha_monitor::channel::Channel;
use eha_monitor::fit::problem::{Free, Problem};
use eha_monitor::ga::{Settings as SearchSettings, SteadyState};
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::state::BASE_ORDER;
use rayon::prelude::*;

/// Seeds of each row of the table of findings.
const SEEDS: u64 = 15;
/// Evaluations of each search in the table of findings.
const SEARCH_BUDGET: u32 = 400;

/// One row of the table of findings.
pub(super) struct Finding {
    /// What the source varied.
    pub(super) question: &'static str,
    /// And how.
    pub(super) setting: &'static str,
    /// Median of the errors over the seeds, percent.
    pub(super) median: f64,
    /// The largest of them.
    pub(super) worst: f64,
}

/// How a search of the table of findings differs from the plain one.
#[derive(Clone, Copy)]
struct Variant {
    question: &'static str,
    setting: &'static str,
    command: &'static str,
    fdj_bounds: [f64; 2],
    population: usize,
    raw_genes: bool,
}

/// The source's findings about its search, put to ours: the genetic algorithm alone, without the Gauss-Newton finish,
/// on noise-free LF data of one mixed fault.
pub(super) fn findings(seed: u64) -> Result<Vec<Finding>, Failure> {
    let plain = Variant {
        question: "command",
        setting: "chirp",
        command: "chirp",
        fdj_bounds: [200.0, 4000.0],
        population: 20,
        raw_genes: false,
    };
    let variants = [
        plain,
        Variant { setting: "mixed", command: "mixed", ..plain },
        Variant { question: "bounds of FDJ", setting: "wide, 200 to 4000 N", ..plain },
        Variant {
            question: "bounds of FDJ",
            setting: "narrow, 200 to 900 N",
            fdj_bounds: [200.0, 900.0],
            ..plain
        },
        Variant { question: "population", setting: "20", ..plain },
        Variant { question: "population", setting: "40", population: 40, ..plain },
        Variant { question: "population", setting: "50", population: 50, ..plain },
        Variant { question: "genes", setting: "normalised", ..plain },
        Variant { question: "genes", setting: "raw (one mutation step for both)", raw_genes: true, ..plain },
    ];
    variants.par_iter().map(|variant| variant.judge(seed)).collect()
}

impl Variant {
    fn judge(&self, first_seed: u64) -> Result<Finding, Failure> {
        let case = Case { bkl: 2e-4, fdj: 800.0, fdj_bounds: self.fdj_bounds, ..CASES[1] };
        let record = record(self.command, case.bkl, case.fdj, false)?;
        let rig: Rig = (BUILT_IN[0].make)();
        let prepared = fit::prepare_with(&rig, &record, NOISE);
        let free: Vec<Free<f64>> = case
            .ranges()
            .iter()
            .map(|range| Free { parameter: range.parameter, lower: range.lower, upper: range.upper })
            .collect();
        let records = [prepared.as_core()];
        let problem = Problem { form: rig.form, parameters: rig.parameters, free: &free, records: &records };
        let mut stepper = Exact::<f64, BASE_ORDER, 32>::new();
        let mut errors: Vec<f64> = (0..SEEDS)
            .map(|index| {
                let seed = first_seed.wrapping_add(index);
                let settings = SearchSettings { population: self.population, ..SearchSettings::default() };
                let mut search =
                    SteadyState::<f64, 2, { fit::MAX_POPULATION }>::new(settings, free.len(), seed);
                if self.raw_genes {
                    // A step that suits the friction (thousands) throws the backlash (thousandths) across its range.
                    let ratio = (case.fdj_bounds[1] - case.fdj_bounds[0]) / (BKL_BOUNDS[1] - BKL_BOUNDS[0]);
                    search.set_mutation_scale(0, ratio);
                }
                for _ in 0..SEARCH_BUDGET {
                    let genes = search.ask();
                    search.tell(problem.misfit(&genes, &mut stepper).mean_square());
                }
                let genes = search.best().map_or([0.0; 2], |(genes, _)| *genes);
                case.mean_error_percent(free[0].value(genes[0]), free[1].value(genes[1]))
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        Ok(Finding {
            question: self.question,
            setting: self.setting,
            median: errors[errors.len() / 2],
            worst: errors[errors.len() - 1],
        })
    }
}

/// Prints them.
pub(super) fn print_findings(findings: &[Finding]) -> Result<(), Failure> {
    let mut table = output::table(["what the source varied", "setting", "median error %", "worst error %"]);
    for finding in findings {
        table.add_row([
            finding.question.to_owned(),
            finding.setting.to_owned(),
            format!("{:.3}", finding.median),
            format!("{:.3}", finding.worst),
        ]);
    }
    output::print(&format!(
        "genetic algorithm alone, {SEARCH_BUDGET} evaluations, {SEEDS} seeds, LF data with BKL 0.2 mm and FDJ 800 N, {} and {}:",
        Channel::UserPosition.info().column,
        Channel::Current.info().column
    ))?;
    output::print(&table.to_string())
}
