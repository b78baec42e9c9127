//! Resets of a mechanical system, with the impulses that keep the constraints.
//!
//!     y⁺ = ŷ + v_z x,   p_z x − r_λ μ = 0,   g(t, y⁺) = 0
//!     p(y⁺, z⁺) = p(y⁺, ẑ) + r_λ μ + e_yᵀ Λ,   w(y⁺, z⁺) = 0
//!
//! and k(t, y⁺, z⁺) = 0 with the reactions to it, and an impact has y⁺ = y, ẑ = z and e_y (v⁺ − v) = −(1 + ε) (e_t +
//! e_y v). Coordinates are corrected by
//!
//!     p_z x − r_λ μ = 0,   w_z x + g = 0,   y ← y + v_z x
//!
//! where they are. Linear equations have the matrix of accelerations, bordered by e_y.

use super::linear_reset::{ListedReset, ResetEquations};
use super::slopes::{Before, SlopesModel};
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, dot};
use liouville_base::linear::set;
use liouville_problem::{Model, Saddle};

/// The equations of corrections and impulses.
pub struct Impulses {
    model: Model,
    /// The matrix at (y⁺, z⁺).
    end: Saddle,
    none: Vec<f64>,
    /// y⁺ and ẑ; z⁺; μ with Λ behind.
    states: [Vec<f64>; 2],
    after: Vec<f64>,
    multipliers: Vec<f64>,
    /// e_y, and v_zᵀ e_y at the end.
    gradient: Vec<f64>,
    row: Vec<f64>,
    /// The unknowns for a unit right-hand side e_y, and v_zᵀ e_y of the transposed matrix.
    unit: Vec<f64>,
    unit_transposed: Vec<f64>,
}

impl Impulses {
    /// A reset of this model, with so many derivatives by time and parameters.
    pub fn listed(model: Model, width: usize) -> ListedReset<Self> {
        let (n, multipliers) = (model.problem.n, model.problem.multipliers());
        let zeros = || vec![0.0; n];
        let equations = Self {
            end: Saddle::new(&model),
            none: vec![0.0; multipliers],
            states: [zeros(), zeros()],
            after: zeros(),
            multipliers: Vec::new(),
            gradient: zeros(),
            row: zeros(),
            unit: vec![0.0; n + multipliers],
            unit_transposed: vec![0.0; n + multipliers],
            model,
        };
        ListedReset::new(equations, [n, n], width)
    }

    /// Solves with the matrix at the end, or its transpose.
    fn solve<const TRANSPOSED: bool>(&mut self, x: &mut [f64]) {
        let (x, mu) = x.split_at_mut(self.model.problem.n);
        if TRANSPOSED {
            self.end.solve_transposed(&self.model, x, mu);
        } else {
            self.end.solve(&self.model, x, mu);
        }
    }

    /// Solves with the matrix at the end in place, bordered by e_y where there is one number more for an impact.
    fn solve_bordered<const TRANSPOSED: bool>(&mut self, x: &mut [f64]) {
        let inner = self.unit.len();
        let (x, border) = x.split_at_mut(inner);
        self.solve::<TRANSPOSED>(x);
        // the column of the border is −e_y
        let (row, unit, sign) = if TRANSPOSED {
            (&self.gradient, &self.unit_transposed, -1.0)
        } else {
            (&self.row, &self.unit, 1.0)
        };
        if let [last] = border {
            let n = row.len();
            let size = (sign * *last - dot(row, &x[..n])) / dot(row, &unit[..n]);
            add_scaled(x, size, unit);
            *last = sign * size;
        }
    }

    /// Finds the border of the matrix, of an impact.
    fn find_border(&mut self, t: f64) {
        let n = self.row.len();
        self.row.fill(0.0);
        match &self.model.problem.clone().patterns.v_z {
            Some(pattern) => {
                let v_z = self.model.stage_blocks(t, &self.states[0], &self.after)[1];
                pattern.multiply_add_transposed(v_z, 1.0, &self.gradient, &mut self.row);
            }
            None => copy(&mut self.row, &self.gradient),
        }
        let of = [&self.gradient, &self.row].map(|from| {
            let mut right = vec![0.0; self.none.len() + n];
            copy(&mut right[..n], from);
            right
        });
        let [mut unit, mut transposed] = of;
        self.solve::<false>(&mut unit);
        self.solve::<true>(&mut transposed);
        (self.unit, self.unit_transposed) = (unit, transposed);
    }
}

impl ResetEquations for Impulses {
    type Matrices = Saddle;

    fn correct(
        &mut self,
        t: f64,
        y: &mut [f64],
        z: &[f64],
    ) -> Result<(Saddle, [Vec<f64>; 2]), StepError> {
        let model = &mut self.model;
        let m = model.problem.m;
        let mut saddle = Saddle::new(model);
        saddle.update(model, t, y, z, &self.none)?;
        let (mut x, mut mu) = (vec![0.0; y.len()], self.none.clone());
        add_scaled(&mut mu[..m], -1.0, model.node(t, y, &self.none[..m])[0]);
        saddle.solve(model, &mut x, &mut mu);
        saddle.mass.add_velocity(&x, y);
        Ok((saddle, [x, mu]))
    }

    fn add_move<const TRANSPOSED: bool>(
        &mut self,
        saddle: &mut Saddle,
        equations: &mut [f64],
        dy: &mut [f64],
    ) {
        let (x, mu) = equations.split_at_mut(dy.len());
        if TRANSPOSED {
            saddle.mass.add_velocity_transposed(-1.0, dy, x);
            saddle.solve_transposed(&self.model, x, mu);
        } else {
            for value in x.iter_mut().chain(&mut *mu) {
                *value = -*value;
            }
            saddle.solve(&self.model, x, mu);
            saddle.mass.add_velocity(x, dy);
        }
    }

    fn make_end(
        &mut self,
        slopes: &SlopesModel,
        t: f64,
        law: &[f64],
        [y, jumped, z]: [&[f64]; 3],
    ) -> Result<(), StepError> {
        if !slopes.has_impulse() {
            return Ok(());
        }
        copy(&mut self.states[0], y);
        copy(&mut self.states[1], jumped);
        copy(&mut self.after, z);
        self.end.update(&mut self.model, t, y, z, &self.none)?;
        let mut x = self.model.end(t, y, jumped)[0].to_vec();
        add_scaled(&mut x, -1.0, self.model.end(t, y, z)[0]);
        x.resize(self.unit.len() + usize::from(slopes.is_impact), 0.0);
        if slopes.is_impact {
            copy(&mut self.gradient, &law[1..]);
            self.find_border(t);
        }
        self.solve_bordered::<false>(&mut x);
        self.multipliers.clear();
        self.multipliers.extend_from_slice(&x[y.len()..]);
        Ok(())
    }

    fn end<const TRANSPOSED: bool>(
        &mut self,
        slopes: &mut SlopesModel,
        (t, lam): (f64, &[f64]),
        changes: &mut [f64],
        dz: &mut [f64],
    ) -> Result<(), StepError> {
        if !slopes.has_impulse() {
            set::<TRANSPOSED, _>(dz, 1.0, &mut changes[1 + dz.len()..=2 * dz.len()]);
            return Ok(());
        }
        let ([y, z], ends) = (
            self.states.clone(),
            [self.after.clone(), self.multipliers.clone()],
        );
        let (at, ends): (Before<'_>, [&[f64]; 2]) = ((t, [&y, &z, lam]), [&ends[0], &ends[1]]);
        if TRANSPOSED {
            let mut back = dz.to_vec();
            back.resize(dz.len() + self.multipliers.len(), 0.0);
            self.solve_bordered::<true>(&mut back);
            add_scaled(changes, -1.0, slopes.impulse(at, ends, &back, true)?);
        } else {
            let moved = slopes.impulse(at, ends, changes, false)?;
            let mut x: Vec<f64> = moved.iter().map(|x| -x).collect();
            self.solve_bordered::<false>(&mut x);
            copy(dz, &x[..dz.len()]);
        }
        Ok(())
    }
}
