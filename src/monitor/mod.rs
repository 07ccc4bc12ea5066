//! The streaming monitor: samples in from an interrupt, verdicts out of the background.
//!
//! ```text
//! interrupt --> Inlet::push --> queue --> Monitor::poll --> screen --> window that fills   (one of two)
//!                                              |                            |
//!                                              |      +---------------------+ full
//!                                              |      v
//!                                              +--> window that is analysed --> passes --> faults, standard errors
//!                                                     from the last estimate      |
//!                                                                                 +--> evidence over windows --> alarm
//! ```
//!
//! **Where a window starts.** An actuator in flight is never at rest at the start of a window, and its state is not
//! measured. The model's own motion under the last estimate is carried on from the end of one window into the next, the
//! same for every candidate, and the first 0.1 s of a window (a quarter at most) is not compared: a loop that follows its
//! command forgets where it was within some 20 ms, the backlash at the first turn. What is carried depends on commands
//! alone and not on noise. Where it is missing (the first window, after a gap, after windows in a row that nothing
//! explains) the model starts at the first measured position, as fast as measured, or at rest where that is the command. A
//! loop whose valve is at its limit forgets next to nothing meanwhile. So a second motion is walked along such a window,
//! from as far off as the first may be, and nothing is compared before both are alike; if they are not by its end, the next
//! window goes on with that. The sensor always starts as if it had been at rest; one that remembers longer than 0.1 s is
//! refused.
//!
//! **What a window must ask.** The offset of each sensor is taken out (see `sums.rs`); the standard errors that the
//! normal equations then predict say whether the window tells an alarmed fault from a healthy one. They are local: without
//! a reversal of the ram, friction of the spool leaves several places that fit as well, so a reversal is asked for
//! besides. If no fault is told, the window is called uninformative and nothing is claimed.
//!
//! **What it costs.** [`Monitor::poll`] never takes more steps of the model than it is allowed, and stops inside a
//! sample if it must. Up to [`LONGEST_PIECE`] of them cannot be parted. A search ends in time for the next window, with the
//! best that it has found: [`Config::steps_per_sample`] says how much there is.

mod alarm;
mod analysis;
pub mod config;
mod pass;
pub mod queue;
pub mod report;
pub mod sample;
pub mod screen;
mod slot;
mod snapshot;
mod sums;
mod window;

pub use snapshot::SnapshotError;

use crate::fit::FRICTION_ERROR;
use crate::integrate::{LONGEST_PIECE, Stepper};
use crate::parameter::Parameter;
use alarm::{Evidence, log_likelihood_ratio, threshold};
use analysis::{Analysis, Found, resolution};
use config::{Config, ConfigError};
use pass::{Scene, Start};
use queue::Outlet;
use report::{Estimate, Report, Verdict};
use sample::Sample;
use screen::{Exclusions, Limits, Reason, Screen, Screened, Sink};
use slot::Slot;
use window::{Scale, Window, samples_in};

/// Time at the start of a window that is not compared, s.
const SETTLE: f32 = 0.1;
/// Time over which it is measured how fast an actuator moves at the start of a window, s.
const SPEED_TIME: f32 = 0.005;
/// Standard deviations of its noise by which the first position may differ from the command, of what rests there.
const REST_SIGMA: f32 = 4.0;
/// Windows in a row that a motion may leave unexplained and is carried on: a fault that grows takes two.
const MOST_UNEXPLAINED: u32 = 2;
/// A sensor with fewer than this part of its samples has failed, in tenths.
const LEAST_PRESENT: u32 = 9;

/// What a call of [`Monitor::poll`] did.
#[must_use = "a report is handed out once"]
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Poll<const FAULTS: usize> {
    /// Samples taken from the queue.
    pub samples: u32,
    /// Steps of the model.
    pub steps: u32,
    /// What there is to say of a window.
    pub report: Option<Report<FAULTS>>,
}

/// What has happened since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Counters {
    /// Samples that came. It goes no further than `u32::MAX`: 49.7 days at 1 kHz.
    pub samples: u32,
    /// What was excluded of them.
    pub exclusions: Exclusions,
    /// Windows that were closed.
    pub windows: u32,
    /// Windows that were thrown away, since the analysis of the one before was still at work.
    pub skipped: u32,
}

#[allow(clippy::struct_excessive_bools, reason = "four independent facts, not a state machine")]
/// A monitor of one actuator: windows of `SAMPLES` samples, up to `FAULTS` faults, a population of `POPULATION`.
#[derive(Debug)]
pub struct Monitor<S, const SAMPLES: usize, const FAULTS: usize, const POPULATION: usize> {
    config: Slot<Config<FAULTS>>,
    stepper: S,
    has_begun: bool,
    windows: [Window<SAMPLES>; 2],
    /// Which of the windows fills: the first (false) or the second.
    second_fills: bool,
    screen: Screen,
    /// Number of the window that fills, and of the one that is analysed.
    number: u32,
    analysed: u32,
    is_analysing: bool,
    /// Has the analysis begun?
    has_analysis: bool,
    analysis: Analysis<FAULTS, POPULATION>,
    /// Where the model starts in the window that is analysed.
    start: Slot<Start>,
    /// Where it has ended in the last one.
    carried: Slot<Start>,
    /// Windows in a row that it has not explained.
    unexplained: u32,
    /// Best estimate so far.
    genes: [f32; FAULTS],
    /// Members of the last population.
    seeds: [[f32; FAULTS]; POPULATION],
    /// How many of them there are.
    seeded: u32,
    evidence: [Evidence; FAULTS],
    /// Samples since the window that is analysed was full.
    latency: u32,
    /// Those of them before the last restart: an analysis that is begun anew then has so much less time.
    late: u32,
    skipped: u32,
    samples: u32,
    exclusions: Exclusions,
    outbox: Slot<Report<FAULTS>>,
    /// Steps that calls of few had left.
    saved: u32,
}

impl<S: Stepper<f32>, const SAMPLES: usize, const FAULTS: usize, const POPULATION: usize>
    Monitor<S, SAMPLES, FAULTS, POPULATION>
{
    /// A monitor that knows nothing of its actuator yet: it takes no samples.
    pub const fn idle(stepper: S) -> Self {
        const {
            assert!(SAMPLES >= 100 && SAMPLES < 1 << 15, "a window has 100 to 32767 samples");
            assert!(FAULTS > 0, "a monitor watches a fault");
        };
        Self {
            config: Slot::Empty,
            stepper,
            has_begun: false,
            windows: [Window::EMPTY; 2],
            second_fills: false,
            screen: Screen::NEW,
            number: 0,
            analysed: 0,
            is_analysing: false,
            has_analysis: false,
            analysis: Analysis::IDLE,
            start: Slot::Empty,
            carried: Slot::Empty,
            unexplained: 0,
            genes: [0.0; FAULTS],
            seeds: [[0.0; FAULTS]; POPULATION],
            seeded: 0,
            evidence: [Evidence::NONE; FAULTS],
            latency: 0,
            late: 0,
            skipped: 0,
            samples: 0,
            exclusions: Exclusions::NONE,
            outbox: Slot::Empty,
            saved: 0,
        }
    }

    /// Tells it what its actuator is, and starts anew.
    ///
    /// # Errors
    /// The configuration is not one that it can work with; it stays as it was.
    #[inline(never)]
    pub fn configure(&mut self, config: &Config<FAULTS>) -> Result<(), ConfigError> {
        config.check()?;
        let settle = settle_samples::<FAULTS, SAMPLES>(config) as f32 * config.sample_period;
        if !config.forgets_sensor(settle) {
            return Err(ConfigError::SensorMemory);
        }
        if !config.suits(&self.stepper) {
            return Err(ConfigError::Model);
        }
        self.begin(config);
        Ok(())
    }

    /// Starts anew with a configuration that it can work with. Not inlined: what it copies would lie on the stack below the
    /// models that are looked at before.
    #[inline(never)]
    fn begin(&mut self, config: &Config<FAULTS>) {
        self.config = Slot::Full(*config);
        self.has_begun = false;
        for window in &mut self.windows {
            window.clear(false);
        }
        self.second_fills = false;
        self.screen = Screen::NEW;
        (self.number, self.analysed, self.latency, self.late, self.saved) = (0, 0, 0, 0, 0);
        (self.skipped, self.samples, self.exclusions) = (0, 0, Exclusions::NONE);
        self.is_analysing = false;
        self.has_analysis = false;
        self.carried = Slot::Empty;
        self.unexplained = 0;
        self.start = Slot::Empty;
        // Nothing is known yet: the search starts at a healthy actuator.
        self.genes = core::array::from_fn(|gene| {
            config.faults.get(gene).map_or(0.0, |fault| fault.free.gene(fault.healthy))
        });
        self.seeds = [[0.0; FAULTS]; POPULATION];
        self.seeded = 0;
        self.evidence = [Evidence::NONE; FAULTS];
        self.outbox = Slot::Empty;
    }

    /// What it was told of its actuator.
    pub const fn config(&self) -> Option<&Config<FAULTS>> {
        self.config.get()
    }

    /// What has happened since the start.
    pub const fn counters(&self) -> Counters {
        Counters {
            samples: self.samples,
            exclusions: self.exclusions,
            windows: self.number,
            skipped: self.skipped,
        }
    }

    /// Is each fault alarmed, by what has been reported so far?
    pub fn alarms(&self) -> [bool; FAULTS] {
        self.evidence.map(|evidence| evidence.alarmed)
    }

    /// Takes the samples that wait in the queue, and works on by at most `budget` steps of the model.
    ///
    /// What a call leaves of a budget below [`LONGEST_PIECE`] is saved for the next one, which takes less than twice that. Of a
    /// larger budget a call may leave less than that, and it is lost.
    pub fn poll(&mut self, outlet: &mut Outlet<'_>, budget: u32) -> Poll<FAULTS> {
        let waiting = outlet.len();
        let mut samples = 0;
        // Those that come meanwhile wait for the next call.
        while samples < waiting as u32
            && let Some(sample) = outlet.pop()
        {
            self.take(&sample);
            samples += 1;
        }
        let (steps, report) = self.work(budget);
        Poll { samples, steps, report }
    }

    /// Takes one sample, where there is no interrupt and no queue.
    #[inline(never)]
    pub fn take(&mut self, sample: &Sample) {
        let Some(config) = self.config.get().copied() else { return };
        self.samples = self.samples.saturating_add(1);
        if self.is_analysing {
            self.latency = self.latency.saturating_add(1);
        }
        let scale = config.scale();
        let limits = Limits {
            sample_period: config.sample_period,
            command: config.reach(),
            position: scale.reach(),
            current: scale.largest_current(),
            noise: config.believed_noise(),
            backlash: config.largest(Parameter::Backlash),
            saturation: config.parameters.current_limit,
            holds_command: config.holds_command,
        };
        let mut screen = self.screen;
        screen.look(sample, &limits, &mut Feed { monitor: self, scale });
        self.screen = screen;
    }

    /// Works on by at most `budget` steps of the model, saved up as for [`poll`](Self::poll) where they are few: the steps
    /// that it took, and what there is to say.
    #[must_use = "a report is handed out once"]
    #[inline(never)]
    pub fn work(&mut self, budget: u32) -> (u32, Option<Report<FAULTS>>) {
        let allowance = if budget < LONGEST_PIECE { self.saved + budget } else { budget };
        let mut left = allowance;
        // One report at a time.
        if self.is_analysing && self.outbox.get().is_none() {
            self.analyse(&mut left);
        }
        // A budget of nothing stays one.
        self.saved = left.min(LONGEST_PIECE - 1);
        (allowance - left, self.outbox.take())
    }

    /// The window that fills.
    fn filling(&mut self) -> &mut Window<SAMPLES> {
        let [first, second] = &mut self.windows;
        if self.second_fills { second } else { first }
    }

    /// Ends the window that fills because the stream is broken; what came of it is of no use.
    fn interrupt(&mut self) {
        if self.filling().filled > 0 {
            let report = self.report_of_filling();
            self.send(report);
            self.number = self.number.wrapping_add(1);
        }
        self.filling().clear(false);
    }

    /// The window that fills is full.
    #[inline(never)]
    fn rotate(&mut self, scale: Scale) {
        let number = self.number;
        self.number = number.wrapping_add(1);
        if self.is_analysing {
            self.skipped = self.skipped.saturating_add(1);
            self.filling().clear(false);
            return;
        }
        let Some(config) = self.config.get().copied() else { return };
        let settle = settle_samples::<FAULTS, SAMPLES>(&config);
        let present = self.filling().present(settle, scale);
        let wanted = (SAMPLES - settle) as u32 * LEAST_PRESENT;
        let uses_current = config.noise.current.is_finite();
        if present[0] * 10 < wanted || (uses_current && present[1] * 10 < wanted) {
            let report = self.report_of_filling();
            self.send(Report { window: number, ..report });
            self.carried = Slot::Empty;
            self.filling().clear(false);
            return;
        }
        let follows = self.filling().follows;
        let command = self.filling().get(0).command(scale);
        let later = samples_in(SPEED_TIME, config.sample_period).max(1) as usize;
        let (first, seen) = self.filling().user_from(0, scale).unwrap_or((0, command));
        let (second, later) = self.filling().user_from(first + later, scale).unwrap_or((first, seen));
        let rests = first == 0 && (seen - command).abs() <= REST_SIGMA * config.believed_noise()[0];
        let elapsed = (second - first) as f32 * config.sample_period;
        let velocity = if rests || second == first { 0.0 } else { (later - seen) / elapsed };
        let position = seen - velocity * first as f32 * config.sample_period;
        let carried = self.carried.take().filter(|carried| follows && carried.is_finite());
        let anew = || Start::moving(&config.model(&self.genes), position, velocity);
        self.start = Slot::Full(carried.unwrap_or_else(anew));
        self.carried = Slot::Empty;
        self.analysed = number;
        (self.latency, self.late) = (0, 0);
        self.second_fills = !self.second_fills;
        self.filling().clear(true);
        self.is_analysing = true;
        self.has_analysis = false;
    }

    /// Goes on with the analysis.
    #[inline(never)]
    fn analyse(&mut self, allowance: &mut u32) {
        let (Some(config), Some(start)) = (self.config.get(), self.start.get()) else { return };
        let scale = config.scale();
        let [first, second] = &self.windows;
        let window = if self.second_fills { first } else { second };
        let settle = settle_samples::<FAULTS, SAMPLES>(config);
        let time = SAMPLES.saturating_sub(self.late as usize);
        let scene = Scene { config, scale, window, start, settle, time };
        if !self.has_analysis {
            let seed = config.seed ^ u64::from(self.analysed);
            self.stepper.begin(config.sample_period, false, !self.has_begun);
            self.has_begun = true;
            self.analysis.begin(&scene, &self.genes, seed);
            self.has_analysis = true;
        }
        let seeds = self.seeds.get(..self.seeded as usize).unwrap_or(&[]);
        if !self.analysis.advance(&scene, seeds, &mut self.stepper, allowance) {
            return;
        }
        self.close();
    }

    /// Ends the analysis. Not inlined: what it copies would lie on the stack below the whole simulation.
    #[inline(never)]
    fn close(&mut self) {
        self.is_analysing = false;
        let analysis = &self.analysis;
        let (found, evaluations, steps) = (analysis.found().copied(), analysis.evaluations, analysis.steps());
        if let Some(count) = analysis.leave_seeds(&mut self.seeds) {
            self.seeded = count;
        }
        if let Some(found) = found {
            let report = self.conclude(&found);
            self.send(Report { evaluations, steps, ..report });
        }
    }

    /// What an analysis says: takes its estimates and its evidence over.
    #[inline(never)]
    fn conclude(&mut self, found: &Found<FAULTS>) -> Report<FAULTS> {
        let [first, second] = &self.windows;
        let window = if self.second_fills { first } else { second };
        let mut report = Report {
            window: self.analysed,
            first_tick: window.first_tick,
            exclusions: window.exclusions,
            latency_samples: self.latency,
            reversals: found.path.reversals,
            travel: finite(found.path.travel),
            ..self.blank()
        };
        let Some(config) = self.config.get().copied() else { return report };
        let errors = found.standard_errors();
        let widening = found.widening();
        let is_explained = found.is_explained();
        let threshold = threshold(&config);
        let (mut informs, mut is_faulty) = (false, false);
        for gene in 0..FAULTS {
            let fault = &config.faults[gene];
            let informative = found.path.reversals > 0 && errors[gene] < resolution(&config, gene);
            let by_noise = fault.free.range() * errors[gene] * widening;
            let of_model = match fault.free.parameter {
                Parameter::DryFriction => const { FRICTION_ERROR as f32 },
                _ => 0.0,
            };
            let error = libm::sqrtf(by_noise * by_noise + of_model * of_model);
            if informative {
                informs = true;
                self.genes[gene] = found.genes[gene];
                let ratio = log_likelihood_ratio(fault, fault.free.value(found.genes[gene]), error);
                if is_explained {
                    self.evidence[gene].take(ratio, threshold);
                    is_faulty |= ratio >= 0.5 * threshold;
                } else {
                    self.evidence[gene].wait(ratio);
                }
            }
            is_faulty |= self.evidence[gene].alarmed;
            report.faults[gene] = Estimate {
                standard_error: error,
                informative,
                ..estimate(&config, gene, self.genes[gene], &self.evidence[gene])
            };
        }
        for (channel, noise) in config.believed_noise().into_iter().enumerate() {
            let (mean, rms) = found.sums.residual(channel);
            // A channel without a single sample has no residual, and its noise may not be finite.
            report.offset[channel] = finite(mean * noise);
            report.residual_rms[channel] = if rms == 0.0 { 0.0 } else { rms * noise };
        }
        self.unexplained = if informs && !is_explained { self.unexplained.saturating_add(1) } else { 0 };
        if self.unexplained <= MOST_UNEXPLAINED {
            self.carried = Slot::Full(found.end);
        }
        report.verdict = match (informs, is_explained, is_faulty) {
            // It runs away, and may have no turns that could tell of a fault.
            _ if widening == f32::INFINITY => Verdict::ModelInadequate,
            (false, ..) => Verdict::Uninformative,
            (_, false, _) => Verdict::ModelInadequate,
            (_, _, true) => Verdict::Fault,
            _ => Verdict::Healthy,
        };
        report
    }

    /// A report that says nothing yet: what was known before.
    fn blank(&self) -> Report<FAULTS> {
        let noise = self.config.get().map_or([0.0; 2], Config::believed_noise);
        let faults = core::array::from_fn(|gene| match (self.config.get(), self.evidence.get(gene)) {
            (Some(config), Some(evidence)) => {
                estimate(config, gene, self.genes.get(gene).copied().unwrap_or(0.0), evidence)
            }
            _ => Estimate::default(),
        });
        Report {
            window: self.number,
            first_tick: 0,
            verdict: Verdict::SensorFault,
            faults,
            residual_rms: [0.0; 2],
            noise,
            offset: [0.0; 2],
            reversals: 0,
            travel: 0.0,
            exclusions: Exclusions::NONE,
            evaluations: 0,
            steps: 0,
            latency_samples: 0,
            skipped: self.skipped,
        }
    }

    /// What there is to say of the window that fills, where its samples are of no use.
    fn report_of_filling(&mut self) -> Report<FAULTS> {
        let window = self.filling();
        let (first_tick, exclusions) = (window.first_tick, window.exclusions);
        Report { first_tick, exclusions, ..self.blank() }
    }

    /// Lays a report out. One that was not fetched is lost.
    const fn send(&mut self, report: Report<FAULTS>) {
        self.outbox = Slot::Full(report);
    }

    /// After a restore: what is not kept is made again.
    fn resume(&mut self) {
        self.has_analysis = false;
        self.late = self.latency;
        self.has_begun = false;
        self.screen.restarted = true;
        // A start that no actuator can have is none, and without one there is nothing to analyse.
        if let Some(config) = self.config.get() {
            let bounds = config.bounds();
            for place in [&mut self.carried, &mut self.start] {
                *place = place.take().filter(|start| start.is_sound(&bounds)).into();
            }
        }
        self.is_analysing &= self.start.get().is_some();
        self.outbox = Slot::Empty;
        let window = self.filling();
        window.filled = window.filled.min(SAMPLES as u32 - 1);
    }
}

/// Samples at the start of a window that are not compared.
fn settle_samples<const FAULTS: usize, const SAMPLES: usize>(config: &Config<FAULTS>) -> usize {
    (samples_in(SETTLE, config.sample_period) as usize).min(SAMPLES / 4)
}

/// A value, or zero for what is no number.
const fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

/// A value with its evidence, and no standard error.
fn estimate<const FAULTS: usize>(
    config: &Config<FAULTS>,
    gene: usize,
    value: f32,
    evidence: &Evidence,
) -> Estimate {
    Estimate {
        value: config.faults.get(gene).map_or(0.0, |fault| fault.free.value(value)),
        standard_error: f32::INFINITY,
        informative: false,
        evidence: evidence.sum / threshold(config),
        alarmed: evidence.alarmed,
    }
}

/// Where the screen puts what it lets through: the window that fills.
struct Feed<'a, S, const SAMPLES: usize, const FAULTS: usize, const POPULATION: usize> {
    monitor: &'a mut Monitor<S, SAMPLES, FAULTS, POPULATION>,
    scale: Scale,
}

impl<S: Stepper<f32>, const SAMPLES: usize, const FAULTS: usize, const POPULATION: usize> Sink
    for Feed<'_, S, SAMPLES, FAULTS, POPULATION>
{
    fn accept(&mut self, sample: &Screened) {
        if self.monitor.filling().take(sample, self.scale) {
            self.monitor.rotate(self.scale);
        }
    }

    fn interrupt(&mut self) {
        self.monitor.interrupt();
    }

    fn take_back(&mut self, count: u32, user: bool, current: bool) {
        self.monitor.filling().take_back(count as usize, user, current);
    }

    fn exclude(&mut self, count: u32, reason: Reason) {
        self.monitor.exclusions.add(count, reason);
        self.monitor.filling().exclusions.add(count, reason);
    }
}
