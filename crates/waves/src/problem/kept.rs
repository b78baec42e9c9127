//! Results about a Hamiltonian, kept for later calls.

use std::any::Any;
use std::sync::{Arc, Mutex, PoisonError};

/// One thing that is kept, in place of the last one.
#[derive(Clone, Default)]
pub(crate) struct Kept(Arc<Mutex<Option<Arc<dyn Any + Send + Sync>>>>);

impl Kept {
    /// Returns the kept result, where it is of this type and fits, or makes one, once for all calls at a time, and keeps
    /// it where it is worth that.
    ///
    /// # Errors
    /// It cannot be made.
    pub(crate) fn get<T: Any + Send + Sync, E>(
        &self,
        fits: impl Fn(&T) -> bool,
        make: impl FnOnce() -> Result<T, E>,
        is_worth: impl FnOnce(&T) -> bool,
    ) -> Result<Arc<T>, E> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = kept.clone().and_then(|kept| kept.downcast::<T>().ok());
        if let Some(known) = known.filter(|known| fits(known)) {
            return Ok(known);
        }
        let made = Arc::new(make()?);
        if is_worth(&made) {
            *kept = Some(made.clone());
        }
        Ok(made)
    }
}
