//! SPARK methods for index-3 mechanical systems, of any coefficients with s stages and k + 1 nodes.
//!
//! One step from (t0, y0, z0) to t1 = t0 + h, with stages T_i = t0 + c_i h and nodes
//! T̂_j = t0 + ĉ_j h:
//!
//!     (S1)  Y_i = y0 + h Σ_j aᵛ_ij v(T_j, Y_j, Z_j)                                     i = 1..s
//!     (S2)  Ŷ_i = y0 + h Σ_j ā_ij v(T_j, Y_j, Z_j)                                      i = 0..k
//!     (S3)  p(T_i, Y_i, Z_i) = p0 + h Σ_j aᶠ_ij f(T_j, Y_j, Z_j) + h Σ_{j<k} â_ij r(T̂_j, Ŷ_j, λ_j)
//!     (S4)  0 = g(T̂_i, Ŷ_i)                                                            i = 1..k
//!     (U1)  y1 = y0 + h Σ_j b_j v(T_j, Y_j, Z_j)
//!     (U2)  p(t1, y1, z1) = p0 + h Σ_j b_j f(T_j, Y_j, Z_j) + h Σ_{j≤k} b̂_j r(T̂_j, Ŷ_j, λ_j)
//!     (U3)  0 = g_t(t1, y1) + g_y(t1, y1) v(t1, y1, z1)
//!
//! (S1)–(S4) give Z_i and λ_0..λ_{k−1}, with V_i = v(T_i, Y_i, Z_i) as unknowns of their own; (U2), (U3) then give z1
//! and λ_k. The λ_j are internal: they are not passed on to the next step. y and p are summed with their rounding errors
//! carried along. Source: jay2007; the paper's ψ is λ. Nonholonomic constraints bring equations in `full_newton`.

mod attempt;
mod derivatives;
mod equations;
mod estimate;
mod full_newton;
mod general;
mod kinks;
mod lanes;
mod node_schur;
mod predictor;
mod probe;
pub mod rattle;
mod small_newton;
mod sparse_schur;
mod stages;
mod tangent;
mod update;
mod velocity_error;
mod yardstick;

use general::General;
use kinks::Kinks;
pub use lanes::{SparkBatch, supports_batch};
use liouville_base::error::StepError;
use liouville_base::linalg::choice::{CHEAP_NEWTON, SCHUR_ITERATIONS};
use liouville_base::linalg::max_norm;
use liouville_base::method::{Stats, Stepper, Symmetric};
use liouville_base::newton::{Backoff, Member, Stop};
use liouville_base::tableau;
use liouville_problem::{Estimate, Mechanical, Model, State, Step};
use liouville_small::{Matrices, Small};
use predictor::Predictor;
pub use tangent::{BatchAdjoint, SparkAdjoint, SparkTangents};
use velocity_error::VelocityError;

/// The solver of the stage equations; all have the same solution, to roundoff.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solver {
    /// Node Schur, and full Newton where that is slow.
    Auto,
    /// Node Schur only, unless its matrix would be dense and large.
    NodeSchur,
    /// Full simplified Newton only.
    Newton,
}

impl Solver {
    /// The most corrections of node Schur.
    fn max_iterations(self, problem: &Mechanical, tableau: &tableau::Spark) -> usize {
        let order = tableau.stages * problem.n + tableau.intervals * problem.m;
        match self {
            Self::Auto => {
                SCHUR_ITERATIONS
                    [usize::from(order > CHEAP_NEWTON || problem.patterns.p_y.is_empty())]
            }
            _ => MOST_ITERATIONS,
        }
    }

    /// The most corrections of a small system, by full Newton or node Schur.
    fn max_small_iterations(self, is_newton: bool, of: (&Mechanical, &tableau::Spark)) -> usize {
        if is_newton {
            return MOST_ITERATIONS;
        }
        self.max_iterations(of.0, of.1)
    }

    /// The matrices allowed for small systems.
    fn matrices(self) -> Matrices {
        match self {
            Self::Auto => Matrices::Any,
            Self::NodeSchur => Matrices::NodeSchur,
            Self::Newton => Matrices::Newton,
        }
    }
}

/// The most corrections of a solver without an alternative.
const MOST_ITERATIONS: usize = 100;

/// Errors of velocities by a tolerance of errors are below so many times the fraction that equations are solved to.
const VELOCITIES: f64 = 10.0;

/// The fraction of a step that is solved first where a small system does not converge from its cold start.
const PART: f64 = 0.5;

/// A SPARK method at work.
#[derive(Clone, Debug)]
pub struct Spark {
    model: Model,
    solver: Solver,
    tableau: tableau::Spark,
    stop: Stop,
    /// The tolerances to roundoff and to that of errors, where each step has its own between them.
    tolerances: Option<[f64; 2]>,
    /// The fast path, which makes nearly all steps of a small system.
    small: Option<Small<f64>>,
    /// The path of all other steps, made at its first use.
    general: Option<Box<General>>,
    predictor: Predictor,
    /// The error estimate, where steps are controlled by errors.
    estimate: Option<Box<Estimate>>,
    noise: estimate::Noise,
    /// Whether steps are refused that only continuation might solve, as shorter ones are made in their place.
    is_shortened: bool,
    /// Whether a controlled step is made by all attempts, as shorter ones have failed too.
    insists: bool,
    kinks: Kinks,
    velocity_error: VelocityError,
    /// The back-off of node Schur, and of the modified iteration.
    schur_backoff: Backoff,
    backoff: Backoff,
    stats: Stats,
}

impl Spark {
    /// The (s,s)-Gauss–Lobatto method for this model.
    ///
    /// # Panics
    /// When `s` is zero.
    pub fn new(model: Model, s: usize, solver: Solver) -> Self {
        Self::of(model, tableau::Spark::gauss(s), solver)
    }

    /// The method of these coefficients.
    pub fn of(mut model: Model, tableau: tableau::Spark, solver: Solver) -> Self {
        let stop = Stop::default();
        let small = Small::new(&mut model, &tableau, solver.matrices());
        let general = match &small {
            Some(_) => None,
            None => Some(General::new(&mut model, &tableau, stop).into()),
        };
        Self {
            predictor: Predictor::new(&model, &tableau),
            general,
            estimate: None,
            noise: estimate::Noise::default(),
            is_shortened: false,
            insists: false,
            kinks: Kinks::default(),
            velocity_error: VelocityError::default(),
            schur_backoff: Backoff::default(),
            backoff: Backoff::default(),
            stats: Stats::default(),
            solver,
            small,
            stop,
            tolerances: None,
            tableau,
            model,
        }
    }

    /// Which method it is, and how its stage equations are solved.
    pub fn kind(&self) -> (tableau::Key, Solver) {
        (self.tableau.key, self.solver)
    }

    /// The state at `t`, from y and z.
    pub fn state(&mut self, t: f64, y: &[f64], z: &[f64]) -> State {
        self.model.state(t, y, z)
    }

    /// Forgets all steps, their statistics, and all that was wanted beside [`Spark::of`].
    pub fn reset(&mut self) {
        self.predictor.reset();
        self.kinks = Kinks::default();
        self.velocity_error = VelocityError::default();
        self.estimate = None;
        self.noise = estimate::Noise::default();
        (self.is_shortened, self.insists) = (false, false);
        (self.schur_backoff, self.backoff) = Default::default();
        self.stats = Stats::default();
        (self.stop, self.tolerances) = (Stop::default(), None);
        if let Some(general) = &mut self.general {
            general.stages.stop = self.stop;
            general.stages.evaluations = 0;
        }
    }

    /// The same, with stage equations solved to this fraction of the velocities instead of to roundoff.
    #[must_use]
    pub fn to_tolerance(mut self, tolerance: f64) -> Self {
        self.aim(tolerance);
        self
    }

    /// The same, with errors of velocities below ten times this fraction of the velocities of each step, but for roundoff.
    ///
    /// The unit of corrections is |V| + |y|/h, so that in short steps, as within a layer of friction, its fractions may be
    /// larger than all velocities.
    #[must_use]
    pub fn to_tolerance_of_velocities(mut self, roundoff: f64) -> Self {
        let of_errors = self.stop.tolerance;
        self.tolerances = (of_errors > roundoff).then_some([roundoff, of_errors]);
        self
    }

    fn aim(&mut self, tolerance: f64) {
        self.stop.tolerance = tolerance;
        if let Some(general) = &mut self.general {
            general.stages.stop = self.stop;
        }
    }

    /// The tolerance of a step from this state.
    fn tolerance_of(&self, [roundoff, of_errors]: [f64; 2], step: Step) -> f64 {
        if self.model.problem.patterns.v_z.is_some() {
            return roundoff; // z is no velocity
        }
        let speed = max_norm(&step.state.z);
        let part = speed / (speed + max_norm(&step.state.y) / step.h.abs());
        if part > 0.0 {
            (VELOCITIES * part * of_errors).clamp(roundoff, of_errors)
        } else {
            roundoff
        }
    }

    /// Makes the step of a small system by the fast path; returns whether that has solved it, up to the commit.
    fn advance_small(&mut self, step: Step) -> bool {
        let Some(small) = &self.small else {
            return false;
        };
        if (self.schur_backoff.is_active() && !small.is_newton()) || self.backoff.is_active() {
            return false;
        }
        let is_made = self.iterate_small(step) || self.continue_small(step);
        if is_made {
            self.schur_backoff.succeed();
            self.backoff.succeed();
        }
        is_made
    }

    /// A cold step of a small system by way of a part of it, from which full Newton comes to all of it; node Schur is
    /// as fast wherever it starts.
    #[cold]
    fn continue_small(&mut self, step: Step) -> bool {
        let (h, is_cold) = (step.h * PART, self.predictor.held.h().is_none());
        let is_newton = self.small.as_ref().is_some_and(Small::is_newton);
        if !is_cold || !is_newton || !self.iterate_small(Step { h, ..step }) {
            return false;
        }
        if let Some(small) = &self.small {
            small.hold(&mut self.predictor.held, h);
        }
        self.predictor.undo();
        let is_made = self.iterate_small(step);
        if !is_made {
            self.predictor.forget();
        }
        is_made
    }

    /// Iterates, and finds the end of the step.
    fn iterate_small(&mut self, step: Step) -> bool {
        let Some(small) = &mut self.small else {
            return false;
        };
        let is_newton = small.is_newton();
        let sizes = (&*self.model.problem, &self.tableau);
        let most = self.solver.max_small_iterations(is_newton, sizes);
        let (until, mut members) = ((most, self.stop), [Member::Active]);
        let (model, from) = (&mut self.model, self.predictor.start());
        let made = small.advance(model, from, step, until, &mut members);
        let (Some(()), [Member::Converged(iterations)]) = (made, members) else {
            return false;
        };
        self.stats.iterations += iterations;
        self.stats.newton_steps += usize::from(is_newton);
        self.stats.schur_steps += usize::from(!is_newton);
        self.stats.evaluations += (iterations + 1) * self.tableau.stages;
        true
    }

    /// The step of any system; it has only to be committed.
    fn advance_general(&mut self, step: Step) -> Result<(), StepError> {
        let mut general = match self.general.take() {
            Some(general) => general,
            None => General::new(&mut self.model, &self.tableau, self.stop).into(),
        };
        let made = general.advance(self, step);
        self.general = Some(general);
        made
    }
}

impl Stepper for Spark {
    type State = State;

    fn step(&mut self, t: f64, h: f64, state: &mut State) -> Result<(), StepError> {
        let step = Step { t, h, state };
        if let Some(tolerances) = self.tolerances {
            self.aim(self.tolerance_of(tolerances, step));
        }
        let is_small = self.advance_small(step);
        if !is_small {
            self.advance_general(step)?;
        }
        if let Some(estimate) = &mut self.estimate {
            estimate.keep(state);
        }
        match (&self.small, &self.general) {
            (Some(small), _) if is_small => small.commit(&mut self.predictor.held, h, state),
            (_, Some(general)) => general.update.commit(state),
            _ => {}
        }
        self.measure((t, h), state);
        Ok(())
    }

    fn forget(&mut self) {
        self.predictor.forget();
        self.kinks.forget();
        self.velocity_error.forget();
    }

    fn stats(&self) -> Stats {
        let general = self.general.as_ref();
        let evaluations = general.map_or(0, |general| general.stages.evaluations);
        Stats {
            evaluations: self.stats.evaluations + evaluations,
            ..self.stats
        }
    }
}

impl Symmetric for Spark {}

// The extrapolated polynomials, the accelerations at the end of the last step, where errors control the steps, and the
// back-off of node Schur and of the modified iteration.
liouville_base::checkpoint!(Spark {
    predictor,
    kinks,
    velocity_error,
    noise,
    schur_backoff,
    backoff
});
