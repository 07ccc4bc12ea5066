//! Values of options that name what they are for: `fdj=800`, `bkl=0..2e-3`, `lvdt_m=5e-6`.

use crate::failure::Failure;
use crate::rig::parameter_named;
use eha_monitor::parameter::Parameter;

/// The text of an option, taken apart by what it should look like.
#[derive(Clone, Copy)]
pub(super) struct Assignment<'a> {
    text: &'a str,
    expected: &'a str,
    /// What stands before the `=`.
    pub(super) name: &'a str,
    /// What stands behind it.
    pub(super) value: &'a str,
}

impl<'a> Assignment<'a> {
    /// The form of a parameter with a value.
    const OF_PARAMETER: &'static str = "NAME=VALUE, such as fdj=800";

    /// Takes a text apart at its first `=`; `expected` is its form, for messages.
    ///
    /// # Errors
    /// Usage: there is none.
    pub(super) fn new(text: &'a str, expected: &'a str) -> Result<Self, Failure> {
        match text.split_once('=') {
            Some((name, value)) => Ok(Self { text, expected, name: name.trim(), value: value.trim() }),
            None => Err(Failure::usage(format!("`{text}`: expected {expected}"))),
        }
    }

    /// A parameter and its value, such as `fdj=800`.
    ///
    /// # Errors
    /// Usage: another form, no such parameter.
    pub(super) fn of_parameter(text: &str) -> Result<(Parameter, f64), Failure> {
        let assignment = Assignment::new(text, Assignment::OF_PARAMETER)?;
        Ok((assignment.parameter()?, assignment.number(assignment.value)?))
    }

    /// The parameter that it names.
    ///
    /// # Errors
    /// Usage: no such parameter.
    pub(super) fn parameter(&self) -> Result<Parameter, Failure> {
        parameter_named(self.name)
    }

    /// The value as two numbers.
    ///
    /// # Errors
    /// Usage: nothing separates them, or one is no number.
    pub(super) fn two_numbers(&self, separator: &str) -> Result<[f64; 2], Failure> {
        let wrong = || Failure::usage(format!("`{}`: expected {}", self.text, self.expected));
        let (first, second) = self.value.split_once(separator).ok_or_else(wrong)?;
        Ok([self.number(first)?, self.number(second)?])
    }

    /// A part of the value as a number.
    ///
    /// # Errors
    /// Usage: it is none.
    pub(super) fn number(&self, part: &str) -> Result<f64, Failure> {
        let part = part.trim();
        let wrong = || {
            Failure::usage(format!("`{}`: `{part}` is not a number, expected {}", self.text, self.expected))
        };
        part.parse().map_err(|_| wrong())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_taken_apart() {
        assert_eq!(Assignment::of_parameter(" fdj = 8e2 "), Ok((Parameter::DryFriction, 800.0)));
        let bounds = Assignment::new("bkl=0..2e-3", "NAME=LOW..HIGH").expect("a name");
        assert_eq!(
            (bounds.parameter(), bounds.two_numbers("..")),
            (Ok(Parameter::Backlash), Ok([0.0, 2e-3]))
        );
    }

    #[test]
    fn every_mistake_says_what_was_expected() {
        let message = |text: &str| Assignment::of_parameter(text).expect_err(text).to_string();
        assert_eq!(message("fdj"), "`fdj`: expected NAME=VALUE, such as fdj=800");
        assert_eq!(message("fdj=x"), "`fdj=x`: `x` is not a number, expected NAME=VALUE, such as fdj=800");
        assert_eq!(message("fdk=1"), "unknown parameter `fdk`; did you mean `fdj`?");
        let bounds = Assignment::new("bkl=0", "NAME=LOW..HIGH").expect("a name");
        assert_eq!(
            bounds.two_numbers("..").expect_err("one").to_string(),
            "`bkl=0`: expected NAME=LOW..HIGH"
        );
    }
}
