//! From the bytes of a text file to its text.

use std::borrow::Cow;

use encoding_rs::{Encoding, UTF_8, WINDOWS_1252};

use super::super::PARQUET_SIGNATURE;
use super::super::error::{Problem, RecordError};
use super::is_mat;
use super::rows::line_ends;

/// First bytes of other files that are no text, and what they are.
const OTHER_SIGNATURES: [(&[u8], &str); 3] = [
    (b"PK\x03\x04", "a ZIP file, as an Excel workbook is one"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook"),
    (PARQUET_SIGNATURE, "a Parquet file"),
];

/// The text of a file without its byte order mark, and what to tell of it. It is UTF-8, or UTF-16 where a mark says so;
/// what is neither is Windows-1252, in which spreadsheets and loggers write their units.
pub(super) fn decode<'a>(file: &str, bytes: &'a [u8]) -> Result<(Cow<'a, str>, Option<String>), RecordError> {
    if is_mat(bytes) {
        return Err(RecordError::new(file, Problem::MatFile));
    }
    if let Some((_, looks_like)) = OTHER_SIGNATURES.iter().find(|(signature, _)| bytes.starts_with(signature))
    {
        return Err(RecordError::new(file, Problem::NotText(looks_like)));
    }
    let (marked, mark) = Encoding::for_bom(bytes).unwrap_or((UTF_8, 0));
    let body = &bytes[mark..];
    if marked != UTF_8 {
        let text = marked.decode_without_bom_handling_and_without_replacement(body);
        let text = text.ok_or_else(|| RecordError::new(file, Problem::NotText("damaged text in UTF-16")))?;
        return without(file, text, |character| character == '\0').map(|text| (text, None));
    }
    match std::str::from_utf8(body) {
        Ok(text) => without(file, text.into(), |character| character == '\0').map(|text| (text, None)),
        Err(error) => {
            let line = 1 + line_ends(&body[..error.valid_up_to()]);
            let (text, _) = WINDOWS_1252.decode_without_bom_handling(body);
            let note = format!("line {line} is not in UTF-8: the file is read as Windows-1252");
            // Any bytes are characters of it.
            let is_no_text = |character: char| character.is_control() && !character.is_whitespace();
            without(file, text, is_no_text).map(|text| (text, Some(note)))
        }
    }
}

/// The text, if it has no character that no text has.
fn without<'a>(
    file: &str,
    text: Cow<'a, str>,
    is_no_text: impl Fn(char) -> bool,
) -> Result<Cow<'a, str>, RecordError> {
    match text.find(is_no_text) {
        None => Ok(text),
        Some(place) => {
            let line = 1 + line_ends(&text.as_bytes()[..place]);
            Err(RecordError::new(file, Problem::NotText("bytes that are no text")).at_line(line))
        }
    }
}
