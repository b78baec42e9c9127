//! Derivatives of the equations of one step, at its stages and nodes.

use super::stages::Stages;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, Pattern, all_finite, copy};
use liouville_base::tableau;
use liouville_problem::{Mechanical, Model, Points, Step, Times, finite};

/// A row a stage, or a node.
#[derive(Clone, Debug)]
pub(super) struct Derivatives {
    pub(super) p_z: Matrix,
    pub(super) v_z: Matrix,
    pub(super) p_y: Matrix,
    pub(super) f_y: Matrix,
    pub(super) f_z: Matrix,
    pub(super) v_y: Matrix,
    pub(super) g_y: Matrix,
    pub(super) r_lam: Matrix,
    pub(super) r_y: Matrix,
    /// Whether those that are constants are there.
    is_ready: bool,
}

impl Derivatives {
    /// Memory for those of a system.
    pub(super) fn new(problem: &Mechanical, tableau: &tableau::Spark) -> Self {
        let at = &problem.patterns;
        let (s, nodes) = (tableau.stages, tableau.intervals + 1);
        Self {
            p_z: Matrix::zeros(s, at.p_z.len()),
            v_z: Matrix::zeros(s, at.v_z.as_ref().map_or(0, Pattern::len)),
            p_y: Matrix::zeros(s, at.p_y.len()),
            f_y: Matrix::zeros(s, at.f_y.len()),
            f_z: Matrix::zeros(s, at.f_z.len()),
            v_y: Matrix::zeros(s, at.v_y.len()),
            g_y: Matrix::zeros(nodes, at.g_y.len()),
            r_lam: Matrix::zeros(nodes, at.r_lam.len()),
            r_y: Matrix::zeros(nodes, at.r_y.len()),
            is_ready: false,
        }
    }

    /// Evaluates all where the stages are, r_y at the first `nodes` nodes.
    pub(super) fn evaluate(
        &mut self,
        model: &mut Model,
        stages: &Stages,
        step: Step,
        nodes: usize,
    ) -> Result<(), StepError> {
        let times = stages.stage_times(step);
        let (y, z) = (&stages.y, &stages.unknowns.z);
        let out = [&mut self.p_z, &mut self.v_z];
        take(
            out,
            times,
            model.stages_blocks(times, y, z),
            (y.rows(), self.is_ready),
        )?;
        let out = [&mut self.p_y, &mut self.f_y, &mut self.f_z, &mut self.v_y];
        take(
            out,
            times,
            model.stages_jacobian(times, y, z),
            (y.rows(), self.is_ready),
        )?;
        if model.problem.m == 0 {
            self.is_ready = true;
            return Ok(());
        }
        let times = stages.node_times(step);
        let (y, lam) = (&stages.node_y, &stages.unknowns.lam);
        let out = [&mut self.g_y, &mut self.r_lam];
        take(
            out,
            times,
            model.nodes_blocks(times, y, lam),
            (y.rows(), self.is_ready),
        )?;
        let points = model.nodes_jacobian(times, y, lam);
        take([&mut self.r_y], times, points, (nodes, self.is_ready))?;
        self.is_ready = true;
        Ok(())
    }
}

/// Copies values at so many points, which have to be finite; constants once.
pub(super) fn take<const N: usize>(
    out: [&mut Matrix; N],
    times: Times,
    mut points: Points<'_, N>,
    (count, is_ready): (usize, bool),
) -> Result<(), StepError> {
    if is_ready && points.is_constant() {
        return Ok(());
    }
    let mut out = out;
    for i in 0..count {
        for (out, values) in out.iter_mut().zip(points.at(i)) {
            if !values.is_empty() {
                copy(out.row_mut(i), values);
            }
        }
    }
    if out.iter().all(|out| all_finite(out.flat())) {
        return Ok(());
    }
    let mut rows = (0..count).flat_map(|i| out.iter().map(move |out| (times.at(i), out.row(i))));
    rows.try_for_each(|(t, values)| finite(values, Quantity::Derivative, t))
}
