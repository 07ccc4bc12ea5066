//! What the laws that are not affine add to the affine rate: metering, Stribeck friction, drag, a supply that sags.
//!
//! They act in two places only, a force on the ram and the rate of the pressure of compressible oil.

use super::state::{Mode, State, side};
use super::{Drive, Model};
use crate::scalar::Real;

/// One value for each place where a curved law acts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Curved<V> {
    /// Force on the ram in its cylinder, N, positive in extension.
    pub(crate) force: V,
    /// Rate of the pressure of compressible oil, Pa/s.
    pub(crate) pressure_rate: V,
}

impl<V: Copy> Curved<V> {
    /// Every value changed in one way.
    pub(crate) fn map<W>(&self, change: impl Fn(V) -> W) -> Curved<W> {
        Curved { force: change(self.force), pressure_rate: change(self.pressure_rate) }
    }
}

/// A term and its slope with the state that it acts on: ram velocity or pressure.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Term<T> {
    pub(crate) value: T,
    pub(crate) slope: T,
}

impl<T: Real> Model<T> {
    /// What the curved laws add to [`affine_rate`](Self::affine_rate) in a mode.
    #[inline]
    pub(crate) fn curved(&self, mode: &Mode, z: &State<T>) -> Curved<Term<T>> {
        let mut curved = Curved::<Term<T>>::default();
        let has_fluid = self.form.drive == Drive::Valve
            && !(self.fluid.is_linear() && self.parameters.supply_sag == T::ZERO);
        let opening = self.spool.opening(z.spool, side(mode.overlap), T::ONE);
        if mode.jack_slides() {
            let (value, slope) = if self.jack.is_affine() {
                (T::ZERO, T::ZERO)
            } else {
                self.jack.curved_force(z.ram, z.ram_velocity, side(mode.jack))
            };
            curved.force = Term { value, slope };
            if has_fluid && !self.fluid.is_compressible() {
                let fluid = self.fluid_now(z);
                let (pressure, slope) = if fluid.is_linear() {
                    fluid.limited_law(mode.pressure, opening, z.ram_velocity)
                } else {
                    fluid.metering_law(opening, z.ram_velocity, T::ZERO)
                };
                let (affine, affine_slope) = self.fluid.limited_law(mode.pressure, opening, z.ram_velocity);
                curved.force.value += self.jack.area * (pressure - affine);
                curved.force.slope += self.jack.area * (slope - affine_slope);
            }
        }
        if has_fluid && self.fluid.is_compressible() && mode.pressure == 0 {
            let (value, slope) = self.fluid_now(z).curved_pressure_rate(&self.fluid, opening, z.pressure);
            curved.pressure_rate = Term { value, slope };
        }
        curved
    }
}
