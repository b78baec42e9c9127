//! Recorded steps: a pullback repeats the steps of a run by a stepper that keeps each of them, with the unknowns that
//! solve its equations.

use crate::error::StepError;
use crate::method::{Estimating, Stats, Stepper, Symmetric};
use crate::real::Scalar;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A method whose steps can be followed back.
pub trait Recordable: Stepper {
    /// Writes the unknowns that solve the equations of the last step, which led to this state.
    fn write_unknowns(&self, state: &Self::State, out: &mut Vec<f64>);
}

/// A state as numbers in a row, those of all its members.
pub trait Recorded {
    /// Appends the numbers.
    fn append_to(&self, out: &mut Vec<f64>);

    /// Takes the numbers from the front of a row, as [`Recorded::append_to`] wrote them.
    ///
    /// # Panics
    /// The row is shorter.
    fn take_from(&mut self, numbers: &mut &[f64]);
}

/// Implements [`Recorded`] by these fields, in this order.
#[macro_export]
macro_rules! recorded {
    ([$($generics:tt)*] $type:ty { $($field:ident),* $(,)? }) => {
        impl<$($generics)*> $crate::recorder::Recorded for $type {
            fn append_to(&self, out: &mut Vec<f64>) {
                $($crate::recorder::Recorded::append_to(&self.$field, out);)*
            }

            fn take_from(&mut self, numbers: &mut &[f64]) {
                $($crate::recorder::Recorded::take_from(&mut self.$field, numbers);)*
            }
        }
    };
}

impl Recorded for f64 {
    fn append_to(&self, out: &mut Vec<f64>) {
        out.push(*self);
    }

    fn take_from(&mut self, numbers: &mut &[f64]) {
        take(std::slice::from_mut(self), numbers);
    }
}

impl<R: Scalar> Recorded for Vec<R> {
    fn append_to(&self, out: &mut Vec<f64>) {
        append(self, out);
    }

    fn take_from(&mut self, numbers: &mut &[f64]) {
        take(self, numbers);
    }
}

/// Appends the numbers of all members.
pub fn append<R: Scalar>(x: &[R], out: &mut Vec<f64>) {
    out.reserve(x.len() * R::MEMBERS);
    for x in x {
        out.extend((0..R::MEMBERS).map(|member| x.member(member)));
    }
}

/// Takes the numbers of all members from the front of a row.
///
/// # Panics
/// The row is shorter.
pub fn take<R: Scalar>(x: &mut [R], numbers: &mut &[f64]) {
    let (own, rest) = numbers.split_at(x.len() * R::MEMBERS);
    for (x, own) in x.iter_mut().zip(own.chunks_exact(R::MEMBERS)) {
        for (member, value) in own.iter().enumerate() {
            x.set_member(member, *value);
        }
    }
    *numbers = rest;
}

/// A step with the unknowns that solved its equations.
#[derive(Clone, Debug)]
pub struct StepRecord<S> {
    /// Time at its start.
    pub t: f64,
    /// Its length.
    pub h: f64,
    /// The state that it began with.
    pub before: S,
    /// The state that it led to.
    pub end: S,
    /// The unknowns that solve its equations.
    pub unknowns: Vec<f64>,
}

impl<S: Clone> StepRecord<S> {
    /// Room for a step of such states.
    pub fn like(state: &S) -> Self {
        let (before, end) = (state.clone(), state.clone());
        let (t, h, unknowns) = (0.0, 0.0, Vec::new());
        Self {
            t,
            h,
            before,
            end,
            unknowns,
        }
    }
}

impl<S> StepRecord<S> {
    /// Time at its end.
    pub fn time(&self) -> f64 {
        self.t + self.h
    }
}

/// Recorded steps, in memory that is used again.
#[derive(Clone, Debug)]
pub struct StepRecords<S> {
    /// Start and length of each step, and where its numbers end.
    steps: Vec<(f64, f64, usize)>,
    /// The states and unknowns of all: a small step takes less time than memory of its own.
    numbers: Vec<f64>,
    states: PhantomData<fn() -> S>,
}

impl<S> StepRecords<S> {
    /// Forgets all steps.
    pub fn clear(&mut self) {
        self.steps.clear();
        self.numbers.clear();
    }

    /// How many steps there are.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// How many numbers they take.
    pub fn numbers(&self) -> usize {
        self.numbers.len()
    }

    /// Where the numbers of a step begin.
    fn place(&self, step: usize) -> usize {
        step.checked_sub(1).map_or(0, |last| self.steps[last].2)
    }

    /// Forgets the last step.
    fn pop(&mut self) {
        self.steps.pop();
        self.numbers.truncate(self.place(self.steps.len()));
    }
}

impl<S: Recorded> StepRecords<S> {
    /// Reads a step, into one of such states.
    ///
    /// # Panics
    /// There is no such step, or its states are of other sizes.
    pub fn read(&self, step: usize, out: &mut StepRecord<S>) {
        let end;
        (out.t, out.h, end) = self.steps[step];
        let mut numbers = &self.numbers[self.place(step)..end];
        for state in [&mut out.before, &mut out.end] {
            state.take_from(&mut numbers);
        }
        out.unknowns.clear();
        out.unknowns.extend_from_slice(numbers);
    }

    /// Some steps, of states like this one.
    ///
    /// # Panics
    /// There are no such steps, or their states are of other sizes.
    pub fn copies(&self, steps: Range<usize>, like: &S) -> Vec<StepRecord<S>>
    where
        S: Clone,
    {
        let copy = |step| {
            let mut out = StepRecord::like(like);
            self.read(step, &mut out);
            out
        };
        steps.map(copy).collect()
    }
}

/// Records that a stepper shares with the adjoint of its method.
#[derive(Debug)]
pub struct SharedRecords<S>(Arc<Mutex<StepRecords<S>>>);

impl<S> Clone for SharedRecords<S> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<S> Default for SharedRecords<S> {
    fn default() -> Self {
        let (steps, numbers, states) = (Vec::new(), Vec::new(), PhantomData);
        Self(Arc::new(Mutex::new(StepRecords {
            steps,
            numbers,
            states,
        })))
    }
}

impl<S> SharedRecords<S> {
    /// The records, locked.
    pub fn lock(&self) -> MutexGuard<'_, StepRecords<S>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A method at work that records its steps; they have the bits of those without.
#[derive(Clone, Debug)]
pub struct Recorder<M: Stepper> {
    method: M,
    records: SharedRecords<M::State>,
    unknowns: Vec<f64>,
}

impl<M: Stepper> Recorder<M> {
    /// The method, and where it records.
    pub fn new(method: M, records: SharedRecords<M::State>) -> Self {
        Self {
            method,
            records,
            unknowns: Vec::new(),
        }
    }
}

impl<M: Recordable> Stepper for Recorder<M>
where
    M::State: Recorded,
{
    type State = M::State;

    fn step(&mut self, t: f64, h: f64, state: &mut M::State) -> Result<(), StepError> {
        let mut records = self.records.lock();
        let StepRecords { steps, numbers, .. } = &mut *records;
        let place = numbers.len();
        state.append_to(numbers);
        let made = self.method.step(t, h, state);
        made.inspect_err(|_| numbers.truncate(place))?;
        state.append_to(numbers);
        self.method.write_unknowns(state, &mut self.unknowns);
        numbers.extend_from_slice(&self.unknowns);
        steps.push((t, h, numbers.len()));
        Ok(())
    }

    fn forget(&mut self) {
        self.method.forget();
    }

    fn stats(&self) -> Stats {
        self.method.stats()
    }
}

impl<M: Recordable + Symmetric> Symmetric for Recorder<M> where M::State: Recorded {}

impl<M: Recordable + Estimating> Estimating for Recorder<M>
where
    M::State: Recorded,
{
    fn error(&self) -> f64 {
        self.method.error()
    }

    fn error_order(&self) -> f64 {
        self.method.error_order()
    }

    fn undo(&mut self, state: &mut M::State) {
        self.method.undo(state);
        self.records.lock().pop();
    }

    fn most_corrections(&self) -> f64 {
        self.method.most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        self.method.insist(insists);
    }
}

// Records are made again with the steps.
crate::checkpoint!([M: Stepper] Recorder<M> { method });
