//! The derivative of a reset, with the impulses that keep the constraints: forwards, and transposed.
//!
//! A law of the state leads to (ŷ, ẑ), and then
//!
//!     y⁺ = ŷ + v_z x,   p_z x − r_λ μ = 0,   g(t, y⁺) = 0
//!     p(y⁺, z⁺) = p(y⁺, ẑ) + r_λ μ + e_yᵀ Λ,   w(y⁺, z⁺) = 0
//!
//! and k(t, y⁺, z⁺) = 0 with the reactions to it, and an impact has y⁺ = y, ẑ = z and e_y (v⁺ − v) = −(1 + ε) (e_t +
//! e_y v). Where ŷ is on the constraints, x is zero and its derivative that of a projection. Linear equations have the
//! matrix of accelerations, bordered by e_y.

use super::slopes::{Before, LinearReset, SlopesModel};
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, dot};
use liouville_problem::{Model, Saddle, SensitivityModel};

/// A reset that is linearised.
#[derive(Clone, Debug)]
pub struct LinearImpulse {
    model: Model,
    sensitivity: SensitivityModel,
    /// The matrices at (ŷ, ẑ) and at (y⁺, z⁺).
    moved: Saddle,
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
    /// Memory for this model.
    pub fn new(model: Model, sensitivity: SensitivityModel) -> Self {
        let (n, m) = (model.problem.n, model.problem.multipliers());
        let zeros = || vec![0.0; n];
        let pair = || [zeros(), vec![0.0; m]];
        Self {
            moved: Saddle::new(&model),
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
            sensitivity,
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

    /// Moves dŷ along the constraints.
    fn project(&mut self, t: f64, along: &[f64], multipliers: usize, dy: &mut [f64]) {
        let (n, problem) = (dy.len(), self.sensitivity.problem.clone());
        let at = &problem.mechanical.patterns;
        self.x.fill(0.0);
        self.mu.fill(0.0);
        at.g_y
            .multiply_add(self.moved.g_y(), -1.0, dy, &mut self.mu);
        let mut tau = vec![along[0]];
        tau.extend_from_slice(&along[1 + 2 * n + multipliers..]);
        let [y, z] = &self.jumped;
        let lam = &self.none[..self.model.problem.m];
        let g_tau = self.sensitivity.node(t, y, lam)[0];
        let by_tau = &problem.patterns.g_tau;
        by_tau.multiply_add(g_tau, -1.0, &tau, &mut self.mu);
        self.moved.solve(&self.model, &mut self.x, &mut self.mu);
        match &at.v_z {
            Some(pattern) => {
                let v_z = self.model.stage_blocks(t, y, z)[1];
                pattern.multiply_add(v_z, 1.0, &self.x, dy);
            }
            None => add_scaled(dy, 1.0, &self.x),
        }
    }

    fn project_back(&mut self, t: f64, multipliers: usize, of_y: &mut [f64], found: &mut [f64]) {
        let (n, problem) = (of_y.len(), self.sensitivity.problem.clone());
        let at = &problem.mechanical.patterns;
        let [y, z] = &self.jumped;
        self.x.fill(0.0);
        self.mu.fill(0.0);
        match &at.v_z {
            Some(pattern) => {
                let v_z = self.model.stage_blocks(t, y, z)[1];
                pattern.multiply_add_transposed(v_z, 1.0, of_y, &mut self.x);
            }
            None => copy(&mut self.x, of_y),
        }
        self.moved
            .solve_transposed(&self.model, &mut self.x, &mut self.mu);
        at.g_y
            .multiply_add_transposed(self.moved.g_y(), -1.0, &self.mu, of_y);
        let mut tau = vec![0.0; problem.width()];
        let lam = &self.none[..self.model.problem.m];
        let g_tau = self.sensitivity.node(t, y, lam)[0];
        let by_tau = &problem.patterns.g_tau;
        by_tau.multiply_add_transposed(g_tau, -1.0, &self.mu, &mut tau);
        found[0] += tau[0];
        add_scaled(&mut found[1 + 2 * n + multipliers..], 1.0, &tau[1..]);
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
        let (n, m) = (self.model.problem.n, self.model.problem.m);
        copy(&mut self.after[0], y);
        copy(&mut self.after[1], z);
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
        slopes.check_jump(t, &self.jumped[0], y)?;
        if m > 0 && !slopes.is_impact {
            let [y, z] = &self.jumped;
            self.moved.update(&mut self.model, t, y, z, &self.none)?;
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
        let (n, m, multipliers) = (problem.n, problem.m, problem.multipliers());
        let mut along = along.to_vec();
        if slopes.is_impact {
            copy(dy, &along[1..=n]);
        } else {
            let (found_y, found_z) = slopes.reset(before, &along, false)?.split_at(n);
            copy(dy, found_y);
            copy(dz, found_z);
            if m > 0 {
                self.project(t, &along, lam.len(), dy);
            }
            copy(&mut along[1..=n], dy);
            copy(&mut along[1 + n..=2 * n], dz);
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
        let width = 1 + 2 * n + lam.len() + self.sensitivity.problem.width() - 1;
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
        if self.model.problem.m > 0 {
            self.project_back(t, lam.len(), &mut of_y, &mut found);
        }
        let back = [of_y, of_z].concat();
        add_scaled(&mut found, 1.0, slopes.reset(before, &back, true)?);
        Ok(found)
    }
}
