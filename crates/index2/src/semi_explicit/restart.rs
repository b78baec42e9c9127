//! States of a semi-explicit system after a jump: y is moved by f_z μ until k = 0, and z follows.

use super::{SemiExplicitModel, SemiExplicitState};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Factor, add_scaled, copy, max_norm};
use liouville_base::newton::{Equations, solve_full};
use liouville_problem::{Jump, Kind, Refused, Restart, Sizes, Violation, finite};

/// How far constraints may be missed, as at the start of a run: in units of the coordinates, and of those at zero.
const TOLERANCES: [f64; 2] = [1e-10, 1e-14];

/// The solver that moves a state to the constraints.
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

/// k = 0, of coordinates that are moved.
struct Positions<'a> {
    of: &'a mut SemiExplicitRestart,
    t: f64,
    y: &'a mut [f64],
    z: &'a [f64],
    sizes: Sizes,
}

impl Equations for Positions<'_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        let SemiExplicitRestart {
            model,
            factor,
            mu,
            moves,
        } = &mut *self.of;
        let (t, problem) = (self.t, model.problem.clone());
        let k = model.constraint(t, self.y);
        finite(k, Quantity::Constraint, t)?;
        copy(mu, k);
        let (w_z, f_z) = model.hidden_jacobian(t, self.y, self.z);
        finite(w_z, Quantity::Derivative, t)?;
        let factored = factor.factor(&problem.patterns.w_z, w_z);
        factored.map_err(|singular| StepError::SingularHidden {
            unknown: singular.column,
        })?;
        factor.solve(mu);
        moves.fill(0.0);
        let at = &problem.patterns.f_z;
        at.multiply_add(f_z, -1.0, mu, moves);
        add_scaled(self.y, 1.0, moves);
        Ok(self.sizes.next(moves, self.y))
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        Ok(self.sizes.are_roundoff())
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
            let sizes = Sizes::of(jump.y);
            let (y, z) = (&mut *jump.y, &*jump.z);
            solve_full(&mut Positions {
                of: self,
                t,
                y,
                z,
                sizes,
            })
            .map(|_| ())
        };
        if let Some(missed) = self.violation(t, jump.y) {
            return Err(Refused::Violated(missed));
        }
        moved?;
        *state = self.model.state(t, jump.y, jump.z, 1.0)?;
        Ok(())
    }
}
