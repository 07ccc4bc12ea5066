//! What is to be fitted to what: records, noise, free parameters.

use super::walk::Walk;
use crate::channel::Channel;
use crate::integrate::Stepper;
use crate::model::drive::Law;
use crate::model::state::Outputs;
use crate::model::{Form, Model};
use crate::parameter::{Parameter, Parameters, Reach};
use crate::scalar::Real;
use crate::simulate::Follower;

/// Number of channels that the model predicts.
pub const MEASURED: usize = Channel::MEASURED.len();

/// Samples between two looks at whether a misfit is above its bound.
const BETWEEN_LOOKS: usize = 40;

/// State and time in which a stretch of a record starts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Start<T> {
    /// Time from the start of the record, s.
    pub time: T,
    /// Ram position, m.
    pub ram: T,
    /// Ram velocity, m/s; the stretch starts at rest where it is 0.
    pub velocity: T,
}

/// A record as the core sees it: slices of equal length, one value a sample.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a, T> {
    /// Sample period, s.
    pub sample_period: T,
    /// Commanded position, m.
    pub command: &'a [T],
    /// Commanded position just before each sample, m: where the straight line from the sample before ends. The command
    /// jumps where that is not the sample itself. Empty where it never does.
    pub arriving: &'a [T],
    /// Share of the sample before each one by which a jump of the command comes before it, from 0 to below 1. Empty where
    /// every jump comes at its sample.
    pub ahead: &'a [T],
    /// Force on the ram from outside, N (driving force minus load); empty where there is none.
    pub force: &'a [T],
    /// Does the force keep the value of a sample until the next one? If not it goes there in a straight line.
    pub holds: bool,
    /// The controller that drives a jack which a force moves; its force comes on top of `force`.
    pub law: Option<Law<T>>,
    /// Measured channels in the order of [`Channel::MEASURED`]; empty where absent, NaN where a sample is missing.
    pub measured: [&'a [T]; MEASURED],
    /// Noise of the measured channels.
    pub noise: Noise<T>,
    /// Samples in a stretch: the model starts anew from `starts` after each. The whole record by default.
    pub stretch: usize,
    /// State at the start of each stretch.
    pub starts: &'a [Start<T>],
    /// Samples at the start of each stretch that are not compared, while the start is forgotten.
    pub settle: usize,
    /// Do command and user position differ by an unknown constant? The mean of the user position's residual is then not
    /// compared: it is that constant's best value.
    pub offset_unknown: bool,
}

impl<'a, T: Real> Record<'a, T> {
    /// A record of one stretch that starts at rest at `start`.
    pub fn new(sample_period: T, command: &'a [T], start: &'a Start<T>) -> Self {
        Self {
            sample_period,
            command,
            arriving: &[],
            ahead: &[],
            force: &[],
            holds: false,
            law: None,
            measured: [&[]; MEASURED],
            noise: [T::ONE / T::ZERO; MEASURED],
            stretch: command.len().max(1),
            starts: core::slice::from_ref(start),
            settle: 0,
            offset_unknown: false,
        }
    }

    /// Commanded position just before a sample, m; none past the end.
    pub fn arriving(&self, sample: usize) -> Option<T> {
        self.arriving.get(sample).or_else(|| self.command.get(sample)).copied()
    }

    /// Samples from one on, at most a number of them, at which the command does not jump.
    pub fn unbroken(&self, sample: usize, most: usize) -> usize {
        let ends = self.arriving.iter().zip(self.command).skip(sample).take(most);
        if self.arriving.is_empty() { most } else { ends.take_while(|(end, command)| end == command).count() }
    }

    /// The record with one more measured channel and the standard deviation of its noise, in its unit (ignored where
    /// the model does not predict the channel).
    #[must_use]
    pub fn with(mut self, channel: Channel, values: &'a [T], noise: T) -> Self {
        if let Some(index) = Channel::MEASURED.iter().position(|&known| known == channel) {
            self.measured[index] = values;
            self.noise[index] = noise;
        }
        self
    }

    /// Does any force act from outside?
    pub fn has_force(&self) -> bool {
        !self.force.is_empty() || self.law.is_some()
    }

    /// Samples from one on, in its stretch, that are not compared with the model, while the start is forgotten.
    #[inline]
    fn settling(&self, sample: usize) -> usize {
        if self.settle == 0 { 0 } else { self.settle.saturating_sub(sample % self.stretch.max(1)) }
    }

    /// Is a sample compared with the model?
    #[inline]
    pub fn is_compared(&self, sample: usize) -> bool {
        self.settling(sample) == 0
    }

    /// What of it is compared with the model.
    pub fn compared(&self) -> Compared<'a, T> {
        let mut compared = Compared { values: [&[]; MEASURED], weights: [T::ZERO; MEASURED] };
        for channel in 0..MEASURED {
            if self.noise[channel].finite() {
                compared.values[channel] = self.measured[channel];
                compared.weights[channel] = T::ONE / self.noise[channel];
            }
        }
        compared
    }
}

/// Standard deviation of the noise of each measured channel, in the channel's unit; not finite: the channel is not
/// used.
pub type Noise<T> = [T; MEASURED];

/// A parameter that a search may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Free<T> {
    /// Which.
    pub parameter: Parameter,
    /// Smallest value, in the parameter's unit.
    pub lower: T,
    /// Largest value.
    pub upper: T,
}

impl<T: Real> Free<T> {
    /// Width of the range.
    pub fn range(&self) -> T {
        self.upper - self.lower
    }

    /// Value of a gene in `[0, 1]`.
    #[inline]
    pub fn value(&self, gene: T) -> T {
        self.lower + gene * self.range()
    }

    /// Gene of a value, cut to `[0, 1]`.
    pub fn gene(&self, value: T) -> T {
        ((value - self.lower) / self.range()).larger(T::ZERO).smaller(T::ONE)
    }
}

/// A fit: structure, parameters, those that are free, and records.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a, T> {
    /// Structure of the model.
    pub form: Form,
    /// Values of the parameters that are not free.
    pub parameters: Parameters<T>,
    /// The free parameters.
    pub free: &'a [Free<T>],
    /// The records, fitted together.
    pub records: &'a [Record<'a, T>],
}

/// The channels of a record that are compared with the model; an unused one is empty.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a, T> {
    values: [&'a [T]; MEASURED],
    /// 1 over the noise.
    weights: [T; MEASURED],
}

impl<T: Real> Compared<'_, T> {
    /// Residual of a channel at a sample in units of its noise, measured minus predicted; none where the channel is
    /// absent, unused or the sample is missing.
    #[inline(always)]
    pub fn residual(&self, channel: usize, sample: usize, outputs: &Outputs<T>) -> Option<T> {
        let &value = self.values[channel].get(sample)?;
        value.finite().then(|| (value - outputs.to_array()[channel]) * self.weights[channel])
    }

    /// Sums over the residuals of a channel at the samples from one on for which there is a prediction, without those
    /// that are missing.
    fn sums(&self, channel: usize, first: usize, predicted: &[T]) -> Sums<T> {
        let values = self.values[channel].get(first..).unwrap_or_default();
        if values.is_empty() {
            return Sums::NONE;
        }
        // One that is missing shows in the sum, so that none has to be asked in the usual case.
        let mut sums = Sums::of_whole(values, predicted);
        if !sums.squares.finite() {
            sums = Sums::NONE;
            sums.add(values.iter().zip(predicted).filter(|(value, _)| value.finite()));
        }
        let weight = self.weights[channel];
        sums.level.sum *= weight;
        sums.squares *= weight * weight;
        sums
    }

    /// Residuals of all channels at a sample, in units of their noise; 0 with `false` where there is none.
    #[inline(always)]
    pub fn residuals(&self, sample: usize, outputs: &Outputs<T>) -> [(T, bool); MEASURED] {
        core::array::from_fn(|channel| match self.residual(channel, sample, outputs) {
            Some(residual) => (residual, true),
            None => (T::ZERO, false),
        })
    }
}

/// Sums over residuals in units of their noise.
#[derive(Clone, Copy)]
struct Sums<T> {
    level: Offset<T>,
    /// Sum of squares.
    squares: T,
}

impl<T: Real> Sums<T> {
    const NONE: Self = Self { level: Offset::NONE, squares: T::ZERO };

    /// The sums over all values for which there is a prediction, before they are weighted; four at a time: a loop of one
    /// pair would cost as much as the pair.
    fn of_whole(values: &[T], predicted: &[T]) -> Self {
        let pairs = values.len().min(predicted.len());
        let (values, last_values) = values.get(..pairs).unwrap_or_default().as_chunks::<4>();
        let (predicted, last_predicted) = predicted.get(..pairs).unwrap_or_default().as_chunks::<4>();
        let mut sums = Self::NONE;
        for (values, predicted) in values.iter().zip(predicted) {
            sums.add(values.iter().zip(predicted));
        }
        sums.add(last_values.iter().zip(last_predicted));
        sums
    }

    /// Adds pairs of a measured value and a predicted one.
    #[inline(always)]
    fn add<'a>(&mut self, pairs: impl Iterator<Item = (&'a T, &'a T)>) {
        for (&value, &predicted) in pairs {
            let residual = value - predicted;
            self.level.add(residual);
            self.squares += residual * residual;
        }
    }
}

/// Residual of a record's user position, summed: what an unknown offset can take away of chi-square, and what is to be
/// added to the prediction then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset<T> {
    sum: T,
    count: u32,
}

impl<T: Real> Offset<T> {
    /// Place of the user position among the measured channels.
    pub const CHANNEL: usize = 0;

    /// Of no sample.
    pub const NONE: Self = Self { sum: T::ZERO, count: 0 };

    /// Adds the residual of a sample.
    pub fn add(&mut self, residual: T) {
        self.sum += residual;
        self.count += 1;
    }

    /// Adds the residuals of other samples.
    fn join(&mut self, other: &Self) {
        self.sum += other.sum;
        self.count += other.count;
    }

    /// Mean of the residual; 0 where there is none.
    pub fn mean(&self) -> T {
        self.mean_of(self.sum)
    }

    /// Mean of something else that was summed over the same samples.
    pub fn mean_of(&self, sum: T) -> T {
        if self.count == 0 { T::ZERO } else { sum / T::from_count(self.count) }
    }

    /// Part of the sum of squares that the mean makes.
    pub fn square(&self) -> T {
        self.sum * self.mean()
    }
}

/// Sum of squares of the residual in units of its noise, and how many samples it is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Misfit<T> {
    /// Sum of `(residual/noise)^2`.
    pub chi_square: T,
    /// Number of terms.
    pub count: u32,
}

impl<T: Real> Misfit<T> {
    /// Mean of the squares: 1 where the residual is just the noise. Infinite where nothing was compared.
    pub fn mean_square(&self) -> T {
        if self.count == 0 { T::ONE / T::ZERO } else { self.chi_square / T::from_count(self.count) }
    }
}

impl<T: Real> Problem<'_, T> {
    /// The parameters with the genes in place of the free ones.
    pub fn parameters_of(&self, genes: &[T]) -> Parameters<T> {
        let mut parameters = self.parameters;
        for (free, &gene) in self.free.iter().zip(genes) {
            parameters.set(free.parameter, free.value(gene));
        }
        parameters
    }

    /// The model of a set of genes.
    pub fn model(&self, genes: &[T]) -> Model<T> {
        Model::new(self.form, &self.parameters_of(genes))
    }

    /// Does any free parameter reach the transition matrices?
    pub fn moves_dynamics(&self) -> bool {
        self.free.iter().any(|free| Model::<T>::reach(self.form, free.parameter) == Reach::Dynamics)
    }

    /// Makes a stepper that has stepped another rig, or may have, one of this rig's: what it keeps of the other would be
    /// taken for this one's.
    pub fn turn_to_this_rig<S: Stepper<T>>(&self, stepper: &mut S) {
        if let Some(record) = self.records.first() {
            stepper.begin(record.sample_period, record.has_force(), true);
        }
    }

    /// Misfit of a set of genes. One evaluation: every record is simulated once. The stepper has to be new, or
    /// [this rig's](Self::turn_to_this_rig).
    pub fn misfit<S: Stepper<T>>(&self, genes: &[T], stepper: &mut S) -> Misfit<T> {
        self.misfit_within(genes, stepper, T::ONE / T::ZERO)
    }

    /// Does a gene change the output of the motion only (backlash, LVDT)? Candidates that differ in it alone share one
    /// motion.
    pub fn is_output(&self, gene: usize) -> bool {
        let free = self.free.get(gene);
        free.is_some_and(|free| Model::<T>::reach(self.form, free.parameter) == Reach::Output)
    }

    /// Misfit of a set of genes, given up as soon as chi-square is above a bound: what has been summed by then. Further
    /// samples could only add to it, also where an offset is unknown: the best one for more samples is no better for
    /// fewer.
    pub fn misfit_within<S: Stepper<T>>(&self, genes: &[T], stepper: &mut S, bound: T) -> Misfit<T> {
        self.misfits_within(genes, [], stepper, bound).0
    }

    /// Misfits of a set of genes and of others that [differ in their output only](Self::is_output), in one evaluation.
    /// They are given up as soon as chi-square of all of them is above a bound.
    pub fn misfits_within<S: Stepper<T>, const OTHERS: usize>(
        &self,
        genes: &[T],
        others: [&[T]; OTHERS],
        stepper: &mut S,
        bound: T,
    ) -> (Misfit<T>, [Misfit<T>; OTHERS]) {
        let model = self.model(genes);
        let mut leader = Tally::NONE;
        let mut followed = [Tally::NONE; OTHERS];
        let mut rig_changed = self.moves_dynamics();
        let mut predicted = [[T::ZERO; BETWEEN_LOOKS]; MEASURED];
        let mut users = [[T::ZERO; BETWEEN_LOOKS]; OTHERS];
        let are_above = |leader: &Tally<T>, followed: &[Tally<T>]| {
            leader.is_above(bound) && followed.iter().all(|tally| tally.is_above(bound))
        };
        for record in self.records {
            stepper.begin(record.sample_period, record.has_force(), rig_changed);
            rig_changed = false;
            let mut walk = Walk::new(&model, record);
            let mut followers =
                others.map(|genes| Some(Follower::of(&self.model(genes), record.sample_period)));
            let compared = record.compared();
            while walk.has_next(record) {
                let (mut first, mut filled) = (0, 0);
                let most = walk.left(record).min(BETWEEN_LOOKS);
                walk.lead_on(record, stepper, &mut followers, most, |sample, outputs, followers| {
                    for (channel, output) in predicted.iter_mut().zip(outputs.to_array()) {
                        if let Some(place) = channel.get_mut(filled) {
                            *place = output;
                        }
                    }
                    for (users, follower) in users.iter_mut().zip(followers.iter_mut().flatten()) {
                        let user = follower.shown();
                        if let Some(place) = users.get_mut(filled) {
                            *place = user;
                        }
                    }
                    filled += 1;
                    first = sample + 1 - filled;
                });
                let settling = record.settling(first);
                for (channel, predicted) in predicted.iter().enumerate() {
                    let sums_of = |predicted: &[T]| {
                        let predicted = predicted.get(settling..filled).unwrap_or_default();
                        compared.sums(channel, first + settling, predicted)
                    };
                    let sums = sums_of(predicted);
                    let is_user = channel == Offset::<T>::CHANNEL;
                    let is_level = record.offset_unknown && is_user;
                    leader.add(sums, is_level);
                    for (tally, users) in followed.iter_mut().zip(&users) {
                        tally.add(if is_user { sums_of(users) } else { sums }, is_level);
                    }
                }
                if are_above(&leader, &followed) {
                    break;
                }
            }
            leader.close();
            followed.iter_mut().for_each(Tally::close);
            if are_above(&leader, &followed) {
                break;
            }
        }
        (leader.misfit, followed.map(|tally| tally.misfit))
    }
}

/// A misfit that is being summed.
#[derive(Clone, Copy)]
struct Tally<T> {
    misfit: Misfit<T>,
    /// What an unknown offset of the present record takes away of it.
    level: Offset<T>,
}

impl<T: Real> Tally<T> {
    const NONE: Self = Self { misfit: Misfit { chi_square: T::ZERO, count: 0 }, level: Offset::NONE };

    fn add(&mut self, sums: Sums<T>, is_level: bool) {
        self.misfit.chi_square += sums.squares;
        self.misfit.count += sums.level.count;
        if is_level {
            self.level.join(&sums.level);
        }
    }

    fn is_above(&self, bound: T) -> bool {
        self.misfit.chi_square - self.level.square() > bound
    }

    /// The end of a record.
    fn close(&mut self) {
        self.misfit.chi_square -= core::mem::replace(&mut self.level, Offset::NONE).square();
    }
}
