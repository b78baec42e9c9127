//! The stage equations of one step, evaluated; see the module above for the letters.

use crate::linalg::{Matrix, add_scaled, max_norm};
use crate::problem::mechanical::{Model, State, finite};
use crate::tableau::GaussLobatto;
use crate::trouble::{Quantity, Trouble};

/// The step being made: from `state` at `t` over `h`.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) t: f64,
    pub(super) h: f64,
    pub(super) state: &'a State,
}

/// Unknowns and values at the Gauss stages 1..s (rows 0..s) and at the Lobatto nodes 0..s.
#[derive(Clone, Debug)]
pub(super) struct Stages {
    pub(super) tableau: GaussLobatto,
    /// Unknowns Z_i, V_i and λ_j.
    pub(super) z: Matrix,
    pub(super) v: Matrix,
    pub(super) lam: Matrix,
    /// Values at the stages.
    pub(super) y: Matrix,
    pub(super) p: Matrix,
    pub(super) f: Matrix,
    /// Values at the nodes.
    pub(super) node_y: Matrix,
    pub(super) g: Matrix,
    pub(super) r: Matrix,
    /// Residuals V_i − v(T_i, Y_i, Z_i) and those of the momentum equation.
    pub(super) velocity_residual: Matrix,
    pub(super) momentum_residual: Matrix,
    pub(super) evaluations: usize,
}

impl Stages {
    pub(super) fn new(model: &Model, s: usize) -> Self {
        let (n, m) = (model.problem.n, model.problem.m);
        let (at_stages, at_nodes) = (Matrix::zeros(s, n), Matrix::zeros(s + 1, n));
        Self {
            tableau: GaussLobatto::new(s),
            z: at_stages.clone(),
            v: at_stages.clone(),
            lam: Matrix::zeros(s + 1, m),
            y: at_stages.clone(),
            p: at_stages.clone(),
            f: at_stages.clone(),
            node_y: at_nodes.clone(),
            g: Matrix::zeros(s + 1, m),
            r: at_nodes,
            velocity_residual: at_stages.clone(),
            momentum_residual: at_stages,
            evaluations: 0,
        }
    }

    /// Time of stage `i`.
    pub(super) fn stage_time(&self, step: Step, i: usize) -> f64 {
        step.t + self.tableau.c[i] * step.h
    }

    /// Time of node `j`.
    pub(super) fn node_time(&self, step: Step, j: usize) -> f64 {
        step.t + self.tableau.c_hat[j] * step.h
    }

    /// Evaluates the model at the current unknowns, and the residuals of (S1)–(S4).
    pub(super) fn evaluate(&mut self, model: &mut Model, step: Step) -> Result<(), Trouble> {
        self.move_points(step);
        self.evaluate_stages(model, step)?;
        if model.problem.m > 0 {
            self.evaluate_nodes(model, step)?;
        }
        self.subtract_impulses(step);
        Ok(())
    }

    /// Y_i = y0 + h Σ a_ij V_j and Ŷ_i = y0 + h Σ ā_ij V_j, the low part of y0 added first.
    fn move_points(&mut self, step: Step) {
        let Step { h, state, .. } = step;
        let s = self.tableau.stages;
        let sum = |out: &mut [f64], coefficients: &[f64], v: &Matrix| {
            out.copy_from_slice(&state.y_low);
            for (j, a) in coefficients.iter().enumerate() {
                add_scaled(out, h * a, v.row(j));
            }
            out.iter_mut().zip(&state.y).for_each(|(out, y)| *out += y);
        };
        for i in 0..s {
            sum(self.y.row_mut(i), self.tableau.a.row(i), &self.v);
        }
        for j in 0..=s {
            sum(self.node_y.row_mut(j), self.tableau.a_bar.row(j), &self.v);
        }
    }

    fn evaluate_stages(&mut self, model: &mut Model, step: Step) -> Result<(), Trouble> {
        for i in 0..self.tableau.stages {
            let t = self.stage_time(step, i);
            let [p, f, v] = model.stage(t, self.y.row(i), self.z.row(i));
            finite(p, Quantity::Momentum, t)?;
            finite(f, Quantity::Force, t)?;
            finite(v, Quantity::Velocity, t)?;
            self.p.row_mut(i).copy_from_slice(p);
            self.f.row_mut(i).copy_from_slice(f);
            for ((out, unknown), v) in self
                .velocity_residual
                .row_mut(i)
                .iter_mut()
                .zip(self.v.row(i))
                .zip(v)
            {
                *out = unknown - v;
            }
        }
        self.evaluations += self.tableau.stages;
        Ok(())
    }

    fn evaluate_nodes(&mut self, model: &mut Model, step: Step) -> Result<(), Trouble> {
        for j in 0..=self.tableau.stages {
            let t = self.node_time(step, j);
            let [g, r] = model.node(t, self.node_y.row(j), self.lam.row(j));
            finite(g, Quantity::Constraint, t)?;
            finite(r, Quantity::Reaction, t)?;
            self.g.row_mut(j).copy_from_slice(g);
            self.r.row_mut(j).copy_from_slice(r);
        }
        Ok(())
    }

    /// P_i − p0 − h Σ a_ij F_j − h Σ_{j<s} â_ij R_j.
    fn subtract_impulses(&mut self, step: Step) {
        let Step { h, state, .. } = step;
        let (s, tableau) = (self.tableau.stages, &self.tableau);
        for i in 0..s {
            let out = self.momentum_residual.row_mut(i);
            out.iter_mut()
                .zip(&state.p_low)
                .for_each(|(out, low)| *out = -low);
            for j in 0..s {
                add_scaled(out, -h * tableau.a[(i, j)], self.f.row(j));
                add_scaled(out, -h * tableau.a_hat[(i, j)], self.r.row(j));
            }
            for ((out, p), p0) in out.iter_mut().zip(self.p.row(i)).zip(&state.p) {
                *out += p - p0;
            }
        }
    }

    /// The size of a velocity correction, relative to what moves the coordinates by their own size.
    pub(super) fn relative(&self, correction: f64, step: Step) -> f64 {
        if correction == 0.0 {
            return 0.0;
        }
        correction / (max_norm(self.v.flat()) + max_norm(&step.state.y) / step.h.abs())
    }
}
