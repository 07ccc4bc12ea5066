//! Units that a mapping may name, and what they are in the unit of a channel.

use eha_monitor::channel::ChannelInfo;

/// A unit of measured data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// As written in a mapping.
    pub symbol: &'static str,
    /// In words, plural.
    pub name: &'static str,
    /// The unit of the channels it converts to.
    pub base: &'static str,
    /// How many `base` one of it is.
    pub factor: f64,
}

/// Every unit, the larger before the smaller among those of one `base`.
pub const UNITS: [Unit; 19] = {
    const fn row(symbol: &'static str, name: &'static str, base: &'static str, factor: f64) -> Unit {
        Unit { symbol, name, base, factor }
    }
    [
        row("m", "metres", "m", 1.0),
        row("in", "inches", "m", 0.0254),
        row("cm", "centimetres", "m", 1e-2),
        row("mm", "millimetres", "m", 1e-3),
        row("um", "micrometres", "m", 1e-6),
        row("A", "amperes", "mA", 1e3),
        row("mA", "milliamperes", "mA", 1.0),
        row("MPa", "megapascals", "Pa", 1e6),
        row("bar", "bars", "Pa", 1e5),
        row("psi", "pounds per square inch", "Pa", 6_894.757_293_168),
        row("kPa", "kilopascals", "Pa", 1e3),
        row("Pa", "pascals", "Pa", 1.0),
        row("kN", "kilonewtons", "N", 1e3),
        row("lbf", "pounds of force", "N", 4.448_221_615_260_5),
        row("N", "newtons", "N", 1.0),
        row("s", "seconds", "s", 1.0),
        row("ms", "milliseconds", "s", 1e-3),
        row("us", "microseconds", "s", 1e-6),
        row("ns", "nanoseconds", "s", 1e-9),
    ]
};

/// The unit of that symbol; micro may be written `u`, `µ` or `μ`.
pub fn unit(symbol: &str) -> Option<&'static Unit> {
    let plain = symbol.trim().replace(['µ', 'μ'], "u");
    UNITS.iter().find(|unit| unit.symbol == plain)
}

/// The unit of those words, in one of its spellings: `Millimeter`, `metres`, `sec`.
pub(super) fn unit_in_words(words: &str) -> Option<&'static Unit> {
    let plain = |text: &str| text.to_lowercase().replace("meter", "metre").trim_end_matches('s').to_owned();
    let words = match plain(words).as_str() {
        "sec" => "second".to_owned(),
        other => other.to_owned(),
    };
    UNITS.iter().find(|unit| plain(unit.name) == words)
}

/// The units that convert to that of `info`.
pub fn units_of(info: &ChannelInfo) -> impl Iterator<Item = &'static Unit> {
    UNITS.iter().filter(|unit| unit.base == info.unit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eha_monitor::channel::CHANNELS;

    #[test]
    fn every_channel_has_its_own_unit() {
        for info in &CHANNELS {
            let own = units_of(info).find(|unit| unit.symbol == info.unit).map(|unit| unit.factor);
            assert_eq!(own, Some(1.0), "{}", info.column);
        }
    }

    #[test]
    fn larger_units_come_first() {
        for info in &CHANNELS {
            let factors: Vec<f64> = units_of(info).map(|unit| unit.factor).collect();
            assert!(factors.is_sorted_by(|a, b| a > b), "{}: {factors:?}", info.column);
        }
    }

    #[test]
    fn micro_has_three_spellings() {
        for symbol in ["um", "µm", "μm"] {
            assert_eq!(unit(symbol).map(|unit| unit.factor), Some(1e-6));
        }
    }

    #[test]
    fn words_have_spellings() {
        let symbol = |words| unit_in_words(words).map(|unit| unit.symbol);
        for (words, expected) in [
            ("Millimeter", "mm"),
            ("metres", "m"),
            ("Inches", "in"),
            ("sec", "s"),
            ("milliseconds", "ms"),
            ("Newton", "N"),
            ("pounds per square inch", "psi"),
        ] {
            assert_eq!(symbol(words), Some(expected), "{words}");
        }
        for none in ["", "mm", "furlong", "V", "counts", "%", "m/s"] {
            assert_eq!(symbol(none), None, "{none}");
        }
    }
}
