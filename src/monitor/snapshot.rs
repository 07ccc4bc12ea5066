//! The state of a monitor as bytes, so that it survives a restart.
//!
//! Little-endian words: a mark, the version, a digest of the configuration, the state, and a CRC-32 of all before it.
//! One list of fields serves both directions.

use super::Monitor;
use super::alarm::{Evidence, threshold};
use super::config::Config;
use super::pass::Start;
use super::screen::{Exclusions, Screen, Screened, Still};
use super::slot::Slot;
use super::window::Window;
use crate::integrate::Stepper;
use crate::model::state::{Mode, State};
use core::error::Error;
use core::fmt;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

/// "EHAM".
const MARK: u32 = 0x4d41_4845;
/// Version of the list of fields, which a test holds to it.
const VERSION: u32 = 5;

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
    /// It says what no monitor can come to.
    Content,
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
            Self::Content => "the snapshot says what no monitor can come to",
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

    /// A float that lies in a range.
    fn within(&mut self, value: &mut f32, _range: [f32; 2]) {
        self.float(value);
    }

    /// A float that may be anything.
    fn any(&mut self, value: &mut f32) {
        self.float(value);
    }

    /// A count that is not above a number.
    fn count(&mut self, value: &mut u32, _most: u32) {
        self.word(value);
    }

    fn flag(&mut self, value: &mut bool) {
        let mut word = u32::from(*value);
        self.word(&mut word);
        *value = word != 0;
    }

    /// The piece of a law: not farther than a number from its middle one.
    fn piece(&mut self, value: &mut i8, _most: i8) {
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

/// Looks whether what a reader would take over can be, and changes nothing.
struct Check<'a> {
    reader: Reader<'a>,
    is_sound: bool,
}

impl Check<'_> {
    fn next(&mut self) -> u32 {
        let mut word = 0;
        self.reader.word(&mut word);
        word
    }
}

impl Archive for Check<'_> {
    fn word(&mut self, _: &mut u32) {
        self.next();
    }

    fn float(&mut self, _: &mut f32) {
        self.is_sound &= f32::from_bits(self.next()).is_finite();
    }

    fn within(&mut self, _: &mut f32, [lower, upper]: [f32; 2]) {
        let value = f32::from_bits(self.next());
        self.is_sound &= value >= lower && value <= upper;
    }

    fn any(&mut self, _: &mut f32) {
        self.next();
    }

    fn count(&mut self, _: &mut u32, most: u32) {
        self.is_sound &= self.next() <= most;
    }

    fn flag(&mut self, _: &mut bool) {
        self.is_sound &= self.next() <= 1;
    }

    fn piece(&mut self, _: &mut i8, most: i8) {
        self.is_sound &= self.next().cast_signed().unsigned_abs() <= most.unsigned_abs().into();
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
    let Config {
        form,
        parameters,
        sample_period,
        holds_command,
        noise,
        faults,
        false_alarm_rate,
        seed,
        steps_per_sample,
    } = &mut config;
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
    digest.word(steps_per_sample);
    digest.word(&mut (*seed as u32));
    digest.word(&mut ((*seed >> 32) as u32));
    digest.0.finalize()
}

fn exclusions(archive: &mut impl Archive, exclusions: &mut Exclusions) {
    for count in exclusions.fields_mut() {
        archive.word(count);
    }
}

/// What is no state of an actuator is dropped after a restore, not refused: a model that runs away leaves some as well.
fn start(archive: &mut impl Archive, start: &mut Start) {
    let Start { state, mode, user, command, doubt } = start;
    let (mut values, mut rests) = (state.to_array(), [state.ram_rest, state.spool_rest]);
    for value in values.iter_mut().chain(&mut rests) {
        archive.any(value);
    }
    *state = State { ram_rest: rests[0], spool_rest: rests[1], ..State::from_array(values) };
    for (field, most) in mode.fields_mut().into_iter().zip(Mode::FARTHEST) {
        archive.piece(field, most);
    }
    archive.any(user);
    archive.any(doubt);
    archive.maybe(command, Archive::float);
}

fn slot(archive: &mut impl Archive, slot: &mut Slot<Start>) {
    let mut content = slot.get().copied();
    archive.maybe(&mut content, |archive, place| start(archive, place));
    *slot = content.into();
}

fn screen<A: Archive>(archive: &mut A, screen: &mut Screen) {
    // That it was restarted is what a restore finds out by itself.
    let Screen { newest, before, moved, commands, known, disorder, unusable, still, restarted: _ } = screen;
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
    for value in moved.iter_mut().chain(commands) {
        archive.float(value);
    }
    archive.count(known, 2);
    archive.word(disorder);
    archive.word(unusable);
    for Still { value, count, lowest, highest, away } in still {
        for value in [value, lowest, highest] {
            archive.float(value);
        }
        archive.word(count);
        archive.word(away);
    }
}

fn window<const SAMPLES: usize>(archive: &mut impl Archive, window: &mut Window<SAMPLES>) {
    for sample in window.samples_mut() {
        for word in sample.words() {
            archive.word(word);
        }
    }
    archive.count(&mut window.filled, SAMPLES as u32);
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
    /// snapshot is refused. Where the next tick follows, it goes on with the same bits, but for a search that is ended to be in
    /// time: it is begun anew, and has less of it. Where some ticks are missing, the window that filled is given up, and
    /// evidence and estimates stay.
    ///
    /// # Errors
    /// The bytes are no snapshot of this version and configuration, damaged, or none of a monitor's making.
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
        let mut check = Check { reader: Reader { bytes: content, at: reader.at }, is_sound: true };
        self.archive(&mut check);
        if check.reader.at != content.len() {
            return Err(SnapshotError::Length);
        }
        if !check.is_sound {
            return Err(SnapshotError::Content);
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
        let most = self.config.get().map_or(0.0, threshold);
        for Evidence { sum, alarmed, waiting } in &mut self.evidence {
            archive.within(sum, [0.0, most]);
            // What it adds is bounded, and no number adds nothing.
            archive.any(waiting);
            archive.flag(alarmed);
        }
        for gene in &mut self.genes {
            archive.within(gene, [0.0, 1.0]);
        }
        archive.count(&mut self.seeded, POPULATION as u32);
        for gene in self.seeds.iter_mut().flatten() {
            archive.within(gene, [0.0, 1.0]);
        }
        slot(archive, &mut self.carried);
        archive.word(&mut self.unexplained);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::exact::Exact;
    use crate::model::Form;
    use crate::monitor::config::Fault;
    use crate::parameter::{Parameter, Parameters};
    use crate::trial::SensorNoise;
    extern crate std;
    use std::boxed::Box;
    use std::format;

    type Small = Monitor<Exact<f32, 5, 1>, 100, 1, 4>;

    /// Gives every word a value of its own, and notes its kind.
    struct Number<'a> {
        next: u32,
        kinds: crc::Digest<'a, u32, NoTable>,
    }

    impl Number<'_> {
        fn take(&mut self, kind: u8) -> u32 {
            self.kinds.update(&[kind]);
            self.next += 1;
            self.next
        }
    }

    impl Archive for Number<'_> {
        fn word(&mut self, value: &mut u32) {
            *value = self.take(b'w');
        }

        fn float(&mut self, value: &mut f32) {
            *value = self.take(b'f') as f32;
        }

        fn flag(&mut self, value: &mut bool) {
            self.take(b'b');
            *value = true;
        }

        fn piece(&mut self, value: &mut i8, most: i8) {
            *value = self.take(b'p' + most as u8) as i8;
        }
    }

    #[test]
    fn another_list_of_fields_is_another_version() {
        let mut monitor = Box::new(Small::idle(Exact::new()));
        let config = Config {
            form: Form::default(),
            parameters: Parameters::default(),
            sample_period: 1e-3,
            holds_command: false,
            noise: SensorNoise { user: 5e-6, current: 0.02 },
            faults: [Fault::new(Parameter::Backlash, [0.0, 1e-3], 1e-4, 2e-4)],
            false_alarm_rate: 1e-6,
            seed: 1,
            steps_per_sample: 100,
        };
        monitor.configure(&config).unwrap();
        let checksum = CHECKSUM;
        let mut number = Number { next: 0, kinds: checksum.digest() };
        monitor.archive(&mut number);
        // Which field has got which number: a field's name, and its place in the list.
        let Monitor { windows, screen, evidence, genes, seeds, carried, start, exclusions, .. } = &*monitor;
        let counts = [
            monitor.number,
            monitor.analysed,
            monitor.latency,
            monitor.skipped,
            monitor.samples,
            monitor.unexplained,
        ];
        let fields = format!(
            "{windows:?} {screen:?} {evidence:?} {genes:?} {seeds:?} {carried:?} {start:?} {counts:?} {exclusions:?}"
        );
        let list = [number.next, number.kinds.finalize(), checksum.checksum(fields.as_bytes())];
        assert_eq!((VERSION, list), (5, [538, 3_395_170_121, 2_381_227_447]), "raise VERSION, and set these");
    }
}
