//! The Newton matrix at a solution: with its derivatives it is the linearised step, which tangents are solved with.

use super::{FullNewton, Offsets, Stages};
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::tableau;
use liouville_problem::{Model, Step};

/// Derivatives in the matrix that it does not keep for itself: at the stages, and of g at the nodes.
#[derive(Clone, Debug)]
pub(crate) struct Derivatives {
    pub(crate) p_y: Matrix,
    pub(crate) f_z: Matrix,
    pub(crate) v_y: Matrix,
    pub(crate) g_y: Matrix,
}

impl Derivatives {
    /// Memory for those of a model.
    pub(super) fn new(model: &Model, tableau: &tableau::Spark) -> Self {
        let at = &model.problem.patterns;
        let (s, nodes) = (tableau.stages, tableau.intervals + 1);
        Self {
            p_y: Matrix::zeros(s, at.p_y.len()),
            f_z: Matrix::zeros(s, at.f_z.len()),
            v_y: Matrix::zeros(s, at.v_y.len()),
            g_y: Matrix::zeros(nodes, at.g_y.len()),
        }
    }
}

impl FullNewton {
    /// Makes and factors the matrix at a solution of the stage equations, where they have been evaluated.
    pub(crate) fn linearize_at(
        &mut self,
        stages: &mut Stages,
        model: &mut Model,
        z1: &mut [f64],
        step: Step,
    ) -> Result<(), StepError> {
        self.start(stages, model, z1, step).linearize()
    }

    /// Solves in place, in the order of equations and unknowns.
    pub(crate) fn solve(&mut self, x: &mut [f64]) {
        self.matrix.solve(x);
    }

    /// Solves with the transposed matrix in place.
    pub(crate) fn solve_transposed(&mut self, x: &mut [f64]) {
        self.matrix.solve_transposed(x);
    }

    /// Number of unknowns.
    pub(crate) fn order(&self) -> usize {
        self.unknowns.len()
    }

    /// Where equations and unknowns begin.
    pub(crate) fn offsets(&self) -> Offsets {
        self.offsets
    }

    /// Further derivatives in the matrix.
    pub(crate) fn derivatives(&self) -> &Derivatives {
        &self.kept
    }

    /// `f_y` at the stages.
    pub(crate) fn f_y(&self) -> &Matrix {
        &self.blocks.f_y.values
    }

    /// `r_y` at the nodes but for the last.
    pub(crate) fn r_y(&self) -> &Matrix {
        &self.blocks.r_y.values
    }

    /// `r_λ` at the nodes.
    pub(crate) fn r_lam(&self) -> &Matrix {
        &self.r_lam
    }
}
