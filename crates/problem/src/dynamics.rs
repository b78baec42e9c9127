//! Derivatives along a trajectory, and multipliers: the interface of models to detectors, observers and monitors.

use super::{Acceleration, Model, model::finite};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::copy;
use std::fmt::Debug;

/// A model whose derivatives along a trajectory can be solved for.
pub trait Dynamics: Clone + Send + Sync + 'static {
    /// Solves for z' and λ, with its memory.
    type Solver: Checkpoint + Clone + Debug;

    /// A solver for this model.
    fn solver(&self) -> Self::Solver;

    /// Sizes of y, z and λ.
    fn sizes(&self) -> [usize; 3];

    /// Whether z is something else than y'.
    fn has_own_z(&self) -> bool;

    /// Moves z to where it follows from (t, y), if it does.
    ///
    /// # Errors
    /// A value that is not finite, a singular matrix, or no convergence.
    fn settle(&mut self, _t: f64, _y: &[f64], _z: &mut [f64]) -> Result<(), StepError> {
        Ok(())
    }

    /// Solves for z' and λ at (t, y, z).
    ///
    /// # Errors
    /// A value that is not finite, a singular matrix, or no convergence.
    fn solve(
        &mut self,
        solver: &mut Self::Solver,
        t: f64,
        y: &[f64],
        z: &[f64],
    ) -> Result<(), StepError>;

    /// Solves for λ at (t, y, z), if the model has one; after an error the next solve starts from zero.
    ///
    /// # Errors
    /// Errors of [`Self::solve`].
    fn solve_lam(
        &mut self,
        solver: &mut Self::Solver,
        t: f64,
        y: &[f64],
        z: &[f64],
    ) -> Result<(), StepError>;

    /// z', as last solved for.
    fn z_dot(solver: &Self::Solver) -> &[f64];

    /// λ, as last solved for.
    fn lam(solver: &Self::Solver) -> &[f64];

    /// Writes y' and y'' at (t, y, z), where z' was last solved for.
    ///
    /// # Errors
    /// A value that is not finite.
    fn derivatives(
        &mut self,
        solver: &Self::Solver,
        t: f64,
        point: (&[f64], &[f64]),
        out: [&mut [f64]; 2],
    ) -> Result<(), StepError>;
}

impl Dynamics for Model {
    type Solver = Acceleration;

    fn solver(&self) -> Acceleration {
        Acceleration::new(self)
    }

    fn sizes(&self) -> [usize; 3] {
        let n = self.problem.n;
        [n, n, self.problem.recorded_multipliers()]
    }

    fn has_own_z(&self) -> bool {
        self.problem.patterns.v_z.is_some()
    }

    fn solve(
        &mut self,
        solver: &mut Acceleration,
        t: f64,
        y: &[f64],
        z: &[f64],
    ) -> Result<(), StepError> {
        solver.solve(self, t, y, z)
    }

    fn solve_lam(
        &mut self,
        solver: &mut Acceleration,
        t: f64,
        y: &[f64],
        z: &[f64],
    ) -> Result<(), StepError> {
        let solved = solver.solve_all(self, t, y, z);
        solved.inspect_err(|_| solver.lam.fill(0.0))
    }

    fn z_dot(solver: &Acceleration) -> &[f64] {
        &solver.z_dot
    }

    fn lam(solver: &Acceleration) -> &[f64] {
        solver.multipliers()
    }

    /// y' = v and y'' = `v_t` + `v_y` v + `v_z` z'.
    fn derivatives(
        &mut self,
        solver: &Acceleration,
        t: f64,
        (y, z): (&[f64], &[f64]),
        [y_dot, y_ddot]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        if self.problem.patterns.v_z.is_some() {
            let [_, _, rate] = self.acceleration(t, y, z);
            copy(y_ddot, rate);
            copy(y_dot, self.end(t, y, z)[2]);
            let problem = self.problem.clone();
            let [_, v_z] = self.stage_blocks(t, y, z);
            if let Some(pattern) = &problem.patterns.v_z {
                pattern.multiply_add(v_z, 1.0, &solver.z_dot, y_ddot);
            }
        } else {
            copy(y_dot, z);
            copy(y_ddot, &solver.z_dot);
        }
        finite(y_dot, Quantity::Velocity, t)?;
        finite(y_ddot, Quantity::Derivative, t)
    }
}
