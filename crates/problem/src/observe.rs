//! Records of a mechanical or semi-explicit system at an output point.

use super::{
    Acceleration, Dynamics, Mechanical, Model, State, TangentView, Turning, model::finite,
    model::finite_state, turns::Turns,
};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::{Quantity, StepError};
use liouville_base::observe::Observe;
use liouville_base::real::Real;
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// The state that a method carries from step to step.
pub trait Carried {
    /// Coordinates.
    fn y(&self) -> &[f64];

    /// Velocities or momenta, as the system has them.
    fn z(&self) -> &[f64];

    /// The method's accelerations and the work done so far, where it carries them.
    fn accelerations(&self) -> Option<(&[f64], f64)> {
        None
    }

    /// The tangents of y, z and of time, where they are carried.
    fn tangents(&self) -> Option<TangentView<'_>> {
        None
    }
}

impl Carried for State {
    fn y(&self) -> &[f64] {
        &self.y
    }

    fn z(&self) -> &[f64] {
        &self.z
    }
}

/// Records y, z, λ and ν, and z' and a of methods that carry a (where states are wanted), the work of such methods, the
/// quantities that a tape computes from (t, y, z) or (t, y, z, λ), and the angles that the observer continues.
#[derive(Clone, Debug)]
pub struct Observer<M: Dynamics = Model> {
    model: M,
    has_states: bool,
    /// Solves for multipliers, where states are recorded or the tape wants them.
    solver: Option<M::Solver>,
    /// Solves for multipliers that are not recorded, made at its first use.
    beside: Option<M::Solver>,
    tape: Arc<Tape>,
    registers: Registers<f64>,
    turns: Option<Turns>,
}

impl<M: Dynamics> Observer<M> {
    /// An observer of `model`, with or without its states.
    ///
    /// # Panics
    /// When the tape's inputs are neither (t, y, z, params) nor (t, y, z, λ, params).
    pub fn new(model: M, params: &[f64], tape: Arc<Tape>, states: bool) -> Self {
        let [n, l, m] = model.sizes();
        let has_lam = takes_multipliers(&tape);
        let wanted = [1, n, l, m, params.len()];
        let wanted = if has_lam {
            &wanted[..]
        } else {
            &[1, n, l, params.len()]
        };
        assert_eq!(tape.inputs(), wanted, "inputs of an observer");
        let solver = (states || has_lam).then(|| model.solver());
        let registers = tape.bind(params);
        Self {
            model,
            has_states: states,
            solver,
            beside: None,
            tape,
            registers,
            turns: None,
        }
    }

    /// The same with angles that are continued from step to step.
    #[must_use]
    pub fn turning(mut self, turning: Option<&Turning>, params: &[f64]) -> Self {
        self.turns = turning.map(|own| Turns::new(own.clone(), params, 1));
        self
    }

    /// Whether it continues angles.
    pub fn is_turning(&self) -> bool {
        self.turns.is_some()
    }

    /// The observed model.
    pub fn model(&self) -> &M {
        &self.model
    }

    /// The tape of the quantities.
    pub fn tape(&self) -> &Arc<Tape> {
        &self.tape
    }

    /// The solver of the multipliers, where states are recorded.
    pub fn solved(&self) -> Option<&M::Solver> {
        self.solver.as_ref().filter(|_| self.has_states)
    }

    fn append<S: Carried>(
        &mut self,
        t: f64,
        state: &S,
        row: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        finite_state(state.y(), t)?;
        finite_state(state.z(), t)?;
        let (y, z) = (state.y(), state.z());
        if let Some(solver) = &mut self.solver {
            self.model.solve_lam(solver, t, y, z)?;
        }
        if let Some(solved) = self.solved() {
            row.extend([y, z, M::lam(solved)].into_iter().flatten());
        }
        if let Some((a, work)) = state.accelerations() {
            if let Some(solved) = self.solved() {
                row.extend_from_slice(M::z_dot(solved));
                row.extend_from_slice(a);
            }
            row.push(work);
        }
        let values = match &self.solver {
            Some(solved) if takes_multipliers(&self.tape) => {
                let args = [&[t], y, z, M::lam(solved)];
                self.tape.eval(&mut self.registers, args)
            }
            _ => self.tape.eval(&mut self.registers, [&[t], y, z]),
        };
        finite(values, Quantity::Observable, t)?;
        row.extend_from_slice(values);
        if let Some(turns) = &mut self.turns {
            turns.follow(t, state.y(), state.z());
            row.extend_from_slice(turns.angles(0));
        }
        Ok(())
    }
}

impl Observer {
    /// Forgets what it has observed.
    pub fn reset(&mut self) {
        if let Some(solver) = &mut self.solver {
            solver.reset();
        }
        self.beside = None;
        if let Some(turns) = &mut self.turns {
            turns.reset();
        }
    }
}

impl<S: Carried, M: Dynamics> Observe<S> for Observer<M> {
    fn width(&self, state: &S) -> usize {
        let [n, l, m] = self.model.sizes();
        let accelerations = state.accelerations().map_or(0, |(a, _)| a.len());
        let states = usize::from(self.has_states) * (n + l + m + 2 * accelerations);
        let angles = self.turns.as_ref().map_or(0, Turns::count);
        states + usize::from(state.accelerations().is_some()) + self.tape.outputs() + angles
    }

    fn observe(&mut self, t: f64, state: &S, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        self.append(t, state, row)
            .inspect_err(|_| row.truncate(start))
    }

    fn locate(&mut self, t: f64, state: &S, place: &mut Vec<f64>) -> Result<bool, StepError> {
        let (y, z) = (state.y(), state.z());
        let solver = (self.beside).get_or_insert_with(|| self.model.solver());
        self.model.solve_lam(solver, t, y, z)?;
        place.extend([y, z, M::lam(solver)].into_iter().flatten());
        let rates = &mut [y, y].map(<[f64]>::to_vec);
        let [y_dot, y_ddot] = rates;
        self.model.solve(solver, t, y, z)?;
        (self.model).derivatives(solver, t, (y, z), [y_dot, y_ddot])?;
        place.extend([y_dot, M::z_dot(solver)].into_iter().flatten());
        Ok(true)
    }

    fn is_following(&self) -> bool {
        self.is_turning()
    }

    fn follow(&mut self, t: f64, state: &S) {
        if let Some(turns) = &mut self.turns {
            turns.follow(t, state.y(), state.z());
        }
    }
}

impl<M: Dynamics> Checkpoint for Observer<M> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        if let Some(solver) = &self.solver {
            solver.save(member, out);
        }
        if let Some(turns) = &self.turns {
            turns.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        if let Some(solver) = &mut self.solver {
            solver.restore(member, saved)?;
        }
        match &mut self.turns {
            Some(turns) => turns.restore(member, saved),
            None => Ok(()),
        }
    }
}

/// Whether a tape of quantities has λ among its inputs.
fn takes_multipliers(tape: &Tape) -> bool {
    tape.inputs().len() == 5
}

/// Records what [`Observer`] does of several members in lock-step, a row of each one after another.
#[derive(Clone, Debug)]
pub struct Observers<R> {
    problem: Arc<Mechanical>,
    params: Vec<R>,
    tape: Arc<Tape>,
    has_states: bool,
    members: usize,
    /// All members at once, unless redundant constraints share their multipliers.
    together: Option<Together<R>>,
    /// Angles that are continued.
    turns: Option<Turns<R>>,
    /// Observers of one member, made where that fails, and its state.
    alone: Vec<Option<Observer>>,
    single: State,
}

/// The model of all members, the solver of its multipliers where they are recorded or the quantities are of them, and
/// the registers of their tape.
#[derive(Clone, Debug)]
struct Together<R> {
    model: Model<R>,
    solver: Option<Acceleration<R>>,
    registers: Registers<R>,
}

impl<R: Real> Observers<R> {
    /// Observers of the first `members` in lock-step, with or without their states.
    ///
    /// # Panics
    /// When the tape's inputs are neither (t, y, z, params) nor (t, y, z, λ, params).
    pub fn new(
        problem: &Arc<Mechanical>,
        (params, members): (&[R], usize),
        (tape, has_states): (Arc<Tape>, bool),
    ) -> Self {
        let together = problem.redundant.is_none().then(|| {
            let model = Model::new(problem.clone(), params);
            Together {
                solver: (has_states || takes_multipliers(&tape)).then(|| Acceleration::new(&model)),
                registers: tape.bind(params),
                model,
            }
        });
        Self {
            problem: problem.clone(),
            params: params.to_vec(),
            tape,
            has_states,
            members,
            together,
            turns: None,
            alone: vec![None; members],
            single: State::zeros(problem.n),
        }
    }

    /// The same with angles that are continued from step to step.
    #[must_use]
    pub fn turning(mut self, turning: Option<&Turning>) -> Self {
        self.turns = turning.map(|own| Turns::new(own.clone(), &self.params, self.members));
        self
    }

    fn width_of_member(&self, n: usize) -> usize {
        let states = 2 * n + self.problem.recorded_multipliers();
        let angles = self.turns.as_ref().map_or(0, Turns::count);
        usize::from(self.has_states) * states + self.tape.outputs() + angles
    }
}

impl<R: Real> Together<R> {
    /// Appends the rows of the first `members`; an error does not say which of them it is.
    fn append(
        &mut self,
        (tape, has_states): (&Tape, bool),
        (t, state): (f64, &State<R>),
        (members, turns): (usize, Option<&Turns<R>>),
        row: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        finite_state(&state.y, t)?;
        finite_state(&state.z, t)?;
        let (y, z) = (&state.y[..], &state.z[..]);
        if let Some(solver) = &mut self.solver {
            solver.solve(&mut self.model, t, y, z)?;
        }
        let values = match &self.solver {
            Some(solved) if takes_multipliers(tape) => {
                tape.eval(&mut self.registers, [&[R::splat(t)], y, z, &solved.lam])
            }
            _ => tape.eval(&mut self.registers, [&[R::splat(t)], y, z]),
        };
        finite(values, Quantity::Observable, t)?;
        let solved = self.solver.as_ref().filter(|_| has_states);
        let parts = solved.map(|solved| [y, z, &solved.lam]);
        for member in 0..members {
            let own = parts.iter().flatten().copied().chain([values]).flatten();
            row.extend(own.map(|x| x.member(member)));
            row.extend(turns.iter().flat_map(|turns| turns.angles(member)));
        }
        Ok(())
    }
}

impl<R: Real> Observe<State<R>> for Observers<R> {
    fn width(&self, state: &State<R>) -> usize {
        self.members * self.width_of_member(state.y.len())
    }

    fn observe(&mut self, t: f64, state: &State<R>, row: &mut Vec<f64>) -> Result<(), StepError> {
        self.follow(t, state);
        let start = row.len();
        let turns = self.turns.as_ref();
        if let Some(together) = &mut self.together
            && (together.append(
                (&self.tape, self.has_states),
                (t, state),
                (self.members, turns),
                row,
            ))
            .is_ok()
        {
            return Ok(());
        }
        for member in 0..self.members {
            self.single.copy_member(0, state, member);
            let alone = self.alone[member].get_or_insert_with(|| {
                let params: Vec<f64> = self.params.iter().map(|x| x.member(member)).collect();
                let model = Model::new(self.problem.clone(), &params);
                Observer::new(model, &params, self.tape.clone(), self.has_states)
            });
            if let Err(error) = alone.observe(t, &self.single, row) {
                row.truncate(start);
                return Err(error.of_member(member));
            }
            row.extend(turns.iter().flat_map(|turns| turns.angles(member)));
        }
        Ok(())
    }

    fn is_following(&self) -> bool {
        self.turns.is_some()
    }

    fn follow(&mut self, t: f64, state: &State<R>) {
        if let Some(turns) = &mut self.turns {
            turns.follow(t, &state.y, &state.z);
        }
    }
}

// Members in lock-step have reactions linear in λ: no solve starts from the last.
impl<R: Real> Checkpoint for Observers<R> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        if let Some(turns) = &self.turns {
            turns.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        match &mut self.turns {
            Some(turns) => turns.restore(member, saved),
            None => Ok(()),
        }
    }
}
