//! Cotangents of a run's states at given times, taken to the ends of its steps as these are made again.

use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled};
use liouville_base::observe::Observe;
use liouville_problem::{Cotangents, KnotCotangents, ObservePoint, Observer, Path, PathAdjoint};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The cotangents that a pullback shares with the observer of its run.
pub(super) struct GivenTimes<P>(Arc<Mutex<GivenCotangents<P>>>);

impl<P> Clone for GivenTimes<P> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

type KnotPlace = (isize, bool);

/// The number of recorded steps.
pub(super) type StepCount = Box<dyn Fn() -> usize + Send>;

/// Cotangents at given times, and those of knots that follow from them.
pub(super) struct GivenCotangents<P> {
    times: Vec<f64>,
    /// Those of (y, z, λ) at each time.
    rows: Matrix,
    point: P,
    path: PathAdjoint,
    /// Memory of a point.
    own: Cotangents,
    /// Those of parameters; given times have none.
    pub(super) tau: Vec<f64>,
    /// By the number of steps recorded up to the knot, and whether a piece of the motion may begin there.
    knots: BTreeMap<KnotPlace, KnotCotangents>,
    made: StepCount,
    /// How many recorded steps lead from one knot to the next.
    parts: usize,
}

impl<P> GivenTimes<P> {
    /// No cotangents yet at these times, of a run that records so many steps between knots.
    pub(super) fn new(
        times: Vec<f64>,
        ([n, l, m], width): ([usize; 3], usize),
        point: P,
        (made, parts): (StepCount, usize),
    ) -> Self {
        Self(Arc::new(Mutex::new(GivenCotangents {
            rows: Matrix::zeros(times.len(), n + l + m),
            times,
            point,
            path: PathAdjoint::default(),
            own: Cotangents::zeros([n, l, 0], width),
            tau: vec![0.0; width],
            knots: BTreeMap::new(),
            made,
            parts,
        })))
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, GivenCotangents<P>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<P: ObservePoint> GivenCotangents<P> {
    /// Sets cotangents of (y, z, λ), a row for each time; returns whether their number fits.
    pub(super) fn give(&mut self, rows: Matrix) -> bool {
        let fits = (rows.rows(), rows.cols()) == (self.rows.rows(), self.rows.cols());
        if fits {
            self.rows = rows;
        }
        fits
    }

    /// Those of knots before the steps that are recorded next.
    pub(super) fn pending(&mut self) -> BTreeMap<KnotPlace, KnotCotangents> {
        std::mem::take(&mut self.knots)
    }

    /// Adds those of knots that were pending before so many steps were recorded.
    pub(super) fn shift(&mut self, pending: BTreeMap<KnotPlace, KnotCotangents>, count: usize) {
        for ((place, starts), knot) in pending {
            let place = place + count.cast_signed();
            self.knots.entry((place, starts)).or_default().add(&knot);
        }
    }

    /// Those of the knot behind so many recorded steps, that a piece of the motion begins or ends with.
    pub(super) fn take(&mut self, count: usize, starts: bool) -> Option<KnotCotangents> {
        self.knots.remove(&(count.cast_signed(), starts))
    }

    /// Takes the cotangents at a time to the knots of the path there.
    fn pull(&mut self, t: f64, path: &Path<P::Model>) -> Result<(), StepError> {
        let is_forward = self.times.first() <= self.times.last();
        let is_before = |own: &f64| if is_forward { *own < t } else { *own > t };
        let row = self.rows.row(self.times.partition_point(is_before));
        if row.iter().all(|x| *x == 0.0) {
            return Ok(());
        }
        let own = &mut self.own;
        own.y.fill(0.0);
        own.z.fill(0.0);
        own.tau.fill(0.0);
        self.point.observe_between((t, path), row, own)?;
        add_scaled(&mut self.tau[1..], 1.0, &own.tau[1..]);
        let found = self.path.pull(path, (&own.y, &own.z));
        let last = (self.made)().cast_signed();
        for (back, knot) in found.iter().enumerate() {
            let place = last - (back * self.parts).cast_signed();
            // behind an event there are no knots before it
            let starts = back > 0 || found.len() == 1;
            self.knots.entry((place, starts)).or_default().add(knot);
        }
        Ok(())
    }
}

/// The observer of a repeated run, with the checkpoint of the first run's.
struct TimesObserver<P: ObservePoint> {
    inner: Observer<P::Model>,
    at_times: GivenTimes<P>,
}

/// The observer of a repeated run, with or without given times.
pub(super) fn observing<P: ObservePoint>(
    inner: Observer<P::Model>,
    at_times: Option<GivenTimes<P>>,
) -> Box<dyn Observe<Path<P::Model>>> {
    match at_times {
        None => Box::new(inner),
        Some(at_times) => Box::new(TimesObserver { inner, at_times }),
    }
}

impl<P: ObservePoint> Observe<Path<P::Model>> for TimesObserver<P> {
    fn width(&self, _: &Path<P::Model>) -> usize {
        0
    }

    fn observe(
        &mut self,
        t: f64,
        path: &Path<P::Model>,
        _: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        self.at_times.lock().pull(t, path)
    }
}

impl<P: ObservePoint> Checkpoint for TimesObserver<P> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.inner.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.inner.restore(member, saved)
    }
}
