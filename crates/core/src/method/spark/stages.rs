//! The stage equations of one step, evaluated; see the module above for the letters.

use crate::linalg::{Matrix, combine, copy, max_norm};
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
    /// Values at the nodes.
    pub(super) node_y: Matrix,
    pub(super) g: Matrix,
    /// Forces: F_1..F_s, then the reactions R_0..R_s.
    pub(super) forces: Matrix,
    /// Residuals V_i − v(T_i, Y_i, Z_i) and those of the momentum equation.
    pub(super) velocity_residual: Matrix,
    pub(super) momentum_residual: Matrix,
    pub(super) evaluations: usize,
    weights: Weights,
}

/// The coefficients times the step size.
#[derive(Clone, Debug)]
struct Weights {
    h: f64,
    /// h a
    stage: Matrix,
    /// h ā
    node: Matrix,
    /// h (a | â), the last column of â, which is zero, left out
    force: Matrix,
}

impl Stages {
    pub(super) fn new(model: &Model, s: usize) -> Self {
        let (n, m) = (model.problem.n, model.problem.m);
        let at_stages = Matrix::zeros(s, n);
        Self {
            tableau: GaussLobatto::new(s),
            z: at_stages.clone(),
            v: at_stages.clone(),
            lam: Matrix::zeros(s + 1, m),
            y: at_stages.clone(),
            p: at_stages.clone(),
            node_y: Matrix::zeros(s + 1, n),
            g: Matrix::zeros(s + 1, m),
            forces: Matrix::zeros(2 * s + 1, n),
            velocity_residual: at_stages.clone(),
            momentum_residual: at_stages,
            evaluations: 0,
            weights: Weights {
                h: f64::NAN,
                stage: Matrix::zeros(s, s),
                node: Matrix::zeros(s + 1, s),
                force: Matrix::zeros(s, 2 * s),
            },
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
        self.evaluate_values(model, step);
        self.subtract_impulses(step);
        let is_finite = |x: &Matrix| x.flat().iter().all(|x| x.is_finite());
        if is_finite(&self.momentum_residual)
            && is_finite(&self.velocity_residual)
            && is_finite(&self.g)
        {
            Ok(())
        } else {
            Err(self.not_finite(step))
        }
    }

    /// Evaluates the model at the current unknowns: points, forces, constraints and reactions.
    pub(super) fn evaluate_values(&mut self, model: &mut Model, step: Step) {
        self.move_points(step);
        let s = self.tableau.stages;
        for i in 0..s {
            let t = self.stage_time(step, i);
            let [p, f, v] = model.stage(t, self.y.row(i), self.z.row(i));
            copy(self.p.row_mut(i), p);
            copy(self.forces.row_mut(i), f);
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
        self.evaluations += s;
        if model.problem.m > 0 {
            for j in 0..=s {
                let t = self.node_time(step, j);
                let [g, r] = model.node(t, self.node_y.row(j), self.lam.row(j));
                copy(self.g.row_mut(j), g);
                copy(self.forces.row_mut(s + j), r);
            }
        }
    }

    /// Y_i = y0 + h Σ a_ij V_j and Ŷ_i = y0 + h Σ ā_ij V_j, the low part of y0 added first.
    fn move_points(&mut self, step: Step) {
        self.scale_weights(step.h);
        let State { y, y_low, .. } = step.state;
        let finish = |_, k: usize, sum| y[k] + (y_low[k] + sum);
        combine(self.y.flat_mut(), &self.weights.stage, &self.v, finish);
        combine(self.node_y.flat_mut(), &self.weights.node, &self.v, finish);
    }

    /// P_i − p0 − h Σ a_ij F_j − h Σ_{j<s} â_ij R_j.
    fn subtract_impulses(&mut self, step: Step) {
        let (State { p, p_low, .. }, stage_p) = (step.state, &self.p);
        let out = self.momentum_residual.flat_mut();
        combine(out, &self.weights.force, &self.forces, |i, k, sum| {
            (stage_p[(i, k)] - p[k]) - (p_low[k] + sum)
        });
    }

    fn scale_weights(&mut self, h: f64) {
        if self.weights.h.to_bits() == h.to_bits() {
            return;
        }
        let (s, tableau) = (self.tableau.stages, &self.tableau);
        self.weights = Weights {
            h,
            stage: Matrix::from_fn(s, s, |i, j| h * tableau.a[(i, j)]),
            node: Matrix::from_fn(s + 1, s, |i, j| h * tableau.a_bar[(i, j)]),
            force: Matrix::from_fn(s, 2 * s, |i, j| {
                h * if j < s {
                    tableau.a[(i, j)]
                } else {
                    tableau.a_hat[(i, j - s)]
                }
            }),
        };
    }

    /// Which value is not finite.
    fn not_finite(&self, step: Step) -> Trouble {
        let s = self.tableau.stages;
        let at_stage = |i: usize| {
            let t = self.stage_time(step, i);
            finite(self.p.row(i), Quantity::Momentum, t)?;
            finite(self.forces.row(i), Quantity::Force, t)?;
            finite(self.velocity_residual.row(i), Quantity::Velocity, t)
        };
        let at_node = |j: usize| {
            let t = self.node_time(step, j);
            finite(self.g.row(j), Quantity::Constraint, t)?;
            finite(self.forces.row(s + j), Quantity::Reaction, t)
        };
        let found = (0..s)
            .map(at_stage)
            .chain((0..=s).map(at_node))
            .find_map(Result::err);
        found.unwrap_or(Trouble::NotConverged {
            iterations: 0,
            size: f64::INFINITY,
        })
    }

    /// The size of a velocity correction, relative to what moves the coordinates by their own size.
    pub(super) fn relative(&self, correction: f64, step: Step) -> f64 {
        if correction == 0.0 {
            return 0.0;
        }
        correction / (max_norm(self.v.flat()) + max_norm(&step.state.y) / step.h.abs())
    }
}
