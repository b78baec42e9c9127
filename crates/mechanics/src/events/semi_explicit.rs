//! The derivative of a reset of a semi-explicit system: forwards, and transposed.
//!
//! A law leads to (ŷ, ẑ), and coordinates are corrected one after another,
//!
//!     w_z μ = k(t, y),   y ← y − f_z μ,   w_z = k_y f_z
//!
//! where they are, with ẑ; z⁺ follows. So are their derivatives, with those of these equations.

use super::slopes::{Before, LinearReset, SlopesModel};
use liouville_base::error::StepError;
use liouville_base::linalg::{Factor, add_scaled, copy, max_norm};
use liouville_index2::semi_explicit::{SemiExplicitModel, SemiExplicitSensitivityModel};

/// More corrections than a law takes to the constraints.
const MOST_CORRECTIONS: usize = 100;
/// The corrections end with that after one of this part of y.
const NEAR: f64 = 1e-10;

/// A correction of coordinates: from where, by which μ, with the matrices there.
#[derive(Clone, Debug)]
struct SemiExplicitCorrection {
    factor: Factor,
    f_z: Vec<f64>,
    y: Vec<f64>,
    mu: Vec<f64>,
}

/// A reset that is linearised.
#[derive(Clone, Debug)]
pub struct SemiExplicitReset {
    model: SemiExplicitModel,
    sensitivity: SemiExplicitSensitivityModel,
    /// Corrections from ŷ to y⁺, and ẑ.
    corrections: Vec<SemiExplicitCorrection>,
    z: Vec<f64>,
    mu: Vec<f64>,
}

impl SemiExplicitReset {
    /// Memory for this model.
    pub fn new(model: SemiExplicitModel, sensitivity: SemiExplicitSensitivityModel) -> Self {
        Self {
            corrections: Vec::new(),
            z: vec![0.0; model.problem.l],
            mu: vec![0.0; model.problem.l],
            model,
            sensitivity,
        }
    }

    /// Moves ŷ to the constraints, and keeps each correction that this takes.
    fn correct(&mut self, t: f64, jumped: &[f64]) -> Result<(), StepError> {
        let (mut y, problem) = (jumped.to_vec(), self.model.problem.clone());
        let mut is_near = false;
        for _ in 0..MOST_CORRECTIONS {
            let mut mu = self.model.constraint(t, &y).to_vec();
            let (w_z, f_z) = self.model.hidden_jacobian(t, &y, &self.z);
            let mut factor = Factor::new(&problem.patterns.w_z);
            let factored = factor.factor(&problem.patterns.w_z, w_z);
            factored.map_err(|singular| StepError::SingularHidden {
                unknown: singular.column,
            })?;
            factor.solve(&mut mu);
            let (from, f_z) = (y.clone(), f_z.to_vec());
            problem.patterns.f_z.multiply_add(&f_z, -1.0, &mu, &mut y);
            let moved = from.iter().zip(&y).map(|(a, b)| (a - b).abs());
            let is_over = is_near;
            is_near = moved.fold(0.0, f64::max) <= NEAR * max_norm(&y);
            let y = from;
            self.corrections
                .push(SemiExplicitCorrection { factor, f_z, y, mu });
            if is_over {
                break;
            }
        }
        Ok(())
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
        copy(&mut self.z, jumped_z);
        self.corrections.clear();
        if slopes.has_moves() {
            self.correct(t, jumped_y)?;
        }
        let made = self.sensitivity.linearize(&mut self.model, t, (y, z));
        made.map(|_| ())
    }

    fn push(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        along: &[f64],
        [dy, dz]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        let (n, l) = (dy.len(), dz.len());
        let (problem, tau) = (self.model.problem.clone(), tau_of(along, n + l));
        let jumped = slopes.reset(before, along, false)?;
        copy(dy, &jumped[..n]);
        let mut along = along.to_vec();
        copy(&mut along[1 + n..=n + l], &jumped[n..]);
        let (t, [.., lam]) = before;
        for correction in &mut self.corrections {
            let SemiExplicitCorrection { factor, f_z, y, mu } = correction;
            copy(&mut along[1..=n], dy);
            let moved = slopes.moves((t, [y, &self.z, lam]), [&[], mu], &along, false)?;
            let (equations, change) = moved.split_at(l);
            copy(&mut self.mu, equations);
            factor.solve(&mut self.mu);
            add_scaled(dy, -1.0, change);
            problem.patterns.f_z.multiply_add(f_z, 1.0, &self.mu, dy);
        }
        self.sensitivity.push(dy, &tau, dz);
        Ok(())
    }

    fn pull(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        [of_y, _]: [&[f64]; 2],
    ) -> Result<Vec<f64>, StepError> {
        let problem = self.model.problem.clone();
        let (n, l) = (problem.n, problem.l);
        let (mut back, mut of_z) = (of_y.to_vec(), vec![0.0; l]);
        let (t, [.., lam]) = before;
        let mut found = vec![0.0; n + l + self.sensitivity.problem.width()];
        for correction in self.corrections.iter_mut().rev() {
            let SemiExplicitCorrection { factor, f_z, y, mu } = correction;
            self.mu.fill(0.0);
            let at = &problem.patterns.f_z;
            at.multiply_add_transposed(f_z, 1.0, &back, &mut self.mu);
            factor.solve_transposed(&mut self.mu);
            let mut of = self.mu.clone();
            of.extend(back.iter().map(|x| -x));
            let moved = slopes.moves((t, [y, &self.z, lam]), [&[], mu], &of, true)?;
            add_scaled(&mut back, 1.0, &moved[1..=n]);
            add_scaled(&mut of_z, 1.0, &moved[1 + n..=n + l]);
            found[0] += moved[0];
            add_scaled(&mut found[1 + n + l..], 1.0, &moved[1 + n + l..]);
        }
        back.extend_from_slice(&of_z);
        add_scaled(&mut found, 1.0, slopes.reset(before, &back, true)?);
        Ok(found)
    }
}
