//! The extended HHT-α method and its relatives, order 2, for M(t, y) z' = F(t, y, z) + r(t, y, λ).
//!
//! One step from (t0, y0, z0, a0) to t1 = t0 + h, with φ := M⁻¹ F:
//!
//!     (3a) y1 = y0 + h z0 + h² ((1/2 − β) a0 + β a1) + h²/2 ((1 − b) A0 + b A1)
//!     (3b) z1 = z0 + h ((1 − γ) a0 + γ a1) + h/2 (A0 + A1)
//!     (3c) (1 − α_m) a1 + α_m a0 = (1 − α_f) φ1 + α_f φ0,   M(t1, y1) φ1 = F(t1, y1, z1)
//!     (3d) M(t0, y0) A0 = r(t0, y0, Λ0),   M(t1, Y) A1 = r(t1, Y, Λ1)
//!     (3e) 0 = g(t1, y1),   0 = g_t(t1, y1) + g_y(t1, y1) z1
//!
//! with Y = y1, or y0 + h z0 in the less implicit variant. a_n approximates φ(t_n + Δ h),
//! Δ = α_m − α_f: it excludes the reaction. The Λ are internal and not passed on. Before a step whose
//! size differs from the last one's, a0 is moved along: a0 ← φ0 + (h/h_old)(a0 − φ0).
//!
//! The index-3 relative of arnold2007 has no A; its φ1 is the whole acceleration,
//! M φ1 = F + r(t1, y1, λ1), and only the constraint itself is imposed.
//!
//! Source: jay2007hht, jay2009; the paper's R is M A, its ψ our Λ.

mod adjoint;
mod attempt;
mod block;
mod coupling;
mod estimate;
mod linear_step;
mod linearization_point;
mod newton_matrix;
mod probe;
mod project;
mod reaction;
mod restart;
mod sizes;
mod slopes;
mod solve;
mod start_tangents;
mod state;
mod tangent;
mod tangent_errors;
mod unknowns;

pub use adjoint::{AlphaAdjoint, AlphaTransposed};
use attempt::AlphaAttempt;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, copy};
use liouville_base::method::{Stats, Stepper, Tolerance};
use liouville_base::newton::{self, Backoff, Signs, Solved};
use liouville_base::tableau;
use liouville_problem::{Acceleration, Saddle, SecondOrderModel};
use newton_matrix::AlphaMatrix;
use reaction::Reaction;
pub use reaction::Reactions;
pub use restart::AlphaRestart;
pub use slopes::AlphaSlopes;
pub use start_tangents::AlphaStartTangents;
pub use state::AlphaState;
pub use tangent::AlphaTangents;
use unknowns::{AlphaSolver, AlphaStep, KeptAlpha};

/// Corrections a step may take.
const MOST_ITERATIONS: usize = 30;

/// Controlled steps grow by 4: one longer than so many of the last one follows a step that was cut, or the short rest of one.
const MOST_RATIO: f64 = 8.0;

/// Whether a step of `h` begins with a0 = φ0.
fn begins_again(before: &AlphaState, h: f64) -> bool {
    before.h != 0.0 && (h / before.h).abs() > MOST_RATIO
}

/// A method of the α family at work.
#[derive(Clone, Debug)]
pub struct Alpha {
    model: SecondOrderModel,
    weights: tableau::Alpha,
    reactions: Reactions,
    tolerance: Option<Tolerance>,
    solver: AlphaSolver,
    matrix: AlphaMatrix,
    acceleration: Acceleration,
    /// dφ/dt, the reactions and their rates in the last step, to start the next with.
    phi_rate: Vec<f64>,
    kept: [Reaction; 2],
    rates: [Reaction; 2],
    /// The state before the last step; during a step, the one after it.
    other: AlphaState,
    /// The state before it as it was carried, where the step has begun again.
    carried: Option<AlphaState>,
    local_error: Vec<f64>,
    error: f64,
    is_warm: bool,
    /// Whether a controlled step is made by all attempts, as shorter ones have failed too.
    insists: bool,
    /// Projects the end of a step where the saddle at hand is too old.
    saddle: Option<Box<Saddle>>,
    /// Moves and multipliers of a projection.
    moved: (Vec<f64>, Vec<f64>),
    backoff: Backoff,
    /// Solutions to be compared.
    kept_solutions: [Option<Box<KeptAlpha>>; 3],
    stats: Stats,
}

impl Alpha {
    /// A method with these weights for this model; without a tolerance, errors are not estimated.
    pub fn new(
        model: SecondOrderModel,
        weights: tableau::Alpha,
        reactions: Reactions,
        tolerance: Option<Tolerance>,
    ) -> Self {
        let n = model.problem.mechanical.n;
        let zeros = || vec![0.0; n];
        let solver = AlphaSolver::new(&model, weights, reactions);
        Self {
            weights,
            reactions,
            matrix: AlphaMatrix::new(&model, &solver, tolerance.is_some()),
            tolerance,
            acceleration: Acceleration::new(&model.general),
            phi_rate: zeros(),
            kept: solver.reactions.clone(),
            rates: solver.reactions.clone(),
            other: AlphaState {
                y: zeros(),
                z: zeros(),
                a: zeros(),
                phi: zeros(),
                h: 0.0,
                work: 0.0,
                power: 0.0,
            },
            carried: None,
            local_error: zeros(),
            error: f64::INFINITY,
            is_warm: false,
            insists: false,
            saddle: None,
            moved: (zeros(), vec![0.0; model.problem.mechanical.m]),
            backoff: Backoff::default(),
            kept_solutions: [None, None, None],
            stats: Stats::default(),
            solver,
            model,
        }
    }

    /// The same, with equations solved to this fraction of y1 and z1 instead of to roundoff.
    #[must_use]
    pub fn to_tolerance(mut self, tolerance: f64) -> Self {
        if tolerance > self.reactions.roundoff() {
            self.solver.newton_tol = Some(tolerance);
            self.matrix.keep_saddle(&self.model);
        }
        self
    }

    /// The state at (t, y, z); a is φ there unless it is given.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    pub fn start(
        &mut self,
        t: f64,
        y: &[f64],
        z: &[f64],
        a: Option<&[f64]>,
    ) -> Result<AlphaState, StepError> {
        self.acceleration.solve(&mut self.model.general, t, y, z)?;
        let phi = if self.reactions == Reactions::Position {
            self.acceleration.z_dot.clone()
        } else {
            self.matrix.mass.update(&mut self.model.general, t, y, z)?;
            let none = vec![0.0; y.len()];
            let mut phi = self.model.residual(t, y, z, &none)?[0].to_vec();
            self.matrix.mass.solve(&mut phi);
            phi
        };
        Ok(AlphaState {
            y: y.to_vec(),
            z: z.to_vec(),
            a: a.unwrap_or(&phi).to_vec(),
            phi,
            h: 0.0,
            work: 0.0,
            power: self.model.power(t, y, z, &self.acceleration.lam)?,
        })
    }

    /// The matrix of the last Newton iterations, unless it is split.
    pub fn newton_matrix(&self) -> Option<Matrix> {
        self.matrix.to_dense()
    }

    /// A first step whose acceleration moves the coordinates by about the tolerance; infinite without one.
    pub fn first_step(&self, state: &AlphaState) -> f64 {
        self.tolerance.as_ref().map_or(f64::INFINITY, |tolerance| {
            tolerance.first_step(&state.y, [&state.phi, &state.a])
        })
    }

    /// Begins again with a0 = φ0 after a step that an event has cut to a much shorter one than `h`: there a0 − φ0, and φ0
    /// of the constraint on the position alone, are roundoff of z over the last step.
    fn leave_cut(&mut self, t: f64, h: f64, state: &mut AlphaState) -> Result<(), StepError> {
        if !begins_again(state, h) {
            return Ok(());
        }
        self.is_warm = false;
        if self.reactions == Reactions::Position {
            self.acceleration
                .solve(&mut self.model.general, t, &state.y, &state.z)?;
            copy(&mut state.phi, &self.acceleration.z_dot);
        }
        copy(&mut state.a, &state.phi);
        state.h = 0.0;
        Ok(())
    }

    /// The unknowns on the line through those of the last step.
    fn extrapolate(&mut self, step: AlphaStep) {
        let at = &mut self.solver;
        copy(&mut at.phi, &step.state.phi);
        add_scaled(&mut at.phi, step.h, &self.phi_rate);
        for ((reaction, kept), rate) in at.reactions.iter_mut().zip(&self.kept).zip(&self.rates) {
            reaction.extrapolate(kept, rate, step.h);
        }
    }

    /// The unknowns as they are at the start of the step.
    fn start_cold(&mut self, step: AlphaStep) -> Result<(), StepError> {
        let AlphaState { y, z, phi, .. } = step.state;
        self.acceleration
            .begin(&mut self.model.general, (step.t, step.h), y, z)?;
        let at = &mut self.solver;
        copy(&mut at.phi, phi);
        for reaction in &mut at.reactions {
            copy(&mut reaction.lam, &self.acceleration.lam);
            for (k, a) in reaction.a.iter_mut().enumerate() {
                *a = self.acceleration.z_dot[k] - phi[k];
            }
        }
        if !self.model.general.problem.is_linear && !at.reactions[1].lam.is_empty() {
            // reactions that are not linear in λ may be far from those at the start
            let (model, t1) = (&mut self.model.general, step.t + step.h);
            if self.acceleration.solve(model, t1, &at.predicted, z).is_ok() {
                copy(&mut at.reactions[1].lam, &self.acceleration.lam);
            }
        }
        Ok(())
    }

    fn attempt(&mut self, step: AlphaStep) -> Result<(), StepError> {
        self.solver.signs = Signs::Regarded;
        newton::attempt(&mut AlphaAttempt::new(self, step), step.h)
    }

    /// The iteration, with factors made where it starts unless there are reusable ones, or with factors for each
    /// correction if it `is_full`.
    fn iterate(&mut self, step: AlphaStep, is_full: bool) -> Result<Solved, StepError> {
        let is_split = self.matrix.is_split;
        if is_full {
            self.matrix.split(false);
        }
        if !is_full && !self.matrix.reuse.is_reusable(step.h) {
            self.stats.factorizations += 1;
            self.matrix
                .update(&mut self.model, &mut self.solver, step)?;
        }
        let at = (step, self.acceleration.borne);
        let mut equations = self.solver.start(&mut self.model, &mut self.matrix, at);
        let outcome = if is_full {
            newton::solve_full(&mut equations)
        } else {
            newton::solve(&mut equations, MOST_ITERATIONS)
        };
        self.stats.factorizations += equations.factorizations;
        if is_full {
            self.matrix.split(is_split);
        }
        let solved = outcome.inspect_err(|_| self.matrix.reuse.discard())?;
        self.stats.iterations += solved.iterations;
        self.stats.evaluations += solved.iterations;
        self.matrix.record(solved.iterations);
        Ok(solved)
    }

    /// The state after the step, in `other`.
    fn finish(&mut self, step: AlphaStep) -> Result<(), StepError> {
        let t1 = step.t + step.h;
        let (at, next) = (&mut self.solver, &mut self.other);
        at.place(step.h);
        copy(&mut next.y, &at.y);
        copy(&mut next.z, &at.z);
        copy(&mut next.phi, &at.phi);
        for k in 0..next.a.len() {
            next.a[k] = self.weights.share() * at.phi[k] + at.known_a[k];
            self.phi_rate[k] = (at.phi[k] - step.state.phi[k]) / step.h;
        }
        for ((reaction, kept), rate) in at.reactions.iter().zip(&self.kept).zip(&mut self.rates) {
            rate.between(
                kept,
                reaction,
                if self.is_warm { step.h } else { f64::INFINITY },
            );
        }
        std::mem::swap(&mut self.kept, &mut at.reactions);
        next.h = step.h;
        self.project(t1)?;
        let next = &mut self.other;
        if self.model.problem.power_of_lam {
            self.acceleration
                .solve(&mut self.model.general, t1, &next.y, &next.z)?;
        }
        next.power = self
            .model
            .power(t1, &next.y, &next.z, &self.acceleration.lam)?;
        next.work = step.state.work + step.h / 2.0 * (step.state.power + next.power);
        Ok(())
    }
}

impl Stepper for Alpha {
    type State = AlphaState;

    fn step(&mut self, t: f64, h: f64, state: &mut AlphaState) -> Result<(), StepError> {
        self.carried = begins_again(state, h).then(|| state.clone());
        let made = self.make(t, h, state);
        if made.is_err() {
            self.restore_carried(state);
        }
        made
    }

    fn forget(&mut self) {
        self.is_warm = false;
    }

    fn stats(&self) -> Stats {
        self.stats
    }
}

impl Alpha {
    /// Puts back the state that a step has begun again from.
    fn restore_carried(&mut self, state: &mut AlphaState) {
        if let Some(carried) = self.carried.take() {
            *state = carried;
        }
    }

    fn make(&mut self, t: f64, h: f64, state: &mut AlphaState) -> Result<(), StepError> {
        self.leave_cut(t, h, state)?;
        let step = AlphaStep { t, h, state };
        let mut attempted = self.attempt(step);
        if attempted.is_err() {
            let (model, motion) = (&mut self.model.general, (&state.y[..], &state.z[..]));
            if self.acceleration.finds_length(model, (t, h), motion) {
                attempted = self.attempt(step);
            }
        }
        attempted.inspect_err(|_| self.is_warm = false)?;
        self.finish(step)?;
        self.is_warm = true;
        if self.tolerance.is_some() {
            self.estimate(step);
        }
        std::mem::swap(state, &mut self.other);
        Ok(())
    }
}

liouville_base::checkpoint!(
    Alpha { is_warm, backoff, acceleration, phi_rate, kept, rates, matrix }
    then |alpha| alpha.matrix.restore_factors(&mut alpha.model)
);
