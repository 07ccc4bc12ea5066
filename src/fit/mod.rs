//! From records to parameters: the residual in units of its noise, a global search, a Gauss-Newton finish.
//!
//! ```text
//! records --> problem (which parameters are free, how noisy each channel is)
//!                |
//!                +--> walk: one prediction a sample --> cost: mean square of residual/noise
//!                +--> ga::SteadyState proposes genes --+      |
//!                +--> gauss_newton: normal equations --+<-----+--> estimate, standard errors, correlation
//! ```

pub mod gauss_newton;
pub mod identify;
pub mod problem;
pub mod walk;

/// Standard uncertainty, N, of the dry friction of a jack that a valve drives, which no record takes away. A program that
/// steps by the source's rule, 2 us at a time, is late by a part of a step wherever the ram stops or starts: to who knows
/// the friction that well, it looks 0.1 to 0.3 N weaker.
pub const FRICTION_ERROR: f64 = 0.2;
