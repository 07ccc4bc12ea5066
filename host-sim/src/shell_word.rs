//! Words of a command line, as a shell takes them.

use std::borrow::Cow;

/// A word that a shell takes for itself, whatever is in it: what may be a pattern to one of them is quoted for all.
pub(crate) fn quoted(word: &str) -> Cow<'_, str> {
    // What has a NUL in it is an argument of no program, and becomes none.
    shlex::try_quote(word).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_shell_would_read_otherwise_is_quoted() {
        for plain in ["identify", "--rig", "machine/rig.toml", "-0.5", "record.csv@0..2", "C:/a_b"] {
            assert_eq!(quoted(plain), plain);
        }
        for (word, expected) in [
            ("", "''"),
            ("lvdt_m=pos[mm]", "'lvdt_m=pos[mm]'"),
            ("=pos", "'=pos'"),
            ("~/a", "'~/a'"),
            ("a*b?", "'a*b?'"),
            ("a b", "'a b'"),
            ("$(x)", "'$(x)'"),
            ("a,b", "'a,b'"),
            ("it's", "\"it's\""),
        ] {
            assert_eq!(quoted(word), expected);
        }
    }
}
