//! Reports for people: one HTML file that needs no network, with inline SVG.
//!
//! ```text
//! identification.rs, diagnosis.rs, reproduction.rs, inspection.rs    what a verb's report says
//!        |-- records.rs, residual.rs, search.rs, estimates.rs    figures of what is named so
//!        |       |-- statistics.rs, surface.rs             what is computed for them
//!        |       `-- plot.rs, path.rs, rows.rs, scale.rs   how they are drawn
//!        `-- page.rs, style.css    the page around them: light, dark and paper
//! ```

mod diagnosis;
mod estimates;
mod identification;
mod inspection;
mod page;
mod path;
mod plot;
mod records;
mod reproduction;
mod residual;
mod rows;
mod scale;
mod search;
mod statistics;
mod surface;

pub(crate) use diagnosis::{Diagnosed, FITTED, HELD_OUT, OfParts, PARTS, channel_rows, diagnosis, name_of};
pub(crate) use identification::{Identified, identification};
pub(crate) use inspection::inspection;
pub(crate) use reproduction::{Portrait, Reproduced, reproduction};

/// Name of a report in the output directory.
pub(crate) const REPORT_FILE: &str = "report.html";
