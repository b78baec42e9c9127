//! z at given coordinates: the solution of the hidden constraint 0 = k_t + k_y f(t, y, z).
//!
//! Newton's method, whose corrections are measured by their change of y', f_z δz.

use super::SemiExplicitModel;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Factor, copy, max_norm};
use liouville_base::newton::{self, Equations};
use liouville_problem::finite;

const MOST_ITERATIONS: usize = 50;

/// The solver, with its memory.
#[derive(Clone, Debug)]
pub struct Algebraic {
    factor: Factor,
    correction: Vec<f64>,
    effect: Vec<f64>,
}

struct AlgebraicEquations<'a> {
    at: &'a mut Algebraic,
    model: &'a mut SemiExplicitModel,
    t: f64,
    y: &'a [f64],
    z: &'a mut [f64],
    speed: f64,
}

impl Algebraic {
    /// Memory for this model.
    pub fn new(model: &SemiExplicitModel) -> Self {
        let problem = &model.problem;
        Self {
            factor: Factor::new(&problem.patterns.w_z),
            correction: vec![0.0; problem.l],
            effect: vec![0.0; problem.n],
        }
    }

    /// Moves `z` to where the hidden constraint holds; changes of y' far below `speed` do not matter.
    ///
    /// # Errors
    /// A value that is not finite, a singular `k_y f_z`, or no convergence where f is nonlinear in z.
    pub fn solve(
        &mut self,
        model: &mut SemiExplicitModel,
        t: f64,
        y: &[f64],
        z: &mut [f64],
        speed: f64,
    ) -> Result<(), StepError> {
        let is_linear = model.problem.is_linear;
        let mut solve = AlgebraicEquations {
            at: self,
            model,
            t,
            y,
            z,
            speed,
        };
        if is_linear {
            let size = solve.correct()?;
            if size.is_finite() {
                Ok(())
            } else {
                Err(StepError::NotConverged {
                    iterations: 1,
                    size,
                })
            }
        } else {
            // far from a solution the first corrections may grow
            match newton::solve(&mut solve, MOST_ITERATIONS) {
                Err(StepError::NotConverged { .. }) => newton::solve_full(&mut solve),
                solved => solved,
            }
            .map(|_| ())
        }
    }
}

impl Equations for AlgebraicEquations<'_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        let (t, y, at) = (self.t, self.y, &mut *self.at);
        let (w, f) = self.model.hidden(t, y, self.z);
        finite(w, Quantity::Hidden, t)?;
        let speed = self.speed + max_norm(f);
        copy(&mut at.correction, w);
        let problem = self.model.problem.clone();
        let (w_z, f_z) = self.model.hidden_jacobian(t, y, self.z);
        finite(w_z, Quantity::Derivative, t)?;
        let patterns = &problem.patterns;
        let factored = at.factor.factor(&patterns.w_z, w_z);
        factored.map_err(|singular| StepError::SingularHidden {
            unknown: singular.column,
        })?;
        at.factor.solve(&mut at.correction);
        at.effect.fill(0.0);
        patterns
            .f_z
            .multiply_add(f_z, 1.0, &at.correction, &mut at.effect);
        for (z, d) in self.z.iter_mut().zip(&at.correction) {
            *z -= d;
        }
        let size = max_norm(&at.effect);
        Ok(if size == 0.0 {
            0.0
        } else {
            size / speed.max(size)
        })
    }
}
