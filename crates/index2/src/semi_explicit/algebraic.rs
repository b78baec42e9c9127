//! z at given coordinates: the solution of the hidden constraint 0 = k_t + k_y f(t, y, z).
//!
//! Newton's method, whose corrections are measured by their change of y', f_z δz.

use super::SemiExplicitModel;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Factor, add_scaled, copy, max_norm};
use liouville_base::newton::{Damped, solve_damped};
use liouville_problem::finite;

/// The solver, with its memory.
#[derive(Clone, Debug)]
pub struct Algebraic {
    factor: Factor,
    correction: Vec<f64>,
    effect: Vec<f64>,
    /// f_z of the last matrix, z there, and the correction.
    f_z: Vec<f64>,
    from: Vec<f64>,
    taken: Vec<f64>,
}

struct AlgebraicEquations<'a> {
    at: &'a mut Algebraic,
    model: &'a mut SemiExplicitModel,
    t: f64,
    y: &'a [f64],
    z: &'a mut [f64],
    /// The size of y', of which corrections are a part; first without f.
    speed: f64,
    is_begun: bool,
}

impl Algebraic {
    /// Memory for this model.
    pub fn new(model: &SemiExplicitModel) -> Self {
        let problem = &model.problem;
        Self {
            factor: Factor::new(&problem.patterns.w_z),
            correction: vec![0.0; problem.l],
            effect: vec![0.0; problem.n],
            f_z: vec![0.0; problem.patterns.f_z.len()],
            from: vec![0.0; problem.l],
            taken: vec![0.0; problem.l],
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
            is_begun: false,
        };
        if is_linear {
            let size = solve.find(true)?;
            if !size.is_finite() {
                return Err(StepError::NotConverged {
                    iterations: 1,
                    size,
                });
            }
        } else {
            solve_damped(&mut solve)?;
        }
        add_scaled(z, -1.0, &self.correction);
        Ok(())
    }
}

impl Damped<f64> for AlgebraicEquations<'_> {
    fn find(&mut self, is_new: bool) -> Result<f64, StepError> {
        let (t, y, at) = (self.t, self.y, &mut *self.at);
        let (w, f) = self.model.hidden(t, y, self.z);
        finite(w, Quantity::Hidden, t)?;
        let of_field = max_norm(f);
        copy(&mut at.correction, w);
        let problem = self.model.problem.clone();
        let patterns = &problem.patterns;
        if is_new {
            let (w_z, f_z) = self.model.hidden_jacobian(t, y, self.z);
            finite(w_z, Quantity::Derivative, t)?;
            copy(&mut at.f_z, f_z);
            let factored = at.factor.factor(&patterns.w_z, w_z);
            factored.map_err(|singular| StepError::SingularHidden {
                unknown: singular.column,
            })?;
        }
        at.factor.solve(&mut at.correction);
        if is_new {
            copy(&mut at.from, self.z);
            copy(&mut at.taken, &at.correction);
        }
        at.effect.fill(0.0);
        (patterns.f_z).multiply_add(&at.f_z, 1.0, &at.correction, &mut at.effect);
        let size = max_norm(&at.effect);
        if !self.is_begun {
            self.speed += of_field + size;
            self.is_begun = true;
        }
        Ok(if size == 0.0 { 0.0 } else { size / self.speed })
    }

    fn take(&mut self, part: f64) {
        copy(self.z, &self.at.from);
        add_scaled(self.z, -part, &self.at.taken);
    }
}
