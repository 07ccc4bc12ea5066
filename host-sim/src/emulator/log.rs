//! What the firmware says: decoding its `defmt` frames, and the small language of its result lines.
//!
//! `result NAME=0x3f800000` is the bits of an `f32`, `result NAME=42` a count; both are the same on every platform.
//! `measure NAME=42` is a cost, known on the microcontroller only. Every other line is for people.

use super::error::EmulatorError;
use defmt_decoder::{DecodeError, Table};
use std::collections::BTreeMap;

/// A decoded line of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogLine {
    /// `error` to `trace`; none on result lines, which no level hides.
    pub level: Option<String>,
    /// The text.
    pub message: String,
}

/// A value that must be the same on every platform.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResultValue {
    /// The bits of an `f32`.
    F32Bits(u32),
    /// A count.
    Count(u64),
}

impl ResultValue {
    /// The value as a number. Compare the bits, not this, to test for equality.
    pub fn as_f64(self) -> f64 {
        match self {
            Self::F32Bits(bits) => f64::from(f32::from_bits(bits)),
            Self::Count(count) => count as f64,
        }
    }
}

/// All that a run of the firmware said.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RunLog {
    /// Every line, in order.
    pub lines: Vec<LogLine>,
    /// The values of the `result` lines, by name.
    pub results: BTreeMap<String, ResultValue>,
    /// The values of the `measure` lines, by name: `NAME.instructions`, `stack.bytes`.
    pub measures: BTreeMap<String, u64>,
    /// The code that the firmware ended with; 0 is success.
    pub exit_code: i32,
}

impl RunLog {
    /// Sorts the lines of a run into results, measurements and prose.
    pub(super) fn new(lines: Vec<LogLine>, exit_code: i32) -> Result<Self, EmulatorError> {
        let mut log = Self { exit_code, ..Self::default() };
        for LogLine { message, .. } in &lines {
            let malformed = || EmulatorError::Line(message.clone());
            let assignment =
                |text: &str| text.split_once('=').map(|(name, value)| (name.to_owned(), value.to_owned()));
            if let Some(text) = message.strip_prefix("result ") {
                let (name, value) = assignment(text).ok_or_else(malformed)?;
                log.results.insert(name, parse_result(&value).ok_or_else(malformed)?);
            } else if let Some(text) = message.strip_prefix("measure ") {
                let (name, value) = assignment(text).ok_or_else(malformed)?;
                log.measures.insert(name, value.parse().map_err(|_| malformed())?);
            }
        }
        log.lines = lines;
        Ok(log)
    }
}

/// Reads `0x` and eight digits as the bits of an `f32`, anything else as a count.
fn parse_result(text: &str) -> Option<ResultValue> {
    match text.strip_prefix("0x") {
        Some(digits) if digits.len() == 8 => u32::from_str_radix(digits, 16).ok().map(ResultValue::F32Bits),
        Some(_) => None,
        None => text.parse().ok().map(ResultValue::Count),
    }
}

/// Decodes the frames that the image `elf` sent; `bytes` may stop within a frame.
pub(super) fn decode(elf: &[u8], bytes: &[u8]) -> Result<Vec<LogLine>, EmulatorError> {
    let table = Table::parse(elf)
        .map_err(|error| EmulatorError::Log(format!("{error:#}")))?
        .ok_or_else(|| EmulatorError::Log("the image has no table of log strings".to_owned()))?;
    let mut decoder = table.new_stream_decoder();
    decoder.received(bytes);
    let mut lines = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => lines.push(LogLine {
                level: frame.level().map(|level| level.as_str().to_owned()),
                message: frame.display_message().to_string(),
            }),
            Err(DecodeError::UnexpectedEof) => return Ok(lines),
            Err(DecodeError::Malformed) => {
                return Err(EmulatorError::Log(format!("malformed frame after {} lines", lines.len())));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log_of(messages: &[&str]) -> Result<RunLog, EmulatorError> {
        let line = |message: &&str| LogLine { level: None, message: (*message).to_owned() };
        RunLog::new(messages.iter().map(line).collect(), 0)
    }

    #[test]
    fn results_and_measures_are_told_apart_from_prose() {
        let log =
            log_of(&["hello", "result x=0x3f800000", "result n=3", "measure x.instructions=17"]).unwrap();
        assert_eq!(log.results["x"], ResultValue::F32Bits(1.0_f32.to_bits()));
        assert_eq!(log.results["n"], ResultValue::Count(3));
        assert_eq!(log.measures["x.instructions"], 17);
        assert_eq!((log.results.len(), log.measures.len(), log.lines.len()), (2, 1, 4));
    }

    #[test]
    fn a_malformed_line_is_an_error_and_not_a_missing_result() {
        for line in
            ["result x", "result x=", "result x=0x3f8", "result x=-1", "measure x=0x10", "measure x=1.5"]
        {
            let error = log_of(&[line]).unwrap_err();
            assert!(error.to_string().contains(line), "{error}");
        }
    }
}
