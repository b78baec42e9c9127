//! A kernel between a processor and its inverse: ψ(t + n h) = P Kⁿ P⁻¹ ψ(t).
//!
//! The kernel K is conjugate to the rotation wanted, R: K = P⁻¹ R P. P⁻¹ is applied before the first step, P before a
//! state is recorded. Source: lopezmarcos1996.

use super::processor::Processor;
use super::{Shears, Wave, check_norm};
use liouville_base::composition::Composed;
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::simd::Stored;

/// A list of shears and its processor.
#[derive(Clone)]
pub struct Processed<S: Stored> {
    kernel: Composed<Shears<S>>,
    processor: Processor,
    tolerance: f64,
    /// The length and the end of the last step of the kernel, for a state between P⁻¹ and P.
    inside: Option<(f64, f64)>,
}

impl<S: Stored> Processed<S> {
    /// A kernel with a processor made for it; the norm may be off by `tolerance`, relatively.
    ///
    /// The kernel of steps back in time is the inverse, with the same processor: its flows are undone, last
    /// to first.
    pub fn new(kernel: Composed<Shears<S>>, processor: Processor, tolerance: f64) -> Self {
        Self {
            kernel,
            processor,
            tolerance,
            inside: None,
        }
    }

    fn process(&mut self, h: f64, state: &mut Wave<S>, is_inverse: bool) -> Result<(), StepError> {
        let shears = self.kernel.parts_mut();
        let shift = shears.shift();
        let sweeper = shears.sweeper_mut();
        self.processor
            .apply(sweeper, (shift, h.abs()), state, is_inverse)
    }
}

impl<S: Stored> Stepper for Processed<S> {
    type State = Wave<S>;

    /// The step length must be the same until the state is synchronized.
    fn step(&mut self, t: f64, h: f64, state: &mut Wave<S>) -> Result<(), StepError> {
        if self.inside.is_none() {
            self.process(h, state, true)?;
        }
        self.kernel.step(t, h, state)?;
        self.inside = Some((h, t + h));
        Ok(())
    }

    fn synchronize(&mut self, state: &mut Wave<S>) -> Result<(), StepError> {
        self.kernel.synchronize(state)?;
        if let Some((h, t)) = self.inside.take() {
            self.process(h, state, false)?;
            check_norm(t, self.tolerance, state)?;
        }
        Ok(())
    }

    fn stats(&self) -> Stats {
        self.kernel.stats()
    }
}

liouville_base::checkpoint!([S: Stored] Processed<S> { kernel, inside });
