//! The state of a monitor as bytes, so that it survives a restart.
//!
//! Little-endian words: a mark, the version, a digest of the configuration, the state, and a CRC-32 of all before it.
//! One list of fields serves both directions.

use super::Monitor;
use super::alarm::Evidence;
use super::config::Config;
use super::pass::Start;
use super::screen::{Exclusions, Screen, Screened, Still};
use super::slot::Slot;
use super::window::Window;
use crate::integrate::Stepper;
use crate::model::state::State;
use core::error::Error;
use core::fmt;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

/// "EHAM".
const MARK: u32 = 0x4d41_4845;
/// Version of the list of fields.
const VERSION: u32 = 1;

const CHECKSUM: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Why a snapshot is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SnapshotError {
    /// The buffer is too small for it, or it is cut short.
    Length,
    /// The bytes are no snapshot.
    Mark,
    /// It is of another version of the monitor.
    Version,
    /// It is damaged.
    Checksum,
    /// It is of a monitor with another configuration.
    Config,
    /// There is no configuration yet.
    NotConfigured,
}

impl fmt::Display for SnapshotError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Length => "the buffer is too small for a snapshot, or the snapshot is cut short",
            Self::Mark => "the bytes are no snapshot",
            Self::Version => "the snapshot is of another version of the monitor",
            Self::Checksum => "the snapshot is damaged",
            Self::Config => "the snapshot is of a monitor with another configuration",
            Self::NotConfigured => "the monitor has no configuration yet",
        })
    }
}

impl Error for SnapshotError {}

/// Reads or writes one word after the other.
trait Archive {
    fn word(&mut self, value: &mut u32);

    fn float(&mut self, value: &mut f32) {
        let mut bits = value.to_bits();
        self.word(&mut bits);
        *value = f32::from_bits(bits);
    }

    fn flag(&mut self, value: &mut bool) {
        let mut word = u32::from(*value);
        self.word(&mut word);
        *value = word != 0;
    }

    fn small(&mut self, value: &mut i8) {
        let mut word = *value as u32;
        self.word(&mut word);
        *value = word as i8;
    }

    fn maybe<T: Copy + Default>(&mut self, value: &mut Option<T>, archive: impl FnOnce(&mut Self, &mut T)) {
        let mut is_there = value.is_some();
        self.flag(&mut is_there);
        let mut content = value.unwrap_or_default();
        archive(self, &mut content);
        *value = is_there.then_some(content);
    }
}

struct Writer<'a> {
    bytes: &'a mut [u8],
    at: usize,
}

impl Archive for Writer<'_> {
    fn word(&mut self, value: &mut u32) {
        if let Some(place) = self.bytes.get_mut(self.at..).and_then(<[u8]>::first_chunk_mut::<4>) {
            *place = value.to_le_bytes();
        }
        self.at = self.at.saturating_add(4);
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Archive for Reader<'_> {
    fn word(&mut self, value: &mut u32) {
        if let Some(place) = self.bytes.get(self.at..).and_then(<[u8]>::first_chunk::<4>) {
            *value = u32::from_le_bytes(*place);
        }
        self.at = self.at.saturating_add(4);
    }
}

/// Sums up what a configuration says.
struct Digest<'a>(crc::Digest<'a, u32, NoTable>);

impl Archive for Digest<'_> {
    fn word(&mut self, value: &mut u32) {
        self.0.update(&value.to_le_bytes());
    }
}

fn digest<const FAULTS: usize>(config: &Config<FAULTS>, shape: [usize; 2]) -> u32 {
    let checksum = CHECKSUM;
    let mut digest = Digest(checksum.digest());
    let mut config = *config;
    let Config { form, parameters, sample_period, holds_command, noise, faults, false_alarm_rate, seed } =
        &mut config;
    for mut word in
        [shape[0] as u32, shape[1] as u32, form.valve as u32, form.feedback as u32, form.drive as u32]
    {
        digest.word(&mut word);
    }
    digest.flag(holds_command);
    for parameter in crate::parameter::Parameter::all() {
        digest.float(&mut parameters.get(parameter));
    }
    for value in [sample_period, &mut noise.user, &mut noise.current, false_alarm_rate] {
        digest.float(value);
    }
    for fault in faults {
        digest.word(&mut (fault.free.parameter as u32));
        for value in [&mut fault.free.lower, &mut fault.free.upper, &mut fault.healthy, &mut fault.alarm] {
            digest.float(value);
        }
    }
    digest.word(&mut (*seed as u32));
    digest.word(&mut ((*seed >> 32) as u32));
    digest.0.finalize()
}

fn exclusions(archive: &mut impl Archive, exclusions: &mut Exclusions) {
    for count in exclusions.fields_mut() {
        archive.word(count);
    }
}

fn start(archive: &mut impl Archive, start: &mut Start) {
    let Start { state, mode, user, command } = start;
    let (mut values, mut rests) = (state.to_array(), [state.ram_rest, state.spool_rest]);
    for value in values.iter_mut().chain(&mut rests) {
        archive.float(value);
    }
    *state = State { ram_rest: rests[0], spool_rest: rests[1], ..State::from_array(values) };
    for field in mode.fields_mut() {
        archive.small(field);
    }
    archive.float(user);
    archive.maybe(command, Archive::float);
}

fn slot(archive: &mut impl Archive, slot: &mut Slot<Start>) {
    let mut content = slot.get().copied();
    archive.maybe(&mut content, |archive, place| start(archive, place));
    *slot = content.into();
}

fn screen<A: Archive>(archive: &mut A, screen: &mut Screen) {
    let Screen { newest, before, commands, known, disorder, unusable, still } = screen;
    let mut waiting = newest.get().copied();
    archive.maybe(&mut waiting, |archive, sample: &mut Screened| {
        archive.word(&mut sample.tick);
        archive.float(&mut sample.command);
        archive.maybe(&mut sample.user, A::float);
        archive.maybe(&mut sample.current, A::float);
    });
    *newest = waiting.into();
    for value in before {
        archive.maybe(value, A::float);
    }
    for command in commands {
        archive.float(command);
    }
    archive.word(known);
    archive.word(disorder);
    archive.word(unusable);
    for Still { value, count, lowest, highest, stuck } in still {
        for value in [value, lowest, highest] {
            archive.float(value);
        }
        archive.word(count);
        archive.flag(stuck);
    }
}

fn window<const SAMPLES: usize>(archive: &mut impl Archive, window: &mut Window<SAMPLES>) {
    for sample in window.samples_mut() {
        for word in sample.words() {
            archive.word(word);
        }
    }
    archive.word(&mut window.filled);
    archive.word(&mut window.first_tick);
    archive.flag(&mut window.follows);
    exclusions(archive, &mut window.exclusions);
}

impl<S, const SAMPLES: usize, const FAULTS: usize, const POPULATION: usize>
    Monitor<S, SAMPLES, FAULTS, POPULATION>
where
    S: Stepper<f32>,
{
    /// A buffer of this many bytes holds a snapshot.
    pub const SNAPSHOT_BYTES: usize = 16 * SAMPLES + 4 * FAULTS * POPULATION + 16 * FAULTS + 640;

    /// Writes the state to a buffer of at least [`SNAPSHOT_BYTES`](Self::SNAPSHOT_BYTES) and returns how many it took.
    ///
    /// Samples in the queue and reports that were not fetched are not part of it. An analysis in progress begins anew
    /// after a restore and comes to the same result.
    ///
    /// # Errors
    /// The buffer is too small, or the monitor is not configured.
    pub fn snapshot(&mut self, bytes: &mut [u8]) -> Result<usize, SnapshotError> {
        let digest = self.digest().ok_or(SnapshotError::NotConfigured)?;
        let mut writer = Writer { bytes, at: 0 };
        for mut word in [MARK, VERSION, digest] {
            writer.word(&mut word);
        }
        self.archive(&mut writer);
        let Writer { bytes, at } = writer;
        let content = bytes.get(..at).ok_or(SnapshotError::Length)?;
        let checksum = CHECKSUM.checksum(content).to_le_bytes();
        let place =
            bytes.get_mut(at..).and_then(<[u8]>::first_chunk_mut::<4>).ok_or(SnapshotError::Length)?;
        *place = checksum;
        Ok(at + 4)
    }

    /// Goes on where a snapshot was taken. The monitor must have the same configuration; it stays as it is where the
    /// snapshot is refused.
    ///
    /// # Errors
    /// The bytes are no snapshot of this version and configuration, or damaged.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), SnapshotError> {
        let digest = self.digest().ok_or(SnapshotError::NotConfigured)?;
        let (content, checksum) = bytes.split_last_chunk::<4>().ok_or(SnapshotError::Length)?;
        let mut reader = Reader { bytes: content, at: 0 };
        let [mut mark, mut version, mut config] = [0; 3];
        for word in [&mut mark, &mut version, &mut config] {
            reader.word(word);
        }
        if mark != MARK {
            return Err(SnapshotError::Mark);
        }
        if version != VERSION {
            return Err(SnapshotError::Version);
        }
        if CHECKSUM.checksum(content) != u32::from_le_bytes(*checksum) {
            return Err(SnapshotError::Checksum);
        }
        if config != digest {
            return Err(SnapshotError::Config);
        }
        let mut length = Writer { bytes: &mut [], at: reader.at };
        self.archive(&mut length);
        if length.at != content.len() {
            return Err(SnapshotError::Length);
        }
        self.archive(&mut reader);
        self.resume();
        Ok(())
    }

    fn digest(&self) -> Option<u32> {
        self.config.get().map(|config| digest(config, [SAMPLES, POPULATION]))
    }

    /// Every field that a restart must not lose.
    fn archive(&mut self, archive: &mut impl Archive) {
        for place in &mut self.windows {
            window(archive, place);
        }
        archive.flag(&mut self.second_fills);
        screen(archive, &mut self.screen);
        for Evidence { sum, alarmed, waiting } in &mut self.evidence {
            archive.float(sum);
            archive.float(waiting);
            archive.flag(alarmed);
        }
        for gene in &mut self.genes {
            archive.float(gene);
        }
        archive.flag(&mut self.has_seeds);
        for gene in self.seeds.iter_mut().flatten() {
            archive.float(gene);
        }
        slot(archive, &mut self.carried);
        slot(archive, &mut self.start);
        archive.flag(&mut self.is_analysing);
        for count in
            [&mut self.number, &mut self.analysed, &mut self.latency, &mut self.skipped, &mut self.samples]
        {
            archive.word(count);
        }
        exclusions(archive, &mut self.exclusions);
    }
}
