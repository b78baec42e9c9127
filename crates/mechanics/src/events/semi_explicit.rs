//! The derivative of a reset of a semi-explicit system: forwards, and transposed.
//!
//! A law leads to (ŷ, ẑ), and then y⁺ = ŷ + f_z μ with k(t, y⁺) = 0, and z⁺ follows. Where ŷ is on the constraints, μ
//! is zero and
//!
//!     dy⁺ = dŷ − f_z w_z⁻¹ (k_y dŷ + k_τ dτ),   w_z = k_y f_z.

use super::slopes::{Before, LinearReset, SlopesModel};
use liouville_base::error::StepError;
use liouville_base::linalg::{Factor, add_scaled, copy};
use liouville_index2::semi_explicit::{SemiExplicitModel, SemiExplicitSensitivityModel};

/// A reset that is linearised.
#[derive(Clone, Debug)]
pub struct SemiExplicitReset {
    model: SemiExplicitModel,
    sensitivity: SemiExplicitSensitivityModel,
    factor: Factor,
    f_z: Vec<f64>,
    k_y: Vec<f64>,
    k_tau: Vec<f64>,
    mu: Vec<f64>,
}

impl SemiExplicitReset {
    /// Memory for this model.
    pub fn new(model: SemiExplicitModel, sensitivity: SemiExplicitSensitivityModel) -> Self {
        let problem = &model.problem;
        Self {
            factor: Factor::new(&problem.patterns.w_z),
            f_z: vec![0.0; problem.patterns.f_z.len()],
            k_y: vec![0.0; problem.patterns.k_y.len()],
            k_tau: vec![0.0; sensitivity.problem.patterns.k_tau.len()],
            mu: vec![0.0; problem.l],
            model,
            sensitivity,
        }
    }
}

/// The changes of time and parameters among those of (t, y, z, θ).
fn tau_of(x: &[f64], state: usize) -> Vec<f64> {
    let mut tau = vec![x[0]];
    tau.extend_from_slice(&x[1 + state..]);
    tau
}

impl LinearReset for SemiExplicitReset {
    fn make(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        [y, z]: [&[f64]; 2],
    ) -> Result<(), StepError> {
        let (t, _) = before;
        let jumped = slopes.law(before)?.to_vec();
        let (jumped_y, jumped_z) = jumped.split_at(y.len());
        slopes.check_jump(t, jumped_y, y)?;
        let (w_z, f_z) = self.model.hidden_jacobian(t, jumped_y, jumped_z);
        copy(&mut self.f_z, f_z);
        let factored = self
            .factor
            .factor(&self.sensitivity.problem.system.patterns.w_z, w_z);
        factored.map_err(|singular| StepError::SingularHidden {
            unknown: singular.column,
        })?;
        copy(&mut self.k_y, self.model.constraint_jacobian(t, jumped_y));
        copy(&mut self.k_tau, self.sensitivity.constraint(t, jumped_y));
        self.sensitivity.linearize(&mut self.model, t, (y, z))
    }

    fn push(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        along: &[f64],
        [dy, dz]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        let problem = self.sensitivity.problem.clone();
        let (at, by_tau) = (&problem.system.patterns, &problem.patterns.k_tau);
        let tau = tau_of(along, dy.len() + dz.len());
        let jumped = slopes.reset(before, along, false)?;
        copy(dy, &jumped[..dy.len()]);
        self.mu.fill(0.0);
        at.k_y.multiply_add(&self.k_y, 1.0, dy, &mut self.mu);
        by_tau.multiply_add(&self.k_tau, 1.0, &tau, &mut self.mu);
        self.factor.solve(&mut self.mu);
        at.f_z.multiply_add(&self.f_z, -1.0, &self.mu, dy);
        self.sensitivity.push(dy, &tau, dz);
        Ok(())
    }

    fn pull(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        [of_y, _]: [&[f64]; 2],
    ) -> Result<Vec<f64>, StepError> {
        let problem = self.sensitivity.problem.clone();
        let (at, by_tau) = (&problem.system.patterns, &problem.patterns.k_tau);
        let (n, l) = (problem.system.n, problem.system.l);
        let (mut back, mut tau) = (of_y.to_vec(), vec![0.0; problem.width()]);
        self.mu.fill(0.0);
        at.f_z
            .multiply_add_transposed(&self.f_z, -1.0, of_y, &mut self.mu);
        self.factor.solve_transposed(&mut self.mu);
        at.k_y
            .multiply_add_transposed(&self.k_y, 1.0, &self.mu, &mut back);
        by_tau.multiply_add_transposed(&self.k_tau, 1.0, &self.mu, &mut tau);
        // z of a law is a guess
        back.resize(n + l, 0.0);
        let mut found = slopes.reset(before, &back, true)?.to_vec();
        found[0] += tau[0];
        add_scaled(&mut found[1 + n + l..], 1.0, &tau[1..]);
        Ok(found)
    }
}
