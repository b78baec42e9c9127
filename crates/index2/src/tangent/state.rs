//! States of semi-explicit systems with their tangents, and what is recorded of them.

use crate::semi_explicit::{SemiExplicitModel, SemiExplicitState};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::observe::Observe;
use liouville_problem::{Carried, Observer, TangentView};

/// A state with its tangents, one a row.
#[derive(Debug, PartialEq)]
pub struct SemiExplicitTangentState {
    /// The state.
    pub motion: SemiExplicitState,
    pub(super) y: Matrix,
    pub(super) z: Matrix,
    pub(super) t: Vec<f64>,
}

liouville_base::clone_in_place!(SemiExplicitTangentState { motion, y, z, t });

impl Carried for SemiExplicitTangentState {
    fn y(&self) -> &[f64] {
        &self.motion.y
    }

    fn z(&self) -> &[f64] {
        &self.motion.z
    }

    fn tangents(&self) -> Option<TangentView<'_>> {
        Some(TangentView {
            y: &self.y,
            z: &self.z,
            t: &self.t,
        })
    }
}

liouville_base::checkpoint!(SemiExplicitTangentState { motion, y, z, t });

/// Records what [`Observer`] does, and behind it the tangents of y and z in one direction after another.
#[derive(Clone, Debug)]
pub struct SemiExplicitTangentObserver(pub Observer<SemiExplicitModel>);

impl Observe<SemiExplicitTangentState> for SemiExplicitTangentObserver {
    fn width(&self, state: &SemiExplicitTangentState) -> usize {
        self.0.width(state) + state.y.flat().len() + state.z.flat().len()
    }

    fn observe(
        &mut self,
        t: f64,
        state: &SemiExplicitTangentState,
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
