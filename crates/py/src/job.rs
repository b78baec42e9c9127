//! Jobs of mechanical and semi-explicit systems: controls, events and start values in, a run out.

use crate::convert;
use crate::errors::refused;
use crate::mechanical::Sensitivity;
use crate::method::MechanicalMethod;
use crate::semi_explicit::SemiExplicitSensitivity;
use liouville_alpha::{AlphaSlopes, AlphaTransposed};
use liouville_base::method::Tolerance;
use liouville_base::run::{Advance, EventRule, Span, StartError};
use liouville_base::tape::Tape;
use liouville_mechanics::events::{EventSlopes, Law};
use liouville_mechanics::run::{
    self, Control, Detection, EventFunction, Problem, Recorded, SystemSensitivity, Tangents,
};
use liouville_problem::{Turning, Watched};
use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use numpy::{PyReadonlyArray1, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use std::sync::Arc;

/// A control of the steps: (rtol, atol, first step or 0, least step) by errors, or reversible (first step, least
/// step, a tape with whether it depends on z' or None), or held to given ends.
#[derive(FromPyObject)]
enum ControlOf<'py> {
    Adaptive(f64, PyReadonlyArray1<'py, f64>, f64, f64),
    Reversible(f64, f64, Option<(PyRef<'py, convert::Tape>, bool)>),
    #[pyo3(transparent)]
    Held(PyReadonlyArray1<'py, f64>),
}

impl ControlOf<'_> {
    fn read(&self, span: f64) -> PyResult<Control> {
        match self {
            Self::Adaptive(rtol, atol, h_first, h_min) => Ok(Control::Adaptive {
                tolerance: Tolerance {
                    rtol: *rtol,
                    atol: atol.as_slice()?.to_vec(),
                    longest: span.abs() / 100.0,
                },
                h_first: (*h_first > 0.0).then_some(*h_first),
                h_min: *h_min,
            }),
            Self::Reversible(h_first, h_min, monitor) => {
                let monitor = monitor.as_ref();
                Ok(Control::Reversible {
                    h_first: *h_first,
                    h_min: *h_min,
                    monitor: monitor.map(|(tape, of_z_dot)| (Tape::clone(&tape.0), *of_z_dot)),
                })
            }
            Self::Held(ends) => Ok(Control::Held(ends.as_slice()?.to_vec())),
        }
    }
}

/// Order of the method, times to record at or None, and events.
pub(crate) type Watch<'py> = (usize, Option<PyReadonlyArray1<'py, f64>>, Vec<EventOf<'py>>);

/// An event: tape, direction, how many end the run or 0, the size of a minimum that is zero, whether it needs lam, its
/// reset or None, whether it is a switch, and its derivatives or None.
type EventOf<'py> = (
    PyRef<'py, convert::Tape>,
    i8,
    usize,
    f64,
    bool,
    Option<ResetOf<'py>>,
    bool,
    Option<SlopesOf<'py>>,
);

/// Derivatives of an event: its gradient, and of its reset, of what moves coordinates after it and of impulses the
/// derivative with its transpose, or None.
type SlopesOf<'py> = (
    PyRef<'py, convert::Tape>,
    Option<Pair<'py>>,
    Option<Pair<'py>>,
    Option<Pair<'py>>,
);
type Pair<'py> = (PyRef<'py, convert::Tape>, PyRef<'py, convert::Tape>);

fn slopes((event, reset, moves, impulse): &SlopesOf<'_>) -> EventSlopes {
    let copied = |tape: &PyRef<'_, convert::Tape>| Tape::clone(&tape.0);
    let pair = |(push, pull): &Pair<'_>| [copied(push), copied(pull)];
    EventSlopes {
        event: copied(event),
        reset: reset.as_ref().map(pair),
        moves: moves.as_ref().map(pair),
        impulse: impulse.as_ref().map(pair),
    }
}

/// A reset: its tape, whether it is an impact, and the tape of the event's rate or None.
type ResetOf<'py> = (
    PyRef<'py, convert::Tape>,
    bool,
    Option<PyRef<'py, convert::Tape>>,
);

pub(crate) fn detection((order, times, events): &Watch<'_>) -> PyResult<Detection> {
    let times = times.as_ref().map(|x| x.as_slice().map(<[f64]>::to_vec));
    let copied = |tape: &PyRef<'_, convert::Tape>| Tape::clone(&tape.0);
    let events = events.iter().enumerate();
    let events = events.map(
        |(index, (tape, direction, terminal, touch, needs_lam, reset, is_switch, derivatives))| {
            EventFunction {
                tape: copied(tape),
                rule: EventRule {
                    index,
                    direction: *direction,
                    terminal: *terminal,
                    touch: *touch,
                },
                needs_lam: *needs_lam,
                reset: reset.as_ref().map(|(tape, is_impact, rate)| {
                    let law = if *is_impact { Law::Impact } else { Law::State };
                    (law(copied(tape)), rate.as_ref().map(copied))
                }),
                is_switch: *is_switch,
                slopes: derivatives.as_ref().map(slopes),
            }
        },
    );
    Ok(Detection {
        order: *order,
        times: times.transpose()?,
        events: events.collect(),
    })
}

/// Derivatives of a mechanical system, or of a semi-explicit one.
#[derive(FromPyObject)]
pub(crate) enum SensitivityOf<'py> {
    Mechanical(PyRef<'py, Sensitivity>),
    SemiExplicit(PyRef<'py, SemiExplicitSensitivity>),
}

impl SensitivityOf<'_> {
    fn read(&self) -> SystemSensitivity {
        match self {
            Self::Mechanical(own) => SystemSensitivity::Mechanical(own.0.clone()),
            Self::SemiExplicit(own) => SystemSensitivity::SemiExplicit(own.0.clone()),
        }
    }

    /// Numbers of y, z and multipliers of a point.
    pub(crate) fn width(&self) -> usize {
        match self {
            Self::Mechanical(own) => {
                let own = &own.0.mechanical;
                2 * own.n + own.multipliers()
            }
            Self::SemiExplicit(own) => own.0.system.n + own.0.system.l,
        }
    }
}

/// Tangents: derivatives of the system, changes of y and of z at the start, those of time and parameters, a row for each
/// direction, by which part of themselves the steps become longer, and derivatives of a step of the alpha family or None.
type TangentsOf<'py> = (
    SensitivityOf<'py>,
    PyReadonlyArrayDyn<'py, f64>,
    PyReadonlyArrayDyn<'py, f64>,
    PyReadonlyArrayDyn<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    Option<AlphaSlopesOf<'py>>,
);

/// Derivatives of a step of the alpha family: tapes of E_u, with its pattern, of E_x dx, of the end and of the start.
type AlphaSlopesOf<'py> = (
    PyRef<'py, convert::Tape>,
    Bound<'py, PyAny>,
    PyRef<'py, convert::Tape>,
    PyRef<'py, convert::Tape>,
    PyRef<'py, convert::Tape>,
);

fn alpha_slopes(
    (matrix, pattern, equations, end, start): &AlphaSlopesOf<'_>,
) -> PyResult<AlphaSlopes> {
    let copied = |tape: &PyRef<'_, convert::Tape>| Tape::clone(&tape.0);
    Ok(AlphaSlopes {
        matrix: copied(matrix),
        pattern: convert::pattern(pattern)?,
        equations: copied(equations),
        end: copied(end),
        start: copied(start),
    })
}

fn tangents((sensitivity, y, z, tau, stretch, alpha): &TangentsOf<'_>) -> PyResult<Tangents> {
    Ok(Tangents {
        alpha: alpha.as_ref().map(alpha_slopes).transpose()?,
        sensitivity: sensitivity.read(),
        start: [y.as_slice()?.to_vec(), z.as_slice()?.to_vec()],
        tau: tau.as_slice()?.to_vec(),
        stretch: stretch.as_slice()?.to_vec(),
    })
}

/// The watch of each step: a tape of energies and powers with whether the energy can only fall, and a tape of
/// constraints left out with their numbers and for each member their sizes, or None.
type WatchedOf<'py> = (
    Option<(PyRef<'py, convert::Tape>, bool)>,
    Option<(
        PyRef<'py, convert::Tape>,
        Vec<usize>,
        PyReadonlyArray1<'py, f64>,
    )>,
);

fn watched((energy, left_out): &WatchedOf<'_>) -> PyResult<Watched> {
    let sized = |(tape, which, sizes): &(PyRef<'_, convert::Tape>, Vec<usize>, _)| {
        let sizes: &PyReadonlyArray1<'_, f64> = sizes;
        Ok::<_, PyErr>((tape.0.clone(), which.clone(), sizes.as_slice()?.to_vec()))
    };
    Ok(Watched {
        energy: energy
            .as_ref()
            .map(|(tape, falls)| (tape.0.clone(), *falls)),
        left_out: left_out.as_ref().map(sized).transpose()?,
    })
}

/// Angles that are continued, by a tape of them and their rates, with their periods.
type TurningOf<'py> = (PyRef<'py, convert::Tape>, PyReadonlyArray1<'py, f64>);

fn turning((tape, periods): &TurningOf<'_>) -> PyResult<Turning> {
    let (tape, periods) = (tape.0.clone(), periods.as_slice()?.into());
    Ok(Turning { tape, periods })
}

/// A job, by the attributes of its dataclass; an ensemble has arrays of rows.
#[derive(FromPyObject)]
#[allow(clippy::struct_excessive_bools)] // the dataclass has them
struct MechanicalJob<'py> {
    start: Vec<Bound<'py, PyArrayDyn<f64>>>,
    params: Bound<'py, PyArrayDyn<f64>>,
    span: (f64, f64, usize, usize),
    observer: PyRef<'py, convert::Tape>,
    states: bool,
    control: Option<ControlOf<'py>>,
    watch: Option<Watch<'py>>,
    tangents: Option<TangentsOf<'py>>,
    watched: WatchedOf<'py>,
    turning: Option<TurningOf<'py>>,
    threads: usize,
    is_ensemble: bool,
    is_reversible: bool,
    is_differentiated: bool,
    parts: Vec<run::Part>,
}

impl MechanicalJob<'_> {
    fn read(&self) -> PyResult<run::Job> {
        let ndim = 1 + usize::from(self.is_ensemble);
        let rows = |x: &Bound<'_, PyArrayDyn<f64>>| x.shape().first().copied().unwrap_or(0);
        let members = self.start.first().map_or(0, rows);
        if self.start.iter().any(|x| rows(x) != members) && self.is_ensemble
            || self.start.iter().any(|x| x.ndim() != ndim)
            || self.params.ndim() != ndim
        {
            let wanted = "a start and its params are arrays of values, or of a row for each member";
            return Err(refused(wanted));
        }
        let (t0, t1, steps, every) = self.span;
        let start = self.start.iter().map(|x| Ok(x.to_vec()?));
        let control = match &self.control {
            None => Control::Fixed,
            Some(control) => control.read(t1 - t0)?,
        };
        Ok(run::Job {
            start: start.collect::<PyResult<_>>()?,
            params: self.params.to_vec()?,
            members: self.is_ensemble.then_some(members),
            parts: self.parts.clone(),
            span: Span {
                t0,
                t1,
                steps,
                every,
            },
            control,
            is_reversible: self.is_reversible,
            is_differentiated: self.is_differentiated,
            detection: self.watch.as_ref().map(detection).transpose()?,
            tangents: self.tangents.as_ref().map(tangents).transpose()?,
            watched: watched(&self.watched)?,
            recorded: Recorded {
                tape: self.observer.0.clone(),
                states: self.states,
                turning: self.turning.as_ref().map(turning).transpose()?,
            },
            threads: self.threads,
        })
    }
}

/// A run of a mechanical or semi-explicit system.
pub(crate) fn start(
    problem: Problem,
    method: &Bound<'_, PyAny>,
    job: &Bound<'_, PyAny>,
) -> PyResult<Result<Box<dyn Advance>, StartError>> {
    let method = method.extract::<MechanicalMethod>()?.read()?;
    let job = job.extract::<MechanicalJob<'_>>()?.read()?;
    Ok(run::start(problem, method, job))
}

/// The derivatives of a step of the alpha family with their transposes: tapes of e_uᵀ w, of e_xᵀ w − E_xᵀ v and of the
/// start.
pub(crate) type AlphaOf<'py> = (
    AlphaSlopesOf<'py>,
    PyRef<'py, convert::Tape>,
    PyRef<'py, convert::Tape>,
    PyRef<'py, convert::Tape>,
);

/// The pullback of a single run in the core's terms.
pub(crate) fn pullback(
    problem: Problem,
    sensitivity: &SensitivityOf<'_>,
    method: &Bound<'_, PyAny>,
    job: &Bound<'_, PyAny>,
    alpha: Option<AlphaOf<'_>>,
) -> PyResult<Result<Box<dyn run::Follow>, StartError>> {
    let method = method.extract::<MechanicalMethod>()?.read()?;
    let job = job.extract::<MechanicalJob<'_>>()?.read()?;
    let sensitivity = match sensitivity {
        SensitivityOf::Mechanical(own) => &own.0,
        SensitivityOf::SemiExplicit(own) => {
            let found = run::Pullback::of_index2(problem, method, job, &own.0);
            return Ok(found.map(|found| Box::new(found) as _));
        }
    };
    let Some((slopes, unknowns, step, start)) = alpha else {
        let found = run::Pullback::new(problem, method, job, sensitivity);
        return Ok(found.map(|found| Box::new(found) as _));
    };
    let copied = |tape: PyRef<'_, convert::Tape>| Tape::clone(&tape.0);
    let transposed = AlphaTransposed {
        unknowns: copied(unknowns),
        step: copied(step),
        start: copied(start),
    };
    let of = (alpha_slopes(&slopes)?, transposed);
    let found = run::Pullback::of_alpha(problem, method, job, sensitivity, of);
    Ok(found.map(|found| Box::new(found) as _))
}

/// The pullbacks of the members of an ensemble in the core's terms; `None` where these do not run in lock-step.
pub(crate) fn members_pullback(
    problem: Problem,
    method: &Bound<'_, PyAny>,
    job: &Bound<'_, PyAny>,
    sensitivity: &Arc<liouville_problem::Sensitivity>,
) -> PyResult<Result<Option<run::MembersPullback>, StartError>> {
    let method = method.extract::<MechanicalMethod>()?.read()?;
    let job = job.extract::<MechanicalJob<'_>>()?.read()?;
    Ok(run::MembersPullback::new(problem, method, job, sensitivity))
}
