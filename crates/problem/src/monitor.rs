//! How long steps should be: a function of the user's, or the time scale of the acceleration.
//!
//! With the metric ‖x‖² = |(v_z x)·(p_z x)| of z, which is xᵀ M x of velocities and xᵀ M⁻¹ x of
//! momenta, and τ ten thousand times the time in which the coordinates change by their own size,
//!
//!     s = (√(‖z'‖⁴ + ‖z‖² ‖z''‖²) + ‖z‖²/τ²)^(−3/8)
//!
//! is r^(3/2) at the distance r from a centre of gravity, and constant along an oscillation, whose
//! acceleration vanishes twice a period. z'' is the central difference of z' = A(t, y, z) along the
//! tangent (1, v, z'), and so is ds/dt of s: both are odd to the last bit when velocities are reversed.
//! Source: hairer2005.

use super::{Acceleration, Carried, Dynamics, Model, model::finite};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{add_scaled, copy, dot, max_norm};
use liouville_base::observe::Monitor;
use liouville_base::tape::{Registers, Tape};

/// The power of an acceleration squared.
const POWER: f64 = -3.0 / 8.0;
/// Central differences are taken over this part of the time in which the coordinates change by
/// their own size.
pub(super) const PART: f64 = 1.0 / 65536.0;
/// Coordinates count as having at least this part of the size they had at the start.
const LEAST_SIZE: f64 = 0.25;
/// Accelerations that take longer than the inverse of this times that time to change a velocity by
/// its own size are none: they may be roundoff.
const LEAST_RATE: f64 = 1e-4;

/// A monitor by a tape (t, y, z, z') → s, ds/dt.
#[derive(Clone, Debug)]
pub struct Traced<M: Dynamics = Model> {
    tape: Tape,
    registers: Registers<f64>,
    model: M,
    /// The solver for z', where ds/dt depends on it.
    solver: Option<M::Solver>,
    zeros: Vec<f64>,
}

/// The monitor of the acceleration.
#[derive(Clone, Debug)]
pub struct TimeScale {
    model: Model,
    acceleration: Acceleration,
    least_size: f64,
    /// The present state, one before or after it, and one before or after that.
    here: MonitoredPoint,
    side: MonitoredPoint,
    far: MonitoredPoint,
    z_ddot: Vec<f64>,
    metric: Metric,
}

/// The factors of ‖x‖² = (v_z x)ᵀ p_z x.
#[derive(Clone, Debug)]
pub(super) struct Metric {
    velocity: Vec<f64>,
    momentum: Vec<f64>,
}

/// A point on the way, with v and z'.
#[derive(Clone, Debug)]
pub(super) struct MonitoredPoint {
    pub(super) t: f64,
    pub(super) y: Vec<f64>,
    pub(super) z: Vec<f64>,
    pub(super) v: Vec<f64>,
    pub(super) z_dot: Vec<f64>,
}

impl<M: Dynamics> Traced<M> {
    /// The monitor of a tape; `of_z_dot` says whether it wants z', or zeros in its place.
    ///
    /// # Panics
    /// When the tape's inputs are not (t, y, z, z', params).
    pub fn new(model: M, params: &[f64], tape: Tape, of_z_dot: bool) -> Self {
        let [n, l, _] = model.sizes();
        assert_eq!(
            tape.inputs(),
            [1, n, l, l, params.len()],
            "inputs of a monitor"
        );
        Self {
            registers: tape.bind(params),
            tape,
            solver: of_z_dot.then(|| model.solver()),
            model,
            zeros: vec![0.0; l],
        }
    }

    fn rate_at(&mut self, t: f64, y: &[f64], z: &[f64]) -> Result<f64, StepError> {
        let z_dot = match &mut self.solver {
            Some(solver) => {
                self.model.solve(solver, t, y, z)?;
                M::z_dot(solver)
            }
            None => &self.zeros,
        };
        let args: [&[f64]; 4] = [&[t], y, z, z_dot];
        let values = self.tape.eval(&mut self.registers, args);
        let (size, rate) = (values[0], values[1]);
        if size.is_finite() && size > 0.0 && rate.is_finite() {
            return Ok(rate / size);
        }
        Err(StepError::Monitor {
            value: size,
            rate,
            t,
        })
    }
}

impl MonitoredPoint {
    pub(super) fn new(t: f64, y: &[f64], z: &[f64]) -> Self {
        Self {
            t,
            y: y.to_vec(),
            z: z.to_vec(),
            v: z.to_vec(),
            z_dot: vec![0.0; z.len()],
        }
    }

    /// Becomes the point that lies `step` ahead of another along the tangent there.
    pub(super) fn shift_from(&mut self, other: &Self, step: f64) {
        self.t = other.t + step;
        copy(&mut self.y, &other.y);
        add_scaled(&mut self.y, step, &other.v);
        copy(&mut self.z, &other.z);
        add_scaled(&mut self.z, step, &other.z_dot);
    }

    pub(super) fn solve(
        &mut self,
        model: &mut Model,
        acceleration: &mut Acceleration,
    ) -> Result<(), StepError> {
        let [_, _, v] = model.end(self.t, &self.y, &self.z);
        finite(v, Quantity::Velocity, self.t)?;
        copy(&mut self.v, if v.is_empty() { &self.z } else { v });
        acceleration.solve(model, self.t, &self.y, &self.z)?;
        copy(&mut self.z_dot, &acceleration.z_dot);
        Ok(())
    }
}

impl TimeScale {
    /// The monitor of a run that starts at (t, y, z) with a step of about `h`.
    pub fn new(model: Model, (t, y, z): (f64, &[f64], &[f64]), h: f64) -> Self {
        let zeros = vec![0.0; model.problem.n];
        let mut monitor = Self {
            acceleration: Acceleration::new(&model),
            least_size: 0.0,
            here: MonitoredPoint::new(t, y, z),
            side: MonitoredPoint::new(t, y, z),
            far: MonitoredPoint::new(t, y, z),
            z_ddot: zeros.clone(),
            metric: Metric::new(zeros.len()),
            model,
        };
        // an error here is raised with the first rate
        let _ = monitor
            .here
            .solve(&mut monitor.model, &mut monitor.acceleration);
        monitor.least_size = LEAST_SIZE * max_norm(y).max(max_norm(&monitor.here.v) * h);
        monitor
    }

    fn rate_at(&mut self, t: f64, y: &[f64], z: &[f64]) -> Result<f64, StepError> {
        self.here.t = t;
        copy(&mut self.here.y, y);
        copy(&mut self.here.z, z);
        self.here.solve(&mut self.model, &mut self.acceleration)?;
        let step = self.difference_step();
        if step == 0.0 {
            return Ok(0.0);
        }
        let ahead = self.vigour(step, step)?;
        let behind = self.vigour(-step, step)?;
        let rate = POWER * (ahead.ln() - behind.ln()) / (2.0 * step);
        // where nothing moves, or only begins to, one step is as good as another
        Ok(if rate.is_finite() { rate } else { 0.0 })
    }

    /// A small part of |y| / (|v| + √(|v'| |y|)).
    fn difference_step(&mut self) -> f64 {
        let here = &self.here;
        self.metric.squares(&mut self.model, here, [&here.z_dot]);
        let size = max_norm(&here.y).max(self.least_size);
        let change = max_norm(&here.v) + (max_norm(&self.metric.velocity) * size).sqrt();
        if change > 0.0 {
            PART * size / change
        } else {
            0.0
        }
    }

    /// s^(−8/3), `shift` ahead of here.
    fn vigour(&mut self, shift: f64, step: f64) -> Result<f64, StepError> {
        let Self { side, far, .. } = self;
        side.shift_from(&self.here, shift);
        side.solve(&mut self.model, &mut self.acceleration)?;
        far.shift_from(side, -step);
        far.solve(&mut self.model, &mut self.acceleration)?;
        copy(&mut self.z_ddot, &far.z_dot);
        far.shift_from(side, step);
        far.solve(&mut self.model, &mut self.acceleration)?;
        for (out, ahead) in self.z_ddot.iter_mut().zip(&far.z_dot) {
            *out = (ahead - *out) / (2.0 * step);
        }
        let vectors = [&side.z[..], &side.z_dot, &self.z_ddot];
        let [speed, acceleration, jerk] = self.metric.squares(&mut self.model, side, vectors);
        let vigour = (acceleration * acceleration + speed * jerk).sqrt();
        let rate = LEAST_RATE * max_norm(&side.v) / max_norm(&side.y).max(self.least_size);
        Ok(vigour + speed * rate * rate)
    }
}

impl Metric {
    pub(super) fn new(n: usize) -> Self {
        Self {
            velocity: vec![0.0; n],
            momentum: vec![0.0; n],
        }
    }

    /// ‖x‖² of each x in the metric at a point; the last one's parts are left in memory.
    pub(super) fn squares<const K: usize>(
        &mut self,
        model: &mut Model,
        at: &MonitoredPoint,
        vectors: [&[f64]; K],
    ) -> [f64; K] {
        let problem = model.problem.clone();
        let [p_z, v_z] = model.stage_blocks(at.t, &at.y, &at.z);
        vectors.map(|x| {
            self.momentum.fill(0.0);
            problem
                .patterns
                .p_z
                .multiply_add(p_z, 1.0, x, &mut self.momentum);
            match &problem.patterns.v_z {
                Some(pattern) => {
                    self.velocity.fill(0.0);
                    pattern.multiply_add(v_z, 1.0, x, &mut self.velocity);
                }
                None => copy(&mut self.velocity, x),
            }
            dot(&self.velocity, &self.momentum).abs()
        })
    }
}

impl<S: Carried, M: Dynamics> Monitor<S> for Traced<M> {
    fn rate(&mut self, t: f64, state: &S) -> Result<f64, StepError> {
        self.rate_at(t, state.y(), state.z())
    }
}

impl<S: Carried> Monitor<S> for TimeScale {
    fn rate(&mut self, t: f64, state: &S) -> Result<f64, StepError> {
        self.rate_at(t, state.y(), state.z())
    }
}

impl<M: Dynamics> Checkpoint for Traced<M> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        if let Some(solver) = &self.solver {
            solver.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        match &mut self.solver {
            Some(solver) => solver.restore(member, saved),
            None => Ok(()),
        }
    }
}

liouville_base::checkpoint!(TimeScale { acceleration });
