//! The equations of one step of the α family, and how their unknowns are corrected.

use super::Reactions;
use super::coupling::Coupling;
use super::newton_matrix::AlphaMatrix;
use super::unknowns::{AlphaSolver, AlphaStep};
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, copy_scaled, furthest, max_norm};
use liouville_base::newton::{Borne, Equations, Signs, Stop, own_yardstick};
use liouville_problem::SecondOrderModel;

/// Corrections below this fraction are roundoff, from which there is nothing to learn.
pub(super) const NOISE: f64 = 64.0 * f64::EPSILON;

/// The equations of one step in the middle of being solved.
pub(super) struct AlphaEquations<'a> {
    pub(super) solver: &'a mut AlphaSolver,
    pub(super) model: &'a mut SecondOrderModel,
    pub(super) matrix: &'a mut AlphaMatrix,
    pub(super) step: AlphaStep<'a>,
    /// The size of the coordinates plus that of h times the velocity, at the start; 0 where none is needed.
    pub(super) yardstick: f64,
    pub(super) borne: Borne<f64>,
    /// How far the last correction has moved y1.
    pub(super) moved_y: f64,
    /// Whether the next correction has factors of its own.
    is_refreshed: bool,
    pub(super) factorizations: usize,
}

impl AlphaSolver {
    /// The equations of a step, from where the unknowns are now, where so much is borne.
    pub(super) fn start<'a>(
        &'a mut self,
        model: &'a mut SecondOrderModel,
        matrix: &'a mut AlphaMatrix,
        (step, borne): (AlphaStep<'a>, Borne<f64>),
    ) -> AlphaEquations<'a> {
        self.broyden.restart();
        let AlphaStep { h, state, .. } = step;
        // linear equations have one solution, wherever it lies
        let yardstick = if self.is_affine {
            0.0
        } else {
            let own = max_norm(&state.y) + h.abs() * max_norm(&state.z);
            own_yardstick(own, h * h * borne.rate(h))
        };
        AlphaEquations {
            solver: self,
            model,
            matrix,
            step,
            yardstick,
            borne,
            moved_y: 0.0,
            is_refreshed: false,
            factorizations: 0,
        }
    }
}

impl AlphaEquations<'_> {
    /// F − M φ1 in `force`, M A − r in `reaction_residuals`, and the constraints in their places of `x`.
    pub(super) fn evaluate(&mut self) -> Result<(), StepError> {
        let AlphaStep { t, h, state } = self.step;
        let (at, t1, n) = (&mut *self.solver, t + h, state.y.len());
        at.place(h);
        let is_paired = at.is_paired();
        let [force, g, w] = self.model.residual(t1, &at.y, &at.z, &at.phi)?;
        copy(&mut at.force, force);
        let slope = at.coupling.slope;
        if is_paired {
            let (of_g, of_w) = at.x[2 * n..].split_at_mut(g.len());
            for (k, (g, w)) in g.iter().zip(w).enumerate() {
                of_g[k] = -g / (h * h);
                of_w[k] = (slope * g / h - w) / h;
            }
        } else {
            for (out, g) in at.x[n..].iter_mut().zip(g) {
                *out = -g / (h * h);
            }
        }
        let [first, last] = &at.reactions;
        match at.reactions_by {
            Reactions::Extended { predicted, .. } if is_paired => {
                let y = if predicted { &at.predicted } else { &at.y };
                let residual = self.model.reaction(t, &state.y, &first.a, &first.lam)?;
                copy(&mut at.reaction_residuals[0], residual);
                self.matrix
                    .transport_residual(self.model, &mut at.reaction_residuals[0]);
                let residual = self.model.reaction(t1, y, &last.a, &last.lam)?;
                copy(&mut at.reaction_residuals[1], residual);
            }
            Reactions::Position if !last.lam.is_empty() => {
                let residual = self.model.reaction(t1, &at.y, &at.none, &last.lam)?;
                add_scaled(&mut at.force, -1.0, residual);
            }
            _ => {}
        }
        Ok(())
    }

    /// η, ζ and the corrections of the multipliers, by the Newton matrix.
    pub(super) fn solve(&mut self) {
        let (at, h) = (&mut *self.solver, self.step.h);
        let (n, Coupling { phi, y, z, slope }) = (at.force.len(), at.coupling);
        copy_scaled(&mut at.x[..n], phi[0], &at.force);
        if !at.is_paired() {
            self.matrix.solve(self.model, &mut at.x, h);
            copy_scaled(&mut at.zeta, slope, &at.x[..n]);
            return;
        }
        let (of_eta, of_d) = at.x[..2 * n].split_at_mut(n);
        let [first, last] = &at.reaction_residuals;
        for k in 0..n {
            of_eta[k] -= y[0] * first[k] + y[1] * last[k];
            of_d[k] = -(z[0] * first[k] + z[1] * last[k]);
        }
        self.matrix.solve(self.model, &mut at.x, h);
        for (k, zeta) in at.zeta.iter_mut().enumerate() {
            *zeta = slope * at.x[k] + at.x[n + k];
        }
    }

    /// The corrections of φ1, A and Λ that belong to them.
    fn apply(&mut self, is_noise: bool) {
        let (at, h) = (&mut *self.solver, self.step.h);
        let (matrix, patterns) = (&mut *self.matrix, &self.model.problem.patterns);
        let (n, is_paired) = (at.force.len(), at.is_paired());
        let (y_phi, [first, last]) = (at.coupling.phi[0], &mut at.reactions);
        if !is_paired {
            add_scaled(&mut at.phi, 1.0 / y_phi, &at.x[..n]);
            add_scaled(&mut last.lam, 1.0 / y_phi, &at.x[n..]);
            return;
        }
        let (eta, rest) = at.x.split_at(n);
        let (d, lam) = rest.split_at(n);
        let (lam_first, lam_last) = lam.split_at(first.lam.len());
        let d_phi = &mut at.force;
        let of = &matrix.derivatives;
        patterns.j_y.multiply_add(&of.j_y, h * h, eta, d_phi);
        patterns.j_z.multiply_add(&of.j_z, h, &at.zeta, d_phi);
        matrix.mass.solve(d_phi);
        let m = lam_first.len();
        let delta = &mut at.delta;
        for k in 0..n {
            let [d_first, d_last] = at.coupling.apart(eta[k] - y_phi * d_phi[k], d[k]);
            delta[k] = d_phi[k];
            delta[n + k] = d_first;
            delta[2 * n + k] = d_last;
        }
        delta[3 * n..3 * n + m].copy_from_slice(lam_first);
        delta[3 * n + m..].copy_from_slice(lam_last);
        if !is_noise {
            at.broyden.improve(delta);
        }
        add_scaled(&mut at.phi, 1.0, &delta[..n]);
        add_scaled(&mut first.a, 1.0, &delta[n..2 * n]);
        add_scaled(&mut last.a, 1.0, &delta[2 * n..3 * n]);
        add_scaled(&mut first.lam, 1.0, &delta[3 * n..3 * n + m]);
        add_scaled(&mut last.lam, 1.0, &delta[3 * n + m..]);
        let (y, phi) = (at.coupling.y, at.coupling.phi);
        for k in 0..n {
            let (p, a0, a1) = (delta[k], delta[n + k], delta[2 * n + k]);
            at.x[k] = phi[0] * p + y[0] * a0 + y[1] * a1;
            at.zeta[k] = phi[1] * p + 0.5 * (a0 + a1);
        }
    }
}

impl Equations for AlphaEquations<'_> {
    fn correct(&mut self) -> Result<f64, StepError> {
        if std::mem::take(&mut self.is_refreshed) {
            self.factorizations += 1;
            self.matrix.update(self.model, self.solver, self.step)?;
            self.solver.broyden.restart();
        }
        self.evaluate()?;
        self.solve();
        let is_noise = self.size() < NOISE;
        self.apply(is_noise);
        let size = self.size().max(self.multiplier_size()?);
        let is_done = size.is_finite() && self.is_exact();
        Ok(if is_done { 0.0 } else { size })
    }

    fn scaled_size(&self, size: f64) -> f64 {
        if size == 0.0 || self.yardstick == 0.0 {
            return 0.0;
        }
        self.moved_y / self.yardstick
    }

    fn deviation(&self) -> f64 {
        if self.yardstick == 0.0 {
            return 0.0;
        }
        let (moved, _) = furthest(&self.solver.y, &self.solver.predicted, self.yardstick);
        moved
    }

    fn is_reversed(&mut self, is_doubtful: bool) -> bool {
        if self.yardstick == 0.0 || !self.solver.signs.are_regarded() {
            return false;
        }
        let is_reversed = if self.model.problem.mechanical.m > 0 {
            is_doubtful && self.matrix.is_turned_by_forces(self.model, self.step.h)
        } else {
            self.matrix.is_against_mass()
        };
        if is_reversed {
            self.solver.signs = Signs::Reversed;
        }
        is_reversed
    }

    fn refresh(&mut self) {
        self.is_refreshed = true;
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        self.is_residual_roundoff()
    }

    fn roundoff_floor(&mut self) -> Result<f64, StepError> {
        self.largest_by_roundoff()
    }

    fn stop(&self) -> Stop {
        self.solver.stop()
    }
}
