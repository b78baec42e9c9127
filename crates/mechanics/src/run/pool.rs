//! Steppers and observers between runs: what a run has made is lent to the next one of the same kind.
//!
//! Making a stepper binds tapes and takes memory; of a short run that was a third of the time.

use super::Recorded;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::method::{Estimating, Stats, Stepper, Symmetric};
use liouville_base::observe::Observe;
use liouville_base::tableau;
use liouville_problem::{Mechanical, Observer};
use liouville_spark::{Solver, Spark};
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError};

/// The most things of one kind that wait for a run.
const MOST: usize = 8;
/// Systems with more coordinates and multipliers make their own each time: they are large, and their runs are long.
const LARGEST: usize = 100;

/// Steppers that runs of one mechanical system have left for the next.
#[derive(Debug, Default)]
pub struct Pools {
    pub(super) steppers: Arc<Pool<Spark>>,
    pub(super) observers: Arc<Pool<Observer>>,
}

/// Something that a run leaves as good as new.
pub(super) trait Reusable: Sized {
    /// Distinguishes items of one system, beside its parameters.
    type Kind;

    /// Whether it is of this kind.
    fn is(&self, kind: &Self::Kind) -> bool;

    /// Forgets all that a run has left in it.
    fn reset(&mut self);
}

impl Reusable for Spark {
    type Kind = (tableau::Key, Solver);

    fn is(&self, kind: &Self::Kind) -> bool {
        self.kind() == *kind
    }

    fn reset(&mut self) {
        Self::reset(self);
    }
}

impl Reusable for Observer {
    type Kind = Recorded;

    fn is(&self, own: &Self::Kind) -> bool {
        Arc::ptr_eq(self.tape(), &own.tape)
            && self.solved().is_some() == own.states
            && self.is_turning() == own.turning.is_some()
    }

    fn reset(&mut self) {
        Self::reset(self);
    }
}

/// Things with the parameters that they were made with.
#[derive(Debug)]
pub(super) struct Pool<T>(Mutex<Vec<(Vec<f64>, T)>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T: Reusable> Pool<T> {
    /// Lends what a run has left, or what `make` makes; large systems have no pool.
    pub(super) fn lend(
        self: &Arc<Self>,
        problem: &Mechanical,
        params: &[f64],
        kind: &T::Kind,
        make: impl FnOnce() -> T,
    ) -> Lent<T> {
        let is_small = problem.n + problem.multipliers() <= LARGEST;
        let kept = is_small.then(|| self.take(params, kind)).flatten();
        let (params, value) = kept.unwrap_or_else(|| (params.to_vec(), make()));
        Lent {
            value: Some((params, value)),
            home: is_small.then(|| self.clone()),
        }
    }

    fn take(&self, params: &[f64], kind: &T::Kind) -> Option<(Vec<f64>, T)> {
        let is_same = |own: &[f64]| {
            own.iter()
                .zip(params)
                .all(|(a, b)| a.to_bits() == b.to_bits())
        };
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let place = kept
            .iter()
            .rposition(|(own, value)| is_same(own) && value.is(kind))?;
        Some(kept.swap_remove(place))
    }

    /// Returns an item to the pool; replaces the oldest when full.
    fn give(&self, own: (Vec<f64>, T)) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() == MOST {
            kept.remove(0);
        }
        kept.push(own);
    }
}

/// Something that goes back to its pool when the run is over.
pub(super) struct Lent<T: Reusable> {
    value: Option<(Vec<f64>, T)>,
    home: Option<Arc<Pool<T>>>,
}

impl<T: Reusable> Lent<T> {
    /// The same after a change.
    pub(super) fn map(mut self, change: impl FnOnce(T) -> T) -> Self {
        self.value = self.value.take().map(|(own, value)| (own, change(value)));
        self
    }

    /// The thing itself, which does not go back.
    ///
    /// # Panics
    /// Never: it is there until it is dropped.
    pub(super) fn keep(mut self) -> T {
        self.value.take().expect(PRESENT).1
    }
}

/// A lent item is present until it goes back.
const PRESENT: &str = "something lent";

impl<T: Reusable> Drop for Lent<T> {
    fn drop(&mut self) {
        if let (Some((own, mut value)), Some(home)) = (self.value.take(), &self.home) {
            value.reset();
            home.give((own, value));
        }
    }
}

impl<T: Reusable> Deref for Lent<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value.as_ref().expect(PRESENT).1
    }
}

impl<T: Reusable> DerefMut for Lent<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.value.as_mut().expect(PRESENT).1
    }
}

/// A copy goes back to the same pool.
impl<T: Reusable + Clone> Clone for Lent<T> {
    fn clone(&self) -> Self {
        Self {
            value: self.value.clone(),
            home: self.home.clone(),
        }
    }
}

impl<T: Reusable + Checkpoint> Checkpoint for Lent<T> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (**self).save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        (**self).restore(member, saved)
    }
}

impl<T: Reusable + Stepper> Stepper for Lent<T> {
    type State = T::State;

    fn step(&mut self, t: f64, h: f64, state: &mut T::State) -> Result<(), StepError> {
        (**self).step(t, h, state)
    }

    fn synchronize(&mut self, state: &mut T::State) -> Result<(), StepError> {
        (**self).synchronize(state)
    }

    fn forget(&mut self) {
        (**self).forget();
    }

    fn stats(&self) -> Stats {
        (**self).stats()
    }
}

impl<T: Reusable + Symmetric> Symmetric for Lent<T> {}

impl<T: Reusable + Estimating> Estimating for Lent<T> {
    fn error(&self) -> f64 {
        (**self).error()
    }

    fn error_order(&self) -> f64 {
        (**self).error_order()
    }

    fn undo(&mut self, state: &mut T::State) {
        (**self).undo(state);
    }

    fn most_corrections(&self) -> f64 {
        (**self).most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        (**self).insist(insists);
    }
}

impl<S, T: Reusable + Observe<S>> Observe<S> for Lent<T> {
    fn width(&self, state: &S) -> usize {
        (**self).width(state)
    }

    fn observe(&mut self, t: f64, state: &S, row: &mut Vec<f64>) -> Result<(), StepError> {
        (**self).observe(t, state, row)
    }

    fn locate(&mut self, t: f64, state: &S, place: &mut Vec<f64>) -> Result<bool, StepError> {
        (**self).locate(t, state, place)
    }

    fn is_following(&self) -> bool {
        (**self).is_following()
    }

    fn follow(&mut self, t: f64, state: &S) {
        (**self).follow(t, state);
    }
}
