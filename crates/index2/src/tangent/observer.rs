//! Records of states of semi-explicit systems with their tangents.

use crate::semi_explicit::SemiExplicitModel;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::observe::Observe;
use liouville_problem::{Carried, Observer};

/// Records what [`Observer`] does, and behind it the tangents of y and z in one direction after another.
#[derive(Clone, Debug)]
pub struct SemiExplicitTangentObserver {
    inner: Observer<SemiExplicitModel>,
    count: usize,
}

impl SemiExplicitTangentObserver {
    /// An observer of so many tangents beside `inner`, which records states.
    pub fn new(inner: Observer<SemiExplicitModel>, count: usize) -> Self {
        Self { inner, count }
    }
}

impl<S: Carried> Observe<S> for SemiExplicitTangentObserver {
    fn width(&self, state: &S) -> usize {
        self.inner.width(state) + self.count * (state.y().len() + state.z().len())
    }

    fn observe(&mut self, t: f64, state: &S, row: &mut Vec<f64>) -> Result<(), StepError> {
        self.inner.observe(t, state, row)?;
        let Some(of) = state.tangents() else {
            return Ok(());
        };
        for direction in 0..self.count {
            row.extend_from_slice(of.y.row(direction));
            row.extend_from_slice(of.z.row(direction));
        }
        Ok(())
    }

    fn locate(&mut self, t: f64, state: &S, place: &mut Vec<f64>) -> Result<bool, StepError> {
        self.inner.locate(t, state, place)
    }
}

impl Checkpoint for SemiExplicitTangentObserver {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.inner.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.inner.restore(member, saved)
    }
}
