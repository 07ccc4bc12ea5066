//! Printouts that users of the source know: its fault-parameter check, and the log of a search.

use super::assignment::Assignment;
use super::check_value;
use crate::failure::Failure;
use crate::fit::{Estimate, Fit, Visit};
use crate::output::{self, quantity};
use crate::thesis::error_percent;
use comfy_table::Table;
use eha_monitor::parameter::Parameter;
use serde_json::{Value, json};

/// True values of parameters, to be held against estimates.
pub(super) struct Truth(Vec<(Parameter, f64)>);

impl Truth {
    /// Reads texts such as `bkl=2e-4`.
    ///
    /// # Errors
    /// Usage: no such parameter, one that is given twice, not a number, or none that the parameter can have.
    pub(super) fn parse(texts: &[String]) -> Result<Self, Failure> {
        let one = |text: &String| -> Result<(Parameter, f64), Failure> {
            let (parameter, value) = Assignment::of_parameter(text)?;
            check_value(parameter, value)?;
            Ok((parameter, value))
        };
        let truths: Vec<(Parameter, f64)> = texts.iter().map(one).collect::<Result<_, _>>()?;
        for (index, (parameter, _)) in truths.iter().enumerate() {
            if truths[..index].iter().any(|(other, _)| other == parameter) {
                let name = parameter.info().name;
                return Err(Failure::usage(format!(
                    "the truth of `{name}` is given twice: expected it once"
                )));
            }
        }
        Ok(Self(truths))
    }

    /// Input, output and error in percent of each estimate whose truth is known.
    fn rows<'a>(&'a self, fit: &'a Fit) -> impl Iterator<Item = (&'a Estimate, f64, f64)> {
        self.0.iter().filter_map(|&(parameter, input)| {
            let estimate = fit.estimate(parameter)?;
            Some((estimate, input, error_percent(input, estimate.value)))
        })
    }

    /// Mean of the magnitudes of the errors, percent; none where no truth is known.
    fn mean(&self, fit: &Fit) -> Option<f64> {
        let errors: Vec<f64> = self.rows(fit).map(|(.., error)| error.abs()).collect();
        (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
    }

    /// The check as members of a JSON result; none where no truth is known.
    pub(super) fn add_to(&self, fit: &Fit, result: &mut Value) {
        let Some(mean) = self.mean(fit) else { return };
        result["check_mean_error_percent"] = output::number(mean);
        result["check"] = self
            .rows(fit)
            .map(|(estimate, input, error)| {
                json!({
                    "name": estimate.parameter.info().name, "input": input,
                    "output": output::number(estimate.value), "error_percent": output::number(error),
                })
            })
            .collect();
    }

    /// Prints the check; nothing where no truth is known.
    ///
    /// # Errors
    /// Stdout cannot be written.
    pub(super) fn print(&self, fit: &Fit) -> Result<(), Failure> {
        let Some(mean) = self.mean(fit) else { return Ok(()) };
        let mut table = output::table(["fault", "symbol", "input", "output", "%err"]);
        for (estimate, input, error) in self.rows(fit) {
            let info = estimate.parameter.info();
            table.add_row([
                info.name.to_owned(),
                info.symbol.to_owned(),
                quantity(input, info.unit),
                quantity(estimate.value, info.unit),
                format!("{error:.4}"),
            ]);
        }
        output::print(&format!("\nfault-parameter check:\n{table}\nmean error {mean:.4} %"))
    }
}

/// The log of a search: a line for each generation and for each finish, of one reading of the records after the other, and one
/// for where it ended, with the evaluations along its valley.
pub(super) fn log(fit: &Fit, population: usize) -> Table {
    let readings = fit.visits.last().map_or(1, |last| last.reading + 1);
    let mut header = ["generation", "evaluations", "best", "worst"].map(str::to_owned).to_vec();
    if readings > 1 {
        header.insert(0, "reading".to_owned());
    }
    header.extend(fit.estimates.iter().map(|estimate| estimate.parameter.info().name.to_owned()));
    let mut table = output::table(&header);
    let mut best: Option<&Visit> = None;
    let mut children = 0;
    for visit in &fit.visits {
        children += usize::from(!visit.finish);
        if best.is_none_or(|best| !visit.is_of_search_of(best) || visit.best < best.best) {
            best = Some(visit);
        }
        if !(visit.finish || children % population.max(1) == 0) {
            continue;
        }
        let generation = children / population.max(1);
        let mut row = vec![
            if visit.finish { "finish".to_owned() } else { generation.to_string() },
            visit.evaluations.to_string(),
            format!("{:.4}", visit.best.sqrt()),
            format!("{:.4}", visit.worst.sqrt()),
        ];
        if readings > 1 {
            let taken = if visit.reading == fit.reading { " (taken)" } else { "" };
            row.insert(0, format!("{}{taken}", visit.reading + 1));
        }
        let values = best.map_or(&visit.values, |best| &best.values);
        row.extend(
            fit.estimates
                .iter()
                .zip(values)
                .map(|(estimate, &value)| quantity(value, estimate.parameter.info().unit)),
        );
        table.add_row(row);
    }
    let mut row =
        ["end", &fit.evaluations.to_string(), &format!("{:.4}", fit.misfit.mean_square().sqrt()), "-"]
            .map(str::to_owned)
            .to_vec();
    if readings > 1 {
        row.insert(0, format!("{} (taken)", fit.reading + 1));
    }
    row.extend(fit.estimates.iter().map(|estimate| quantity(estimate.value, estimate.parameter.info().unit)));
    table.add_row(row);
    table
}
