//! Why the program ends without a result, and its exit code.

use crate::interrupt;
use crate::record::RecordError;
use std::fmt;

/// The kinds of failure, one exit code each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailureKind {
    /// Something outside the user's input failed.
    Failure,
    /// Wrong usage or configuration.
    Usage,
    /// Bad input data.
    Data,
    /// No convergence within the budget.
    Convergence,
    /// The user ended it.
    Interrupted,
}

/// The exit codes of the program, for its help.
pub const EXIT_CODES: &str = "Exit codes: 0 done, 1 failure, 2 usage or configuration, 3 bad input data, \
                              4 no convergence within the budget, 130 interrupted (the result is what was found so far).";

impl FailureKind {
    /// Exit code of the process.
    pub const fn exit_code(self) -> u8 {
        match self {
            Self::Failure => 1,
            Self::Usage => 2,
            Self::Data => 3,
            Self::Convergence => 4,
            Self::Interrupted => interrupt::EXIT_CODE,
        }
    }
}

/// A failure with its message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// What kind of failure.
    pub kind: FailureKind,
    message: String,
}

impl Failure {
    /// Something outside the user's input failed.
    pub fn other(message: impl fmt::Display) -> Self {
        Self { kind: FailureKind::Failure, message: message.to_string() }
    }

    /// Wrong usage or configuration.
    pub fn usage(message: impl fmt::Display) -> Self {
        Self { kind: FailureKind::Usage, message: message.to_string() }
    }

    /// Bad input data.
    pub fn data(message: impl fmt::Display) -> Self {
        Self { kind: FailureKind::Data, message: message.to_string() }
    }

    /// No convergence within the budget.
    pub fn convergence(message: impl fmt::Display) -> Self {
        Self { kind: FailureKind::Convergence, message: message.to_string() }
    }

    /// The user ended it.
    pub fn interrupted(message: impl fmt::Display) -> Self {
        Self { kind: FailureKind::Interrupted, message: message.to_string() }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

impl From<RecordError> for Failure {
    fn from(error: RecordError) -> Self {
        Self::data(error)
    }
}
