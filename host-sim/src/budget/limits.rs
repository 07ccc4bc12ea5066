//! The file of limits.

use crate::failure::Failure;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The file, as it stands beside this crate.
const FILE: &str = include_str!("../../budgets.toml");

/// What one figure may be, and why.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// Name of the figure.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// The measurement that it comes from.
    from: String,
    /// How many of the thing that is limited the measurement holds.
    #[serde(default = "one")]
    per: u64,
    /// Most on each machine, by its name.
    limit: BTreeMap<String, u64>,
    /// What the product wants.
    pub target: Option<u64>,
    /// Why.
    pub reason: String,
    /// The feature whose image overruns it.
    pub control: String,
}

const fn one() -> u64 {
    1
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    budget: Vec<Budget>,
}

impl Budget {
    /// Every budget, in the order of the file.
    ///
    /// # Errors
    /// The file is not what it should be.
    pub fn all() -> Result<Vec<Self>, Failure> {
        let file: File =
            toml::from_str(FILE).map_err(|error| Failure::other(format!("budgets.toml: {error}")))?;
        Ok(file.budget)
    }

    /// The figure among the measurements of a machine; part of a unit counts as a whole one.
    ///
    /// # Errors
    /// It was not measured.
    pub(super) fn figure(&self, measures: &BTreeMap<String, u64>) -> Result<u64, Failure> {
        let value = measures.get(&self.from);
        let value =
            value.ok_or_else(|| self.wrong(&format!("the firmware does not measure `{}`", self.from)))?;
        Ok(value.div_ceil(self.per.max(1)))
    }

    /// The limit on a machine.
    ///
    /// # Errors
    /// The file has none.
    pub(super) fn limit(&self, machine: &str) -> Result<u64, Failure> {
        self.limit.get(machine).copied().ok_or_else(|| self.wrong(&format!("no limit for `{machine}`")))
    }

    fn wrong(&self, what: &str) -> Failure {
        Failure::other(format!("budgets.toml: `{}`: {what}", self.name))
    }
}
