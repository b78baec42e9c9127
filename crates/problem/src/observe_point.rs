//! The adjoint of the values that are recorded at a point of a run.

use super::{Carried, Cotangents, Dynamics, Side};
use liouville_base::error::StepError;

/// Takes cotangents of the values at a point to y, z and τ there.
pub trait ObservePoint: Clone + Send + Sync + 'static {
    /// The model of the motion.
    type Model: Dynamics;

    /// Adds cotangents of (y, z, λ) of a state.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn observe(
        &mut self,
        at: (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError>;

    /// The derivative along the motion, on one side, of a function with these cotangents at a state.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    fn rate(
        &mut self,
        at: (f64, &impl Carried),
        side: Side,
        of: &Cotangents,
    ) -> Result<f64, StepError>;
}
