//! Energies that cannot be right.

use crate::errors::refused;
use liouville_base::checkpoint::Checkpoint;
use liouville_problem::{EnergyChange, EnergyColumns, EnergyWatch, KineticColumns};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::collections::BTreeMap;

/// Follows the energy of a motion through its records, in memory that does not grow with their number. `kinetic` is the
/// column of the kinetic energy, or those of the first of n velocities and momenta with n. `start` is the energy at
/// the start, that of the first record if None; changes up to `roundoff` do not count; with `falls` it can only fall,
/// and only a gain counts.
#[pyclass(name = "EnergyWatch", module = "liouville._core")]
pub(crate) struct PyEnergyWatch {
    inner: EnergyWatch,
    width: usize,
}

/// Columns of the kinetic energy, or of the first of n velocities and momenta with n.
#[derive(FromPyObject)]
pub(crate) enum KineticAt {
    Product(usize, usize, usize),
    Recorded(usize),
}

/// What a watch has found, and numbers of it.
type Found = (&'static str, Vec<f64>);

/// A change by its name.
fn named(change: EnergyChange) -> Found {
    match change {
        EnergyChange::Large {
            record,
            t,
            energies: [first, now],
        } => ("change", vec![record as f64, t, first, now]),
        EnergyChange::Rise {
            between: [from, to],
            energies: [low, high],
        } => ("rise", vec![from, to, low, high]),
        EnergyChange::Jump {
            between: [from, to],
            part,
        } => ("jump", vec![from, to, part]),
    }
}

impl PyEnergyWatch {
    /// The width of records and the number of their members.
    fn shape(&self, rows: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<(usize, usize)> {
        let shape = rows.shape();
        let width = shape.last().copied().unwrap_or(0);
        if shape.len() < 2 || width < self.width {
            return Err(refused("records are rows with all these columns"));
        }
        Ok((width, shape.iter().skip(1).rev().skip(1).product()))
    }
}

#[pymethods]
impl PyEnergyWatch {
    #[new]
    #[pyo3(signature = (energy, kinetic, start = None, roundoff = 0.0, falls = false))]
    fn new(
        energy: usize,
        kinetic: KineticAt,
        start: Option<f64>,
        roundoff: f64,
        falls: bool,
    ) -> Self {
        let (kinetic, end) = match kinetic {
            KineticAt::Recorded(at) => (KineticColumns::Recorded(at), at + 1),
            KineticAt::Product(v, p, n) => (KineticColumns::Product { v, p, n }, v.max(p) + n),
        };
        Self {
            inner: EnergyWatch::new(EnergyColumns { energy, kinetic }, start, roundoff, falls),
            width: end.max(energy + 1),
        }
    }

    /// Excludes a change by a reset; to be called before the records after it are added.
    fn reset(&mut self, t: f64, change: f64) {
        self.inner.reset(t, change);
    }

    /// Looks at further records, of one motion.
    fn add(
        &mut self,
        py: Python<'_>,
        times: PyReadonlyArray1<'_, f64>,
        rows: PyReadonlyArrayDyn<'_, f64>,
    ) -> PyResult<()> {
        let (width, members) = self.shape(&rows)?;
        if members != 1 {
            return Err(refused("a watch follows one motion"));
        }
        let (times, rows) = (times.as_slice()?, rows.as_slice()?);
        let inner = &mut self.inner;
        py.detach(|| {
            for (t, row) in times.iter().zip(rows.chunks_exact(width)) {
                inner.add(*t, row);
            }
        });
        Ok(())
    }

    /// What records of shape (k, P, width) show of a range of members, each watched from its own start on: the number of
    /// each member of which something is found, and what `found` has of it. `starts` has the energy at the start of each
    /// of the P, or of none; `resets` has the times and changes of members that have any, in order.
    fn found_of_each(
        &self,
        py: Python<'_>,
        times: PyReadonlyArray1<'_, f64>,
        rows: PyReadonlyArrayDyn<'_, f64>,
        starts: PyReadonlyArray1<'_, f64>,
        resets: BTreeMap<usize, Vec<(f64, f64)>>,
        members: (usize, usize),
    ) -> PyResult<Vec<(usize, Found)>> {
        let (width, count) = self.shape(&rows)?;
        let (times, rows, starts) = (times.as_slice()?, rows.as_slice()?, starts.as_slice()?);
        if members.1 > count || !(starts.is_empty() || starts.len() == count) {
            return Err(refused("there is a start for each member"));
        }
        let found = |member: usize| {
            let mut watch = self.inner.of_another(starts.get(member).copied());
            for (t, change) in resets.get(&member).into_iter().flatten() {
                watch.reset(*t, *change);
            }
            let all = rows.chunks_exact(width).skip(member).step_by(count);
            for (t, row) in times.iter().zip(all) {
                watch.add(*t, row);
            }
            Some((member, named(watch.found()?)))
        };
        Ok(py.detach(|| (members.0..members.1).filter_map(found).collect()))
    }

    /// What is found, and numbers of it. Of a "change" by more than the energy's size: the number of the record, its
    /// time, and the energies at the start and there. Of a "rise": two times and the energies there. Of a "jump": the
    /// times around it, and its part of the energy's size. None if there is none.
    fn found(&self) -> Option<Found> {
        self.inner.found().map(named)
    }

    /// All that the rest of the run adds to.
    fn save<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let mut saved = Vec::new();
        self.inner.save(0, &mut saved);
        PyArray1::from_vec(py, saved)
    }

    /// Goes on where a watch that was made in the same way was saved.
    fn restore(&mut self, saved: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let mut saved = saved.as_slice()?;
        self.inner.restore(0, &mut saved).map_err(refused)?;
        if saved.is_empty() {
            Ok(())
        } else {
            Err(refused("what was saved is of another watch"))
        }
    }
}
