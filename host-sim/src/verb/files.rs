//! The files that a verb reads and writes, looked at before its work starts.

use super::segment;
use crate::cli::Common;
use crate::failure::Failure;
use crate::output;
use crate::rig::BUILT_IN;
use crate::whole_file::{self, file_at};
use std::path::{Path, PathBuf};

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
