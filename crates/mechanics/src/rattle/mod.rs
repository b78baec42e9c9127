//! RATTLE for separable systems with holonomic constraints, order 2.
//!
//! One step from (t0, y0, p0) to t1 = t0 + h, with G_i = g_y(t_i, y_i):
//!
//!     p_h = p0 + h/2 (f(t0, y0) − G0ᵀ λ),   y1 = y0 + h v_h,   v_h = W (p_h − p_0) + v_0,   0 = g(t1, y1)
//!     p1 = p_h + h/2 (f(t1, y1) − G1ᵀ μ),   0 = g_t(t1, y1) + G1 v1
//!
//! It is the Lobatto IIIA–IIIB pair of two stages where constant p_z and v_z leave nothing implicit but
//! the multipliers; f and G at the end of a step serve the next. λ comes from the simplified Newton
//! iteration with the matrix G(t1, ỹ1) W G0ᵀ at the first guess ỹ1, whose error shrinks by what that
//! guess is wrong; μ by one solve with G1 W G1ᵀ. y and p are summed with their rounding errors carried
//! along. Source: andersen1983; hairer2006, VII.1.4.

mod guess;
mod mass;
mod positions;
mod reactions;

use crate::problem::{SeparableModel, State};
use guess::Guess;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch};
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, carry, copy};
use liouville_base::method::{Stats, Stepper, Symmetric};
use liouville_base::newton;
use mass::ConstantMass;
use positions::{Positions, Step};
use reactions::Reactions;

/// Corrections of the multipliers a step may take.
const MOST_ITERATIONS: usize = 100;

/// RATTLE at work.
#[derive(Clone, Debug)]
pub struct Rattle {
    model: SeparableModel,
    mass: ConstantMass,
    reactions: Reactions,
    positions: Positions,
    guess: Guess,
    /// f where the next step starts, and where that is.
    force: Vec<f64>,
    start: Option<f64>,
    start_y: Vec<f64>,
    /// The end of a step while it is being found.
    low: Vec<f64>,
    y_low: Vec<f64>,
    p: Vec<f64>,
    v: Vec<f64>,
    stats: Stats,
}

impl Rattle {
    /// The method for this model.
    ///
    /// # Errors
    /// A singular mass.
    pub fn new(mut model: SeparableModel) -> Result<Self, StepError> {
        let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
        let zeros = vec![0.0; n];
        let mass = ConstantMass::new(&mut model.general)?;
        Ok(Self {
            reactions: Reactions::new(&model, &mass),
            positions: Positions::new(n, m),
            guess: Guess::new(m),
            force: zeros.clone(),
            start: None,
            start_y: zeros.clone(),
            low: zeros.clone(),
            y_low: zeros.clone(),
            p: zeros.clone(),
            v: zeros,
            stats: Stats::default(),
            mass,
            model,
        })
    }

    /// f and G at the start, unless the step before has left them.
    fn begin(&mut self, step: Step) -> Result<(), StepError> {
        let State { y, .. } = step.state;
        // a time that was added up differs from one that was multiplied by an ulp or two
        let nearly = 4.0 * f64::EPSILON * (step.t.abs() + step.h.abs());
        let is_kept = self.start.is_some_and(|t| (t - step.t).abs() <= nearly);
        if is_kept && self.start_y == *y {
            return Ok(());
        }
        self.start = None;
        copy(&mut self.force, self.model.force(step.t, y)?);
        self.stats.evaluations += 1;
        self.reactions.start_at(&mut self.model, step.t, y)?;
        copy(&mut self.start_y, y);
        self.start = Some(step.t);
        Ok(())
    }

    /// λ and y1, from the steps before or cold.
    fn solve_positions(&mut self, step: Step) -> Result<(), StepError> {
        let is_warm = self.guess.extrapolate(&mut self.positions.lam, step.h);
        if !is_warm {
            self.positions.lam.fill(0.0);
        }
        match self.iterate(step) {
            Err(_) if is_warm => {
                self.stats.cold_starts += 1;
                self.positions.lam.fill(0.0);
                self.iterate(step)
            }
            outcome => outcome,
        }
    }

    fn iterate(&mut self, step: Step) -> Result<(), StepError> {
        let mut solve = self.positions.start(
            &mut self.model,
            &mut self.mass,
            &mut self.reactions,
            &self.force,
            step,
        );
        self.stats.iterations += newton::solve(&mut solve, MOST_ITERATIONS)?;
        self.stats.factorizations += solve.factorizations;
        Ok(())
    }

    /// y1 and p_h from the λ found, their low parts in `y_low` and `low`.
    fn move_coordinates(&mut self, step: Step) {
        let State { y, p, .. } = step.state;
        self.positions.impulse(0.5 * step.h, &mut self.low);
        self.mass.velocity(p, &self.low, &mut self.v);
        let moves = self.y_low.iter_mut().zip(&step.state.y_low);
        for ((out, low), v) in moves.zip(&self.v) {
            *out = low + step.h * v;
        }
        carry(y, &mut self.y_low, self.positions.y_mut());
    }

    /// p1 with f and G at the end; μ is the multiplier that stops velocities leaving the constraints.
    fn solve_velocities(&mut self, step: Step) -> Result<(), StepError> {
        let (t, y) = (step.t + step.h, self.positions.y());
        self.start = None;
        copy(&mut self.force, self.model.force(t, y)?);
        self.stats.evaluations += 1;
        add_scaled(&mut self.low, 0.5 * step.h, &self.force);
        if self.model.problem.mechanical.m > 0 {
            self.reactions.start_at(&mut self.model, t, y)?;
            self.stats.factorizations += self.reactions.factor()?;
            self.mass.velocity(&step.state.p, &self.low, &mut self.v);
            self.reactions.stop(&self.model, &self.v, &mut self.low);
        }
        carry(&step.state.p, &mut self.low, &mut self.p);
        Ok(())
    }
}

impl Stepper for Rattle {
    type State = State;

    fn step(&mut self, t: f64, h: f64, state: &mut State) -> Result<(), StepError> {
        let step = Step { t, h, state };
        self.begin(step)?;
        self.solve_positions(step)?;
        self.move_coordinates(step);
        self.solve_velocities(step)?;
        self.guess.keep(h, &self.positions.lam);
        self.mass.state(&self.p, &self.low, &mut state.z);
        std::mem::swap(&mut state.y, self.positions.y_mut());
        std::mem::swap(&mut state.y_low, &mut self.y_low);
        std::mem::swap(&mut state.p, &mut self.p);
        std::mem::swap(&mut state.p_low, &mut self.low);
        copy(&mut self.start_y, &state.y);
        self.start = Some(t + h);
        Ok(())
    }

    fn forget(&mut self) {
        self.guess.forget();
    }

    fn stats(&self) -> Stats {
        self.stats
    }
}

impl Symmetric for Rattle {}

/// The multipliers before, and where f and G are those of the next start.
impl Checkpoint for Rattle {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.guess.save(member, out);
        self.start.save(member, out);
        self.start_y.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.guess.restore(member, saved)?;
        self.start.restore(member, saved)?;
        self.start_y.restore(member, saved)?;
        if let Some(t) = self.start {
            let force = self
                .model
                .force(t, &self.start_y)
                .map_err(|_| CheckpointMismatch)?;
            copy(&mut self.force, force);
            let (reactions, model) = (&mut self.reactions, &mut self.model);
            let started = reactions.start_at(model, t, &self.start_y);
            // where G is constant this is done once
            let factored = started.and_then(|()| reactions.factor());
            if model.problem.mechanical.m > 0 {
                factored.map_err(|_| CheckpointMismatch)?;
            }
        }
        Ok(())
    }
}
