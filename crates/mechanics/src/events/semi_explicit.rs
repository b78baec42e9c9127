//! Resets of a semi-explicit system: a law leads to (ŷ, ẑ), and coordinates are corrected one after another,
//!
//!     w_z μ = k(t, y),   y ← y − f_z μ,   w_z = k_y f_z
//!
//! where they are, with ẑ; z⁺ follows from y⁺.

use super::linear_reset::{ListedReset, ResetEquations};
use super::slopes::SlopesModel;
use liouville_base::error::StepError;
use liouville_base::linalg::Factor;
use liouville_index2::semi_explicit::{SemiExplicitModel, SemiExplicitSensitivityModel};

/// The equations of corrections and of z behind them.
pub struct HiddenMoves {
    model: SemiExplicitModel,
    sensitivity: SemiExplicitSensitivityModel,
}

impl HiddenMoves {
    /// A reset of this model.
    pub fn listed(
        model: SemiExplicitModel,
        sensitivity: SemiExplicitSensitivityModel,
    ) -> ListedReset<Self> {
        let (sizes, width) = (
            [model.problem.n, model.problem.l],
            sensitivity.problem.width(),
        );
        ListedReset::new(Self { model, sensitivity }, sizes, width)
    }
}

impl ResetEquations for HiddenMoves {
    /// The factored w_z, and f_z.
    type Matrices = (Factor, Vec<f64>);

    fn correct(
        &mut self,
        t: f64,
        y: &mut [f64],
        z: &[f64],
    ) -> Result<(Self::Matrices, [Vec<f64>; 2]), StepError> {
        let problem = self.model.problem.clone();
        let mut mu = self.model.constraint(t, y).to_vec();
        let (w_z, f_z) = self.model.hidden_jacobian(t, y, z);
        let mut factor = Factor::new(&problem.patterns.w_z);
        let factored = factor.factor(&problem.patterns.w_z, w_z);
        factored.map_err(|singular| StepError::SingularHidden {
            unknown: singular.column,
        })?;
        factor.solve(&mut mu);
        problem.patterns.f_z.multiply_add(f_z, -1.0, &mu, y);
        Ok(((factor, f_z.to_vec()), [Vec::new(), mu]))
    }

    fn add_move<const TRANSPOSED: bool>(
        &mut self,
        (factor, f_z): &mut Self::Matrices,
        equations: &mut [f64],
        dy: &mut [f64],
    ) {
        let at = &self.model.problem.patterns.f_z;
        if TRANSPOSED {
            at.multiply_add_transposed(f_z, 1.0, dy, equations);
            factor.solve_transposed(equations);
        } else {
            factor.solve(equations);
            at.multiply_add(f_z, 1.0, equations, dy);
        }
    }

    fn make_end(
        &mut self,
        _: &SlopesModel,
        t: f64,
        _: &[f64],
        [y, _, z]: [&[f64]; 3],
    ) -> Result<(), StepError> {
        let made = self.sensitivity.linearize(&mut self.model, t, (y, z));
        made.map(|_| ())
    }

    // cotangents of z⁺ are with those of y⁺ already
    fn end<const TRANSPOSED: bool>(
        &mut self,
        _: &mut SlopesModel,
        _: (f64, &[f64]),
        changes: &mut [f64],
        dz: &mut [f64],
    ) -> Result<(), StepError> {
        if !TRANSPOSED {
            let (n, l) = (self.model.problem.n, dz.len());
            let tau = [&changes[..1], &changes[1 + n + l..]].concat();
            self.sensitivity.push(&changes[1..=n], &tau, dz);
        }
        Ok(())
    }
}
