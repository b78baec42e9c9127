//! The end of a step whose equations are solved to a tolerance, moved onto the constraints.
//!
//!     y1 ← y1 + M⁻¹ r_λ μ,  0 = g(t1, y1);   z1 ← z1 + M⁻¹ r_λ μ,  0 = g_t(t1, y1) + g_y(t1, y1) z1
//!
//! by the saddle at hand, which is kept over many steps, and where that is too old by that of t1.

use super::{Alpha, Reactions};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{add_scaled, copy_scaled, max_norm};
use liouville_base::newton::Projection;
use liouville_problem::{Saddle, finite};

/// A point that is off its constraints by no more than so many roundings is on them.
const ROUNDINGS: f64 = 16.0 * f64::EPSILON;

/// The part of a state that a projection moves.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    Positions,
    Velocities,
}

impl Alpha {
    /// Moves y1 and z1 of the step to `t1` onto the constraints, where its equations are solved to a tolerance.
    pub(super) fn project(&mut self, t1: f64) -> Result<(), StepError> {
        if self.solver.newton_tol.is_none() || self.model.problem.mechanical.m == 0 {
            return Ok(());
        }
        self.move_onto(t1, Part::Positions)?;
        // by the position alone velocities are off the hidden constraint by O(h²), and λ jumps where h changes: reactions that
        // are not linear in it would have no near start
        if self.reactions == Reactions::Position && self.model.problem.mechanical.is_linear {
            return Ok(());
        }
        self.move_onto(t1, Part::Velocities)
    }

    fn move_onto(&mut self, t1: f64, part: Part) -> Result<(), StepError> {
        if self.correct_by(None, t1, part)? {
            return Ok(());
        }
        let model = &mut self.model.general;
        let mut saddle = (self.saddle.take()).unwrap_or_else(|| Box::new(Saddle::new(model)));
        saddle.update(model, t1, &self.other.y, &self.other.z, &self.kept[1].lam)?;
        self.correct_by(Some(&mut saddle), t1, part)?;
        self.saddle = Some(saddle);
        Ok(())
    }

    /// Corrections by this saddle, or by the one at hand; says whether the last one was roundoff.
    fn correct_by(
        &mut self,
        mut saddle: Option<&mut Saddle>,
        t1: f64,
        part: Part,
    ) -> Result<bool, StepError> {
        let (next, model) = (&mut self.other, &mut self.model.general);
        let (moved, multipliers) = &mut self.moved;
        let mut projection = Projection::new(self.solver.stop());
        let (mut size, mut unit) = (0.0, 0.0);
        while projection.is_wanted() {
            let (residuals, quantity) = match part {
                Part::Positions => {
                    let [g, _] = model.node(t1, &next.y, &self.kept[1].lam);
                    (g, Quantity::Constraint)
                }
                Part::Velocities => {
                    let [_, w, _] = model.end(t1, &next.y, &next.z);
                    (w, Quantity::Hidden)
                }
            };
            finite(residuals, quantity, t1)?;
            copy_scaled(multipliers, -1.0, residuals);
            moved.fill(0.0);
            match saddle.as_deref_mut().or(self.matrix.saddle()) {
                Some(saddle) => saddle.solve(model, moved, multipliers),
                None => return Ok(false),
            }
            let of_y = max_norm(&next.y);
            let (x, rest) = match part {
                Part::Positions => (&mut next.y, 0.0),
                Part::Velocities => (&mut next.z, of_y / next.h.abs()),
            };
            (size, unit) = (max_norm(moved), max_norm(x) + rest);
            if projection.take(size, unit) != 0.0 {
                add_scaled(x, 1.0, moved);
            }
        }
        Ok(size <= ROUNDINGS * unit)
    }
}
