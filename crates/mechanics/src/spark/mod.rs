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
//! (S1)–(S4) give Z_i and λ_0..λ_{k−1}, with V_i = v(T_i, Y_i, Z_i) as unknowns of their own;
//! (U2), (U3) then give z1 and λ_k. The λ_j are internal: they are not passed on to the next step.
//! y and p are summed with their rounding errors carried along. Source: jay2007; the paper's ψ is λ.
//! Nonholonomic constraints bring equations of their own, in `full_newton`.

mod estimate;
mod full_newton;
mod lanes;
mod node_schur;
mod predictor;
mod sparse_schur;
mod stages;
mod update;

use crate::problem::{Mechanical, Model, State};
use estimate::Estimate;
use full_newton::FullNewton;
use liouville_base::error::StepError;
use liouville_base::linalg::choice::{CHEAP_NEWTON, SCHUR_ITERATIONS};
use liouville_base::method::{Stats, Stepper, Symmetric};
use liouville_base::newton::{self, Attempts, Start};
use liouville_base::tableau;
use node_schur::NodeSchur;
use predictor::Predictor;
use stages::{Stages, Step, Unknowns};
use update::Update;

pub use lanes::{BATCH, SparkBatch, supports_batch};

/// How the stage equations are solved; all ways lead to the same solution, to roundoff.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solver {
    /// Node Schur, and full Newton where that is slow.
    Auto,
    /// Node Schur only, but where its matrix would be dense and large.
    NodeSchur,
    /// Full simplified Newton only.
    Newton,
}

impl Solver {
    /// Corrections that node Schur may take.
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
}

/// Corrections a solver may take when there is no other.
const MOST_ITERATIONS: usize = 100;
/// Steps node Schur rests at most after failing; each failure in a row doubles the rest.
const LONGEST_REST: usize = 1023;

/// A SPARK method at work.
#[derive(Clone, Debug)]
pub struct Spark {
    model: Model,
    solver: Solver,
    stages: Stages,
    schur: NodeSchur,
    /// Full Newton, made when it is first wanted.
    full: Option<Box<FullNewton>>,
    predictor: Predictor,
    update: Update,
    /// What tells errors, where they are wanted.
    estimate: Option<Box<Estimate>>,
    /// Where node Schur started, for full Newton to start there too.
    start: Unknowns,
    /// Steps still to be made by full Newton, and how many it was last time.
    resting: usize,
    rest: usize,
    /// Whether node Schur has found the present stages.
    is_by_schur: bool,
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
        model.reserve_batch(tableau.stages, tableau.intervals + 1);
        let stages = Stages::new(&model, tableau);
        Self {
            solver,
            schur: NodeSchur::new(&model, &stages),
            full: None,
            predictor: Predictor::new(&model, &stages.tableau),
            update: Update::new(&model),
            estimate: None,
            start: stages.unknowns.clone(),
            resting: 0,
            rest: 0,
            is_by_schur: false,
            stats: Stats::default(),
            stages,
            model,
        }
    }

    /// The same, with stage equations solved to this fraction of the velocities instead of to roundoff.
    #[must_use]
    pub fn to_tolerance(mut self, tolerance: f64) -> Self {
        self.stages.stop.tolerance = tolerance;
        self
    }

    /// (U1)–(U3), and what the next step is extrapolated from.
    fn finish(&mut self, step: Step) -> Result<(), StepError> {
        // the update needs forces at the last iterate: older ones cost a drift in the energy
        let last = self.stages.tableau.intervals - 1;
        self.stages.evaluate_values(&mut self.model, step, last);
        if self.is_by_schur && self.stages.loses_moves(&self.model.problem) {
            self.schur.find_lost_moves(&mut self.stages, step);
        } else {
            self.stages.lost_moves.clear();
        }
        self.update.solve(&mut self.model, &mut self.stages, step)?;
        let (z, v) = (&self.update.z, &self.update.v);
        self.predictor
            .keep(&self.stages, step.h, &step.state.z, z, v);
        Ok(())
    }

    fn iterate(&mut self, step: Step) -> Result<(), StepError> {
        self.is_by_schur = false;
        let iterations = if self.wants_newton() {
            self.iterate_newton(step)?
        } else {
            self.start.copy_from(&self.stages.unknowns);
            match self.iterate_schur(step) {
                Err(_) if self.solver == Solver::Auto => {
                    self.rest = (2 * self.rest + 1).min(LONGEST_REST);
                    self.resting = self.rest;
                    self.stages.unknowns.copy_from(&self.start);
                    self.iterate_newton(step)?
                }
                outcome => {
                    self.rest = 0;
                    self.is_by_schur = outcome.is_ok();
                    outcome?
                }
            }
        };
        self.stats.iterations += iterations;
        Ok(())
    }

    /// Whether full Newton is asked for or all there is, or node Schur rests after having failed.
    fn wants_newton(&mut self) -> bool {
        let is_resting = self.resting > 0;
        self.resting = self.resting.saturating_sub(1);
        is_resting
            || self.solver == Solver::Newton
            || !self.schur.is_able()
            || self.model.problem.l() > 0
    }

    fn iterate_schur(&mut self, step: Step) -> Result<usize, StepError> {
        let (stages, model) = (&mut self.stages, &mut self.model);
        let most = self.solver.max_iterations(&model.problem, &stages.tableau);
        newton::solve(&mut self.schur.start(stages, model, step), most)
    }

    fn iterate_newton(&mut self, step: Step) -> Result<usize, StepError> {
        self.stats.newton_steps += 1;
        let (stages, model) = (&mut self.stages, &mut self.model);
        let full = self
            .full
            .get_or_insert_with(|| FullNewton::new(model, stages).into());
        let mut equations = full.start(stages, model, &mut self.update.z, step);
        newton::solve(&mut equations, MOST_ITERATIONS)
    }
}

/// A step whose stage equations are attempted.
struct Attempt<'a> {
    spark: &'a mut Spark,
    step: Step<'a>,
}

impl Attempts for Attempt<'_> {
    fn start(&mut self, h: f64, start: Start) -> Result<bool, StepError> {
        let step = Step { h, ..self.step };
        let Spark {
            model,
            stages,
            predictor,
            update,
            ..
        } = &mut *self.spark;
        if start == Start::Extrapolated {
            return Ok(predictor.extrapolate(stages, &mut update.z, h));
        }
        let is_still = start == Start::Still;
        predictor.start_cold(model, stages, &mut update.z, step, is_still)?;
        Ok(true)
    }

    fn iterate(&mut self, h: f64) -> Result<(), StepError> {
        self.spark.iterate(Step { h, ..self.step })
    }

    fn hold_shorter(&mut self, h: f64) -> Result<(), StepError> {
        self.spark.finish(Step { h, ..self.step })?;
        self.spark.predictor.undo();
        Ok(())
    }

    fn forget(&mut self) {
        self.spark.predictor.forget();
    }

    fn count_cold_start(&mut self) {
        self.spark.stats.cold_starts += 1;
    }
}

impl Stepper for Spark {
    type State = State;

    fn step(&mut self, t: f64, h: f64, state: &mut State) -> Result<(), StepError> {
        let step = Step { t, h, state };
        newton::attempt(&mut Attempt { spark: self, step }, h)?;
        self.finish(step)?;
        if let Some(estimate) = &mut self.estimate {
            estimate.keep(state);
        }
        self.update.commit(state);
        if let Some(estimate) = &mut self.estimate {
            estimate.measure(self.predictor.velocities(), h, state);
        }
        Ok(())
    }

    fn forget(&mut self) {
        self.predictor.forget();
    }

    fn stats(&self) -> Stats {
        Stats {
            evaluations: self.stages.evaluations,
            ..self.stats
        }
    }
}

impl Symmetric for Spark {}

// What is extrapolated, and how long node Schur still rests.
liouville_base::checkpoint!(Spark {
    predictor,
    resting,
    rest
});
