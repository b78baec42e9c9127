//! Tangents of a motion: the derivatives of its states in some directions, carried with them and recorded.

use super::sensitivity::SensitivityModel;
use super::{Carried, Jump, Model, Observer, Refused, Restart, Saddle, State, model::finite};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, Pattern};
use liouville_base::observe::Observe;

/// A state with its tangents, one a row.
#[derive(Debug, PartialEq)]
pub struct TangentState<S = State> {
    /// The state.
    pub motion: S,
    /// Tangents of coordinates.
    pub y: Matrix,
    /// Tangents of velocities or momenta, as the system has them.
    pub z: Matrix,
    /// Tangents of the other parts of the carried state: of p, summed up from their increments, or of accelerations.
    pub carried: Matrix,
    /// Tangents of time.
    pub t: Vec<f64>,
}

liouville_base::clone_in_place!([S: Clone] TangentState<S> { motion, y, z, carried, t });

impl<S: Carried> Carried for TangentState<S> {
    fn y(&self) -> &[f64] {
        self.motion.y()
    }

    fn z(&self) -> &[f64] {
        self.motion.z()
    }

    fn accelerations(&self) -> Option<(&[f64], f64)> {
        self.motion.accelerations()
    }

    fn tangents(&self) -> Option<TangentView<'_>> {
        Some(TangentView {
            y: &self.y,
            z: &self.z,
            t: &self.t,
        })
    }
}

/// Restarts a state that carries tangents; these are the tangents of the event's reset.
pub struct TangentRestart<S>(pub Box<dyn Restart<S>>);

impl<S> Checkpoint for TangentRestart<S> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.0.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.0.restore(member, saved)
    }
}

impl<S> Restart<TangentState<S>> for TangentRestart<S> {
    fn restart(
        &mut self,
        t: f64,
        before: &TangentState<S>,
        jump: Jump<'_>,
        state: &mut TangentState<S>,
    ) -> Result<(), Refused> {
        self.0.restart(t, &before.motion, jump, &mut state.motion)
    }
}

/// Writes the tangents of the carried state where a motion begins, from those of y, z and time.
pub trait BeginTangents<S>: Send + Sync {
    /// Writes them at `t`, in these directions.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn begin(
        &mut self,
        t: f64,
        directions: &mut Directions,
        state: &mut TangentState<S>,
    ) -> Result<(), StepError>;
}

/// The tangents of momenta: dp = p_y dy + p_z dz + p_τ dτ.
#[derive(Clone, Debug)]
pub struct MomentumTangents {
    /// The model.
    pub model: Model,
    /// Its derivatives by time and parameters.
    pub sensitivity: SensitivityModel,
}

impl BeginTangents<State> for MomentumTangents {
    fn begin(
        &mut self,
        t: f64,
        directions: &mut Directions,
        state: &mut TangentState,
    ) -> Result<(), StepError> {
        let Self { model, sensitivity } = self;
        let (State { y, z, .. }, p) = (&state.motion, &mut state.carried);
        let problem = sensitivity.problem.clone();
        let (at, by_tau) = (&problem.mechanical.patterns, &problem.patterns.p_tau);
        let [p_tau, ..] = sensitivity.stage(t, y, z);
        let [p_z, _] = model.stage_blocks(t, y, z);
        for direction in 0..directions.count() {
            let out = p.row_mut(direction);
            out.fill(0.0);
            at.p_z.multiply_add(p_z, 1.0, state.z.row(direction), out);
            let tau = directions.tau(direction, state.t[direction]);
            by_tau.multiply_add(p_tau, 1.0, tau, out);
        }
        let [p_y, ..] = model.stage_jacobian(t, y, z);
        for direction in 0..directions.count() {
            let out = p.row_mut(direction);
            at.p_y.multiply_add(p_y, 1.0, state.y.row(direction), out);
            finite(out, Quantity::Derivative, t)?;
        }
        Ok(())
    }
}

/// Tangents of a point: of coordinates, of z and of its time, a row for each direction.
#[derive(Clone, Copy, Debug)]
pub struct TangentView<'a> {
    /// Tangents of coordinates.
    pub y: &'a Matrix,
    /// Tangents of z.
    pub z: &'a Matrix,
    /// Tangents of time.
    pub t: &'a [f64],
}

liouville_base::checkpoint!([S: Checkpoint] TangentState<S> { motion, y, z, carried, t });

/// Directions in which a run is differentiated.
#[derive(Clone, Debug)]
pub struct Directions {
    /// Changes of τ = (t, θ), a row for each direction; those of t are written where they are wanted.
    pub tau: Matrix,
    /// By which part of itself a step becomes longer.
    pub stretch: Vec<f64>,
}

impl Directions {
    /// How many there are.
    pub fn count(&self) -> usize {
        self.stretch.len()
    }

    /// The changes of τ in a direction, where t changes by so much.
    #[inline]
    pub fn tau(&mut self, direction: usize, t: f64) -> &[f64] {
        let row = self.tau.row_mut(direction);
        row[0] = t;
        row
    }
}

/// The tangents of z' and λ, which solve the equations of accelerations at a point.
#[derive(Clone, Debug)]
pub struct AccelerationTangents {
    /// The model.
    pub model: Model,
    /// Its derivatives by time and parameters.
    pub sensitivity: SensitivityModel,
    matrix: Saddle,
    a: Vec<f64>,
    b: Vec<f64>,
}

impl AccelerationTangents {
    /// Memory for this model.
    pub fn new(model: Model, sensitivity: SensitivityModel) -> Self {
        Self {
            matrix: Saddle::new(&model),
            a: vec![0.0; model.problem.n],
            b: vec![0.0; model.problem.multipliers()],
            model,
            sensitivity,
        }
    }

    /// Solves for the tangents of z' and λ at (t, y, z, z', λ), and gives them to `take` in one direction after another.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn solve(
        &mut self,
        (t, [y, z, z_dot, lam]): (f64, [&[f64]; 4]),
        (of, directions): (TangentView<'_>, &mut Directions),
        mut take: impl FnMut(usize, &[f64], &[f64]),
    ) -> Result<(), StepError> {
        self.matrix.update(&mut self.model, t, y, z, lam)?;
        let problem = self.sensitivity.problem.clone();
        let at = &problem.patterns;
        let values = self.sensitivity.motion(t, [y, z, z_dot, lam]);
        for part in values {
            finite(part, Quantity::Derivative, t)?;
        }
        let (motion, rate) = values.split_at(3);
        for direction in 0..directions.count() {
            let tau = directions.tau(direction, of.t[direction]);
            let along = [of.y.row(direction), of.z.row(direction), tau];
            subtract(&at.motion, motion, along, &mut self.a);
            subtract(&at.rate, rate, along, &mut self.b);
            self.matrix.solve(&self.model, &mut self.a, &mut self.b);
            take(direction, &self.a, &self.b);
        }
        Ok(())
    }
}

/// Records what [`Observer`] does, and behind it the tangents of y, z and λ in one direction after another.
///
/// λ solves the equations of accelerations at the point, whose tangent this is too: the multipliers inside a step are
/// of a lower order, and those at its end have roundoff that a derivative would show.
#[derive(Clone, Debug)]
pub struct TangentObserver {
    inner: Observer,
    acceleration: AccelerationTangents,
    directions: Directions,
}

impl TangentObserver {
    /// An observer of tangents in these directions beside `inner`, which records states.
    pub fn new(inner: Observer, sensitivity: SensitivityModel, directions: Directions) -> Self {
        let model = inner.model().clone();
        Self {
            inner,
            acceleration: AccelerationTangents::new(model, sensitivity),
            directions,
        }
    }

    fn append<S: Carried>(
        &mut self,
        t: f64,
        state: &S,
        row: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        self.inner.observe(t, state, row)?;
        let (Some(solved), Some(of)) = (self.inner.solved(), state.tangents()) else {
            return Ok(());
        };
        let point = [state.y(), state.z(), &solved.z_dot, &solved.lam];
        let directions = &mut self.directions;
        self.acceleration
            .solve((t, point), (of, directions), |direction, _, lam| {
                row.extend_from_slice(of.y.row(direction));
                row.extend_from_slice(of.z.row(direction));
                row.extend_from_slice(lam);
            })
    }
}

/// out = −Σ A x
fn subtract(patterns: &[Pattern; 3], values: &[&[f64]], along: [&[f64]; 3], out: &mut [f64]) {
    out.fill(0.0);
    for ((pattern, values), x) in patterns.iter().zip(values).zip(along) {
        pattern.multiply_add(values, -1.0, x, out);
    }
}

impl<S: Carried> Observe<S> for TangentObserver {
    fn width(&self, state: &S) -> usize {
        let problem = &self.acceleration.model.problem;
        let each = 2 * problem.n + problem.multipliers();
        self.inner.width(state) + self.directions.count() * each
    }

    fn observe(&mut self, t: f64, state: &S, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        self.append(t, state, row)
            .inspect_err(|_| row.truncate(start))
    }

    fn locate(&mut self, t: f64, state: &S, place: &mut Vec<f64>) -> Result<bool, StepError> {
        self.inner.locate(t, state, place)
    }

    fn is_following(&self) -> bool {
        self.inner.is_turning()
    }

    fn follow(&mut self, t: f64, state: &S) {
        self.inner.follow(t, state);
    }
}

impl Checkpoint for TangentObserver {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.inner.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.inner.restore(member, saved)
    }
}
