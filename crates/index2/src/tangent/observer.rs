//! What is recorded of states of semi-explicit systems with their tangents.

use crate::semi_explicit::{SemiExplicitModel, SemiExplicitState};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::observe::Observe;
use liouville_problem::{Observer, TangentState};

/// Records what [`Observer`] does, and behind it the tangents of y and z in one direction after another.
#[derive(Clone, Debug)]
pub struct SemiExplicitTangentObserver(pub Observer<SemiExplicitModel>);

impl Observe<TangentState<SemiExplicitState>> for SemiExplicitTangentObserver {
    fn width(&self, state: &TangentState<SemiExplicitState>) -> usize {
        self.0.width(state) + state.y.flat().len() + state.z.flat().len()
    }

    fn observe(
        &mut self,
        t: f64,
        state: &TangentState<SemiExplicitState>,
        row: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        self.0.observe(t, state, row)?;
        for direction in 0..state.t.len() {
            row.extend_from_slice(state.y.row(direction));
            row.extend_from_slice(state.z.row(direction));
        }
        Ok(())
    }
}

impl Checkpoint for SemiExplicitTangentObserver {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.0.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.0.restore(member, saved)
    }
}
