//! The unknowns of one step of the α family, and what follows from them alone.

use super::coupling::Coupling;
use super::reaction::Reaction;
use super::{AlphaState, Reactions};
use liouville_base::newton::{Broyden, Signs, Stop};
use liouville_base::tableau::Alpha;
use liouville_problem::SecondOrderModel;

/// The step being made.
pub(super) type AlphaStep<'a> = liouville_base::method::Step<'a, AlphaState>;

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
    pub(super) broyden: Broyden,
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
        self.reactions_by.are_paired(self.reactions[0].lam.len())
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
}
