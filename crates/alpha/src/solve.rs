//! The equations of one step of the α family, and how their unknowns are corrected.

use super::coupling::Coupling;
use super::newton_matrix::AlphaMatrix;
use super::reaction::Reaction;
use super::{AlphaState, Reactions};
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, copy_scaled, furthest, max_norm};
use liouville_base::newton::{Broyden, Equations, Stop, own_yardstick};
use liouville_base::tableau::Alpha;
use liouville_problem::SecondOrderModel;

/// Corrections below this fraction are roundoff, from which there is nothing to learn.
const NOISE: f64 = 64.0 * f64::EPSILON;

/// The step being made.
pub(super) type AlphaStep<'a> = liouville_base::method::Step<'a, AlphaState>;

/// The meaning of a determinant's sign in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Signs {
    /// A solution with the other sign than that of a small step is on another branch; none was found.
    Regarded,
    /// The same, and one was found.
    Reversed,
    /// Nothing: there are constraints, or the branch turns as a stretched spring does that ends compressed.
    Disregarded,
}

/// The unknowns of a step, and the memory of solving for them.
#[derive(Clone, Debug)]
pub(super) struct AlphaSolver {
    weights: Alpha,
    pub(super) reactions_by: Reactions,
    /// To which fraction of y1 and z1 the equations are solved; without one, to roundoff.
    pub(super) newton_tol: Option<f64>,
    /// Whether one correction solves the equations: no derivative depends on anything but parameters.
    pub(super) is_affine: bool,
    pub(super) coupling: Coupling,
    pub(super) signs: Signs,
    /// φ1
    pub(super) phi: Vec<f64>,
    /// A0 with Λ0, and A1 with Λ1; where there is no A, λ1 is in the second.
    pub(super) reactions: [Reaction; 2],
    /// y1
    pub(super) y: Vec<f64>,
    /// z1
    pub(super) z: Vec<f64>,
    /// a0, as the size of this step wants it.
    pub(super) a: Vec<f64>,
    /// a1 − c φ1, and the base to which φ1 and A are added.
    pub(super) known_a: Vec<f64>,
    known_y: Vec<f64>,
    known_z: Vec<f64>,
    /// y0 + h z0
    pub(super) predicted: Vec<f64>,
    /// No acceleration.
    pub(super) none: Vec<f64>,
    /// F − M φ1
    pub(super) force: Vec<f64>,
    /// M A − r of each reaction.
    pub(super) reaction_residuals: [Vec<f64>; 2],
    /// The right-hand side of the Newton matrix, then η, d, dΛ0, dΛ1; or η and dλ1 y_φ.
    pub(super) x: Vec<f64>,
    pub(super) zeta: Vec<f64>,
    pub(super) delta: Vec<f64>,
    broyden: Broyden,
    /// The unknowns before a perturbation that measures roundoff, made at its first use.
    pub(super) probe: Option<Box<KeptAlpha>>,
}

/// A solution kept beside the present one.
#[derive(Clone, Debug, Default)]
pub(super) struct KeptAlpha {
    pub(super) h: f64,
    pub(super) y: Vec<f64>,
    phi: Vec<f64>,
    reactions: [Reaction; 2],
}

impl KeptAlpha {
    /// Keeps the unknowns, and y1 with them.
    pub(super) fn copy_from(&mut self, solver: &AlphaSolver) {
        self.y.clone_from(&solver.y);
        self.phi.clone_from(&solver.phi);
        self.reactions.clone_from(&solver.reactions);
    }

    /// Puts the unknowns back, and y1.
    pub(super) fn put_back(&self, solver: &mut AlphaSolver) {
        solver.y.clone_from(&self.y);
        solver.phi.clone_from(&self.phi);
        solver.reactions.clone_from(&self.reactions);
    }
}

/// The equations of one step in the middle of being solved.
pub(super) struct AlphaEquations<'a> {
    pub(super) solver: &'a mut AlphaSolver,
    model: &'a mut SecondOrderModel,
    pub(super) matrix: &'a mut AlphaMatrix,
    pub(super) step: AlphaStep<'a>,
    /// The size of the coordinates plus that of h times the velocity, at the start; 0 where none is needed.
    pub(super) yardstick: f64,
    /// The largest acceleration that forces and reactions take from one another.
    pub(super) borne: f64,
    /// How far the last correction has moved y1.
    pub(super) moved_y: f64,
    /// Whether the next correction has factors of its own.
    is_refreshed: bool,
    pub(super) factorizations: usize,
}

impl AlphaSolver {
    pub(super) fn new(model: &SecondOrderModel, weights: Alpha, reactions: Reactions) -> Self {
        let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
        let zeros = || vec![0.0; n];
        let reaction = || Reaction {
            a: zeros(),
            lam: vec![0.0; m],
        };
        let mut solver = Self {
            weights,
            reactions_by: reactions,
            newton_tol: None,
            is_affine: model.problem.is_affine(),
            coupling: Coupling::new(weights, reactions),
            signs: Signs::Disregarded,
            phi: zeros(),
            reactions: [reaction(), reaction()],
            y: zeros(),
            z: zeros(),
            a: zeros(),
            known_a: zeros(),
            known_y: zeros(),
            known_z: zeros(),
            predicted: zeros(),
            none: zeros(),
            force: zeros(),
            reaction_residuals: [zeros(), zeros()],
            x: Vec::new(),
            zeta: zeros(),
            delta: vec![0.0; 3 * n + 2 * m],
            broyden: Broyden::new(3 * n + 2 * m, 3 * n),
            probe: None,
        };
        solver.x = vec![
            0.0;
            if solver.is_paired() {
                2 * (n + m)
            } else {
                n + m
            }
        ];
        solver
    }

    /// When the equations are solved.
    pub(super) fn stop(&self) -> Stop {
        Stop {
            tolerance: self.newton_tol.unwrap_or(self.reactions_by.roundoff()),
            // Broyden's corrections fall faster and faster
            has_steady_rate: false,
            min_rate: 0.1,
        }
    }

    /// Whether A0 and A1 are unknowns, each with its multipliers.
    pub(super) fn is_paired(&self) -> bool {
        !self.reactions[0].lam.is_empty() && self.reactions_by != Reactions::Position
    }

    /// Everything that is known before the unknowns are.
    pub(super) fn prepare(&mut self, AlphaStep { h, state, .. }: AlphaStep) {
        let Alpha {
            alpha_m,
            alpha_f,
            gamma,
            beta,
        } = self.weights;
        let is_same = state.h == 0.0 || state.h.to_bits() == h.to_bits();
        let ratio = h / state.h;
        for k in 0..state.y.len() {
            let (y, z, phi) = (state.y[k], state.z[k], state.phi[k]);
            // a lies at t0 + Δ h: another step size moves it
            let a = if is_same {
                state.a[k]
            } else {
                phi + ratio * (state.a[k] - phi)
            };
            let known = (alpha_f * phi - alpha_m * a) / (1.0 - alpha_m);
            self.a[k] = a;
            self.known_a[k] = known;
            self.known_y[k] = y + h * (z + h * ((0.5 - beta) * a + beta * known));
            self.known_z[k] = z + h * ((1.0 - gamma) * a + gamma * known);
            self.predicted[k] = y + h * z;
        }
    }

    /// y1 and z1 from the unknowns.
    pub(super) fn place(&mut self, h: f64) {
        let Coupling { phi, y, .. } = self.coupling;
        let [first, last] = &self.reactions;
        let each = if self.is_paired() { 0.5 } else { 0.0 };
        for k in 0..self.y.len() {
            let (a0, a1) = (first.a[k], last.a[k]);
            let by_y = phi[0] * self.phi[k] + (y[0] * a0 + y[1] * a1);
            self.y[k] = self.known_y[k] + h * h * by_y;
            self.z[k] = self.known_z[k] + h * (phi[1] * self.phi[k] + each * (a0 + a1));
        }
    }

    /// The equations of a step, from where the unknowns are now, where so much acceleration is borne.
    pub(super) fn start<'a>(
        &'a mut self,
        model: &'a mut SecondOrderModel,
        matrix: &'a mut AlphaMatrix,
        (step, borne): (AlphaStep<'a>, f64),
    ) -> AlphaEquations<'a> {
        self.broyden.restart();
        let AlphaStep { h, state, .. } = step;
        // linear equations have one solution, wherever it lies
        let yardstick = if self.is_affine {
            0.0
        } else {
            let own = max_norm(&state.y) + h.abs() * max_norm(&state.z);
            own_yardstick(own, h * h * borne)
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
        let at = &mut *self.solver;
        let (n, Coupling { phi, y, z, slope }) = (at.force.len(), at.coupling);
        copy_scaled(&mut at.x[..n], phi[0], &at.force);
        if !at.is_paired() {
            self.matrix.solve(&mut at.x, n);
            copy_scaled(&mut at.zeta, slope, &at.x[..n]);
            return;
        }
        let (of_eta, of_d) = at.x[..2 * n].split_at_mut(n);
        let [first, last] = &at.reaction_residuals;
        for k in 0..n {
            of_eta[k] -= y[0] * first[k] + y[1] * last[k];
            of_d[k] = -(z[0] * first[k] + z[1] * last[k]);
        }
        self.matrix.solve(&mut at.x, 2 * n);
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
        patterns.j_y.multiply_add(&matrix.j_y, h * h, eta, d_phi);
        patterns.j_z.multiply_add(&matrix.j_z, h, &at.zeta, d_phi);
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
        let size = self.size();
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

    fn is_reversed(&mut self) -> bool {
        let (signs, at) = (&mut self.solver.signs, &*self.matrix);
        if self.yardstick == 0.0 || *signs == Signs::Disregarded {
            return false;
        }
        let both = at.matrix.is_negative().zip(at.mass.is_negative());
        let is_reversed = both.is_some_and(|(own, of_mass)| own != of_mass);
        if is_reversed {
            *signs = Signs::Reversed;
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
