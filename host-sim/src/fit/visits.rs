//! Where a search has been.

use super::{Fit, MAX_FREE, MAX_POPULATION};
use eha_monitor::fit::identify::{Identification, Progress};
use eha_monitor::fit::problem::Problem;

/// A place that a search went to, and where the population stood after it.
#[derive(Clone, Debug, PartialEq)]
pub struct Visit {
    /// Value of each free parameter.
    pub values: Vec<f64>,
    /// Cost of the best member: mean square in units of the noise.
    pub best: f64,
    /// Cost of the worst member.
    pub worst: f64,
    /// Was it the end of a Gauss-Newton finish, not a child?
    pub finish: bool,
    /// Evaluations of the model so far.
    pub evaluations: u32,
    /// Which reading of the records was searched.
    pub reading: usize,
    /// Which search of that reading it was, of those from several seeds.
    pub search: usize,
}

impl Visit {
    /// Is it one of the same search as another?
    pub fn is_of_search_of(&self, other: &Self) -> bool {
        (self.reading, self.search) == (other.reading, other.search)
    }
}

/// What several searches took together.
#[derive(Default)]
pub(super) struct InAll {
    /// Their visits, one search after the other.
    pub(super) visits: Vec<Visit>,
    /// Evaluations of the model.
    pub(super) evaluations: u32,
    /// Was one of them interrupted?
    pub(super) interrupted: bool,
}

impl InAll {
    /// Takes over what one more of them took; `placed` says which one it is.
    pub(super) fn add(&mut self, fit: &mut Fit, placed: impl Fn(Visit) -> Visit) {
        let before = self.evaluations;
        let later = |visit: Visit| placed(Visit { evaluations: before + visit.evaluations, ..visit });
        self.visits.extend(fit.visits.drain(..).map(later));
        self.evaluations += fit.evaluations;
        self.interrupted |= fit.interrupted;
    }
}

/// Generations in a search: as many children as the population has members, its first members included.
pub(super) fn generations(visits: &[Visit], population: usize) -> u32 {
    let children = visits.iter().filter(|visit| !visit.finish).count();
    (children / population.max(1)) as u32
}

/// Notes the places at which the search has been since the last call: new members of the first population, the last child,
/// or the best finish.
pub(super) fn note_visits(
    visits: &mut Vec<Visit>,
    problem: &Problem<'_, f64>,
    identification: &Identification<f64, MAX_FREE, MAX_POPULATION>,
    progress: Progress,
) {
    let search = identification.search();
    let costs = || search.members().map(|(_, cost)| cost);
    let (best, worst) = (costs().fold(f64::INFINITY, f64::min), costs().fold(0.0, f64::max));
    let finish = progress == Progress::Finished;
    let visit = |genes: &[f64; MAX_FREE]| {
        let values = problem.free.iter().zip(genes).map(|(free, &gene)| free.value(gene)).collect();
        Visit {
            values,
            best,
            worst,
            finish,
            evaluations: identification.evaluations(),
            reading: 0,
            search: 0,
        }
    };
    match (progress, identification.result()) {
        (Progress::Filled, _) => {
            let new = visits.len();
            visits.extend(search.members().skip(new).map(|(genes, _)| visit(genes)));
        }
        (Progress::Finished, Some(result)) => visits.push(visit(&result.genes)),
        _ => visits.push(visit(search.last_child())),
    }
}
