//! Adjoints of steps of an index-2 method that were recorded.

use super::super::Index2;
use super::super::stages::{CollocationStages, CollocationStep};
use super::Index2Tangents;
use super::linear_step::LinearCollocation;
use crate::semi_explicit::{SemiExplicitSensitivityModel, SemiExplicitState};
use liouville_base::error::StepError;
use liouville_base::linalg::copy;
use liouville_base::recorder::{Recordable, StepRecord};
use liouville_problem::{Cotangents, TangentState};

impl Recordable for Index2 {
    fn write_unknowns(&self, _: &SemiExplicitState, out: &mut Vec<f64>) {
        out.clear();
        out.extend_from_slice(self.stages.v.flat());
        out.extend_from_slice(self.stages.z.flat());
    }
}

impl Recordable for Index2Tangents {
    fn write_unknowns(&self, state: &TangentState<SemiExplicitState>, out: &mut Vec<f64>) {
        self.index2.write_unknowns(&state.motion, out);
    }
}

/// Follows recorded steps of an index-2 method back.
#[derive(Clone, Debug)]
pub struct Index2Adjoint {
    stages: CollocationStages,
    linear: LinearCollocation,
}

impl Index2Adjoint {
    /// The adjoint of a method at work.
    pub fn new(index2: &Index2, sensitivity: SemiExplicitSensitivityModel) -> Self {
        Self {
            stages: index2.stages.clone(),
            linear: LinearCollocation::new(index2, sensitivity),
        }
    }

    /// Takes cotangents from the end of a step to its start.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn follow(
        &mut self,
        record: &StepRecord<SemiExplicitState>,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let step = CollocationStep {
            t: record.t,
            h: record.h,
            state: &record.before,
        };
        let (v, z) = record.unknowns.split_at(self.stages.v.flat().len());
        copy(self.stages.v.flat_mut(), v);
        copy(self.stages.z.flat_mut(), z);
        self.stages.move_points(step);
        self.linear.make(&self.stages, step, None)?;
        let LinearCollocation { map, solvers, .. } = &mut self.linear;
        let Ok(()) = map.pull(solvers, of);
        Ok(())
    }
}
