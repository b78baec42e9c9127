//! Coefficients that this process has computed: a run of a few steps takes less time than they do.

use super::lobatto::Force;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// A family of SPARK methods, which the number of stages makes one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Family {
    Gauss,
    Radau,
    Lobatto(Force),
}

/// A SPARK method: its family, and its number of stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key(pub(super) Family, pub(super) usize);

/// Values computed once for each method, for as long as the process lives.
#[derive(Debug, Default)]
pub struct Known<V: 'static>(Mutex<BTreeMap<Key, &'static V>>);

impl<V> Known<V> {
    /// None yet.
    pub const fn new() -> Self {
        Self(Mutex::new(BTreeMap::new()))
    }

    /// Returns the coefficients of a method, computed where they are not known yet.
    pub fn once(&self, key: Key, compute: impl FnOnce() -> V) -> &'static V {
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known().get(&key) {
            return found;
        }
        // without the lock: many stages take long
        let computed = compute();
        known()
            .entry(key)
            .or_insert_with(|| Box::leak(Box::new(computed)))
    }
}
