//! RATTLE for separable systems with holonomic constraints, order 2.
//!
//! One step from (t0, y0, p0) to t1 = t0 + h, with G_i = g_y(t_i, y_i):
//!
//!     p_h = p0 + h/2 (f(t0, y0) − G0ᵀ λ),   y1 = y0 + h v_h,   v_h = W (p_h − p_0) + v_0,   0 = g(t1, y1)
//!     p1 = p_h + h/2 (f(t1, y1) − G1ᵀ μ),   0 = g_t(t1, y1) + G1 v1
//!
//! It is the Lobatto IIIA–IIIB pair of two stages where constant p_z and v_z leave nothing implicit but
//! the multipliers; f and G at the end of a step serve the next. λ comes from the simplified Newton
//! iteration with the matrix G(t1, ỹ1) W G0ᵀ at the first guess ỹ1, which converges at a rate
//! proportional to the error of that guess; μ by one solve with G1 W G1ᵀ. y and p are summed with their rounding errors carried
//! along. Source: andersen1983; hairer2006, VII.1.4.

mod guess;
mod mass;
mod positions;
mod reactions;

use crate::{Solver, Spark};
use guess::Guess;
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, sum_compensated};
use liouville_base::method::{Stats, Stepper, Symmetric};
use liouville_base::newton::{self, Attempts, Start};
use liouville_base::tableau::{self, Force};
use liouville_problem::{SeparableModel, State};
use mass::ConstantMass;
use positions::{Positions, RattleStep};
use reactions::RattleReactions;

/// Corrections of the multipliers a step may take.
const MOST_ITERATIONS: usize = 100;

/// RATTLE at work.
#[derive(Clone, Debug)]
pub struct Rattle {
    model: SeparableModel,
    mass: ConstantMass,
    reactions: RattleReactions,
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
    /// The same method by its stage equations, for steps where the iteration for λ fails; made at its first use.
    stages: Option<Box<Spark>>,
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
            reactions: RattleReactions::new(&model, &mass),
            positions: Positions::new(n, m),
            guess: Guess::new(m),
            force: zeros.clone(),
            start: None,
            start_y: zeros.clone(),
            low: zeros.clone(),
            y_low: zeros.clone(),
            p: zeros.clone(),
            v: zeros,
            stages: None,
            stats: Stats::default(),
            mass,
            model,
        })
    }

    /// f and G at the start, unless the step before has left them.
    fn begin(&mut self, step: RattleStep) -> Result<(), StepError> {
        let State { y, .. } = step.state;
        // a time summed up differs by an ulp or two from one that is a product
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

    /// The iteration; says whether the solution is near its start.
    fn iterate(&mut self, step: RattleStep) -> Result<bool, StepError> {
        let mut solve = self.positions.start(
            &mut self.model,
            &mut self.mass,
            &mut self.reactions,
            &self.force,
            step,
        );
        let solved = newton::solve(&mut solve, MOST_ITERATIONS)?;
        self.stats.factorizations += solve.factorizations;
        self.stats.iterations += solved.iterations;
        Ok(solved.is_near)
    }

    /// y1 and p_h from the λ found, their low parts in `y_low` and `low`.
    fn move_coordinates(&mut self, step: RattleStep) {
        let State { y, p, .. } = step.state;
        self.positions.impulse(0.5 * step.h, &mut self.low);
        self.mass.velocity(p, &self.low, &mut self.v);
        let moves = self.y_low.iter_mut().zip(&step.state.y_low);
        for ((out, low), v) in moves.zip(&self.v) {
            *out = low + step.h * v;
        }
        sum_compensated(y, &mut self.y_low, self.positions.y_mut());
    }

    /// p1 with f and G at the end; μ is the multiplier that stops velocities leaving the constraints.
    fn solve_velocities(&mut self, step: RattleStep) -> Result<(), StepError> {
        let (t, y) = (step.t + step.h, self.positions.y());
        self.start = None;
        copy(&mut self.force, self.model.force(t, y)?);
        self.stats.evaluations += 1;
        add_scaled(&mut self.low, 0.5 * step.h, &self.force);
        if self.model.problem.mechanical.m > 0 {
            self.reactions.start_at(&mut self.model, t, y)?;
            self.stats.factorizations += self.reactions.factor()?;
            self.mass.velocity(&step.state.p, &self.low, &mut self.v);
            self.reactions.project(&self.model, &self.v, &mut self.low);
        }
        sum_compensated(&step.state.p, &mut self.low, &mut self.p);
        Ok(())
    }

    /// y1, λ and p1, by multipliers alone; says whether they are near the start, and taken.
    fn advance(&mut self, step: RattleStep) -> Result<bool, StepError> {
        self.begin(step)?;
        if newton::attempt_modified(&mut RattleAttempt { rattle: self, step }, step.h)? {
            self.move_coordinates(step);
            self.solve_velocities(step)?;
            return Ok(true);
        }
        Ok(false)
    }

    /// The same step by the stage equations of the pair, which take near-singular positions.
    fn step_by_stages(&mut self, t: f64, h: f64, state: &mut State) -> Result<(), StepError> {
        (self.start, self.guess) = (None, Guess::new(self.positions.lam.len()));
        let model = &self.model.general;
        let stages = self.stages.get_or_insert_with(|| {
            let pair = tableau::Spark::lobatto(2, Force::B);
            Box::new(Spark::of(model.clone(), pair, Solver::Auto))
        });
        // a resumed run knows nothing of earlier ones either
        stages.predictor.reset();
        stages.forget();
        stages.step(t, h, state)
    }
}

/// A step whose multipliers are attempted.
struct RattleAttempt<'a> {
    rattle: &'a mut Rattle,
    step: RattleStep<'a>,
}

impl Attempts for RattleAttempt<'_> {
    fn start(&mut self, h: f64, start: Start) -> Result<bool, StepError> {
        let lam = &mut self.rattle.positions.lam;
        match start {
            Start::Extrapolated => return Ok(self.rattle.guess.extrapolate(lam, h)),
            _ => lam.fill(0.0),
        }
        Ok(true)
    }

    fn iterate(&mut self, h: f64) -> Result<bool, StepError> {
        self.rattle.iterate(RattleStep { h, ..self.step })
    }

    fn count_cold_start(&mut self) {
        self.rattle.stats.cold_starts += 1;
    }
}

impl Stepper for Rattle {
    type State = State;

    fn step(&mut self, t: f64, h: f64, state: &mut State) -> Result<(), StepError> {
        let advanced = self.advance(RattleStep { t, h, state });
        if advanced != Ok(true) {
            let by_stages = self.step_by_stages(t, h, state);
            return by_stages.map_err(|later| match (later, advanced) {
                (later @ StepError::StepTooLarge { .. }, _) | (later, Ok(_)) => later,
                (_, Err(error)) => error,
            });
        }
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
        let by_stages = self.stages.as_ref().map(|stages| stages.stats());
        self.stats + by_stages.unwrap_or_default()
    }
}

impl Symmetric for Rattle {}

// The multipliers before, and where f and G are those of the next start.
liouville_base::checkpoint!(Rattle { guess, start, start_y } then Self::evaluate_start);

impl Rattle {
    /// The force and reactions at the start of the next step, which are functions of the point saved.
    fn evaluate_start(&mut self) -> Result<(), CheckpointMismatch> {
        let Some(t) = self.start else {
            return Ok(());
        };
        let force = self
            .model
            .force(t, &self.start_y)
            .map_err(|_| CheckpointMismatch)?;
        copy(&mut self.force, force);
        let (reactions, model) = (&mut self.reactions, &mut self.model);
        let started = reactions.start_at(model, t, &self.start_y);
        // a constant G is factored once
        let factored = started.and_then(|()| reactions.factor());
        if model.problem.mechanical.m > 0 {
            factored.map_err(|_| CheckpointMismatch)?;
        }
        Ok(())
    }
}
