//! Derivatives of events and their resets, and their use along a run.

use super::reset::Law;
use super::times::Given;
use liouville_base::error::{Obstacle, Quantity, StepError};
use liouville_base::tape::{Registers, Tape};

/// The derivatives of an event e by x = (t, y, z, λ, θ); each input is a tape's, before the parameters.
#[derive(Clone, Debug)]
pub struct EventSlopes {
    /// (t, y, z, λ) → e_x
    pub event: Tape,
    /// The derivative of a reset (y, z)⁺ along a direction, (t, y, z, λ, dx), and its transpose, (t, y, z, λ, c).
    pub reset: Option<[Tape; 2]>,
    /// The same of what moves coordinates that a reset has left beside the constraints, (t, y, z, λ, x, μ, dx) and
    /// (t, y, z, λ, x, μ, c), with x and μ held: of the equations of a correction, and of the change of y that it makes.
    pub moves: Option<[Tape; 2]>,
    /// The same of the equations of an impulse, (t, y, z, λ, z⁺, Λ, dx) and (t, y, z, λ, z⁺, Λ, c), with the impulses
    /// held: of p⁺ − p − r_λ μ − e_yᵀ Λ, of w⁺ and of an impact's e_y (v⁺ − v) + (1 + ε) (e_t + e_y v).
    pub impulse: Option<[Tape; 2]>,
}

impl EventSlopes {
    /// Whether they are those of an event and its law, with so many numbers of y, z, λ and parameters, and `x` in all.
    pub(crate) fn fit(&self, law: Option<&Law>, [n, l, lam, params]: [usize; 4], x: usize) -> bool {
        let point = [1, n, l, lam];
        let takes = |tape: &Tape, more: &[usize], outputs: usize| {
            let wanted = point.iter().chain(more).chain([&params]);
            tape.inputs().iter().eq(wanted) && tape.outputs() == outputs
        };
        let is_impact = matches!(law, Some(Law::Impact(_)));
        let of_reset = self
            .reset
            .as_ref()
            .map(|[push, pull]| takes(push, &[x], n + l) && takes(pull, &[n + l], x));
        let of_moves = self.moves.as_ref().map(|[push, pull]| {
            let (parts, rows) = match push.inputs() {
                [_, _, _, _, a, b, ..] => ([*a, *b], push.outputs()),
                _ => return false,
            };
            let [a, b] = parts;
            takes(push, &[a, b, x], rows) && takes(pull, &[a, b, rows], x) && rows == a + b + n
        });
        let of_impulse = self.impulse.as_ref().map(|[push, pull]| {
            let (own, rows) = match push.inputs() {
                [_, _, _, _, _, own, ..] => (*own, n + own),
                _ => return false,
            };
            takes(push, &[n, own, x], rows) && takes(pull, &[n, own, rows], x)
        });
        takes(&self.event, &[], x)
            && of_reset.is_some() == matches!(law, Some(Law::State(_)))
            && of_reset != Some(false)
            && of_moves != Some(false)
            && of_impulse != Some(false)
            && (!is_impact || of_impulse.is_some())
    }
}

type Ready = (Tape, Registers<f64>);

/// The derivatives ready to be evaluated.
#[derive(Clone, Debug)]
pub struct SlopesModel {
    /// Its number in the user's list.
    pub(super) index: usize,
    event: Ready,
    law: Option<Ready>,
    /// Whether its reset is an impact.
    pub(super) is_impact: bool,
    reset: Option<[Ready; 2]>,
    moves: Option<[Ready; 2]>,
    impulse: Option<[Ready; 2]>,
}

/// Where a motion jumps: t, and y, z and λ before it.
pub type Before<'a> = (f64, [&'a [f64]; 3]);

impl SlopesModel {
    /// Binds parameters to the derivatives of the event number `index`, which does this to the motion.
    pub fn new(index: usize, slopes: &EventSlopes, law: Option<&Law>, params: &[f64]) -> Self {
        let ready = |tape: &Tape| (tape.clone(), tape.bind(params));
        let pair = |pair: &[Tape; 2]| [ready(&pair[0]), ready(&pair[1])];
        let law = law.map(|law| match law {
            Law::State(tape) => (tape, false),
            Law::Impact(tape) => (tape, true),
        });
        Self {
            index,
            event: ready(&slopes.event),
            is_impact: law.is_some_and(|(_, is_impact)| is_impact),
            law: law.map(|(tape, _)| ready(tape)),
            reset: slopes.reset.as_ref().map(pair),
            moves: slopes.moves.as_ref().map(pair),
            impulse: slopes.impulse.as_ref().map(pair),
        }
    }

    fn eval<'a, const K: usize>(
        (tape, registers): &'a mut Ready,
        index: usize,
        t: f64,
        args: [&[f64]; K],
    ) -> Result<&'a [f64], StepError> {
        let values = tape.eval(registers, args);
        if values.iter().all(|x| x.is_finite()) {
            return Ok(values);
        }
        Err(StepError::NotFinite {
            quantity: Quantity::Derivative,
            index,
            t,
        })
    }

    /// e_x.
    ///
    /// # Errors
    /// A derivative that is not finite.
    pub fn gradient(&mut self, (t, [y, z, lam]): (f64, [&[f64]; 3])) -> Result<&[f64], StepError> {
        Self::eval(&mut self.event, self.index, t, [&[t], y, z, lam])
    }

    /// The values of the law of a reset; empty for an event without one.
    pub(super) fn law(&mut self, (t, [y, z, lam]): Before<'_>) -> Result<&[f64], StepError> {
        match &mut self.law {
            Some(law) => Self::eval(law, self.index, t, [&[t], y, z, lam]),
            None => Ok(&[]),
        }
    }

    /// The derivative of a reset of the state along dx, or its transpose.
    pub(super) fn reset(
        &mut self,
        (t, [y, z, lam]): Before<'_>,
        x: &[f64],
        is_transposed: bool,
    ) -> Result<&[f64], StepError> {
        match &mut self.reset {
            Some(pair) => {
                let own = &mut pair[usize::from(is_transposed)];
                Self::eval(own, self.index, t, [&[t], y, z, lam, x])
            }
            None => Ok(&[]),
        }
    }

    /// Whether its reset may leave the constraints.
    pub(super) fn has_moves(&self) -> bool {
        self.moves.is_some()
    }

    /// The derivative of a correction of coordinates along dx, or its transpose.
    pub(super) fn moves(
        &mut self,
        (t, [y, z, lam]): Before<'_>,
        [x, mu]: [&[f64]; 2],
        along: &[f64],
        is_transposed: bool,
    ) -> Result<&[f64], StepError> {
        match &mut self.moves {
            Some(pair) => {
                let own = &mut pair[usize::from(is_transposed)];
                Self::eval(own, self.index, t, [&[t], y, z, lam, x, mu, along])
            }
            None => Ok(&[]),
        }
    }

    /// Whether impulses change the momenta after it.
    pub(super) fn has_impulse(&self) -> bool {
        self.impulse.is_some()
    }

    /// The derivative of the equations of an impulse along dx, or its transpose.
    pub(super) fn impulse(
        &mut self,
        (t, [y, z, lam]): Before<'_>,
        [after, impulses]: [&[f64]; 2],
        x: &[f64],
        is_transposed: bool,
    ) -> Result<&[f64], StepError> {
        match &mut self.impulse {
            Some(pair) => {
                let own = &mut pair[usize::from(is_transposed)];
                let args = [&[t], y, z, lam, after, impulses, x];
                Self::eval(own, self.index, t, args)
            }
            None => Ok(&[]),
        }
    }
}

/// An event that a part of a step has led to.
#[derive(Clone, Copy, Debug)]
pub struct Meeting<'a> {
    /// Which event, and how many times it was met before.
    pub event: usize,
    /// See `event`.
    pub hit: usize,
    /// The part of the step, 0 and 1 for its ends.
    pub part: f64,
    /// When.
    pub t: f64,
    /// The length of the whole step.
    pub h: f64,
    /// λ there.
    pub lam: &'a [f64],
    /// Whether the event depends on it.
    pub needs_lam: bool,
    /// The largest size of the event's function in the step.
    pub height: f64,
    /// Whether it ends the run, or is a switch that ends the step.
    pub is_last: bool,
    /// The obstacle beside it that leaves it without a derivative.
    pub obstacle: Option<Obstacle>,
}

/// The rate of an event's function is zero where it is below this part of its size in a step, over a step.
const GRAZING: f64 = 1e-7;

impl Meeting<'_> {
    /// Refuses an event whose time has no derivative; its function has this rate there.
    ///
    /// # Errors
    /// The function is flat, jumps or bends.
    pub fn check(&self, rate: f64) -> Result<(), StepError> {
        let is_flat = (rate * self.h).abs() <= GRAZING * self.height;
        let why = match self.obstacle {
            Some(Obstacle::Kink) | None if is_flat => Obstacle::Flat,
            Some(seen) => seen,
            None => return Ok(()),
        };
        let (event, t) = (self.event, self.t);
        Err(StepError::Undifferentiable { event, t, why })
    }
}

/// Follows the events of a run: differentiates them at once, or keeps the data of their derivatives.
pub trait FollowEvents<State>: Send + Sync {
    /// A step begins here.
    fn begin(&mut self, state: &mut State);

    /// A step led to the state at `t`.
    fn align(&mut self, t: f64, state: &mut State);

    /// A part of the step led to an event.
    ///
    /// # Errors
    /// It has no derivative.
    fn meet(&mut self, met: Meeting<'_>, state: &mut State) -> Result<(), StepError>;

    /// The step, or a part of it, led to the state at a given time.
    ///
    /// # Errors
    /// It has no derivative.
    fn hold(&mut self, at: Given, state: &mut State) -> Result<(), StepError>;

    /// The event number `index` made one state the other at `t`, with λ before.
    ///
    /// # Errors
    /// It has no derivative.
    fn reset(
        &mut self,
        at: (usize, f64),
        lam: &[f64],
        states: (&State, &mut State),
    ) -> Result<(), StepError>;

    /// An event has ended the run: the last record moves with it.
    fn end(&mut self) {}

    /// Appends what is recorded of a state at an event.
    ///
    /// # Errors
    /// A derivative that is not finite.
    fn record(&mut self, t: f64, state: &State, row: &mut Vec<f64>) -> Result<(), StepError>;
}
