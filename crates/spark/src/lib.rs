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
mod estimate;
mod full_newton;
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
mod yardstick;

use attempt::{KeptStages, SparkAttempt};
use full_newton::FullNewton;
pub use lanes::{SparkBatch, supports_batch};
use liouville_base::error::StepError;
use liouville_base::linalg::choice::{CHEAP_NEWTON, SCHUR_ITERATIONS};
use liouville_base::method::{Stats, Stepper, Symmetric};
use liouville_base::newton::{self, Continuation, Equations, Member, Rest, Solved};
use liouville_base::tableau;
use liouville_problem::{Estimate, Mechanical, Model, State, Step};
use liouville_small::{Matrices, Small};
use node_schur::NodeSchur;
use predictor::Predictor;
use small_newton::SmallNewton;
use stages::{Stages, Unknowns};
pub use tangent::{SparkAdjoint, SparkTangents};
use update::Update;

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

/// A SPARK method at work.
#[derive(Clone, Debug)]
pub struct Spark {
    model: Model,
    solver: Solver,
    /// The fast path, which makes nearly all steps of a small system.
    small: Option<Box<Small<f64>>>,
    stages: Stages,
    schur: NodeSchur,
    /// Full Newton, made at its first use.
    full: Option<Box<FullNewton>>,
    predictor: Predictor,
    update: Update,
    /// The error estimate, where steps are controlled by errors.
    estimate: Option<Box<Estimate>>,
    /// Start values of node Schur, from which full Newton starts after its failure.
    start: Unknowns,
    /// Solutions kept by the attempts, each made at its first use.
    kept: [Option<Box<KeptStages>>; 3],
    continuation: Option<Box<Continuation>>,
    /// Rest of node Schur, and of the modified iteration.
    schur_rest: Rest,
    rest: Rest,
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
        let small = Small::new(&mut model, &tableau, solver.matrices());
        let stages = Stages::new(&model, tableau);
        Self {
            solver,
            small,
            schur: NodeSchur::new(&model, &stages),
            full: None,
            predictor: Predictor::new(&model, &stages.tableau),
            update: Update::new(&model),
            estimate: None,
            start: stages.unknowns.clone(),
            kept: [None, None, None],
            continuation: None,
            schur_rest: Rest::default(),
            rest: Rest::default(),
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

    /// (U1)–(U3), and the polynomials that the next step is extrapolated from.
    fn finish(&mut self, step: Step) -> Result<(), StepError> {
        // forces of an earlier iterate would make the energy drift
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

    /// Makes the step of a small system by the fast path; returns whether that has solved it, up to the commit.
    fn advance_small(&mut self, step: Step) -> bool {
        let Some(small) = &mut self.small else {
            return false;
        };
        let is_newton = small.is_newton();
        if (self.schur_rest.is_on() && !is_newton) || self.rest.is_on() {
            return false;
        }
        let stages = &mut self.stages;
        let sizes = (&*self.model.problem, &stages.tableau);
        let most = self.solver.max_small_iterations(is_newton, sizes);
        let (until, mut members) = ((most, stages.stop), [Member::Open]);
        let (model, from) = (&mut self.model, self.predictor.start());
        let made = small.advance(model, from, step, until, &mut members);
        let (Some(()), [Member::Converged(iterations)]) = (made, members) else {
            return false;
        };
        self.stats.iterations += iterations;
        self.stats.newton_steps += usize::from(is_newton);
        stages.evaluations += (iterations + 1) * stages.tableau.stages;
        self.schur_rest.end_row();
        self.rest.end_row();
        true
    }

    /// The modified iteration, by node Schur or by the matrix of full Newton; returns whether the solution is near.
    fn iterate(&mut self, step: Step) -> Result<bool, StepError> {
        self.is_by_schur = false;
        let solved = if self.wants_newton() {
            self.iterate_newton(step, false)?
        } else {
            self.start.copy_from(&self.stages.unknowns);
            match self.iterate_schur(step) {
                Err(_) if self.solver == Solver::Auto => {
                    self.schur_rest.begin();
                    self.stages.unknowns.copy_from(&self.start);
                    self.iterate_newton(step, false)?
                }
                outcome => {
                    self.schur_rest.end_row();
                    self.is_by_schur = outcome.is_ok();
                    outcome?
                }
            }
        };
        self.stats.iterations += solved.iterations;
        Ok(solved.is_near)
    }

    /// Full Newton, or where only node Schur is allowed the modified iteration again.
    fn iterate_full(&mut self, step: Step) -> Result<bool, StepError> {
        if self.is_schur_only() {
            return self.iterate(step);
        }
        self.is_by_schur = false;
        let solved = self.iterate_newton(step, true)?;
        self.stats.iterations += solved.iterations;
        Ok(solved.is_near)
    }

    /// Whether node Schur is the only solver.
    fn is_schur_only(&self) -> bool {
        self.solver == Solver::NodeSchur && self.schur.is_able() && self.model.problem.l() == 0
    }

    /// The error of a step; node Schur alone cannot show that the step is too large, only that it does not converge.
    fn without_full(&self, error: StepError) -> StepError {
        match error {
            StepError::StepTooLarge { .. } if self.is_schur_only() => StepError::NotConverged {
                iterations: self
                    .solver
                    .max_iterations(&self.model.problem, &self.stages.tableau),
                size: f64::INFINITY,
            },
            error => error,
        }
    }

    /// Whether full Newton takes the place of node Schur: by choice of the user, for small systems with a varying mass, for
    /// nonholonomic constraints, or while node Schur is left out after failures.
    fn wants_newton(&mut self) -> bool {
        let is_small = self.small.as_ref().is_some_and(|small| small.is_newton());
        self.schur_rest.take()
            || is_small
            || self.solver == Solver::Newton
            || !self.schur.is_able()
            || self.model.problem.l() > 0
    }

    fn iterate_schur(&mut self, step: Step) -> Result<Solved, StepError> {
        let (stages, model) = (&mut self.stages, &mut self.model);
        let most = self.solver.max_iterations(&model.problem, &stages.tableau);
        newton::solve(&mut self.schur.start(stages, model, step), most)
    }

    /// Newton's method with the full matrix, made once or for each correction.
    fn iterate_newton(&mut self, step: Step, is_each: bool) -> Result<Solved, StepError> {
        self.stats.newton_steps += 1;
        let (stages, model) = (&mut self.stages, &mut self.model);
        if let Some(small) = &mut self.small
            && small.is_newton()
        {
            self.start.copy_from(&stages.unknowns);
            let mut equations = SmallNewton::new(small, stages, model, step);
            let solved = Self::solve_newton(&mut equations, is_each);
            // its matrix is factored without pivots, so a failure is repeated with one that has them
            let is_own = match solved {
                Ok(_) => true,
                Err(StepError::NotConverged { size, .. }) => !is_each && size < 1.0,
                Err(_) => false,
            };
            if is_own {
                return solved;
            }
            stages.unknowns.copy_from(&self.start);
        }
        let full = self
            .full
            .get_or_insert_with(|| FullNewton::new(model, stages).into());
        let mut equations = full.start(stages, model, &mut self.update.z, step);
        Self::solve_newton(&mut equations, is_each)
    }

    fn solve_newton(equations: &mut impl Equations, is_each: bool) -> Result<Solved, StepError> {
        if is_each {
            newton::solve_full(equations)
        } else {
            newton::solve(equations, MOST_ITERATIONS)
        }
    }
}

impl Stepper for Spark {
    type State = State;

    fn step(&mut self, t: f64, h: f64, state: &mut State) -> Result<(), StepError> {
        let step = Step { t, h, state };
        let is_small = self.advance_small(step);
        if !is_small {
            let attempted = newton::attempt(&mut SparkAttempt { spark: self, step }, h);
            attempted.map_err(|error| self.without_full(error))?;
            self.finish(step)?;
        }
        if let Some(estimate) = &mut self.estimate {
            estimate.keep(state);
        }
        match &self.small {
            Some(small) if is_small => small.commit(&mut self.predictor.held, h, state),
            _ => self.update.commit(state),
        }
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

// The extrapolated polynomials, and the back-off of node Schur and of the modified iteration.
liouville_base::checkpoint!(Spark {
    predictor,
    schur_rest,
    rest
});
