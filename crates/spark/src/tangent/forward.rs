//! Tangents through one step.

use super::super::stages::Stages;
use super::equations::LinearEquations;
use super::linear_step::LinearStep;
use super::step_changes::StepChanges;
use liouville_base::error::StepError;
use liouville_base::linalg::copy;
use liouville_problem::{Directions, Model, Step, TangentState};

/// The memory of a direction.
#[derive(Clone, Debug)]
pub(super) struct Forward(StepChanges);

/// A direction through a step from a state.
#[derive(Clone, Copy)]
pub(super) struct StepAlong<'a> {
    pub(super) step: Step<'a>,
    pub(super) direction: usize,
    pub(super) before: &'a TangentState,
    /// The relative change of the step size.
    pub(super) stretch: f64,
}

impl Forward {
    pub(super) fn new(linear: &LinearStep, stages: &Stages) -> Self {
        Self(StepChanges::new(linear, stages))
    }

    /// Writes the tangent at the end of a linearised step.
    ///
    /// # Errors
    /// A singular matrix.
    pub(super) fn follow(
        &mut self,
        of: (&mut LinearStep, &mut LinearEquations),
        at: (&Model, &Stages),
        directions: &mut Directions,
        along: StepAlong,
        state: &mut TangentState,
    ) -> Result<(), StepError> {
        let (
            changes,
            StepAlong {
                before, direction, ..
            },
        ) = (&mut self.0, along);
        changes.right.fill(0.0);
        copy(&mut changes.start.y, before.y.row(direction));
        copy(&mut changes.start.p, before.carried.row(direction));
        let clock = &mut changes.clock;
        (clock.t0, clock.stretch) = (before.t[direction], along.stretch);
        copy(&mut clock.tau, directions.tau.row(direction));
        changes.pass::<false>(of, at, along.step.h)?;
        copy(state.y.row_mut(direction), &changes.end.y);
        copy(
            state.z.row_mut(direction),
            &changes.right[changes.momentum.clone()],
        );
        copy(state.carried.row_mut(direction), &changes.end.p);
        state.t[direction] = changes.clock.t1;
        Ok(())
    }

    /// δZ_i and δV_i of the last direction, and what is behind them.
    pub(super) fn unknowns(&self, linear: &LinearStep) -> [&[f64]; 2] {
        let right = &self.0.right;
        [right, &right[linear.places().0.v..]]
    }
}
