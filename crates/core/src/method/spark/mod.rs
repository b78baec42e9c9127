//! The (s,s)-Gauss–Lobatto SPARK methods for index-3 mechanical systems, order 2s.
//!
//! One step from (t0, y0, z0) to t1 = t0 + h, with Gauss stages T_i = t0 + c_i h and Lobatto nodes
//! T̂_j = t0 + ĉ_j h:
//!
//!     (S1)  Y_i = y0 + h Σ_j a_ij v(T_j, Y_j, Z_j)                                      i = 1..s
//!     (S2)  Ŷ_i = y0 + h Σ_j ā_ij v(T_j, Y_j, Z_j)                                      i = 0..s
//!     (S3)  p(T_i, Y_i, Z_i) = p0 + h Σ_j a_ij f(T_j, Y_j, Z_j) + h Σ_{j<s} â_ij r(T̂_j, Ŷ_j, λ_j)
//!     (S4)  0 = g(T̂_i, Ŷ_i)                                                            i = 1..s
//!     (U1)  y1 = y0 + h Σ_j b_j v(T_j, Y_j, Z_j)
//!     (U2)  p(t1, y1, z1) = p0 + h Σ_j b_j f(T_j, Y_j, Z_j) + h Σ_{j≤s} b̂_j r(T̂_j, Ŷ_j, λ_j)
//!     (U3)  0 = g_t(t1, y1) + g_y(t1, y1) v(t1, y1, z1)
//!
//! (S1)–(S4) give Z_i and λ_0..λ_{s−1}, with V_i = v(T_i, Y_i, Z_i) as unknowns of their own;
//! (U2), (U3) then give z1 and λ_s. The λ_j are internal: they are not passed on to the next step.
//! y and p are summed with their rounding errors carried along. Source: jay2007; the paper's ψ is λ.

mod full_newton;
mod node_schur;
mod predictor;
mod stages;
mod update;

use super::{Stats, Stepper};
use crate::linalg::{Matrix, copy};
use crate::newton;
use crate::problem::mechanical::{Model, State};
use crate::trouble::Trouble;
use full_newton::FullNewton;
use node_schur::NodeSchur;
use predictor::Predictor;
use stages::{Stages, Step};
use update::Update;

/// How the stage equations are solved; all ways lead to the same solution, to roundoff.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solver {
    /// Node Schur, and full Newton where that is slow.
    Auto,
    /// Node Schur only.
    NodeSchur,
    /// Full simplified Newton only.
    Newton,
}

/// Corrections node Schur may take before full Newton is the better choice.
const SCHUR_ITERATIONS: usize = 16;
/// Corrections full Newton may take.
const NEWTON_ITERATIONS: usize = 30;
/// Stages this far from their start, in units of the velocity, belong to another branch.
const BRANCH: f64 = 1.0;

/// Gauss–Lobatto SPARK at work.
#[derive(Clone, Debug)]
pub struct Spark {
    model: Model,
    solver: Solver,
    stages: Stages,
    schur: NodeSchur,
    full: Option<Box<FullNewton>>,
    predictor: Predictor,
    update: Update,
    /// The start values of the iteration.
    start: [Matrix; 3],
    /// Steps still to be made by full Newton, and how many it was last time.
    resting: usize,
    rest: usize,
    stats: Stats,
}

impl Spark {
    /// The s-stage method for this model.
    ///
    /// # Panics
    /// When `s` is zero.
    pub fn new(model: Model, s: usize, solver: Solver) -> Self {
        let stages = Stages::new(&model, s);
        Self {
            solver,
            schur: NodeSchur::new(&model, &stages),
            full: None,
            predictor: Predictor::new(&model, s),
            update: Update::new(&model),
            start: [stages.z.clone(), stages.v.clone(), stages.lam.clone()],
            resting: 0,
            rest: 0,
            stats: Stats::default(),
            stages,
            model,
        }
    }

    /// (S1)–(S4), from the step before or cold.
    fn solve_stages(&mut self, step: Step) -> Result<(), Trouble> {
        if self
            .predictor
            .extrapolate(&mut self.stages, &mut self.update.z, step.h)
        {
            if self.iterate(step).is_ok() {
                return Ok(());
            }
            self.stats.cold_starts += 1;
        }
        self.predictor
            .start_cold(&mut self.model, &mut self.stages, &mut self.update.z, step)?;
        self.iterate(step)
    }

    fn iterate(&mut self, step: Step) -> Result<(), Trouble> {
        let unknowns = [&self.stages.z, &self.stages.v, &self.stages.lam];
        for (start, unknown) in self.start.iter_mut().zip(unknowns) {
            copy(start.flat_mut(), unknown.flat());
        }
        let iterations = match self.solver {
            Solver::NodeSchur => self.iterate_schur(step, newton_limit(Solver::NodeSchur))?,
            Solver::Newton => self.iterate_newton(step)?,
            Solver::Auto if self.resting > 0 => {
                self.resting -= 1;
                self.iterate_newton(step)?
            }
            Solver::Auto => match self.iterate_schur(step, newton_limit(Solver::Auto)) {
                Ok(iterations) => {
                    self.rest = 0;
                    iterations
                }
                Err(_) => {
                    // each failure in a row doubles the rest
                    self.rest = (2 * self.rest + 1).min(1023);
                    self.resting = self.rest;
                    for (k, unknown) in
                        [&mut self.stages.z, &mut self.stages.v, &mut self.stages.lam]
                            .into_iter()
                            .enumerate()
                    {
                        unknown.flat_mut().copy_from_slice(self.start[k].flat());
                    }
                    self.iterate_newton(step)?
                }
            },
        };
        self.stats.iterations += iterations;
        self.check_branch(step)
    }

    fn iterate_schur(&mut self, step: Step, most: usize) -> Result<usize, Trouble> {
        let Self {
            schur: solver,
            stages,
            model,
            ..
        } = self;
        newton::solve(
            &mut node_schur::Solve {
                solver,
                stages,
                model,
                step,
                is_frozen: false,
            },
            most,
        )
    }

    fn iterate_newton(&mut self, step: Step) -> Result<usize, Trouble> {
        self.stats.newton_steps += 1;
        let Self {
            full,
            stages,
            model,
            ..
        } = self;
        let solver = full.get_or_insert_with(|| Box::new(FullNewton::new(model, stages)));
        newton::solve(
            &mut full_newton::Solve {
                solver,
                stages,
                model,
                step,
                is_frozen: false,
            },
            NEWTON_ITERATIONS,
        )
    }

    /// A solution far from its start may satisfy every equation and still be another motion.
    fn check_branch(&self, step: Step) -> Result<(), Trouble> {
        let largest = |x: &[f64]| x.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
        let (found, start) = (self.stages.v.flat(), self.start[1].flat());
        let moved = found
            .iter()
            .zip(start)
            .fold(0.0_f64, |largest, (a, b)| largest.max((a - b).abs()));
        let y = largest(&step.state.y) / step.h.abs();
        let size = largest(found).max(largest(start)).max(0.1 * y);
        if moved > BRANCH * size {
            Err(Trouble::Branch {
                ratio: moved / size,
            })
        } else {
            Ok(())
        }
    }
}

fn newton_limit(solver: Solver) -> usize {
    if solver == Solver::Auto {
        SCHUR_ITERATIONS
    } else {
        3 * SCHUR_ITERATIONS
    }
}

impl Stepper for Spark {
    type State = State;

    fn step(&mut self, t: f64, h: f64, state: &mut State) -> Result<(), Trouble> {
        let step = Step { t, h, state };
        self.solve_stages(step)?;
        // the update needs forces at the last iterate: older ones cost a drift in the energy
        self.stages.evaluate_values(&mut self.model, step);
        self.update.solve(&mut self.model, &mut self.stages, step)?;
        self.predictor
            .keep(&self.stages, h, &state.z, &self.update.z, &self.update.v);
        self.update.commit(state);
        Ok(())
    }

    fn stats(&self) -> Stats {
        Stats {
            evaluations: self.stages.evaluations,
            ..self.stats
        }
    }
}
