//! Runs the program in a directory of its own.

use serde_json::Value;
use std::path::PathBuf;
use std::process::Command;
use tempfile::TempDir;

/// Exit codes as the program's help states them.
pub(crate) const USAGE: i32 = 2;
pub(crate) const BAD_DATA: i32 = 3;
pub(crate) const NO_CONVERGENCE: i32 = 4;

/// The faults of every simulated record here, m and N.
pub(crate) const BKL: f64 = 2e-4;
pub(crate) const FDJ: f64 = 800.0;

/// What a run left behind.
pub(crate) struct Run {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Run {
    /// The same, after a check that it succeeded.
    pub(crate) fn done(self) -> Self {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        self
    }

    /// The same, after a check that it failed with this exit code, no result, and a message that has these parts.
    pub(crate) fn refused(self, code: i32, parts: &[&str]) -> Self {
        assert_eq!(self.code, Some(code), "{}", self.stderr);
        assert_eq!(self.stdout, "", "a failure prints no result");
        for part in parts {
            assert!(self.stderr.contains(part), "`{part}` is not in: {}", self.stderr);
        }
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
        self
    }

    /// Stdout as one JSON object and nothing else.
    pub(crate) fn json(&self) -> Value {
        let value: Value = serde_json::from_str(&self.stdout)
            .unwrap_or_else(|error| panic!("{error}: {}\n{}", self.stdout, self.stderr));
        assert!(value.is_object(), "{value}");
        value
    }
}

/// A record's CSV text, cells of a column changed: `change` is given the number of the sample and the cell.
pub(crate) fn with_cells(text: &str, column: &str, change: impl Fn(usize, &str) -> String) -> String {
    let mut rows = text.lines().filter(|line| !line.starts_with('#'));
    let header = rows.next().expect("a header");
    let place = header.split(',').position(|name| name == column).expect("the column");
    let changed = rows.enumerate().map(|(sample, row)| {
        let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
        cells[place] = change(sample, &cells[place]);
        cells.join(",")
    });
    std::iter::once(header.to_owned()).chain(changed).collect::<Vec<_>>().join("\n")
}

/// A directory in which the program runs.
pub(crate) struct Bench {
    directory: TempDir,
}

impl Bench {
    pub(crate) fn new() -> Self {
        Self { directory: tempfile::tempdir().expect("a temporary directory") }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).expect("a file in the temporary directory");
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).expect("a file that the program wrote")
    }

    /// Names of everything in the directory, sorted.
    pub(crate) fn files(&self) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(self.directory.path())
            .expect("the temporary directory")
            .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    /// The program with arguments, ready to start.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
        command.args(arguments).current_dir(self.directory.path());
        command
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Run {
        let output = self.command(arguments).output().expect("the program starts");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
        Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    /// Makes a record with [`BKL`] and [`FDJ`]; the step is ten times the default, for speed.
    pub(crate) fn simulate(&self, name: &str, arguments: &[&str]) {
        let (bkl, fdj) = (format!("bkl={BKL}"), format!("fdj={FDJ}"));
        let fixed = ["simulate", "-o", name, "--step", "1e-5", "--set", &bkl, "--set", &fdj];
        self.run(&[&fixed[..], arguments].concat()).done();
    }

    /// Makes `record.csv` with the noise of the design's sensors, on the channels that they have.
    pub(crate) fn noisy_record(&self) {
        let noise = "lvdt_m=5e-6,current_mA=0.02";
        self.simulate(
            "record.csv",
            &["--model", "lf", "--noise", noise, "--channels", "lvdt_m,current_mA", "--seed", "7"],
        );
    }
}

/// The entry of a list of objects that has this name.
pub(crate) fn named<'a>(list: &'a Value, name: &str) -> &'a Value {
    let entries = list.as_array().expect("a list");
    entries.iter().find(|entry| entry["name"] == name).unwrap_or_else(|| panic!("no {name} in {list}"))
}

/// A number of a JSON object.
pub(crate) fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

/// Names of the members of a JSON object, sorted.
pub(crate) fn keys(value: &Value) -> Vec<&str> {
    let mut keys: Vec<&str> = value.as_object().expect("an object").keys().map(String::as_str).collect();
    keys.sort_unstable();
    keys
}

/// The same result without what a clock measured.
pub(crate) fn timeless(mut value: Value) -> Value {
    match &mut value {
        Value::Object(members) => {
            members.retain(|name, _| !name.starts_with("seconds"));
            members.values_mut().for_each(|member| *member = timeless(member.take()));
        }
        Value::Array(entries) => entries.iter_mut().for_each(|entry| *entry = timeless(entry.take())),
        _ => {}
    }
    value
}
