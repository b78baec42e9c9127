//! A symmetric method as the one part of a composition.

use super::{Composed, Flow, NeedsAdjoint, Parts};
use crate::error::StepError;
use crate::method::{Stats, Stepper, Symmetric};
use crate::tableau::Scheme;

/// A symmetric method as the one part of a composition.
#[derive(Clone, Debug)]
pub struct Base<S: Stepper> {
    stepper: S,
    kept: Option<S::State>,
}

impl<S: Symmetric> Composed<Base<S>>
where
    S::State: Clone,
{
    /// A symmetric method, composed by the stages γ of `scheme`.
    ///
    /// # Errors
    /// The scheme has no such stages.
    pub fn of_symmetric(stepper: S, scheme: &Scheme) -> Result<Self, NeedsAdjoint> {
        let stages = scheme.stages().ok_or(NeedsAdjoint(scheme.name))?;
        Ok(Self::of_stages(stepper, &stages))
    }

    /// A symmetric method, composed by stages of these fractions of a step.
    pub fn of_stages(stepper: S, stages: &[f64]) -> Self {
        let mut offset = 0.0;
        let program = stages.iter().map(|&weight| {
            let flow = Flow {
                part: 0,
                is_adjoint: false,
                weight,
                offset,
            };
            offset += weight;
            flow
        });
        let base = Base {
            stepper,
            kept: None,
        };
        Self::following(base, program.collect())
    }
}

impl<S: Symmetric> Parts for Base<S>
where
    S::State: Clone,
{
    type State = S::State;

    fn count(&self) -> usize {
        1
    }

    fn is_exact(&self, _: usize) -> bool {
        false
    }

    fn flow(
        &mut self,
        _: usize,
        _: bool,
        t: f64,
        h: f64,
        state: &mut S::State,
    ) -> Result<(), StepError> {
        self.stepper.step(t, h, state)
    }

    /// The method checks its states itself.
    fn check(&self, _: f64, _: &S::State) -> Result<(), StepError> {
        Ok(())
    }

    fn keep(&mut self, state: &S::State) -> bool {
        match &mut self.kept {
            Some(kept) => kept.clone_from(state),
            none => *none = Some(state.clone()),
        }
        true
    }

    fn put_back(&mut self, state: &mut S::State) {
        if let Some(kept) = &self.kept {
            state.clone_from(kept);
        }
    }

    fn forget(&mut self) {
        self.stepper.forget();
    }

    fn stats(&self, _: usize) -> Stats {
        self.stepper.stats()
    }

    fn stats_of(&self, member: usize, _: usize) -> Stats {
        self.stepper.stats_of(member)
    }
}

crate::checkpoint!([S: Stepper] Base<S> { stepper });

impl<S: Symmetric> Symmetric for Composed<Base<S>> where S::State: Clone {}
