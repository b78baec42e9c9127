//! Errors of the steps, in units of a tolerance.

use super::Spark;
use super::kinks::{self, Kinks};
use super::velocity_error::VelocityError;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::method::{Estimating, Tolerance};
use liouville_problem::{Estimate, Mass, Model, State, StepVelocities};

/// Solutions of stage equations are off by some of so many roundings.
const ROUNDINGS: f64 = 1024.0;
/// Roundings are looked for where a step is this part of the longest since they last were.
const SHORT: f64 = 0.125;

impl Spark {
    /// The same, with errors estimated in units of a tolerance.
    #[must_use]
    pub fn estimating(mut self, tolerance: Tolerance) -> Self {
        let estimate = Estimate::new(&self.tableau, tolerance);
        self.estimate = Some(Box::new(estimate));
        self.noise = Noise::new(self.model.problem.n);
        self.kinks = Kinks::new(&self.model, &self.tableau);
        self.velocity_error = VelocityError::new(self.model.problem.n);
        self
    }

    /// The same, where a step that only continuation might solve is refused, to be made shorter.
    #[must_use]
    pub fn shortened(mut self) -> Self {
        self.is_shortened = true;
        self
    }

    /// Estimates the error of the step from t that led to `state`, if there is an estimate.
    pub(super) fn measure(&mut self, (t, h): (f64, f64), state: &State) {
        let Some(estimate) = &mut self.estimate else {
            return;
        };
        if self.noise.is_heard_at(h) {
            self.noise.hear(&mut self.model, t + h, state);
        }
        let noise = &self.noise.velocities[..];
        let rows = self.predictor.velocities();
        estimate.measure(StepVelocities { rows, noise }, h, state);
        self.kinks.begin();
        self.velocity_error.begin();
        if estimate.error() > 1.0 {
            return;
        }
        let ends = [estimate.before(state), state];
        let solved_by = (&mut self.model, &mut self.predictor);
        let unseen = self.kinks.error(solved_by, (t, h), ends, (estimate, noise));
        let (kinks, tolerance) = (&self.kinks, &estimate.tolerance);
        let rows = self.predictor.velocities();
        let (of_velocity, order) = if kinks.are_known() {
            let both = |end, k| {
                let of_v = estimate.defect(StepVelocities { rows, noise }, end, k);
                [of_v, kinks.defects[end][k]]
            };
            let y = ends.map(|state| &state.y[..]);
            self.velocity_error.measure(rows, h, (y, tolerance), both)
        } else {
            (0.0, 1.0)
        };
        // below the tolerance a kink leaves the steps as they are
        if unseen > 1.0 {
            estimate.raise(unseen, kinks::ORDER);
        }
        estimate.raise(of_velocity, order);
    }

    /// A first step whose acceleration moves the coordinates by about the tolerance; infinite without one.
    ///
    /// # Errors
    /// The acceleration cannot be solved for.
    pub fn first_step(&mut self, t: f64, state: &State) -> Result<f64, StepError> {
        let Some(estimate) = &self.estimate else {
            return Ok(f64::INFINITY);
        };
        let acceleration = self.predictor.acceleration(&mut self.model, t, state)?;
        Ok(estimate.tolerance.first_step(&state.y, [acceleration; 2]))
    }
}

/// Changes of velocities by roundings of momenta: large, where a moment of inertia is tiny.
///
/// It is looked for where steps become so short that it may be the cause.
#[derive(Clone, Debug, Default)]
pub(super) struct Noise {
    velocities: Vec<f64>,
    /// The longest step since it was last looked for.
    longest: f64,
}

impl Noise {
    /// Makes zero noise of `n` coordinates.
    fn new(n: usize) -> Self {
        Self {
            velocities: vec![0.0; n],
            longest: 0.0,
        }
    }

    fn is_heard_at(&mut self, h: f64) -> bool {
        let is_short = h.abs() < SHORT * self.longest;
        self.longest = if is_short {
            h.abs()
        } else {
            self.longest.max(h.abs())
        };
        is_short
    }

    /// Finds by how much velocities change with momenta that are off by roundings, in two patterns of signs.
    fn hear(&mut self, model: &mut Model, t: f64, state: &State) {
        let mut mass = Mass::new(model);
        if mass.update(model, t, &state.y, &state.z).is_err() {
            return;
        }
        self.velocities.fill(0.0);
        for flipped in 0..2 {
            let momenta = state.p.iter().enumerate();
            let off = momenta.map(|(k, p)| if k % 2 == flipped { -p.abs() } else { p.abs() });
            let mut off: Vec<f64> = off.map(|p| ROUNDINGS * f64::EPSILON * p).collect();
            mass.solve_velocity(&mut off);
            for (noise, off) in self.velocities.iter_mut().zip(off) {
                *noise = noise.max(off.abs());
            }
        }
    }
}

// Where errors do not control the steps nothing is saved, as of members in lock-step.
impl Checkpoint for Noise {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        if !self.velocities.is_empty() {
            self.longest.save(member, out);
            self.velocities.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        if self.velocities.is_empty() {
            return Ok(());
        }
        self.longest.restore(member, saved)?;
        self.velocities.restore(member, saved)
    }
}

impl Estimating for Spark {
    fn error(&self) -> f64 {
        self.estimate.as_ref().map_or(f64::INFINITY, |x| x.error())
    }

    fn error_order(&self) -> f64 {
        self.estimate.as_ref().map_or(1.0, |x| x.order())
    }

    fn undo(&mut self, state: &mut State) {
        if let Some(estimate) = &self.estimate {
            estimate.undo(state);
            self.predictor.undo();
            self.kinks.undo();
            self.velocity_error.undo();
        }
    }

    fn most_corrections(&self) -> f64 {
        self.stop.most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        self.insists = insists;
    }
}
