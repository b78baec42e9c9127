//! Specialised Runge–Kutta methods for semi-explicit systems of index 2: on Gauss points, of order 2s, and on
//! Radau points, of order 2s − 1.
//!
//! One step from (t0, y0) to t1 = t0 + h, with stages T_i = t0 + c_i h:
//!
//!     (I1)  Y_i = y0 + h Σ_j a_ij V_j,   V_i = f(T_i, Y_i, Z_i)                        i = 1..s
//!     (I2)  0 = Σ_j b_j P_{i−1}(c_j) k(T_j, Y_j)                                       i = 1..s−1
//!     (I3)  y1 = y0 + h Σ_j b_j V_j,   0 = k(t1, y1)
//!     (I4)  0 = k_t(t1, y1) + k_y(t1, y1) f(t1, y1, z1)
//!
//! The constraint holds at the ends of steps; at the stages only its Legendre moments vanish. On Radau points
//! the last stage is the end, so (I2) and (I3) are s independent conditions on s values k(T_j, Y_j): all of them
//! vanish, and this is Radau IIA. (I1)–(I3) give V_i and Z_i, (I4) then z1, with the order of y where the Z_i
//! have order s. z0 is used by no step. y is summed with its rounding errors carried along. Sources: jay2006;
//! hairer1996, VII.4.

mod attempt;
mod estimate;
mod newton_matrix;
mod predictor;
mod probe;
pub mod semi_explicit;
mod stages;
mod tangent;

use crate::semi_explicit::{Algebraic, SemiExplicitModel, SemiExplicitState};
use attempt::CollocationAttempt;
use estimate::EndVelocities;
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, max_norm, sum_compensated};
use liouville_base::method::{Stats, Stepper, Symmetric};
use liouville_base::newton::{self, Backoff, Continuation, Equations, Predictor, Solved};
use liouville_base::tableau::Spark;
use liouville_problem::finite_state;
use newton_matrix::CollocationMatrix;
use stages::{CollocationStages, CollocationStep, KeptCollocation};
pub use tangent::{Index2Adjoint, Index2Tangents, SemiExplicitTangentObserver};

/// Corrections a step may take.
const MOST_ITERATIONS: usize = 100;

/// The s-stage method at work.
#[derive(Clone, Debug)]
pub struct Index2 {
    model: SemiExplicitModel,
    stages: CollocationStages,
    matrix: CollocationMatrix,
    predictor: Predictor,
    algebraic: Algebraic,
    z: Vec<f64>,
    /// f at the start of the step, or next to it where the step before has left it.
    slope: Vec<f64>,
    /// Whether the present start is far from the solution.
    is_far: bool,
    backoff: Backoff,
    /// Solutions to be compared.
    kept: [Option<Box<KeptCollocation>>; 3],
    continuation: Option<Box<Continuation>>,
    /// The error estimate, where steps are controlled by errors.
    estimate: Option<Box<EndVelocities>>,
    y: Vec<f64>,
    y_low: Vec<f64>,
    stats: Stats,
}

/// (I1)–(I3) in the middle of being solved.
struct CollocationEquations<'a> {
    stages: &'a mut CollocationStages,
    matrix: &'a mut CollocationMatrix,
    model: &'a mut SemiExplicitModel,
    step: CollocationStep<'a>,
    /// Whether each correction has a matrix of its own, and v at the start.
    is_fresh: bool,
    slope: &'a [f64],
    /// Corrections by the factors there are.
    corrections: f64,
    stats: &'a mut Stats,
}

impl Index2 {
    /// The method on s Gauss points for this model.
    ///
    /// # Panics
    /// When `s` is zero.
    pub fn new(model: SemiExplicitModel, s: usize) -> Self {
        Self::of(model, &Spark::gauss(s))
    }

    /// The method on the stages of these coefficients, Gauss or Radau.
    pub fn of(model: SemiExplicitModel, tableau: &Spark) -> Self {
        let stages = CollocationStages::new(&model, tableau);
        Self {
            matrix: CollocationMatrix::new(&model, &stages),
            predictor: predictor::predictor(&stages),
            algebraic: Algebraic::new(&model),
            z: vec![0.0; model.problem.l],
            slope: vec![0.0; model.problem.n],
            is_far: false,
            backoff: Backoff::default(),
            kept: [None, None, None],
            continuation: None,
            estimate: None,
            y: vec![0.0; model.problem.n],
            y_low: vec![0.0; model.problem.n],
            stats: Stats::default(),
            stages,
            model,
        }
    }

    /// V_i and Z_i where Euler's method leads to, each z from the hidden constraint there.
    fn start_by_euler(&mut self, step: CollocationStep) {
        let SemiExplicitState { y, z, .. } = step.state;
        copy(&mut self.slope, self.model.field(step.t, y, z));
        let speed = max_norm(y) / step.h.abs();
        for i in 0..self.stages.count() {
            let t = self.stages.time(step.t, step.h, i);
            let (point, unknowns) = (self.stages.y.row_mut(i), self.stages.z.row_mut(i));
            copy(point, y);
            add_scaled(point, t - step.t, &self.slope);
            copy(unknowns, z);
            let found = self
                .algebraic
                .solve(&mut self.model, t, point, unknowns, speed);
            if found.is_err() {
                copy(unknowns, z);
            }
            copy(
                self.stages.v.row_mut(i),
                self.model.field(t, point, unknowns),
            );
        }
    }

    /// V_i and Z_i as they are at the start of the step.
    fn start_constant(&mut self, step: CollocationStep) {
        for i in 0..self.stages.count() {
            copy(self.stages.v.row_mut(i), &self.slope);
            copy(self.stages.z.row_mut(i), &step.state.z);
        }
    }

    /// The iteration; from far away, or if it `is_full`, each correction has its own matrix.
    fn iterate(&mut self, step: CollocationStep, is_full: bool) -> Result<Solved, StepError> {
        let mut equations = CollocationEquations {
            stages: &mut self.stages,
            matrix: &mut self.matrix,
            model: &mut self.model,
            step,
            is_fresh: self.is_far,
            slope: &self.slope,
            corrections: 0.0,
            stats: &mut self.stats,
        };
        let outcome = if is_full {
            newton::solve_full(&mut equations)
        } else {
            newton::solve(&mut equations, MOST_ITERATIONS)
        };
        match outcome {
            Ok(solved) => {
                self.matrix.reuse.record(solved.iterations);
                self.stats.iterations += solved.iterations;
                Ok(solved)
            }
            Err(error) => {
                self.matrix.reuse.discard();
                Err(error)
            }
        }
    }

    /// The cause of a singular matrix, where it is found at the start of the step.
    fn diagnose_rank(&mut self, step: CollocationStep, error: StepError) -> StepError {
        if error != StepError::SingularNewton {
            return error;
        }
        copy(&mut self.z, &step.state.z);
        let at_start =
            self.algebraic
                .solve(&mut self.model, step.t, &step.state.y, &mut self.z, 1.0);
        match at_start {
            Err(singular @ StepError::SingularHidden { .. }) => singular,
            _ => error,
        }
    }
}

impl Stepper for Index2 {
    type State = SemiExplicitState;

    fn step(&mut self, t: f64, h: f64, state: &mut SemiExplicitState) -> Result<(), StepError> {
        let step = CollocationStep { t, h, state };
        let attempted = newton::attempt(&mut CollocationAttempt { index2: self, step }, h);
        attempted.map_err(|error| self.diagnose_rank(step, error))?;
        self.stages.move_points(step);
        let speed = max_norm(&state.y) / h.abs();
        self.stages.end_of_z(&mut self.z);
        self.algebraic.solve(
            &mut self.model,
            t + h,
            self.stages.end(),
            &mut self.z,
            speed,
        )?;
        predictor::keep(&mut self.predictor, &self.stages, h);
        copy(&mut self.y_low, &state.y_low);
        self.stages.add_moves(&mut self.y_low);
        sum_compensated(&state.y, &mut self.y_low, &mut self.y);
        finite_state(&self.y, t + h)?;
        self.begin_estimate(t, state);
        copy(&mut state.y, &self.y);
        copy(&mut state.y_low, &self.y_low);
        copy(&mut state.z, &self.z);
        self.end_estimate(t, h, state);
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

impl Symmetric for Index2 {}

impl Equations for CollocationEquations<'_> {
    fn scaled_size(&self, size: f64) -> f64 {
        self.stages.scaled_size(size, self.step)
    }

    fn deviation(&self) -> f64 {
        self.stages.deviation(self.slope, self.step)
    }

    fn refresh(&mut self) {
        self.matrix.reuse.discard();
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        self.is_residual_roundoff()
    }

    fn roundoff_floor(&mut self) -> Result<f64, StepError> {
        self.largest_by_roundoff()
    }

    fn correct(&mut self) -> Result<f64, StepError> {
        self.stages.evaluate(self.model, self.step)?;
        let is_slow = self.corrections >= self.matrix.reuse.max_iterations();
        if self.is_fresh || is_slow || !self.matrix.reuse.is_reusable(self.step.h) {
            self.matrix.update(self.model, self.stages, self.step)?;
            self.stats.factorizations += 1;
            self.corrections = 0.0;
        }
        self.corrections += 1.0;
        let size = self.matrix.correct(self.model, self.stages, self.step.h);
        Ok(self.stages.relative(size, self.step))
    }
}

liouville_base::checkpoint!(
    Index2 { predictor, matrix, backoff }
    then |index2| index2.matrix.restore_factors(&mut index2.model, &index2.stages)
);
