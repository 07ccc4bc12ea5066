//! Which column or variable holds which channel, and in which unit.

use std::fmt;

use eha_monitor::channel::{CHANNELS, Channel, ChannelInfo};

use super::error::Problem;
use super::units::{Unit, unit, units_of};
use crate::shell_word;

/// Least similarity of two names (normalised Damerau-Levenshtein) for one to be offered for the other.
const SIMILAR: f64 = 0.75;

/// Least likeness (Jaro-Winkler, which counts the first letters most) of a name that is there to one that is not.
const LIKE: f64 = 0.8;

/// Relative difference of two factors that is none.
const ROUNDING: f64 = 1e-9;

/// Where the channels are found in a file, and the factors that bring them to the unit of the channel.
///
/// The default finds each channel under the name of its own column, in its own unit.
/// An entry is `COLUMN=NAME`, `COLUMN=NAME[UNIT]` or `COLUMN=NAME*FACTOR`, as in `lvdt_m=pos[mm]` or
/// `lvdt_m=adc.ch0*1.5e-5`. `NAME` is a column of a text file; or a variable of a MAT file, a path to the field of a
/// structure (`data.pos`), or a column or a row of an array (`data(:,2)`). A header that ends in the unit itself
/// (`Position [mm]`) is found by `lvdt_m=Position [mm]`. Units: [`UNITS`](super::units::UNITS).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mapping {
    entries: Vec<Entry>,
}

/// The source of one channel.
#[derive(Clone, Debug, PartialEq)]
struct Entry {
    channel: Channel,
    /// Without the unit.
    name: String,
    /// With the unit.
    full_name: String,
    factor: f64,
    /// The unit and the scale, as they are written behind the name; empty where the entry says neither.
    scaling: String,
}

/// A mapping that cannot be used: a mistake in the configuration, not in the data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MappingError {
    entry: String,
    reason: String,
}

impl fmt::Display for MappingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "mapping `{}`: {}", self.entry, self.reason)
    }
}

impl std::error::Error for MappingError {}

/// Is a channel read?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Without it there is no record.
    Must,
    /// Where it is there.
    May,
    /// It is left where it is.
    No,
}

/// A channel that was found.
pub(super) struct Found<T> {
    pub(super) channel: Channel,
    /// Unit of the channel per unit of the source.
    pub(super) factor: f64,
    pub(super) unit: UnitFrom,
    pub(super) source: T,
}

/// What says in which unit a source is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum UnitFrom {
    /// Its name, which is that of the channel.
    Name,
    /// The mapping, by a unit or a factor.
    Mapping,
    /// A row of units under the header.
    Row,
    /// Nothing: it is taken to be that of the channel.
    Nothing,
}

impl Mapping {
    /// Reads entries such as `lvdt_m=pos[mm]`.
    ///
    /// # Errors
    ///
    /// An entry without `=` or without a name, a channel that does not exist or is given twice, two channels of one name, a unit that is unknown
    /// or measures something else than the channel, a factor that is not a finite number other than 0.
    pub fn parse<'a>(entries: impl IntoIterator<Item = &'a str>) -> Result<Self, MappingError> {
        let mut mapping = Self::default();
        for text in entries {
            let entry = Entry::parse(text)
                .and_then(|entry| {
                    let column = |of: &Entry| of.channel.info().column;
                    if mapping.entry(entry.channel).is_some() {
                        return Err(format!("`{}` is mapped twice", column(&entry)));
                    }
                    match mapping.entries.iter().find(|known| known.full_name == entry.full_name) {
                        None => Ok(entry),
                        Some(known) => Err(format!("`{}` is {} already", entry.full_name, column(known))),
                    }
                })
                .map_err(|reason| MappingError { entry: text.to_owned(), reason })?;
            mapping.entries.push(entry);
        }
        Ok(mapping)
    }

    /// The entries of a list such as `t_s=time,lvdt_m=data(:,2)[mm]`: a comma that no `COLUMN=` follows is part of a name.
    pub fn split(text: &str) -> impl Iterator<Item = &str> {
        let mut rest = Some(text);
        std::iter::from_fn(move || {
            let text = rest?;
            let end = before_entry(text, ',');
            rest = end.map(|end| &text[end + 1..]);
            Some(&text[..end.unwrap_or(text.len())])
        })
    }

    fn entry(&self, channel: Channel) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.channel == channel)
    }

    /// Every channel that `find` knows by name, in the order of the channel table.
    ///
    /// `present` are the names to list if channels that must be there are not, `offered` those that can be read.
    pub(super) fn resolve<T>(
        &self,
        wanted: impl Fn(&ChannelInfo) -> Wanted,
        present: &[String],
        offered: impl Fn() -> Vec<String>,
        mut find: impl FnMut(&str) -> Option<T>,
    ) -> Result<Vec<Found<T>>, Problem> {
        let mut all = Vec::new();
        let mut missing = Vec::new();
        for info in CHANNELS.iter().filter(|info| wanted(info) != Wanted::No) {
            let channel = info.channel;
            let entry = self.entry(channel);
            let (source, factor, unit) = match entry {
                None => (find(info.column), 1.0, UnitFrom::Name),
                Some(entry) => {
                    let unit = if entry.scaling.is_empty() { UnitFrom::Nothing } else { UnitFrom::Mapping };
                    (find(&entry.full_name).or_else(|| find(&entry.name)), entry.factor, unit)
                }
            };
            match source {
                Some(source) => all.push(Found { channel, factor, unit, source }),
                None if entry.is_some() || wanted(info) == Wanted::Must => missing.push(info),
                None => {}
            }
        }
        if missing.is_empty() {
            return Ok(all);
        }
        let named = |info: &&ChannelInfo| match self.entry(info.channel) {
            Some(entry) => format!("{}={}", info.column, entry.full_name),
            None => info.column.to_owned(),
        };
        Err(Problem::Missing {
            expected: missing.iter().map(named).collect(),
            present: present.to_vec(),
            hint: self.how_to_map(&missing, offered()),
        })
    }

    /// The option that says where all channels are, those that are missing among the names that are left over; none where
    /// every one of them is mapped already, and no name is like it.
    fn how_to_map(&self, missing: &[&ChannelInfo], mut left_over: Vec<String>) -> Option<String> {
        left_over.retain(|name| self.entries.iter().all(|of| *name != of.name && *name != of.full_name));
        let mut is_like_any = false;
        let mut entry_of = |info: &ChannelInfo| {
            let entry = self.entry(info.channel);
            if !missing.iter().any(|other| other.channel == info.channel) {
                return entry.map(Entry::text);
            }
            let like = match entry {
                Some(entry) => entry.similar(&left_over),
                None => meant(info, &left_over),
            };
            let Some((place, text)) = like else {
                return Some(format!("{}=NAME{}", info.column, entry.map_or("", |entry| &entry.scaling)));
            };
            is_like_any = true;
            left_over.remove(place);
            Some(text)
        };
        let entries: Vec<String> = CHANNELS.iter().filter_map(&mut entry_of).collect();
        let option = option(&entries.join(","));
        let is_mapped = |info: &&ChannelInfo| self.entry(info.channel).is_some();
        if missing.iter().all(is_mapped) {
            return is_like_any.then(|| format!("did you mean {option}?"));
        }
        let one = if missing.len() == 1 { "one" } else { "them" };
        let such_as = if is_like_any { ", such as" } else { ":" };
        let rate = if missing.iter().any(|info| info.channel == Channel::Time && !is_mapped(info)) {
            ", or give the sampling rate: `--rate HZ`"
        } else {
            ""
        };
        Some(format!("map {one}{such_as} {option}{rate}"))
    }
}

/// Where a separator is in a text that `COLUMN=` follows.
fn before_entry(text: &str, separator: char) -> Option<usize> {
    let is_column = |text: &str| text.chars().all(|c| c.is_alphanumeric() || c == '_');
    let separates = |&(at, _): &(usize, &str)| {
        text[at + 1..].split_once('=').is_some_and(|(column, _)| is_column(column.trim()))
    };
    text.match_indices(separator).find(separates).map(|(at, _)| at)
}

/// The name that may be a channel, by its place among others, and the entry that maps it.
fn meant(info: &ChannelInfo, names: &[String]) -> Option<(usize, String)> {
    names.iter().enumerate().find_map(|(place, name)| {
        let (close, unit) = closest(name)?;
        (close.channel == info.channel).then(|| (place, entry_for(name, close, unit)))
    })
}

/// An entry as the option that says it, to be pasted into a shell.
pub(super) fn option(entry: &str) -> String {
    format!("`--columns {}`", shell_word::quoted(entry))
}

impl Entry {
    fn parse(text: &str) -> Result<Self, String> {
        let (column, source) =
            text.split_once('=').ok_or("expected COLUMN=NAME, COLUMN=NAME[UNIT] or COLUMN=NAME*FACTOR")?;
        let column = column.trim();
        if let Some(at) = before_entry(source, ';') {
            return Err(format!("expected commas between entries, found `{}`", source[at..].trim()));
        }
        let info = CHANNELS.iter().find(|info| info.column == column).ok_or_else(|| {
            let known: Vec<&str> = CHANNELS.iter().map(|info| info.column).collect();
            format!("`{column}` is not a channel, expected one of {}", known.join(", "))
        })?;
        // What is no number at all is part of a name.
        let is_scale = |text: &str| {
            let text = text.trim();
            text.parse::<f64>().is_ok() || text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c))
        };
        let (full_name, scale) = match source.rsplit_once('*').filter(|(_, scale)| is_scale(scale)) {
            None => (source.trim(), None),
            Some((name, scale)) => (name.trim(), Some(parse_scale(scale)?)),
        };
        let (name, factor) = match full_name.strip_suffix(']').and_then(|rest| rest.rsplit_once('[')) {
            // Of counts and the like the scale says it all: their brackets are part of the name.
            Some((_, symbol)) if scale.is_some() && unit(symbol).is_none() => (full_name, 1.0),
            Some((name, symbol)) => (name.trim(), parse_unit(symbol, info)?.factor),
            None => (full_name, 1.0),
        };
        if name.is_empty() {
            return Err("the name of the column or variable is missing".to_owned());
        }
        Ok(Self {
            channel: info.channel,
            name: name.to_owned(),
            full_name: full_name.to_owned(),
            factor: factor * scale.unwrap_or(1.0),
            scaling: source.trim().strip_prefix(name).unwrap_or_default().trim().to_owned(),
        })
    }

    /// The entry as it is written.
    fn text(&self) -> String {
        format!("{}={}{}", self.channel.info().column, self.name, self.scaling)
    }

    /// The name that is most like the one that is not there, by its place among others, and the entry that maps it.
    fn similar(&self, names: &[String]) -> Option<(usize, String)> {
        let wanted = self.name.to_lowercase();
        let likeness = |name: &String| strsim::jaro_winkler(&wanted, &bare(name).to_lowercase());
        // Of names that are equally like it, the first.
        let (place, name, _) = names
            .iter()
            .enumerate()
            .rev()
            .map(|(place, name)| (place, name, likeness(name)))
            .filter(|(_, _, likeness)| *likeness >= LIKE)
            .max_by(|(_, _, a), (_, _, b)| a.total_cmp(b))?;
        let scaling = match self.scaling.split_once(']') {
            Some((_, scale)) if name.ends_with(']') => scale,
            _ => &self.scaling,
        };
        Some((place, format!("{}={name}{scaling}", self.channel.info().column)))
    }
}

/// A name without the unit in brackets at its end.
fn bare(name: &str) -> &str {
    name.strip_suffix(']').and_then(|rest| rest.rsplit_once('[')).map_or(name, |(name, _)| name.trim_end())
}

fn parse_scale(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(scale) if scale.is_finite() && scale != 0.0 => Ok(scale),
        _ => Err(format!("the scale `{}` is not a finite number other than 0", text.trim())),
    }
}

fn parse_unit(symbol: &str, info: &ChannelInfo) -> Result<&'static Unit, String> {
    let known = || units_of(info).map(|unit| unit.symbol).collect::<Vec<_>>().join(", ");
    match unit(symbol) {
        Some(unit) if unit.base == info.unit => Ok(unit),
        Some(unit) => Err(format!("`{}` is in {}, expected one of {}", unit.symbol, unit.name, known())),
        None => Err(format!(
            "the unit `{}` is not known, expected one of {}; for counts and other units give a scale in {} per unit, \
             as in `{}=NAME*1.5e-5`",
            symbol.trim(),
            known(),
            info.unit,
            info.column,
        )),
    }
}

/// What to tell about a name that was not used: how to map it to the channel that may be meant, if one is close and is
/// asked for.
pub(super) fn suggestion(name: &str, is_asked_for: impl Fn(&ChannelInfo) -> bool) -> Option<String> {
    let close = closest(name).filter(|(info, _)| is_asked_for(info));
    close.map(|(info, unit)| format!("map it with {}", option(&entry_for(name, info, unit))))
}

/// The entry that maps a name.
fn entry_for(name: &str, info: &ChannelInfo, unit: Option<&Unit>) -> String {
    let unit = unit.map(|unit| format!("[{}]", unit.symbol)).filter(|unit| !name.ends_with(unit.as_str()));
    format!("{}={name}{}", info.column, unit.unwrap_or_default())
}

/// The entry that reads a channel from a name with a factor, whatever the file or the name says of a unit.
pub(super) fn entry_with(info: &ChannelInfo, name: &str, factor: f64) -> String {
    let own = name.strip_suffix(']').and_then(|rest| Some(rest.rsplit_once('[')?.1)).and_then(unit);
    let is_in = |unit: &&Unit| (factor.abs() / unit.factor - 1.0).abs() < ROUNDING;
    let scaling = match units_of(info).find(is_in) {
        Some(unit) => {
            let symbol = if own == Some(unit) { String::new() } else { format!("[{}]", unit.symbol) };
            format!("{symbol}{}", if factor < 0.0 { "*-1" } else { "" })
        }
        None => format!("*{:e}", factor / own.map_or(1.0, |unit| unit.factor)),
    };
    format!("{}={name}{scaling}", info.column)
}

/// The channel that a name, itself not that of a column, may stand for, and the unit that it ends in.
fn closest(name: &str) -> Option<(&'static ChannelInfo, Option<&'static Unit>)> {
    if CHANNELS.iter().any(|info| info.column == name) {
        return None;
    }
    let words: Vec<&str> =
        name.split(|c: char| !c.is_alphanumeric() && c != '-').filter(|word| !word.is_empty()).collect();
    let (last, head) = words.split_last()?;
    let plain = words.join("_").to_lowercase();
    let stem = head.join("_").to_lowercase();
    CHANNELS.iter().find_map(|info| {
        let unit = units_of(info).find(|unit| unit.symbol.eq_ignore_ascii_case(last));
        let is_stem = |text: &str| stems(info).any(|stem| stem == text);
        if is_stem(&plain) {
            return Some((info, None));
        }
        if let (Some(unit), true) = (unit, is_stem(&stem)) {
            return Some((info, Some(unit)));
        }
        let similarity = strsim::normalized_damerau_levenshtein(&plain, &info.column.to_lowercase());
        (similarity >= SIMILAR).then_some((info, None))
    })
}

/// Names of a channel without its unit: that of the column, and the first word of its description.
fn stems(info: &ChannelInfo) -> impl Iterator<Item = &'static str> {
    let column = info.column.rsplit_once('_').map(|(stem, _)| stem);
    let word = info.description.split([' ', ',']).next();
    column.into_iter().chain(word)
}

#[cfg(test)]
mod tests {
    use super::super::ReadOptions;
    use super::*;

    fn reason(entry: &str) -> String {
        Mapping::parse([entry]).expect_err("must be refused").to_string()
    }

    fn factor(entry: &str) -> f64 {
        Mapping::parse([entry]).expect("must be read").entries[0].factor
    }

    #[test]
    fn a_column_is_one_channel() {
        let both = |one: &str, other: &str| Mapping::parse([one, other]).map_err(|error| error.to_string());
        let refused = both("command_m=Soll[mm]", "lvdt_m=Soll[mm]").expect_err("must be refused");
        assert!(refused.contains("`Soll[mm]` is command_m already"), "{refused}");
        assert!(both("command_m=Soll[mm]", "lvdt_m=Ist[mm]").is_ok());
    }

    #[test]
    fn entries_give_name_and_factor() {
        assert_eq!(factor("lvdt_m=pos"), 1.0);
        assert_eq!(factor("lvdt_m = data.pos [mm]"), 1e-3);
        assert_eq!(factor("lvdt_m=adc*-1.5e-5"), -1.5e-5);
        assert_eq!(factor("current_mA=i[A]"), 1e3);
        assert_eq!(factor("dp_Pa=dp[bar]"), 1e5);
        assert_eq!(factor("load_N=f[kN]*-1"), -1e3);
        assert_eq!(factor("t_s=time[us]"), 1e-6);
    }

    #[test]
    fn a_list_is_split_between_its_entries() {
        let entries = |text| Mapping::split(text).collect::<Vec<_>>();
        assert_eq!(entries("t_s=time, lvdt_m=pos[mm]"), ["t_s=time", " lvdt_m=pos[mm]"]);
        assert_eq!(
            entries("t_s=d(:, 1),lvdt_m=d(2 ,:)[mm],load_N=f"),
            ["t_s=d(:, 1)", "lvdt_m=d(2 ,:)[mm]", "load_N=f"]
        );
        assert_eq!(entries("t_s=time"), ["t_s=time"]);
        assert_eq!(entries("lvdt_m=lvdt, m[mm],t_s=time, s"), ["lvdt_m=lvdt, m[mm]", "t_s=time, s"]);
        assert_eq!(entries("t_s=time,lvdt_m="), ["t_s=time", "lvdt_m="]);
    }

    #[test]
    fn a_missing_name_gets_the_one_that_is_most_like_it() {
        let hint = |entry: &str, present: &[&str]| {
            let mapping = Mapping::parse([entry]).expect("valid");
            let present: Vec<String> = present.iter().map(ToString::to_string).collect();
            match mapping.resolve(
                |info| ReadOptions::default().wanted(info),
                &present,
                || present.clone(),
                |name| (name == "t_s" || name == "command_m").then_some(()),
            ) {
                Err(Problem::Missing { hint, .. }) => hint,
                _ => None,
            }
        };
        let names = ["t_s", "Positon", "Position 2 [mm]", "Force"];
        let meant = |text: &str| Some(format!("did you mean `--columns {text}`?"));
        assert_eq!(hint("lvdt_m=position[mm]", &names), meant("'lvdt_m=Positon[mm]'"));
        assert_eq!(hint("lvdt_m=Position2", &names), meant("'lvdt_m=Position 2 [mm]'"));
        assert_eq!(hint("lvdt_m=force*2", &names), meant("'lvdt_m=Force*2'"));
        assert_eq!(hint("lvdt_m=Positio2[mm]*2", &names), meant("'lvdt_m=Position 2 [mm]*2'"));
        assert_eq!(hint("lvdt_m=Pos", &names), meant("'lvdt_m=Positon'"));
        assert_eq!(hint("lvdt_m=pressure", &names), None);
        assert_eq!(hint("lvdt_m=data(:,0)", &["data(:,1)", "data(:,2)"]), meant("'lvdt_m=data(:,1)'"));
    }

    #[test]
    fn all_that_is_missing_is_told_at_once() {
        let told = |entries: &[&str], present: &[&str]| {
            let mapping = Mapping::parse(entries.iter().copied()).expect("valid");
            let present: Vec<String> = present.iter().map(ToString::to_string).collect();
            let place = |name: &str| present.iter().position(|other| other == name);
            match mapping.resolve(
                |info| ReadOptions::default().wanted(info),
                &present,
                || present.clone(),
                place,
            ) {
                Err(problem) => problem.to_string(),
                Ok(_) => String::new(),
            }
        };
        assert_eq!(
            told(&[], &["Time (ms)", "Ref", "Pos"]),
            "`t_s`, `command_m`, `lvdt_m` are missing: found `Time (ms)`, `Ref`, `Pos`; map them, such as \
             `--columns 't_s=Time (ms)[ms],command_m=NAME,lvdt_m=NAME'`, or give the sampling rate: `--rate HZ`"
        );
        assert_eq!(
            told(&["t_s=Time (ms)[ms]"], &["Time (ms)", "Ref", "Pos"]),
            "`command_m`, `lvdt_m` are missing: found `Time (ms)`, `Ref`, `Pos`; map them: \
             `--columns 't_s=Time (ms)[ms],command_m=NAME,lvdt_m=NAME'`"
        );
        assert_eq!(
            told(&["t_s=Tme*1e-3", "command_m=Re"], &["Time", "Ref", "LVDT [mm]"]),
            "`t_s=Tme`, `command_m=Re`, `lvdt_m` are missing: found `Time`, `Ref`, `LVDT [mm]`; map them, such as \
             `--columns 't_s=Time*1e-3,command_m=Ref,lvdt_m=LVDT [mm]'`"
        );
        // No name is offered twice, and none that is another channel.
        assert_eq!(
            told(&["t_s=Time", "command_m=Position1", "lvdt_m=Position2"], &["Time", "Position"]),
            "`command_m=Position1`, `lvdt_m=Position2` are missing: found `Time`, `Position`; did you mean \
             `--columns 't_s=Time,command_m=Position,lvdt_m=NAME'`?"
        );
        assert_eq!(told(&["t_s=Time", "command_m=Ref", "lvdt_m=Pos"], &["Time", "Ref", "Pos"]), "");
    }

    #[test]
    fn a_header_may_carry_its_unit() {
        let mapping = Mapping::parse(["lvdt_m=Position [mm]", "command_m=ref[mm]"]).expect("valid");
        let names = ["t_s", "Position [mm]", "ref"];
        let found = mapping
            .resolve(
                |info| ReadOptions::default().wanted(info),
                &[],
                Vec::new,
                |name| names.iter().position(|&other| other == name),
            )
            .map(|all| all.iter().map(|found| (found.source, found.factor)).collect::<Vec<_>>());
        assert_eq!(found.expect("all there"), [(0, 1.0), (2, 1e-3), (1, 1e-3)]);
    }

    #[test]
    fn a_header_may_hold_what_is_no_unit_and_no_scale() {
        let entry = |text| Mapping::parse([text]).expect("valid").entries[0].clone();
        let Entry { name, factor, .. } = entry("lvdt_m=Pos [counts]*1.5e-5");
        assert_eq!((name.as_str(), factor), ("Pos [counts]", 1.5e-5));
        let Entry { name, factor, .. } = entry("load_N=Force *mean[kN]");
        assert_eq!((name.as_str(), factor), ("Force *mean", 1e3));
    }

    #[test]
    fn an_entry_that_is_offered_has_the_factor_that_it_was_made_for() {
        for (name, made_for, expected) in [
            ("pos", 1e-3, "lvdt_m=pos[mm]"),
            ("pos", 1.0, "lvdt_m=pos[m]"),
            ("pos", -1e-2, "lvdt_m=pos[cm]*-1"),
            ("pos", 1.5e-5, "lvdt_m=pos*1.5e-5"),
            ("Pos [mm]", 1e-3, "lvdt_m=Pos [mm]"),
            ("Pos [mm]", -1e-3, "lvdt_m=Pos [mm]*-1"),
            ("Pos [mm]", 1e-2, "lvdt_m=Pos [mm][cm]"),
            ("Pos [mm]", 2e-3, "lvdt_m=Pos [mm]*2e0"),
            ("lvdt, m", 1e-3, "lvdt_m=lvdt, m[mm]"),
            ("Pos *mean", 1e-3, "lvdt_m=Pos *mean[mm]"),
            ("Pos [counts]", 1.5e-5, "lvdt_m=Pos [counts]*1.5e-5"),
            ("data(:,2)", -1.0, "lvdt_m=data(:,2)[m]*-1"),
        ] {
            let entry = entry_with(Channel::UserPosition.info(), name, made_for);
            assert_eq!((entry.as_str(), factor(&entry)), (expected, made_for));
            assert_eq!(Mapping::split(&entry).count(), 1);
        }
    }

    #[test]
    fn every_mistake_has_its_reason() {
        assert!(reason("lvdt_m").contains("expected COLUMN=NAME"));
        assert_eq!(
            reason("t_s=t; command_m=cmd"),
            "mapping `t_s=t; command_m=cmd`: expected commas between entries, found `; command_m=cmd`"
        );
        assert!(reason("lvdt=x").contains("`lvdt` is not a channel, expected one of t_s, command_m"));
        assert!(reason("lvdt_m=").contains("name of the column or variable is missing"));
        assert!(reason("lvdt_m=[mm]").contains("name of the column or variable is missing"));
        assert!(reason("lvdt_m=x[bar]").contains("`bar` is in bars, expected one of m, in, cm, mm, um"));
        assert!(reason("lvdt_m=x[counts]").contains("as in `lvdt_m=NAME*1.5e-5`"));
        assert!(reason("lvdt_m=x*0").contains("not a finite number other than 0"));
        assert!(reason("lvdt_m=x*inf").contains("not a finite number other than 0"));
        let twice = Mapping::parse(["lvdt_m=a", "lvdt_m=b"]).expect_err("twice").to_string();
        assert_eq!(twice, "mapping `lvdt_m=b`: `lvdt_m` is mapped twice");
    }

    #[test]
    fn close_names_are_offered() {
        let offer = |name| suggestion(name, |_| true).unwrap_or_default();
        assert_eq!(suggestion("Time", |info| info.channel != Channel::Time), None);
        let offers =
            |name, option: &str| assert_eq!(offer(name), format!("map it with `--columns {option}`"));
        offers("lvdt_mm", "'lvdt_m=lvdt_mm[mm]'");
        offers("command", "'command_m=command'");
        offers("LVDT [mm]", "'lvdt_m=LVDT [mm]'");
        offers("Time", "'t_s=Time'");
        offers("time_ms", "'t_s=time_ms[ms]'");
        offers("comand_m", "'command_m=comand_m'");
        offers("LVDT_M", "'lvdt_m=LVDT_M[m]'");
        offers("~time", "'t_s=~time'");
        assert_eq!(offer("temperature_C"), "");
        assert_eq!(offer("ram_m"), "", "a column of the table, left out on purpose");
        assert_eq!(offer(""), "");
    }
}
