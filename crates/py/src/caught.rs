//! Exceptions that Python raises inside a step: they wait until the step is over.

use liouville_base::cancel::{self, CancelToken};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// A place for the first exception; clones are the same place.
#[derive(Clone, Default)]
pub(crate) struct Caught(Arc<Mutex<Option<PyErr>>>);

/// Works without the interpreter, and raises what a signal raised meanwhile: steps of the work look for it.
pub(crate) fn attending<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let signals = Caught::default();
    let found = py.detach(|| cancel::within(signals.cancel(), work));
    signals.take().map_or(Ok(found), Err)
}

impl Caught {
    /// Keeps the exception of an outcome, if there is one; returns whether there is none.
    pub(crate) fn is_fine(&self, outcome: PyResult<()>) -> bool {
        let Err(error) = outcome else {
            return true;
        };
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get_or_insert(error);
        false
    }

    /// The exception, if there is one.
    pub(crate) fn take(&self) -> Option<PyErr> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// A token that is cancelled by a signal, such as Ctrl-C.
    pub(crate) fn cancel(&self) -> CancelToken {
        let caught = self.clone();
        #[allow(clippy::redundant_closure_for_method_calls)]
        // the method itself has too short a lifetime
        CancelToken::new(move || !caught.is_fine(Python::attach(|py| py.check_signals())))
    }
}
