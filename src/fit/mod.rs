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
