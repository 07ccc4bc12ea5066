//! What a recorder on the plant sees, and what it adds to it.

use std::f64::consts::TAU;

/// Uniform samples of a run, from time zero on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Command (m).
    pub command: Vec<f64>,
    /// Position of the user as the sensor gives it (m).
    pub lvdt: Vec<f64>,
    /// Position of the ram (m), over ground where the mount gives way.
    pub ram: Vec<f64>,
    /// Current `Cor` before hysteresis and offset (mA).
    pub current: Vec<f64>,
    /// Pressure difference `P12` (Pa).
    pub pressure: Vec<f64>,
    /// Flapper `XF` (m), zero where the valve has no dynamic flapper; no recorder sees it.
    pub flapper: Vec<f64>,
    /// Spool `XS` (m); no recorder sees it.
    pub spool: Vec<f64>,
    /// All external force on the ram, springs and disturbance included, detent excluded (N).
    pub load: Vec<f64>,
}

impl Record {
    /// Adds noise to the sensor's samples whose standard deviation is `seconds` times the command's rate
    /// (an effect outside the catalogue: no model of additive noise explains it).
    pub fn add_rate_noise(&mut self, seconds: f64, period: f64, seed: u64) {
        let mut gauss = Gauss::new(seed);
        for i in 0..self.lvdt.len() {
            let rate = (self.command[i] - self.command[i.saturating_sub(1)]) / period;
            self.lvdt[i] += seconds * rate.abs() * gauss.draw();
        }
    }
}

/// Adds white Gaussian noise to a channel.
pub fn add_noise(channel: &mut [f64], rms: f64, seed: u64) {
    add_filtered_noise(channel, rms, 0.0, seed);
}

/// Adds Gaussian noise behind a filter of first order that starts empty: what neighbouring samples share of it is given, from
/// 0 (white) to below 1.
pub fn add_filtered_noise(channel: &mut [f64], rms: f64, shared: f64, seed: u64) {
    let mut gauss = Gauss::new(seed);
    let mut filtered = 0.0;
    for x in channel {
        filtered = shared * filtered + (1.0 - shared * shared).sqrt() * gauss.draw();
        *x += rms * filtered;
    }
}

/// Rounds a channel to multiples of a unit.
pub fn quantise(channel: &mut [f64], unit: f64) {
    for x in channel {
        *x = (*x / unit).round() * unit;
    }
}

/// Root mean square of the difference of two channels.
pub fn rms_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "channels of equal length");
    (a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// Seeded deviates: splitmix64 and the polar angle form of Box and Muller.
#[derive(Debug, Clone)]
pub struct Gauss {
    state: u64,
}

impl Gauss {
    /// A generator that repeats for the same seed.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// The next deviate, of mean 0 and variance 1.
    pub fn draw(&mut self) -> f64 {
        // 1 - uniform is in (0, 1], where the logarithm is finite.
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }

    /// The next number from 0 to 1, 1 excluded.
    pub fn uniform(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
