//! States of a semi-explicit system after a jump: y is moved by f_z μ until k = 0, and z follows.

use super::{SemiExplicitModel, SemiExplicitState};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Factor, copy, max_norm};
use liouville_problem::{Corrections, Jump, Kind, Refused, Restart, Violation, finite};

/// How far constraints may be missed, as at the start of a run: in units of the coordinates, and of those at zero.
const TOLERANCES: [f64; 2] = [1e-10, 1e-14];

/// What moves a state to the constraints.
pub struct SemiExplicitRestart {
    model: SemiExplicitModel,
    factor: Factor,
    mu: Vec<f64>,
    moves: Vec<f64>,
}

impl Checkpoint for SemiExplicitRestart {}

impl SemiExplicitRestart {
    /// For this model.
    pub fn new(model: SemiExplicitModel) -> Self {
        let problem = &model.problem;
        Self {
            factor: Factor::new(&problem.patterns.w_z),
            mu: vec![0.0; problem.l],
            moves: vec![0.0; problem.n],
            model,
        }
    }

    fn move_positions(&mut self, t: f64, y: &mut [f64], z: &[f64]) -> Result<(), StepError> {
        let problem = self.model.problem.clone();
        let mut corrections = Corrections::of(max_norm(y));
        loop {
            let k = self.model.constraint(t, y);
            finite(k, Quantity::Constraint, t)?;
            copy(&mut self.mu, k);
            let (w_z, f_z) = self.model.hidden_jacobian(t, y, z);
            finite(w_z, Quantity::Derivative, t)?;
            let factored = self.factor.factor(&problem.patterns.w_z, w_z);
            factored.map_err(|singular| StepError::SingularHidden {
                unknown: singular.column,
            })?;
            self.factor.solve(&mut self.mu);
            self.moves.fill(0.0);
            let at = &problem.patterns.f_z;
            at.multiply_add(f_z, -1.0, &self.mu, &mut self.moves);
            for (y, x) in y.iter_mut().zip(&self.moves) {
                *y += x;
            }
            if corrections.is_last(max_norm(&self.moves), max_norm(y))? {
                return Ok(());
            }
        }
    }

    /// The constraint that is missed most, if one is.
    fn violation(&mut self, t: f64, y: &[f64]) -> Option<Violation> {
        let problem = self.model.problem.clone();
        let unit = TOLERANCES[0] * max_norm(y) + TOLERANCES[1];
        let mut limits = vec![0.0; problem.l];
        let slopes = self.model.constraint_jacobian(t, y);
        for (&(row, _), slope) in problem.patterns.k_y.entries().iter().zip(slopes) {
            limits[row] += slope.abs() * unit;
        }
        let values = self.model.constraint(t, y).iter().zip(&limits).enumerate();
        let is_within = |value: f64, limit: f64| value.abs() <= limit;
        let over = values.filter(|(_, (value, limit))| !is_within(**value, **limit));
        let worst = over.max_by(|a, b| a.1.0.abs().total_cmp(&b.1.0.abs()))?;
        let (index, (value, limit)) = worst;
        Some(Violation {
            kind: Kind::Holonomic,
            index,
            value: *value,
            limit: *limit,
        })
    }
}

impl Restart<SemiExplicitState> for SemiExplicitRestart {
    fn restart(
        &mut self,
        t: f64,
        before: &SemiExplicitState,
        jump: Jump<'_>,
        state: &mut SemiExplicitState,
    ) -> Result<(), Refused> {
        let moved = if *jump.y == before.y[..] {
            Ok(())
        } else {
            self.move_positions(t, jump.y, jump.z)
        };
        if let Some(missed) = self.violation(t, jump.y) {
            return Err(Refused::Violated(missed));
        }
        moved?;
        *state = self.model.state(t, jump.y, jump.z, 1.0)?;
        Ok(())
    }
}
