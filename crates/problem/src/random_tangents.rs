//! Tangents in a few random directions, whose errors the steps of a differentiated run follow: that of an impulse, and
//! of changes of all parameters. The steps are the same whatever a run is differentiated by, tangents or a pullback.

use super::{
    Acceleration, BeginTangents, Carried, Directions, Model, Saddle, SensitivityModel,
    TangentSizes, TangentState,
};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, copy, max_norm};
use liouville_base::method::{Estimating, LEAST_ROUNDINGS, Stats, Stepper, Symmetric, Tolerance};
use liouville_base::recorder::Recordable;

/// The golden section.
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// Quasi-random numbers of 1/2 to 1 and either sign, the same in every run. They are made of multiples of the golden
/// section, of which two that are j apart differ by 1/(5 j) at least: where a force goes from one parameter to the next,
/// a direction by both shows that.
pub fn random_numbers() -> impl FnMut() -> f64 {
    let mut count = 0.0;
    move || {
        count += GOLDEN;
        let s = 2.0 * f64::fract(count) - 1.0;
        (0.5 + (s.abs() + s * s) / 4.0).copysign(s)
    }
}

/// Directions by a motion's start alone, by the parameters that are not zero, each in units of itself, and by those that
/// are: no row is left out but those without parameters.
fn random_directions(params: &[f64]) -> Directions {
    let mut random = random_numbers();
    let units: Vec<f64> = params.iter().map(|_| random()).collect();
    let row = |of: fn(f64) -> f64| {
        let each = params.iter().zip(&units).map(|(x, unit)| unit * of(*x));
        std::iter::once(0.0).chain(each).collect::<Vec<_>>()
    };
    let by_params = [row(|x| x), row(|x| f64::from(u8::from(x == 0.0)))];
    let by_params = by_params
        .into_iter()
        .filter(|row| row.iter().any(|x| *x != 0.0));
    let rows: Vec<_> = [row(|_| 0.0)].into_iter().chain(by_params).collect();
    Directions {
        tau: Matrix::from_fn(rows.len(), params.len() + 1, |i, j| rows[i][j]),
        stretch: vec![0.0; rows.len()],
    }
}

/// The largest of several errors.
#[derive(Clone, Copy, Debug)]
pub struct LargestError {
    /// The error, in units of the tolerance.
    pub error: f64,
    /// The power of h with which it falls.
    pub order: f64,
}

impl LargestError {
    /// The largest of a method's own error and of these.
    pub fn of(method: &impl Estimating, others: impl Iterator<Item = Self>) -> Self {
        let (error, order) = (method.error(), method.error_order());
        let mut largest = Self { error, order };
        for other in others {
            largest.raise(other.error, other.order);
        }
        largest
    }

    /// An error whose order is not known.
    fn new(error: f64) -> Self {
        Self { error, order: 1.0 }
    }

    /// Takes another error where it is larger.
    pub fn raise(&mut self, error: f64, order: f64) {
        if error > self.error {
            *self = Self { error, order };
        }
    }
}

/// Random tangents, carried beside a motion, and their errors.
#[derive(Clone, Debug)]
pub struct RandomTangents<B, S> {
    /// Their directions.
    pub directions: Directions,
    /// A motion with them before its last step, and after it.
    pub before: TangentState<S>,
    #[allow(missing_docs)]
    pub after: TangentState<S>,
    /// The tolerances that their errors are measured by.
    pub sizes: TangentSizes,
    /// The largest error of the last step.
    pub largest: LargestError,
    /// Writes them where a motion begins, which the next step may do.
    starts: B,
    begins: bool,
}

impl<B: BeginTangents<S>, S: Clone> RandomTangents<B, S> {
    /// Tangents of a motion with these parameters; `sizes` are the lengths of y, z and of what a state carries.
    pub fn new(
        starts: B,
        (motion, params): (&S, &[f64]),
        sizes: [usize; 3],
        tolerance: &Tolerance,
    ) -> Self {
        let directions = random_directions(params);
        let [y, z, carried] = sizes.map(|size| Matrix::zeros(directions.count(), size));
        let state = TangentState {
            motion: motion.clone(),
            t: vec![0.0; directions.count()],
            y,
            z,
            carried,
        };
        Self {
            directions,
            before: state.clone(),
            after: state,
            sizes: TangentSizes::new(tolerance),
            largest: LargestError::new(f64::INFINITY),
            starts,
            begins: true,
        }
    }

    /// Begins a step from a motion at `t`: the one before stands.
    ///
    /// # Errors
    /// A derivative where the motion begins that is not finite, or a singular matrix.
    pub fn begin(&mut self, t: f64, motion: &S) -> Result<(), StepError> {
        self.sizes.begin();
        self.largest = LargestError::new(0.0);
        self.after.motion.clone_from(motion);
        if self.begins {
            self.starts
                .begin(t, &mut self.directions, &mut self.after)?;
            self.begins = false;
        }
        self.before.clone_from(&self.after);
        Ok(())
    }

    /// Leaves out the last step, which was rejected or failed.
    pub fn undo(&mut self) {
        self.after.clone_from(&self.before);
        self.sizes.undo();
    }

    /// Lets the next step begin a motion.
    pub fn forget(&mut self) {
        self.begins = true;
    }
}

liouville_base::checkpoint!([B: Send + Sync, S: Checkpoint] RandomTangents<B, S> { after, sizes, begins });

/// Begins random tangents of a mechanical motion, on its constraints: the first by an impulse, the others by what
/// parameters move at once.
#[derive(Clone, Debug)]
pub struct MechanicalStart<B> {
    sensitivity: SensitivityModel,
    model: Model,
    solver: Acceleration,
    matrix: Saddle,
    /// The tangents of what the method carries.
    carried: B,
}

impl<B> MechanicalStart<B> {
    /// The start of tangents of a system with these derivatives.
    pub fn new(model: Model, sensitivity: SensitivityModel, carried: B) -> Self {
        Self {
            solver: Acceleration::new(&model),
            matrix: Saddle::new(&model),
            sensitivity,
            model,
            carried,
        }
    }
}

impl<S: Carried, B: BeginTangents<S>> BeginTangents<S> for MechanicalStart<B> {
    fn begin(
        &mut self,
        t: f64,
        directions: &mut Directions,
        state: &mut TangentState<S>,
    ) -> Result<(), StepError> {
        let (model, sensitivity) = (&mut self.model, &mut self.sensitivity);
        let problem = sensitivity.problem.clone();
        let (at, by_tau) = (&problem.mechanical.patterns, &problem.patterns);
        let (y, z) = (state.motion.y(), state.motion.z());
        let (m, mut random) = (model.problem.m, random_numbers());
        state.t.fill(0.0);
        self.solver.solve(model, t, y, z)?;
        self.matrix.update(model, t, y, z, &self.solver.lam)?;
        let (lam, nu) = self.solver.lam.split_at(m);
        let (mut a, mut b) = (vec![0.0; y.len()], vec![0.0; self.solver.lam.len()]);
        for direction in 0..directions.count() {
            let (tau, dy) = (directions.tau(direction, 0.0), state.y.row_mut(direction));
            a.fill(0.0);
            b.fill(0.0);
            if m > 0 {
                let [g_tau, _] = sensitivity.node(t, y, lam);
                by_tau.g_tau.multiply_add(g_tau, -1.0, tau, &mut b[..m]);
            }
            self.matrix.solve(model, &mut a, &mut b);
            dy.fill(0.0);
            self.matrix.mass.add_velocity(&a, dy);
            a.fill(0.0);
            b.fill(0.0);
            if direction == 0 {
                let velocity: Vec<f64> = y.iter().map(|_| random()).collect();
                let [p_z, _] = model.stage_blocks(t, y, z);
                at.p_z.multiply_add(p_z, 1.0, &velocity, &mut a);
            }
            if m > 0 {
                let [w_y, w_tau] = sensitivity.hidden(t, y, z);
                by_tau.w_y.multiply_add(w_y, -1.0, dy, &mut b[..m]);
                by_tau.w_tau.multiply_add(w_tau, -1.0, tau, &mut b[..m]);
            }
            let patterns = problem.mechanical.nonholonomic.as_ref();
            if let (Some(own), Some([of_k, _])) = (patterns, &by_tau.nonholonomic) {
                let [k_y, ..] = model.nonholonomic_blocks(t, y, z, nu);
                own.patterns.k_y.multiply_add(k_y, -1.0, dy, &mut b[m..]);
                if let Some([k_tau, _]) = sensitivity.nonholonomic(t, [y, z, nu]) {
                    of_k.multiply_add(k_tau, -1.0, tau, &mut b[m..]);
                }
            }
            self.matrix.solve(model, &mut a, &mut b);
            // where constraints leave nothing of the impulse, its roundings are no tangent
            if direction == 0 && max_norm(&a) <= LEAST_ROUNDINGS * f64::EPSILON {
                a.fill(0.0);
            }
            copy(state.z.row_mut(direction), &a);
        }
        self.carried.begin(t, directions, state)
    }
}

/// A method that carries tangents, none of which is asked for, as one whose state is the motion alone.
#[derive(Clone, Debug)]
pub struct TangentLed<T, S> {
    method: T,
    state: TangentState<S>,
}

impl<T, S> TangentLed<T, S> {
    /// A method with a state without tangents.
    pub fn new((method, state): (T, TangentState<S>)) -> Self {
        Self { method, state }
    }
}

impl<T: Stepper<State = TangentState<S>>, S: Checkpoint + Clone> Stepper for TangentLed<T, S> {
    type State = S;

    fn step(&mut self, t: f64, h: f64, state: &mut S) -> Result<(), StepError> {
        self.state.motion.clone_from(state);
        let made = self.method.step(t, h, &mut self.state);
        state.clone_from(&self.state.motion);
        made
    }

    fn forget(&mut self) {
        self.method.forget();
    }

    fn stats(&self) -> Stats {
        self.method.stats()
    }
}

impl<T: Symmetric<State = TangentState<S>>, S: Checkpoint + Clone> Symmetric for TangentLed<T, S> {}

impl<T: Estimating<State = TangentState<S>>, S: Checkpoint + Clone> Estimating
    for TangentLed<T, S>
{
    fn error(&self) -> f64 {
        self.method.error()
    }

    fn error_order(&self) -> f64 {
        self.method.error_order()
    }

    fn undo(&mut self, state: &mut S) {
        self.method.undo(&mut self.state);
        state.clone_from(&self.state.motion);
    }

    fn most_corrections(&self) -> f64 {
        self.method.most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        self.method.insist(insists);
    }
}

impl<T: Recordable<State = TangentState<S>>, S: Checkpoint + Clone> Recordable
    for TangentLed<T, S>
{
    fn write_unknowns(&self, _: &S, out: &mut Vec<f64>) {
        self.method.write_unknowns(&self.state, out);
    }
}

liouville_base::checkpoint!([T: Checkpoint, S: Checkpoint] TangentLed<T, S> { method });
