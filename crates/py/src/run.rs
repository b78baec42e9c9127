//! Runs, as Python drives them: a slice of time, then a look at the signals.

use crate::caught::{Caught, begin_slice};
use crate::errors;
use crate::mechanical::Mechanical;
use crate::operator::Hamiltonian;
use crate::second_order::{SecondOrder, Separable};
use crate::semi_explicit::SemiExplicit;
use crate::split::Split;
use crate::{job, schrodinger, split};
use liouville_base::cancel;
use liouville_base::observe::Finding;
use liouville_base::run::{Advance, Failure, StartError, Status, check};
use liouville_mechanics::run::Problem;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::{PyException, PyMemoryError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::Duration;

/// A system in the form that its method steps.
#[derive(FromPyObject)]
pub(crate) enum System<'py> {
    General(PyRef<'py, Mechanical>),
    Separable(PyRef<'py, Separable>),
    SecondOrder(PyRef<'py, SecondOrder>),
    SemiExplicit(PyRef<'py, SemiExplicit>),
    Split(PyRef<'py, Split>),
    Hamiltonian(PyRef<'py, Hamiltonian>),
}

/// A run about to start, or the error of its start; `method` and `job` are read by the attributes of their dataclasses.
#[pyfunction]
pub(crate) fn run<'py>(
    py: Python<'py>,
    system: System<'py>,
    method: &Bound<'py, PyAny>,
    job: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    check_room(job)?;
    let problem = match system {
        System::General(problem) => Problem::General(problem.0.clone(), problem.1.clone()),
        System::Separable(problem) => Problem::Separable(problem.0.clone()),
        System::SecondOrder(problem) => Problem::SecondOrder(problem.0.clone()),
        System::SemiExplicit(problem) => Problem::SemiExplicit(problem.0.clone()),
        System::Split(split) => {
            let run = split::start(&split, method, job)?;
            return Run::started(py, run, Vec::new());
        }
        System::Hamiltonian(hamiltonian) => {
            let (run, caught) = schrodinger::start(py, &hamiltonian, method, job)?;
            return Run::started(py, run, caught);
        }
    };
    Run::started(py, job::start(problem, method, job)?, Vec::new())
}

/// A start is copied, laid out for a method, and stepped: so many times its bytes are there at once, or more.
const COPIES: usize = 3;

/// The members of an ensemble are copied, and then laid out and stepped some at a time.
const COPIES_OF_MEMBERS: usize = 2;

/// Refuses a run where there is no memory for its start.
fn check_room(job: &Bound<'_, PyAny>) -> PyResult<()> {
    let py = job.py();
    let size = |x: &Bound<'_, PyAny>| x.getattr(intern!(py, "nbytes"))?.extract::<usize>();
    let is_ensemble: bool = job.getattr(intern!(py, "is_ensemble"))?.extract()?;
    let mut bytes = size(&job.getattr(intern!(py, "params"))?)?;
    for part in job.getattr(intern!(py, "start"))?.try_iter()? {
        bytes += size(&part?)?;
    }
    let copies = if is_ensemble {
        COPIES_OF_MEMBERS
    } else {
        COPIES
    };
    check(copies.saturating_mul(bytes)).map_err(|_| {
        let size = bytes as f64 / f64::from(1 << 20);
        PyMemoryError::new_err(format!(
            "a start of {size:.1} MiB leaves no memory for a run"
        ))
    })
}

/// Runs of Schrödinger equations as an ensemble: the Hamiltonian, method and job of each member.
#[pyfunction]
pub(crate) fn run_each<'py>(
    py: Python<'py>,
    members: Vec<schrodinger::Member<'py>>,
    threads: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let (run, caught) = schrodinger::start_each(py, &members, threads)?;
    Run::started(py, run, caught)
}

/// A run of any system by any method.
#[pyclass(module = "liouville._core")]
pub(crate) struct Run {
    inner: Box<dyn Advance>,
    caught: Vec<Caught>,
}

impl Run {
    /// A run in which no exceptions are raised.
    pub(crate) fn of(inner: Box<dyn Advance>) -> Self {
        let caught = Vec::new();
        Self { inner, caught }
    }

    /// A run for Python, or the error of its start; Python may raise exceptions inside its steps.
    fn started(
        py: Python<'_>,
        run: Result<Box<dyn Advance>, StartError>,
        caught: Vec<Caught>,
    ) -> PyResult<Bound<'_, PyAny>> {
        match run {
            Ok(inner) => Ok(Bound::new(py, Self { inner, caught })?.into_any()),
            Err(StartError::Invalid(sentence)) => Err(errors::refused(sentence)),
            Err(StartError::Failed(error)) => match caught.iter().find_map(Caught::take) {
                Some(error) => Err(error),
                None => Ok(errors::error(py, &error)?.into_any()),
            },
        }
    }
}

#[pymethods]
impl Run {
    /// Makes steps for `seconds`, or until there are `steps` in all; "paused", "done", or the error with the
    /// step and its time. An exception of a signal is raised here, and so is one of a function of the model that is no
    /// `Exception`; another ends the step, as "raised" with the exception as its cause.
    #[pyo3(signature = (seconds, steps = None))]
    fn advance<'py>(
        &mut self,
        py: Python<'py>,
        seconds: f64,
        steps: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let run = &mut self.inner;
        let budget = Duration::try_from_secs_f64(seconds).map_err(errors::refused)?;
        let steps = steps.unwrap_or(usize::MAX);
        let signals = Caught::default();
        begin_slice(budget);
        let status =
            py.detach(|| cancel::within(signals.cancel(), || run.advance_to(steps, budget)));
        let caught = self.caught.iter().chain([&signals]);
        let (of_model, of_signals): (Vec<_>, Vec<_>) = caught.partition(|x| x.is_of_model());
        if let Some(error) = of_signals.into_iter().find_map(Caught::take) {
            return Err(error);
        }
        if let Some(error) = of_model.into_iter().find_map(Caught::take) {
            if !error.is_instance_of::<PyException>(py) {
                return Err(error);
            }
            let dict = PyDict::new(py);
            dict.set_item("kind", "raised")?;
            dict.set_item("cause", error)?;
            dict.set_item("step", self.inner.done())?;
            dict.set_item("start", self.inner.time())?;
            return Ok(dict.into_any());
        }
        match status {
            Status::Paused => Ok("paused".into_pyobject(py)?.into_any()),
            Status::Done => Ok("done".into_pyobject(py)?.into_any()),
            Status::Failed { n, t, error } => {
                let dict = errors::error(py, &error)?;
                dict.set_item("step", n)?;
                dict.set_item("start", t)?;
                Ok(dict.into_any())
            }
        }
    }

    /// Number of steps made.
    #[getter]
    fn done(&self) -> usize {
        self.inner.done()
    }

    /// The time reached.
    #[getter]
    fn t(&self) -> f64 {
        self.inner.time()
    }

    /// How many members of an ensemble have come to their end, or failed.
    #[getter]
    fn over(&self) -> usize {
        self.inner.over()
    }

    /// The members that failed: errors with the member, and with the step and the time at its start unless the start
    /// itself failed.
    fn failures<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let of_member = |failure: Failure| {
            let dict = errors::error(py, &failure.error)?;
            dict.set_item("member", failure.member)?;
            if let Some((n, t)) = failure.step {
                dict.set_item("step", n)?;
                dict.set_item("start", t)?;
            }
            Ok(dict)
        };
        self.inner.failures().into_iter().map(of_member).collect()
    }

    /// Findings of the motion, or of members that are over: the number of each member, a kind and its numbers.
    fn found(&self) -> Vec<(usize, Finding)> {
        self.inner.found()
    }

    /// Statistics of the steps.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (stats, rejected) = self.inner.stats();
        let dict = PyDict::new(py);
        dict.set_item(intern!(py, "iterations"), stats.iterations)?;
        dict.set_item(intern!(py, "evaluations"), stats.evaluations)?;
        dict.set_item(intern!(py, "factorizations"), stats.factorizations)?;
        dict.set_item(intern!(py, "newton_steps"), stats.newton_steps)?;
        dict.set_item(intern!(py, "schur_steps"), stats.schur_steps)?;
        dict.set_item(intern!(py, "cold_starts"), stats.cold_starts)?;
        dict.set_item(intern!(py, "rejected"), rejected)?;
        if let Some(sizes) = self.inner.sizes() {
            dict.set_item(intern!(py, "h_smallest"), sizes.smallest)?;
            dict.set_item(intern!(py, "h_largest"), sizes.largest)?;
            dict.set_item(intern!(py, "h_next"), sizes.next)?;
        }
        Ok(dict)
    }

    /// For each event function times, rows (y, z, lam) one after another, of one with a reset each followed by that
    /// after it, and members of an ensemble; then which one ended the run, when, where its hits accumulate if they do,
    /// and of which member.
    #[allow(clippy::type_complexity)]
    fn events<'py>(
        &mut self,
        py: Python<'py>,
    ) -> (
        Vec<(
            Bound<'py, PyArray1<f64>>,
            Bound<'py, PyArray1<f64>>,
            Bound<'py, PyArray1<usize>>,
        )>,
        Vec<(usize, f64, Option<f64>, usize)>,
    ) {
        let events = self.inner.events();
        let found = events.found.into_iter().map(|hits| {
            let times = PyArray1::from_vec(py, hits.times);
            let rows = PyArray1::from_vec(py, hits.rows);
            (times, rows, PyArray1::from_vec(py, hits.members))
        });
        let ends = events.ends.into_iter();
        let ends = ends.map(|end| (end.event, end.t, end.limit, end.member));
        (found.collect(), ends.collect())
    }

    /// Times and rows of the records; the run keeps none. A section has rows of its own times.
    #[allow(clippy::type_complexity)]
    fn take<'py>(
        &mut self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArrayDyn<f64>>)> {
        let was_short = self.inner.is_short();
        let records = self.inner.take();
        if self.inner.is_short() && !was_short {
            return Err(PyMemoryError::new_err("the records do not fit in memory"));
        }
        self.arrays(py, records)
    }

    /// The same of a run that goes on: what was recorded since this was last called.
    #[allow(clippy::type_complexity)]
    fn collect<'py>(
        &mut self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArrayDyn<f64>>)> {
        let records = self.inner.collect();
        self.arrays(py, records)
    }

    /// All that the rest of the run depends on, without the records and events collected before; None where runs of
    /// this kind cannot be saved.
    fn save<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let mut saved = Vec::new();
        let no_memory = |_| PyMemoryError::new_err("the state of the run does not fit in memory");
        let is_saved = self.inner.save(&mut saved).map_err(no_memory)?;
        Ok(is_saved.then(|| PyArray1::from_vec(py, saved)))
    }

    /// The arguments of the equations at the present state: coordinates, velocities and multipliers; and the rates of the
    /// first two. None where there is no single motion on constraints.
    fn place<'py>(&mut self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        Some(PyArray1::from_vec(py, self.inner.place()?))
    }

    /// Goes on where a run that was begun in the same way was saved.
    fn restore(&mut self, saved: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        self.inner
            .restore(saved.as_slice()?)
            .map_err(errors::refused)
    }
}

impl Run {
    /// Times and rows, as arrays.
    #[allow(clippy::type_complexity)]
    fn arrays<'py>(
        &self,
        py: Python<'py>,
        (times, rows): (Vec<f64>, Vec<f64>),
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArrayDyn<f64>>)> {
        let shape = self.inner.shape();
        let count = match shape.iter().product() {
            0 => times.len(),
            width => rows.len() / width,
        };
        let shape = [&[count], shape.as_slice()].concat();
        Ok((
            PyArray1::from_vec(py, times),
            PyArray1::from_vec(py, rows).reshape(shape)?,
        ))
    }
}
