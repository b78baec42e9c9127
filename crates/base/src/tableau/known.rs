//! Coefficients that this process has computed: a run of a few steps takes less time than they do.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// The Lobatto coefficients of the forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Force {
    /// IIIA, as positions.
    A,
    /// IIIB, as reactions: symplectic.
    B,
    /// IIIC.
    C,
    /// IIIC*, the adjoint of IIIC.
    CStar,
    /// IIID.
    D,
}

impl Force {
    /// The one of this name: "A", "B", "C", "C*" or "D".
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "A" => Self::A,
            "B" => Self::B,
            "C" => Self::C,
            "C*" => Self::CStar,
            "D" => Self::D,
            _ => return None,
        })
    }
}

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
