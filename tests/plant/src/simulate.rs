//! Time stepping: midpoint steps that are cut where dry friction or the flapper's stop sets in or lets go, or the plain
//! steps of the source.

use std::f64::consts::TAU;

use crate::physics::{Contacts, Equations, Signals, State, sat};
use crate::{Command, Plant, Record, Valve, sample_time};

/// How the plant steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Rule {
    /// Midpoint steps, cut at every event: second order.
    #[default]
    Midpoint,
    /// The source's steps, as most programs take them: rates at the start of a step, positions with the velocities at its
    /// end, a velocity that would change its sign set to zero, events at the ends of steps. First order.
    SemiImplicitEuler,
}

/// Step that the tests use (s).
pub const DEFAULT_STEP: f64 = 2e-6;
/// Period of the recorder (s).
pub const SAMPLE_PERIOD: f64 = 1e-3;

/// The end of a step is looked at this much earlier, to see a command before its jump.
const BEFORE: f64 = 1e-12;
/// Most events within one step; the rest of a step with more of them is taken as it comes.
const MOST_EVENTS: usize = 8;

impl Plant {
    /// Runs the plant from rest at zero on the command as a 1 ms recorder knows it (straight lines between
    /// samples), and records as many samples.
    pub fn record(&self, command: &Command, samples: usize) -> Record {
        self.simulate(&command.sampled(samples + 1, SAMPLE_PERIOD), samples, DEFAULT_STEP)
    }

    /// Runs the plant from rest at zero on the command as it is, at a step (s) that is rounded to divide 1 ms.
    pub fn simulate(&self, command: &Command, samples: usize, step: f64) -> Record {
        let equations = Equations { p: &self.parameters, e: &self.effects, command };
        let mut runner =
            Runner { equations, rule: self.rule, state: State::default(), contacts: Contacts::default() };
        let steps = (SAMPLE_PERIOD / step).round().max(1.0) as usize;
        let step = SAMPLE_PERIOD / steps as f64;
        let mut sensed = Vec::new();
        let mut record = Record::default();
        for i in 0..samples {
            let start = sample_time(i, SAMPLE_PERIOD);
            let now = runner.look(start, runner.command_rate(start, step)).1;
            sensed.push(now.sensed);
            record.command.push(now.command);
            record.ram.push(now.ram);
            record.current.push(now.current);
            record.pressure.push(now.pressure);
            record.flapper.push(runner.state.flapper);
            record.spool.push(runner.state.spool);
            record.load.push(now.load);
            record.lvdt.push(self.sense(start, delayed(&sensed, self.effects.sensor_delay / step)));
            for j in 0..steps {
                let end = runner.step(start + j as f64 * step, step);
                if self.effects.sensor_delay > 0.0 && j + 1 < steps {
                    sensed.push(end.sensed);
                }
            }
        }
        record
    }

    /// Static errors of the sensor.
    fn sense(&self, t: f64, x: f64) -> f64 {
        let e = &self.effects;
        x * (1.0 + e.sensor_gain)
            + e.sensor_cubic * x.powi(3)
            + e.sensor_offset
            + e.sensor_drift * t
            + e.sensor_hum.at(t)
            + match e.sensor_ripple {
                0.0 => 0.0,
                amplitude => amplitude * (TAU * x / e.sensor_ripple_pitch).sin(),
            }
    }
}

/// The value `steps` before the last one, interpolated; before the first one, the first.
fn delayed(history: &[f64], steps: f64) -> f64 {
    let at = ((history.len() - 1) as f64 - steps).max(0.0);
    let (low, high) = (history[at.floor() as usize], history[at.ceil() as usize]);
    low + (high - low) * at.fract()
}

struct Runner<'a> {
    equations: Equations<'a>,
    rule: Rule,
    state: State,
    contacts: Contacts,
}

impl Runner<'_> {
    fn look(&self, t: f64, command_rate: f64) -> (State, Signals) {
        self.equations.rates(t, &self.state, &self.contacts, command_rate)
    }

    /// Mean rate of the command over a step; jumps at its ends do not count.
    fn command_rate(&self, t: f64, h: f64) -> f64 {
        (self.equations.command.value(t + h - BEFORE) - self.equations.command.value(t)) / h
    }

    /// Advances by `h` from `start`; returns the signals at the end.
    fn step(&mut self, start: f64, h: f64) -> Signals {
        let command_rate = self.command_rate(start, h);
        match self.rule {
            Rule::Midpoint => self.cut_step(start, h, command_rate),
            Rule::SemiImplicitEuler => self.plain_step(start, h, command_rate),
        }
    }

    /// Rates and signals here, once all changes that are due at once are made.
    fn settled(&mut self, t: f64, command_rate: f64) -> (State, Signals) {
        let (mut rate, mut now) = self.look(t, command_rate);
        for _ in 0..MOST_EVENTS {
            if self.settle(t, &now) {
                (rate, now) = self.look(t, command_rate);
            }
        }
        (rate, now)
    }

    /// A semi-implicit Euler step.
    fn plain_step(&mut self, t: f64, h: f64, command_rate: f64) -> Signals {
        let (rate, _) = self.settled(t, command_rate);
        let mut state = self.state.moved(&rate, h);
        let turns_back = state.ram_rate * self.contacts.jack_slide < 0.0;
        state.ram = self.state.ram + if turns_back { 0.0 } else { h * state.ram_rate };
        if self.contacts.flapper_stop == 0.0 {
            state.flapper = self.state.flapper + h * state.flapper_rate;
        }
        state.body = self.state.body + h * state.body_rate;
        let state = self.stopped(state);
        let (_, signals) = self.equations.rates(t + h - BEFORE, &state, &self.contacts, command_rate);
        let due = self.margins(t + h, &signals, &state).map(|margin| margin < 0.0);
        self.accept(state, &signals);
        self.switch(due, &signals);
        signals
    }

    /// Midpoint steps, one from event to event.
    fn cut_step(&mut self, start: f64, h: f64, command_rate: f64) -> Signals {
        let mut left = h;
        for event in 0..=MOST_EVENTS {
            let t = start + (h - left);
            let (rate, now) = self.settled(t, command_rate);
            let margins = self.margins(t, &now, &self.state);
            let (state, signals) = self.midpoint(t, left, &rate, command_rate);
            let ends = self.margins(t + left, &signals, &state);
            // Where each margin crosses zero, as a part of what is left; 1 where it does not.
            let part = |i: usize| {
                let from = margins[i].max(0.0);
                if ends[i] < 0.0 { from / (from - ends[i]) } else { 1.0 }
            };
            let first = part(0).min(part(1)).min(part(2));
            if first >= 1.0 || event == MOST_EVENTS {
                self.accept(state, &signals);
                return signals;
            }
            let due = std::array::from_fn(|i| part(i) <= first);
            let (state, signals) = self.midpoint(t, first * left, &rate, command_rate);
            self.accept(state, &signals);
            self.switch(due, &signals);
            left *= 1.0 - first;
        }
        unreachable!("the last pass returns")
    }

    /// One midpoint step from here, contacts as they are; the state, and the signals there.
    fn midpoint(&self, t: f64, h: f64, rate: &State, command_rate: f64) -> (State, Signals) {
        let middle = self.state.moved(rate, 0.5 * h);
        let (rate, _) = self.equations.rates(t + 0.5 * h, &middle, &self.contacts, command_rate);
        let state = self.stopped(self.state.moved(&rate, h));
        let (_, signals) = self.equations.rates(t + h - BEFORE, &state, &self.contacts, command_rate);
        (state, signals)
    }

    /// Inelastic end stops and bounds.
    fn stopped(&self, mut s: State) -> State {
        let p = self.equations.p;
        if s.ram.abs() > p.jack_stop {
            s.ram = sat(s.ram, p.jack_stop);
            s.ram_rate = 0.0;
        }
        s.spool = sat(s.spool, p.spool_stop);
        s.integral = sat(s.integral, p.error_integral_limit);
        s.pressure = sat(s.pressure, self.equations.pressure_bound(&s));
        s
    }

    /// How far flapper, spool and jack are from a change of contact at a time; negative beyond it.
    fn margins(&self, t: f64, signals: &Signals, state: &State) -> [f64; 3] {
        let (p, contacts) = (self.equations.p, &self.contacts);
        let flapper = match (p.valve, contacts.flapper_stop) {
            (Valve::SecondOrderFlapper, 0.0) => p.flapper_stop - state.flapper.abs(),
            (_, side) => side * signals.flapper_push,
        };
        let spool = match (p.valve, contacts.spool_slide) {
            (Valve::FirstOrder { .. }, _) => 1.0,
            (_, 0.0) => p.spool_friction - signals.spool_drive.abs(),
            (_, slide) if p.spool_sticks_below_breakaway => slide * signals.spool_drive - p.spool_friction,
            (_, slide) => slide * signals.spool_drive - p.spool_friction / p.spool_friction_ratio,
        };
        let jack = match contacts.jack_slide {
            0.0 if state.ram * signals.jack_hold.signum() >= p.jack_stop => 1.0,
            0.0 => self.equations.breakaway(t, signals.jack_hold.signum()) - signals.jack_hold.abs(),
            slide => slide * state.ram_rate,
        };
        [flapper, spool, jack]
    }

    /// Makes the changes that are due at once, as after a jump of the command; whether there are any.
    fn settle(&mut self, t: f64, signals: &Signals) -> bool {
        let due = self.margins(t, signals, &self.state).map(|margin| margin < 0.0);
        self.switch(due, signals);
        due.contains(&true)
    }

    /// Changes the contacts of flapper, spool and jack where due.
    fn switch(&mut self, due: [bool; 3], signals: &Signals) {
        let (p, state, contacts) = (self.equations.p, &mut self.state, &mut self.contacts);
        let [flapper, spool, jack] = due;
        let changed = |now: f64, force: f64| if now == 0.0 { force.signum() } else { 0.0 };
        if flapper {
            contacts.flapper_stop = changed(contacts.flapper_stop, state.flapper);
            state.flapper = p.flapper_stop.copysign(state.flapper);
            state.flapper_rate = 0.0;
        }
        if spool {
            contacts.spool_slide = changed(contacts.spool_slide, signals.spool_drive);
        }
        if jack {
            contacts.jack_slide = changed(contacts.jack_slide, signals.jack_hold);
            state.ram_rate = 0.0;
        }
    }

    /// Takes over a state and its plays; the ram rests at its stop.
    fn accept(&mut self, state: State, signals: &Signals) {
        let at_stop = state.ram * self.contacts.jack_slide >= self.equations.p.jack_stop;
        self.state = state;
        self.contacts = Contacts {
            flapper_stop: self.contacts.flapper_stop,
            spool_slide: self.contacts.spool_slide,
            jack_slide: if at_stop { 0.0 } else { self.contacts.jack_slide },
            ..signals.contacts
        };
    }
}
