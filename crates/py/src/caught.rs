//! Exceptions that Python raises inside a step: they wait until the step is over.

use liouville_base::cancel::{self, CancelToken};
use pyo3::prelude::*;
use std::cell::Cell;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

thread_local! {
    /// When the slice of a run that this thread makes is over, but for a step that takes longer than that.
    static SLICE_END: Cell<Option<Instant>> = const { Cell::new(None) };
}

/// Begins a slice of a run that is to take so long.
pub(crate) fn begin_slice(budget: Duration) {
    SLICE_END.set(Instant::now().checked_add(budget.saturating_mul(2)));
}

/// A place for the first exception; clones are the same place.
#[derive(Clone, Default)]
pub(crate) struct Caught {
    error: Arc<Mutex<Option<PyErr>>>,
    /// Whether a function of the model raises it, and not a handler of signals.
    is_of_model: bool,
}

/// Runs `work` with the GIL released; re-raises an exception of a signal handler, which steps of the work check.
pub(crate) fn attending<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let signals = Caught::default();
    let found = py.detach(|| cancel::within(signals.cancel(), work));
    signals.take().map_or(Ok(found), Err)
}

impl Caught {
    /// A place for what a function of the model raises.
    pub(crate) fn of_model() -> Self {
        Self {
            is_of_model: true,
            ..Self::default()
        }
    }

    /// Whether a function of the model raised what is here.
    pub(crate) fn is_of_model(&self) -> bool {
        self.is_of_model
    }

    /// Keeps the exception of an outcome, if there is one; returns whether there is none.
    pub(crate) fn is_fine(&self, outcome: PyResult<()>) -> bool {
        let Err(error) = outcome else {
            return true;
        };
        self.error
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get_or_insert(error);
        false
    }

    /// The exception, if there is one.
    pub(crate) fn take(&self) -> Option<PyErr> {
        self.error
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take()
    }

    /// A token that is cancelled by a signal, such as Ctrl-C.
    pub(crate) fn cancel(&self) -> CancelToken {
        let caught = self.clone();
        CancelToken::new(move || caught.is_signalled())
    }

    /// The same in the middle of a step that takes longer than a slice: between steps the run has a state to keep.
    pub(crate) fn cancel_step(&self) -> CancelToken {
        let caught = self.clone();
        CancelToken::new(move || {
            SLICE_END.get().is_none_or(|end| Instant::now() >= end) && caught.is_signalled()
        })
    }

    fn is_signalled(&self) -> bool {
        #[allow(clippy::redundant_closure_for_method_calls)]
        // the method itself has too short a lifetime
        !self.is_fine(Python::attach(|py| py.check_signals()))
    }
}
