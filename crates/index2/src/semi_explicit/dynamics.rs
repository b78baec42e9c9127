//! Derivatives along a trajectory: z' and y''.
//!
//! The hidden constraint 0 = w(t, y, z) holds along the trajectory, and so do its derivative and that of f:
//!
//!     0 = w_t + w_y f + w_z z',   y'' = f_t + f_y f + f_z z'

use super::{Algebraic, SemiExplicitModel, SemiExplicitState};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Factor, copy};
use liouville_problem::{Carried, Dynamics, finite};

/// The solver for z', with its memory.
#[derive(Clone, Debug)]
pub struct RateSolver {
    pub(super) factor: Factor,
    /// z', as last solved for.
    pub(super) z_dot: Vec<f64>,
    /// y'', as last solved for.
    pub y_ddot: Vec<f64>,
}

impl Checkpoint for RateSolver {}

impl Carried for SemiExplicitState {
    fn y(&self) -> &[f64] {
        &self.y
    }

    fn z(&self) -> &[f64] {
        &self.z
    }
}

impl Dynamics for SemiExplicitModel {
    type Solver = RateSolver;

    fn solver(&self) -> RateSolver {
        let problem = &self.problem;
        RateSolver {
            factor: Factor::new(&problem.patterns.w_z),
            z_dot: vec![0.0; problem.l],
            y_ddot: vec![0.0; problem.n],
        }
    }

    fn sizes(&self) -> [usize; 3] {
        [self.problem.n, self.problem.l, 0]
    }

    fn has_own_z(&self) -> bool {
        true
    }

    fn settle(&mut self, t: f64, y: &[f64], z: &mut [f64]) -> Result<(), StepError> {
        Algebraic::new(self).solve(self, t, y, z, 0.0)
    }

    fn solve(
        &mut self,
        solver: &mut RateSolver,
        t: f64,
        y: &[f64],
        z: &[f64],
    ) -> Result<(), StepError> {
        let (drift, rate) = self.rates(t, y, z);
        finite(drift, Quantity::Hidden, t)?;
        finite(rate, Quantity::Derivative, t)?;
        solver
            .z_dot
            .iter_mut()
            .zip(drift)
            .for_each(|(out, x)| *out = -x);
        copy(&mut solver.y_ddot, rate);
        let problem = self.problem.clone();
        let patterns = &problem.patterns;
        let (w_z, f_z) = self.hidden_jacobian(t, y, z);
        finite(w_z, Quantity::Derivative, t)?;
        finite(f_z, Quantity::Derivative, t)?;
        let factored = solver.factor.factor(&patterns.w_z, w_z);
        factored.map_err(|singular| StepError::SingularHidden {
            unknown: singular.column,
        })?;
        solver.factor.solve(&mut solver.z_dot);
        patterns
            .f_z
            .multiply_add(f_z, 1.0, &solver.z_dot, &mut solver.y_ddot);
        Ok(())
    }

    /// Nothing: z takes the place of λ, and every state has it.
    fn solve_lam(
        &mut self,
        _solver: &mut RateSolver,
        _t: f64,
        _y: &[f64],
        _z: &[f64],
    ) -> Result<(), StepError> {
        Ok(())
    }

    fn z_dot(solver: &RateSolver) -> &[f64] {
        &solver.z_dot
    }

    fn lam(_solver: &RateSolver) -> &[f64] {
        &[]
    }

    fn derivatives(
        &mut self,
        solver: &RateSolver,
        t: f64,
        (y, z): (&[f64], &[f64]),
        [y_dot, y_ddot]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        copy(y_dot, self.field(t, y, z));
        copy(y_ddot, &solver.y_ddot);
        finite(y_dot, Quantity::Field, t)
    }
}
