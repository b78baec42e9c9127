//! The derivative of a reset, with the impulses that keep the constraints: forwards, and transposed.
//!
//! A law of the state leads to (ŷ, ẑ), and then
//!
//!     y⁺ = ŷ + v_z x,   p_z x − r_λ μ = 0,   g(t, y⁺) = 0
//!     p(y⁺, z⁺) = p(y⁺, ẑ) + r_λ μ + e_yᵀ Λ,   w(y⁺, z⁺) = 0
//!
//! and k(t, y⁺, z⁺) = 0 with the reactions to it, and an impact has y⁺ = y, ẑ = z and e_y (v⁺ − v) = −(1 + ε) (e_t +
//! e_y v). Coordinates are corrected one after another, by
//!
//!     p_z x − r_λ μ = 0,   w_z x + g = 0,   y ← y + v_z x
//!
//! where they are, and so are their derivatives, with those of these equations. Linear equations have the matrix of
//! accelerations, bordered by e_y.

use super::slopes::{Before, LinearReset, SlopesModel};
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, dot, max_norm};
use liouville_problem::{Model, Saddle};

/// More corrections than a law takes to the constraints.
const MOST_CORRECTIONS: usize = 100;
/// The corrections end with that after one of this part of y.
const NEAR: f64 = 1e-10;

/// A correction of coordinates: from where, by which x and μ, with the matrix there.
#[derive(Clone, Debug)]
struct Correction {
    saddle: Saddle,
    y: Vec<f64>,
    x: Vec<f64>,
    mu: Vec<f64>,
}

/// A reset that is linearised.
#[derive(Clone, Debug)]
pub struct LinearImpulse {
    model: Model,
    /// How many numbers time and parameters have.
    width: usize,
    /// Corrections from ŷ to y⁺.
    corrections: Vec<Correction>,
    /// The matrix at (y⁺, z⁺).
    end: Saddle,
    none: Vec<f64>,
    /// ŷ, ẑ; y⁺, z⁺; μ with Λ behind.
    jumped: [Vec<f64>; 2],
    after: [Vec<f64>; 2],
    impulses: Vec<f64>,
    /// e_y, and v_zᵀ e_y at the end.
    gradient: Vec<f64>,
    row: Vec<f64>,
    /// The unknowns for a unit right-hand side e_y, and v_zᵀ e_y.
    unit: [Vec<f64>; 2],
    unit_transposed: [Vec<f64>; 2],
    x: Vec<f64>,
    mu: Vec<f64>,
}

impl LinearImpulse {
    /// Memory for this model, with so many derivatives by time and parameters.
    pub fn new(model: Model, width: usize) -> Self {
        let (n, m) = (model.problem.n, model.problem.multipliers());
        let zeros = || vec![0.0; n];
        let pair = || [zeros(), vec![0.0; m]];
        Self {
            width,
            corrections: Vec::new(),
            end: Saddle::new(&model),
            none: vec![0.0; model.problem.multipliers()],
            jumped: [zeros(), zeros()],
            after: [zeros(), zeros()],
            impulses: Vec::new(),
            gradient: zeros(),
            row: zeros(),
            unit: pair(),
            unit_transposed: pair(),
            x: zeros(),
            mu: vec![0.0; m],
            model,
        }
    }

    /// Finds the impulses, which led from z to z⁺.
    fn find_impulses(&mut self, t: f64, is_impact: bool) -> Result<(), StepError> {
        let ([y, z], jumped) = (&self.after, &self.jumped[1]);
        self.end.update(&mut self.model, t, y, z, &self.none)?;
        copy(&mut self.x, self.model.end(t, y, z)[0]);
        add_scaled(&mut self.x, -1.0, self.model.end(t, y, jumped)[0]);
        self.mu.fill(0.0);
        self.end.solve(&self.model, &mut self.x, &mut self.mu);
        self.impulses.clear();
        if !is_impact {
            self.impulses.extend(self.mu.iter().map(|mu| -mu));
            return Ok(());
        }
        self.row.fill(0.0);
        let problem = self.model.problem.clone();
        match &problem.patterns.v_z {
            Some(pattern) => {
                let v_z = self.model.stage_blocks(t, y, z)[1];
                pattern.multiply_add_transposed(v_z, 1.0, &self.gradient, &mut self.row);
            }
            None => copy(&mut self.row, &self.gradient),
        }
        for ([x, mu], from) in [
            (&mut self.unit, &self.gradient),
            (&mut self.unit_transposed, &self.row),
        ] {
            copy(x, from);
            mu.fill(0.0);
        }
        let [x, mu] = &mut self.unit;
        self.end.solve(&self.model, x, mu);
        let [x, mu] = &mut self.unit_transposed;
        self.end.solve_transposed(&self.model, x, mu);
        let [x, mu] = &self.unit;
        let size = dot(&self.row, &self.x) / dot(&self.row, x);
        let own = self.mu.iter().zip(mu);
        self.impulses
            .extend(own.map(|(found, unit)| size * unit - found));
        self.impulses.push(size);
        Ok(())
    }

    /// Moves ŷ to the constraints, and keeps each correction that this takes.
    fn correct(&mut self, t: f64) -> Result<(), StepError> {
        let (m, [mut y, z]) = (self.model.problem.m, self.jumped.clone());
        let mut is_near = false;
        for _ in 0..MOST_CORRECTIONS {
            let mut saddle = Saddle::new(&self.model);
            saddle.update(&mut self.model, t, &y, &z, &self.none)?;
            let (mut x, mut mu) = (vec![0.0; y.len()], self.none.clone());
            let g = self.model.node(t, &y, &self.none[..m])[0];
            add_scaled(&mut mu[..m], -1.0, g);
            saddle.solve(&self.model, &mut x, &mut mu);
            let from = y.clone();
            saddle.mass.add_velocity(&x, &mut y);
            let moved = from.iter().zip(&y).map(|(a, b)| (a - b).abs());
            let is_over = is_near;
            is_near = moved.fold(0.0, f64::max) <= NEAR * max_norm(&y);
            let y = from;
            self.corrections.push(Correction { saddle, y, x, mu });
            if is_over {
                break;
            }
        }
        Ok(())
    }

    /// Takes dŷ through all corrections, with what else moves of (t, y, z, λ, θ).
    fn push_corrections(
        &mut self,
        slopes: &mut SlopesModel,
        (t, lam): (f64, &[f64]),
        mut along: Vec<f64>,
        dy: &mut [f64],
    ) -> Result<(), StepError> {
        let n = dy.len();
        for correction in &mut self.corrections {
            let Correction { saddle, y, x, mu } = correction;
            copy(&mut along[1..=n], dy);
            let point: Before<'_> = (t, [y, &self.jumped[1], lam]);
            let moved = slopes.moves(point, [x, mu], &along, false)?;
            let (equations, change) = moved.split_at(n + mu.len());
            self.x.fill(0.0);
            self.mu.fill(0.0);
            add_scaled(&mut self.x, -1.0, &equations[..n]);
            add_scaled(&mut self.mu, -1.0, &equations[n..]);
            saddle.solve(&self.model, &mut self.x, &mut self.mu);
            add_scaled(dy, 1.0, change);
            saddle.mass.add_velocity(&self.x, dy);
        }
        Ok(())
    }

    /// Takes cotangents of y⁺ to those of ŷ and ẑ, and of all else.
    fn pull_corrections(
        &mut self,
        slopes: &mut SlopesModel,
        (t, lam): (f64, &[f64]),
        [of_y, of_z]: [&mut [f64]; 2],
        found: &mut [f64],
    ) -> Result<(), StepError> {
        let n = of_y.len();
        for correction in self.corrections.iter_mut().rev() {
            let Correction { saddle, y, x, mu } = correction;
            self.x.fill(0.0);
            self.mu.fill(0.0);
            saddle.mass.add_velocity_transposed(-1.0, of_y, &mut self.x);
            saddle.solve_transposed(&self.model, &mut self.x, &mut self.mu);
            let back = [&self.x[..], &self.mu, of_y].concat();
            let point: Before<'_> = (t, [y, &self.jumped[1], lam]);
            let moved = slopes.moves(point, [x, mu], &back, true)?;
            add_scaled(of_y, 1.0, &moved[1..=n]);
            add_scaled(of_z, 1.0, &moved[1 + n..=2 * n]);
            found[0] += moved[0];
            add_scaled(&mut found[1 + 2 * n..], 1.0, &moved[1 + 2 * n..]);
        }
        Ok(())
    }
}

impl LinearReset for LinearImpulse {
    fn make(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        [y, z]: [&[f64]; 2],
    ) -> Result<(), StepError> {
        let (t, [y0, z0, _]) = before;
        let n = self.model.problem.n;
        copy(&mut self.after[0], y);
        copy(&mut self.after[1], z);
        self.corrections.clear();
        let is_impact = slopes.is_impact;
        let law = slopes.law(before)?;
        if is_impact {
            copy(&mut self.gradient, &law[1..]);
            copy(&mut self.jumped[0], y0);
            copy(&mut self.jumped[1], z0);
        } else {
            let (jumped_y, jumped_z) = law.split_at(n);
            copy(&mut self.jumped[0], jumped_y);
            copy(&mut self.jumped[1], jumped_z);
        }
        if slopes.has_moves() {
            self.correct(t)?;
        }
        if slopes.has_impulse() {
            self.find_impulses(t, slopes.is_impact)?;
        }
        Ok(())
    }

    fn push(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        along: &[f64],
        [dy, dz]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        let (t, [y0, z0, lam]) = before;
        let problem = &self.model.problem;
        let (n, multipliers) = (problem.n, problem.multipliers());
        let mut along = along.to_vec();
        if slopes.is_impact {
            copy(dy, &along[1..=n]);
        } else {
            let (found_y, found_z) = slopes.reset(before, &along, false)?.split_at(n);
            copy(dy, found_y);
            copy(dz, found_z);
            copy(&mut along[1 + n..=2 * n], dz);
            if slopes.has_moves() {
                self.push_corrections(slopes, (t, lam), along.clone(), dy)?;
            }
            copy(&mut along[1..=n], dy);
        }
        if !slopes.has_impulse() {
            return Ok(());
        }
        let z = if slopes.is_impact {
            z0
        } else {
            &self.jumped[1]
        };
        let y = if slopes.is_impact { y0 } else { &self.after[0] };
        let ends: [&[f64]; 2] = [&self.after[1], &self.impulses];
        let moved = slopes.impulse((t, [y, z, lam]), ends, &along, false)?;
        self.mu.fill(0.0);
        dz.fill(0.0);
        add_scaled(dz, -1.0, &moved[..n]);
        add_scaled(&mut self.mu, -1.0, &moved[n..n + multipliers]);
        self.end.solve(&self.model, dz, &mut self.mu);
        if let Some(rate) = moved.get(n + multipliers) {
            let unit = &self.unit[0];
            let size = (-rate - dot(&self.row, dz)) / dot(&self.row, unit);
            add_scaled(dz, size, unit);
        }
        Ok(())
    }

    fn pull(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        [of_y, of_z]: [&[f64]; 2],
    ) -> Result<Vec<f64>, StepError> {
        let (t, [y0, z0, lam]) = before;
        let n = self.model.problem.n;
        let width = 2 * n + lam.len() + self.width;
        let (mut found, mut of_y, mut of_z) = (vec![0.0; width], of_y.to_vec(), of_z.to_vec());
        if slopes.has_impulse() {
            copy(&mut self.x, &of_z);
            self.mu.fill(0.0);
            self.end
                .solve_transposed(&self.model, &mut self.x, &mut self.mu);
            let mut back = [&self.x[..], &self.mu].concat();
            if slopes.is_impact {
                let [unit, unit_mu] = &self.unit_transposed;
                let size = dot(&self.gradient, &self.x) / dot(&self.gradient, unit);
                add_scaled(&mut back[..n], -size, unit);
                add_scaled(&mut back[n..], -size, unit_mu);
                back.push(size);
            }
            let z = if slopes.is_impact {
                z0
            } else {
                &self.jumped[1]
            };
            let y = if slopes.is_impact { y0 } else { &self.after[0] };
            let ends: [&[f64]; 2] = [&self.after[1], &self.impulses];
            let moved = slopes.impulse((t, [y, z, lam]), ends, &back, true)?;
            add_scaled(&mut found, -1.0, moved);
            of_z.fill(0.0);
        }
        if slopes.is_impact {
            add_scaled(&mut found[1..=n], 1.0, &of_y);
            return Ok(found);
        }
        let (own_y, own_z) = found[1..=2 * n].split_at_mut(n);
        add_scaled(&mut of_y, 1.0, own_y);
        add_scaled(&mut of_z, 1.0, own_z);
        own_y.fill(0.0);
        own_z.fill(0.0);
        if slopes.has_moves() {
            let of = [&mut of_y[..], &mut of_z];
            self.pull_corrections(slopes, (t, lam), of, &mut found)?;
        }
        let back = [of_y, of_z].concat();
        add_scaled(&mut found, 1.0, slopes.reset(before, &back, true)?);
        Ok(found)
    }
}
