//! Steps of any system: the stage equations, by node Schur or full Newton, and the end of the step.

use super::equations::StageEquations;
use super::full_newton::{FullNewton, FullSolver};
use super::node_schur::NodeSchur;
use super::stages::{Stages, Unknowns};
use super::update::Update;
use super::{MOST_ITERATIONS, Solver, Spark};
use liouville_base::error::StepError;
use liouville_base::newton::{self, Continuation, Equations, Solved, Stop};
use liouville_base::tableau;
use liouville_problem::{Model, Step};
use liouville_small::Small;

/// The memory of such a step.
#[derive(Clone, Debug)]
pub(super) struct General {
    pub(super) stages: Stages,
    schur: NodeSchur,
    /// Full Newton, made at its first use.
    full: Option<Box<FullNewton>>,
    pub(super) update: Update,
    /// Start values of node Schur, from which full Newton starts after its failure.
    start: Unknowns,
    /// Solutions kept by the attempts, each made at its first use.
    pub(super) kept: [Option<Box<KeptStages>>; 3],
    pub(super) continuation: Option<Box<Continuation>>,
    /// Whether node Schur has solved for the present stages.
    pub(super) is_by_schur: bool,
}

/// A solution kept beside the present one.
#[derive(Clone, Debug)]
pub(super) struct KeptStages {
    pub(super) h: f64,
    pub(super) unknowns: Unknowns,
    pub(super) z1: Vec<f64>,
    pub(super) is_by_schur: bool,
}

impl General {
    #[inline(never)]
    pub(super) fn new(model: &mut Model, tableau: &tableau::Spark, stop: Stop) -> Self {
        model.reserve_batch(tableau.stages, tableau.intervals + 1);
        let mut stages = Stages::new(model, tableau.clone());
        stages.stop = stop;
        Self {
            schur: NodeSchur::new(model, &stages),
            full: None,
            update: Update::new(model),
            start: stages.unknowns.clone(),
            kept: [None, None, None],
            continuation: None,
            is_by_schur: false,
            stages,
        }
    }

    /// (U1)–(U3), and the polynomials that the next step is extrapolated from.
    pub(super) fn finish(&mut self, spark: &mut Spark, step: Step) -> Result<(), StepError> {
        let (model, stages) = (&mut spark.model, &mut self.stages);
        // forces of an earlier iterate would make the energy drift
        let last = stages.tableau.intervals - 1;
        stages.evaluate_values(model, step, last);
        if self.is_by_schur && stages.finds_lost_displacements(&model.problem) {
            self.schur.find_lost_displacements(stages, step);
        } else {
            stages.lost_displacements.clear();
        }
        self.update.solve(model, stages, step)?;
        let (z, v) = (&self.update.z, &self.update.v);
        (spark.predictor).keep(stages, step.h, &step.state.z, z, v);
        Ok(())
    }

    /// The modified iteration, by node Schur or by the matrix of full Newton.
    pub(super) fn iterate(&mut self, spark: &mut Spark, step: Step) -> Result<Solved, StepError> {
        self.is_by_schur = false;
        let solved = if self.wants_newton(spark) {
            self.iterate_newton(spark, step, false)?
        } else {
            self.start.copy_from(&self.stages.unknowns);
            match self.iterate_schur(spark, step) {
                Err(_) if spark.solver == Solver::Auto => {
                    spark.schur_backoff.fail();
                    self.stages.unknowns.copy_from(&self.start);
                    self.iterate_newton(spark, step, false)?
                }
                outcome => {
                    spark.schur_backoff.succeed();
                    self.is_by_schur = outcome.is_ok();
                    spark.stats.schur_steps += usize::from(self.is_by_schur);
                    outcome?
                }
            }
        };
        spark.stats.iterations += solved.iterations;
        Ok(solved)
    }

    /// Full Newton, or where only node Schur is allowed the modified iteration again.
    pub(super) fn iterate_full(
        &mut self,
        spark: &mut Spark,
        step: Step,
    ) -> Result<Solved, StepError> {
        if self.is_schur_only(spark) {
            return self.iterate(spark, step);
        }
        self.is_by_schur = false;
        let solved = self.iterate_newton(spark, step, true)?;
        spark.stats.iterations += solved.iterations;
        Ok(solved)
    }

    /// Whether node Schur is the only solver.
    fn is_schur_only(&self, spark: &Spark) -> bool {
        let problem = &spark.model.problem;
        spark.solver == Solver::NodeSchur && self.schur.has_matrix() && problem.l() == 0
    }

    /// The error of a step; node Schur alone cannot show that the step is too large, only that it does not converge.
    pub(super) fn error_of(&self, spark: &Spark, error: StepError) -> StepError {
        let (problem, tableau) = (&spark.model.problem, &spark.tableau);
        match error {
            StepError::StepTooLarge { .. } if self.is_schur_only(spark) => {
                StepError::NotConverged {
                    iterations: spark.solver.max_iterations(problem, tableau),
                    size: f64::INFINITY,
                }
            }
            error => error,
        }
    }

    /// Whether full Newton takes the place of node Schur: by choice of the user, for small systems with a varying mass,
    /// for nonholonomic constraints, or while node Schur is left out after failures.
    fn wants_newton(&self, spark: &mut Spark) -> bool {
        let is_small = spark.small.as_ref().is_some_and(Small::is_newton);
        spark.schur_backoff.skip()
            || is_small
            || spark.solver == Solver::Newton
            || !self.schur.has_matrix()
            || spark.model.problem.l() > 0
    }

    fn iterate_schur(&mut self, spark: &mut Spark, step: Step) -> Result<Solved, StepError> {
        let (stages, model) = (&mut self.stages, &mut spark.model);
        let most = spark.solver.max_iterations(&model.problem, &spark.tableau);
        let mut equations = StageEquations::new(&mut self.schur, stages, model, step);
        newton::solve(&mut equations, most)
    }

    /// Newton's method with the full matrix, made once or for each correction.
    fn iterate_newton(
        &mut self,
        spark: &mut Spark,
        step: Step,
        is_full: bool,
    ) -> Result<Solved, StepError> {
        spark.stats.newton_steps += 1;
        let (stages, model) = (&mut self.stages, &mut spark.model);
        if let Some(small) = &mut spark.small
            && small.is_newton()
        {
            self.start.copy_from(&stages.unknowns);
            let mut equations = StageEquations::new(&mut *small, stages, model, step);
            let solved = Self::solve_newton(&mut equations, is_full);
            // its matrix is factored without pivots, so a failure is repeated with one that has them
            let is_own = match solved {
                Ok(_) => true,
                Err(StepError::NotConverged { size, .. }) => !is_full && size < 1.0,
                Err(_) => false,
            };
            if is_own {
                return solved;
            }
            stages.unknowns.copy_from(&self.start);
        }
        let full = (self.full).get_or_insert_with(|| FullNewton::new(model, stages).into());
        let solver = FullSolver {
            newton: full,
            z1: &mut self.update.z,
        };
        let mut equations = StageEquations::new(solver, stages, model, step);
        Self::solve_newton(&mut equations, is_full)
    }

    fn solve_newton(equations: &mut impl Equations, is_full: bool) -> Result<Solved, StepError> {
        if is_full {
            newton::solve_full(equations)
        } else {
            newton::solve(equations, MOST_ITERATIONS)
        }
    }
}
