//! The equations of one step of the α family, and how their unknowns are corrected.

use super::frozen::Frozen;
use super::{Reactions, State};
use crate::linalg::{add_scaled, copy, max_norm};
use crate::newton::Equations;
use crate::problem::mechanical::SecondOrderModel;
use crate::tableau::Alpha;
use crate::trouble::Trouble;

/// The step being made.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) t: f64,
    pub(super) h: f64,
    pub(super) state: &'a State,
}

/// An acceleration by the constraints, and the multipliers it comes from.
#[derive(Clone, Debug)]
pub(super) struct Reaction {
    pub(super) a: Vec<f64>,
    pub(super) lam: Vec<f64>,
}

impl Reaction {
    /// `self = last + h rate`
    pub(super) fn extrapolate(&mut self, last: &Self, rate: &Self, h: f64) {
        let ahead = |out: &mut [f64], last: &[f64], rate: &[f64]| {
            copy(out, last);
            add_scaled(out, h, rate);
        };
        ahead(&mut self.a, &last.a, &rate.a);
        ahead(&mut self.lam, &last.lam, &rate.lam);
    }

    /// `self = (new - old) / h`
    pub(super) fn between(&mut self, old: &Self, new: &Self, h: f64) {
        let slope = |out: &mut [f64], old: &[f64], new: &[f64]| {
            for (k, out) in out.iter_mut().enumerate() {
                *out = (new[k] - old[k]) / h;
            }
        };
        slope(&mut self.a, &old.a, &new.a);
        slope(&mut self.lam, &old.lam, &new.lam);
    }
}

/// How y1 and z1 depend on the unknowns, with c = da1/dφ1:
///
///     y1 = … + h² (β c φ1 + y_0 A0 + y_1 A1),   z1 = … + h (γ c φ1 + z_0 A0 + z_1 A1)
#[derive(Clone, Copy, Debug)]
pub(super) struct Coupling {
    /// β c, γ c
    pub(super) phi: [f64; 2],
    /// y_0, y_1; all zero where there is no A.
    y: [f64; 2],
    /// z_i − (γ/β) y_i
    z: [f64; 2],
    /// γ/β
    slope: f64,
    /// y_0 z_1 − y_1 z_0 = (1 − 2 b)/4
    determinant: f64,
    /// The weight in y1 of the reaction taken at y1.
    pub(super) moving: f64,
}

impl Coupling {
    fn new(weights: Alpha, reactions: Reactions) -> Self {
        let c = weights.share();
        let phi = [weights.beta * c, weights.gamma * c];
        let slope = weights.gamma / weights.beta;
        let (y, moving) = match reactions {
            Reactions::Extended {
                b,
                predicted: false,
            } => ([(1.0 - b) / 2.0, b / 2.0], b / 2.0),
            Reactions::Extended { b, predicted: true } => ([(1.0 - b) / 2.0, b / 2.0], 0.0),
            Reactions::Position => ([0.0; 2], phi[0]),
        };
        let z = match reactions {
            Reactions::Extended { .. } => y.map(|y| 0.5 - slope * y),
            Reactions::Position => [0.0; 2],
        };
        Self {
            phi,
            y,
            z,
            slope,
            determinant: y[0] * z[1] - y[1] * z[0],
            moving,
        }
    }

    /// x_0 and x_1 from y_0 x_0 + y_1 x_1 and the same with z.
    fn apart(&self, by_y: f64, by_z: f64) -> [f64; 2] {
        [
            (self.z[1] * by_y - self.y[1] * by_z) / self.determinant,
            (self.y[0] * by_z - self.z[0] * by_y) / self.determinant,
        ]
    }
}

/// The unknowns of a step, and the memory of solving for them.
#[derive(Clone, Debug)]
pub(super) struct Solver {
    weights: Alpha,
    reactions_by: Reactions,
    /// Whether one correction solves the equations: no derivative depends on anything but parameters.
    is_affine: bool,
    pub(super) coupling: Coupling,
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
    /// a1 − c φ1, and what φ1 and A add to.
    pub(super) known_a: Vec<f64>,
    known_y: Vec<f64>,
    known_z: Vec<f64>,
    /// y0 + h z0
    predicted: Vec<f64>,
    /// F − M φ1
    force: Vec<f64>,
    /// M A − r of each reaction.
    pulls: [Vec<f64>; 2],
    d: Vec<f64>,
    nu: Vec<f64>,
    /// η over μ
    eta: Vec<f64>,
    zeta: Vec<f64>,
    none: Vec<f64>,
}

/// The equations of one step in the middle of being solved.
pub(super) struct Solve<'a> {
    solver: &'a mut Solver,
    model: &'a mut SecondOrderModel,
    frozen: &'a mut Frozen,
    step: Step<'a>,
    /// Corrections made.
    pub(super) made: usize,
}

impl Solver {
    pub(super) fn new(model: &SecondOrderModel, weights: Alpha, reactions: Reactions) -> Self {
        let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
        let zeros = || vec![0.0; n];
        let reaction = || Reaction {
            a: zeros(),
            lam: vec![0.0; m],
        };
        Self {
            weights,
            reactions_by: reactions,
            is_affine: model.problem.is_affine(),
            coupling: Coupling::new(weights, reactions),
            phi: zeros(),
            reactions: [reaction(), reaction()],
            y: zeros(),
            z: zeros(),
            a: zeros(),
            known_a: zeros(),
            known_y: zeros(),
            known_z: zeros(),
            predicted: zeros(),
            force: zeros(),
            pulls: [zeros(), zeros()],
            d: zeros(),
            nu: vec![0.0; m],
            eta: vec![0.0; n + m],
            zeta: zeros(),
            none: zeros(),
        }
    }

    /// Everything that is known before the unknowns are.
    pub(super) fn prepare(&mut self, Step { h, state, .. }: Step) {
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
        let each = if self.has_accelerations() { 0.5 } else { 0.0 };
        for k in 0..self.y.len() {
            let (a0, a1) = (first.a[k], last.a[k]);
            let by_y = phi[0] * self.phi[k] + (y[0] * a0 + y[1] * a1);
            self.y[k] = self.known_y[k] + h * h * by_y;
            self.z[k] = self.known_z[k] + h * (phi[1] * self.phi[k] + each * (a0 + a1));
        }
    }

    /// Whether the reactions have accelerations of their own.
    fn has_accelerations(&self) -> bool {
        !self.nu.is_empty() && self.reactions_by != Reactions::Position
    }

    /// The equations of a step, from where the unknowns are now.
    pub(super) fn start<'a>(
        &'a mut self,
        model: &'a mut SecondOrderModel,
        frozen: &'a mut Frozen,
        step: Step<'a>,
    ) -> Solve<'a> {
        Solve {
            solver: self,
            model,
            frozen,
            step,
            made: 0,
        }
    }
}

impl Solve<'_> {
    /// The right-hand sides: F − M φ1 in `force`, M A − r in `pulls`, those of the constraints in μ and ν.
    fn evaluate(&mut self) -> Result<(), Trouble> {
        let Step { t, h, state } = self.step;
        let (at, t1, n) = (&mut *self.solver, t + h, state.y.len());
        at.place(h);
        let [force, g, w] = self.model.residual(t1, &at.y, &at.z, &at.phi)?;
        copy(&mut at.force, force);
        for (k, (g, w)) in g.iter().zip(w).enumerate() {
            at.eta[n + k] = -g / (h * h);
            at.nu[k] = (at.coupling.slope * g / h - w) / h;
        }
        if at.nu.is_empty() {
            return Ok(());
        }
        let [first, last] = &at.reactions;
        match at.reactions_by {
            Reactions::Extended { predicted, .. } => {
                let y = if predicted { &at.predicted } else { &at.y };
                let pull = self.model.reaction(t, &state.y, &first.a, &first.lam)?;
                copy(&mut at.pulls[0], pull);
                let pull = self.model.reaction(t1, y, &last.a, &last.lam)?;
                copy(&mut at.pulls[1], pull);
            }
            Reactions::Position => {
                let pull = self.model.reaction(t1, &at.y, &at.none, &last.lam)?;
                at.force
                    .iter_mut()
                    .zip(pull)
                    .for_each(|(f, pull)| *f -= pull);
            }
        }
        Ok(())
    }

    /// d and ν: what corrects the hidden constraint beyond what comes with the position.
    fn correct_velocity(&mut self) {
        let at = &mut *self.solver;
        at.d.fill(0.0);
        if at.has_accelerations() {
            let z = at.coupling.z;
            for (k, d) in at.d.iter_mut().enumerate() {
                *d = -(z[0] * at.pulls[0][k] + z[1] * at.pulls[1][k]);
            }
            let saddle = &mut self.frozen.saddle;
            saddle.solve(&self.model.general, &mut at.d, &mut at.nu);
        }
    }

    /// η and μ, and with them ζ = (γ/β) η + d.
    fn correct_position(&mut self) {
        let (at, h) = (&mut *self.solver, self.step.h);
        let (j_z, patterns) = (&self.frozen.j_z, &self.model.problem.patterns);
        let (n, Coupling { phi, y, slope, .. }) = (at.d.len(), at.coupling);
        let eta = &mut at.eta[..n];
        copy(eta, &at.force);
        patterns.j_z.multiply_add(j_z, h, &at.d, eta);
        for (k, eta) in eta.iter_mut().enumerate() {
            *eta = phi[0] * *eta - (y[0] * at.pulls[0][k] + y[1] * at.pulls[1][k]);
        }
        self.frozen.solve(&mut at.eta);
        for (k, zeta) in at.zeta.iter_mut().enumerate() {
            *zeta = slope * at.eta[k] + at.d[k];
        }
    }

    /// The corrections of φ1, A and Λ that η, ζ, μ and ν stand for.
    fn apply(&mut self) {
        let (at, h) = (&mut *self.solver, self.step.h);
        let (frozen, patterns) = (&mut *self.frozen, &self.model.problem.patterns);
        let (n, phi) = (at.d.len(), at.coupling.phi);
        let (eta, mu) = at.eta.split_at(n);
        let [first, last] = &mut at.reactions;
        if at.nu.is_empty() || at.reactions_by == Reactions::Position {
            at.phi
                .iter_mut()
                .zip(eta)
                .for_each(|(out, eta)| *out += eta / phi[0]);
            last.lam
                .iter_mut()
                .zip(mu)
                .for_each(|(out, mu)| *out += mu / phi[0]);
            return;
        }
        patterns
            .j_y
            .multiply_add(&frozen.j_y, h * h, eta, &mut at.force);
        patterns
            .j_z
            .multiply_add(&frozen.j_z, h, &at.zeta, &mut at.force);
        frozen.mass.solve(&mut at.force);
        for k in 0..n {
            at.phi[k] += at.force[k];
            let [d_first, d_last] = at.coupling.apart(eta[k] - phi[0] * at.force[k], at.d[k]);
            first.a[k] += d_first;
            last.a[k] += d_last;
        }
        for (k, (mu, nu)) in mu.iter().zip(&at.nu).enumerate() {
            let [d_first, d_last] = at.coupling.apart(*mu, *nu);
            first.lam[k] += d_first;
            last.lam[k] += d_last;
        }
    }

    /// The corrections h² η and h ζ, in units of the position and of the velocity; without A, the
    /// velocity goes with the position, whose roundoff it has in units of 1/h.
    fn size(&self) -> f64 {
        let (at, h) = (&*self.solver, self.step.h.abs());
        let (y, z) = (max_norm(&at.y), max_norm(&at.z));
        let eta = h * h * max_norm(&at.eta[..at.y.len()]);
        let zeta = h * max_norm(&at.zeta);
        let relative = |d: f64, x: f64| if d == 0.0 { 0.0 } else { d / x.max(d) };
        let of_y = relative(eta, y.max(h * z));
        match at.reactions_by {
            Reactions::Position => of_y,
            Reactions::Extended { .. } => of_y.max(relative(zeta, z.max(h * max_norm(&at.phi)))),
        }
    }
}

impl Equations for Solve<'_> {
    fn correct(&mut self) -> Result<f64, Trouble> {
        self.evaluate()?;
        self.correct_velocity();
        self.correct_position();
        self.apply();
        self.made += 1;
        let size = self.size();
        Ok(if self.solver.is_affine && size.is_finite() {
            0.0
        } else {
            size
        })
    }

    fn tolerance(&self) -> f64 {
        match self.solver.reactions_by {
            // what is left is damped, unlike in a symplectic method
            Reactions::Extended { .. } => f64::EPSILON,
            // what is left in the position is divided by h in the velocity
            Reactions::Position => 1e-3 * f64::EPSILON,
        }
    }
}
