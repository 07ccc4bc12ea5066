//! The files that a verb reads and writes, looked at before its work starts.

use super::{log_warnings, segment};
use crate::cli::Common;
use crate::failure::Failure;
use crate::output;
use crate::record::Record;
use crate::rig::BUILT_IN;
use crate::whole_file::{self, file_at};
use std::path::{Path, PathBuf};

/// What to tell of records, each with the path that was given, that are parts of one file and have samples in common. The
/// first `fitted` of them are fitted, the others held out.
///
/// # Errors
/// Usage: samples that are fitted are held out as well.
pub(super) fn common_samples(
    common: &Common,
    records: &[(&PathBuf, &Record)],
    fitted: usize,
) -> Result<Vec<String>, Failure> {
    let file = |path: &PathBuf| segment(path).ok().and_then(|(file, _)| file_at(&file));
    let is_before_end = |a: &Record, b: &Record| a.start_time_s() <= b.time_s(b.len() - 1);
    let mut notes = Vec::new();
    for (index, (path, record)) in records.iter().enumerate() {
        for (other, (other_path, other_record)) in records[..index].iter().enumerate() {
            let is_common = file(path).is_some_and(|it| file(other_path) == Some(it))
                && is_before_end(record, other_record)
                && is_before_end(other_record, record);
            let [one, two] = [other_path.display(), path.display()];
            if is_common && other < fitted && index >= fitted {
                return Err(Failure::usage(format!(
                    "{one} is fitted and has samples in common with {two}, which is held out: expected other samples"
                )));
            }
            if is_common {
                notes.push(format!("{one} and {two} have samples in common, which count twice"));
            }
        }
    }
    log_warnings(common, &notes);
    Ok(notes)
}

/// What a verb reads, and what it will write.
pub(super) struct Files<'a> {
    common: &'a Common,
    inputs: Vec<PathBuf>,
    outputs: Vec<PathBuf>,
}

impl<'a> Files<'a> {
    /// A verb that reads the rig, if that is a file, and writes nothing yet.
    pub(super) fn new(common: &'a Common) -> Self {
        let is_built_in = |name: &String| BUILT_IN.iter().any(|built_in| built_in.name == name);
        let rig = common.rig.iter().filter(|name| !is_built_in(name)).map(PathBuf::from);
        Self { common, inputs: rig.collect(), outputs: Vec::new() }
    }

    /// Reads records as well, or segments of them.
    pub(super) fn reads(mut self, records: &[PathBuf]) -> Self {
        // What is no segment is said where it is read.
        let file = |path: &PathBuf| segment(path).map_or_else(|_| path.clone(), |(file, _)| file);
        self.inputs.extend(records.iter().map(file));
        self
    }

    /// Writes a file as well, if there is a path for it.
    pub(super) fn writes(mut self, path: Option<PathBuf>) -> Self {
        self.outputs.extend(path);
        self
    }

    /// Writes files into the directory of `--out` as well, if there is one.
    pub(super) fn writes_in_out(mut self, names: &[&str]) -> Self {
        self.outputs.extend(names.iter().filter_map(|name| output::out_path(self.common, name)));
        self
    }

    /// Refuses to write over what is read, or twice to one place, and what cannot be written.
    ///
    /// # Errors
    /// Usage: an output is an input, or another output. A file cannot be written.
    pub(super) fn check(self) -> Result<(), Failure> {
        let same = |path: &Path, others: &[PathBuf]| {
            let file = file_at(path)?;
            others.iter().find(|other| file_at(other).is_some_and(|other| other == file)).cloned()
        };
        for (index, path) in self.outputs.iter().enumerate() {
            let shown = path.display();
            if let Some(input) = same(path, &self.inputs) {
                return Err(Failure::usage(format!(
                    "{shown} would be written over {}, which is read: expected another file or directory",
                    input.display()
                )));
            }
            if same(path, &self.outputs[..index]).is_some() {
                return Err(Failure::usage(format!("{shown} would be written twice: expected another file")));
            }
        }
        for path in &self.outputs {
            whole_file::check(path).map_err(|error| output::cannot_write(path, &error))?;
        }
        Ok(())
    }
}
