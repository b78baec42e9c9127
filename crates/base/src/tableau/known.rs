//! Coefficients that this process has computed: a run of a few steps takes less time than they do.

use super::lobatto::Force;
use super::spark::Spark;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// A family of SPARK methods, which the number of stages makes one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Family {
    Gauss,
    Radau,
    Lobatto(Force),
}

static KNOWN: Mutex<BTreeMap<(Family, usize), Spark>> = Mutex::new(BTreeMap::new());

/// The method with this number of stages, computed where it is not known yet.
pub(super) fn once(family: Family, stages: usize, compute: impl FnOnce() -> Spark) -> Spark {
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(found) = known().get(&(family, stages)) {
        return found.clone();
    }
    // without the lock: many stages take long
    let computed = compute();
    known().insert((family, stages), computed.clone());
    computed
}
