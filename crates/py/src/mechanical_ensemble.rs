//! Ensembles of mechanical systems: start values and parameters of each member in, one run out.

use crate::convert::{self, Mechanical};
use crate::errors;
use crate::mechanical_run::{alpha, spark};
use crate::run::Run;
use crate::second_order::{SecondOrder, Separable};
use crate::tableau::scheme_of;
use liouville_base::composition::{Composed, NeedsAdjoint};
use liouville_base::ensemble::{Ensemble, Layout};
use liouville_base::error::StepError;
use liouville_base::method::{Stepper, Symmetric};
use liouville_base::observe::Observe;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::run::{self, Advance, Fixed};
use liouville_base::tableau::{self, Scheme};
use liouville_base::tape::Tape;
use liouville_mechanics::alpha::{Alpha, Reactions};
use liouville_mechanics::problem::{Model, Observer, Observers, SecondOrderModel, SeparableModel};
use liouville_mechanics::rattle::Rattle;
use liouville_mechanics::spark::{BATCH, SparkBatch, supports_batch};
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;

/// A system in the form that its method steps, with the method.
enum Stepped {
    Spark(
        Arc<liouville_mechanics::problem::Mechanical>,
        Box<spark::Asked>,
    ),
    Rattle(
        Arc<liouville_mechanics::problem::Separable>,
        Option<&'static Scheme>,
    ),
    Alpha(
        Arc<liouville_mechanics::problem::SecondOrder>,
        tableau::Alpha,
        Reactions,
    ),
}

/// What every run of an ensemble begins with.
struct Begin {
    stepped: Stepped,
    observer: Tape,
    /// Rows of parameters: one for each member, or one for all.
    params: Vec<f64>,
    /// y, z and perhaps a, in rows of n values.
    start: Vec<Vec<f64>>,
    span: (f64, f64, usize, usize),
    states: bool,
}

type Begun = Result<Box<dyn Advance + Sync>, StepError>;

impl Stepped {
    fn read(problem: &Bound<'_, PyAny>, method: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(problem) = problem.extract::<PyRef<'_, SecondOrder>>() {
            let (weights, reactions) = alpha::read(method)?;
            return Ok(Self::Alpha(problem.0.clone(), weights, reactions));
        }
        if let Ok(problem) = problem.extract::<PyRef<'_, Separable>>() {
            return Ok(Self::Rattle(problem.0.clone(), scheme_of(method)?));
        }
        let problem = problem.extract::<PyRef<'_, Mechanical>>()?;
        let asked = Box::new(spark::Asked::read(method)?);
        Ok(Self::Spark(problem.0.clone(), asked))
    }

    /// Refuses a scheme that needs adjoint steps.
    fn check(&self) -> PyResult<()> {
        let scheme = match self {
            Self::Spark(_, asked) => asked.scheme,
            Self::Rattle(_, scheme) => *scheme,
            Self::Alpha(..) => None,
        };
        match scheme {
            Some(scheme) if scheme.stages().is_none() => {
                Err(errors::refused(NeedsAdjoint(scheme.name)))
            }
            _ => Ok(()),
        }
    }

    fn problem(&self) -> &Arc<liouville_mechanics::problem::Mechanical> {
        match self {
            Self::Spark(problem, _) => problem,
            Self::Rattle(problem, _) => &problem.mechanical,
            Self::Alpha(problem, ..) => &problem.mechanical,
        }
    }

    /// How many members a block has.
    fn width(&self) -> usize {
        match self {
            Self::Spark(problem, asked) if supports_batch(problem, asked.solver) => BATCH,
            _ => 1,
        }
    }
}

impl Begin {
    fn params(&self, member: usize) -> &[f64] {
        let width = self.stepped.problem().stage.inputs()[3];
        let place = if self.params.len() > width { member } else { 0 };
        &self.params[place * width..(place + 1) * width]
    }

    fn start(&self, part: usize, member: usize) -> &[f64] {
        let n = self.stepped.problem().n;
        &self.start[part][member * n..(member + 1) * n]
    }

    /// A run of these members: in lock-step where there are several.
    fn run(&self, members: &[usize]) -> Begun {
        match &self.stepped {
            Stepped::Spark(problem, asked) if members.len() > 1 => {
                self.together(problem, asked, members)
            }
            Stepped::Spark(problem, asked) => self.spark(problem, asked, members[0]),
            Stepped::Rattle(problem, scheme) => self.rattle(problem, *scheme, members[0]),
            Stepped::Alpha(problem, weights, reactions) => {
                self.alpha(problem, (*weights, *reactions), members[0])
            }
        }
    }

    fn together(
        &self,
        problem: &Arc<liouville_mechanics::problem::Mechanical>,
        asked: &spark::Asked,
        members: &[usize],
    ) -> Begun {
        let params = side_by_side(members, |member| self.params(member));
        let y = side_by_side(members, |member| self.start(0, member));
        let z = side_by_side(members, |member| self.start(1, member));
        let tableau = asked.tableau.clone();
        let stepper = SparkBatch::of(problem, (&params, members.len()), tableau, asked.solver);
        let mut stepper = stepper.to_tolerance(asked.tolerance);
        let state = stepper.state(self.span.0, &y, &z);
        let each = if self.is_common() {
            &members[..1]
        } else {
            members
        };
        let observers = each.iter().map(|member| self.observer(*member)).collect();
        let observer = Observers::new(observers, members.len());
        self.symmetric(stepper, asked.scheme, observer, state)
    }

    /// Whether all members have the same parameters.
    fn is_common(&self) -> bool {
        self.params.len() == self.stepped.problem().stage.inputs()[3]
    }

    fn observer(&self, member: usize) -> Observer {
        let params = self.params(member);
        let model = Model::new(self.stepped.problem().clone(), params);
        Observer::new(model, params, self.observer.clone(), self.states)
    }

    fn spark(
        &self,
        problem: &Arc<liouville_mechanics::problem::Mechanical>,
        asked: &spark::Asked,
        member: usize,
    ) -> Begun {
        let mut model = Model::new(problem.clone(), self.params(member));
        let state = model.state(self.span.0, self.start(0, member), self.start(1, member));
        self.symmetric(
            asked.stepper(model),
            asked.scheme,
            self.observer(member),
            state,
        )
    }

    fn rattle(
        &self,
        problem: &Arc<liouville_mechanics::problem::Separable>,
        scheme: Option<&'static Scheme>,
        member: usize,
    ) -> Begun {
        let mut model = SeparableModel::new(problem.clone(), self.params(member));
        let (y, z) = (self.start(0, member), self.start(1, member));
        let state = model.general.state(self.span.0, y, z);
        self.symmetric(Rattle::new(model)?, scheme, self.observer(member), state)
    }

    fn alpha(
        &self,
        problem: &Arc<liouville_mechanics::problem::SecondOrder>,
        (weights, reactions): (tableau::Alpha, Reactions),
        member: usize,
    ) -> Begun {
        let model = SecondOrderModel::new(problem.clone(), self.params(member));
        let mut stepper = Alpha::new(model, weights, reactions, None);
        let (y, z) = (self.start(0, member), self.start(1, member));
        let a = (self.start.len() > 2).then(|| self.start(2, member));
        let state = stepper.start(self.span.0, y, z, a)?;
        self.launched(stepper, self.observer(member), state)
    }

    fn symmetric<S, O>(
        &self,
        stepper: S,
        scheme: Option<&'static Scheme>,
        observer: O,
        state: S::State,
    ) -> Begun
    where
        S: Symmetric + Sync + 'static,
        S::State: Clone + Send + Sync,
        O: Observe<S::State> + Sync + 'static,
    {
        let Some(scheme) = scheme else {
            return self.launched(stepper, observer, state);
        };
        let composed = Composed::of_symmetric(stepper, scheme);
        let composed = composed.unwrap_or_else(|_| unreachable!("the scheme has been looked at"));
        self.launched(composed, observer, state)
    }

    fn launched<S, O>(&self, stepper: S, observer: O, state: S::State) -> Begun
    where
        S: Stepper + Sync + 'static,
        S::State: Send + Sync,
        O: Observe<S::State> + Sync + 'static,
    {
        let (t0, t1, steps, every) = self.span;
        let control = Fixed::new(t0, (t1 - t0) / steps as f64, steps);
        let expected = steps / every + 2;
        let run = run::Run::new(stepper, observer, state, control, every, expected)?;
        Ok(Box::new(run))
    }
}

/// Rows of several members in lock-step; places without one follow the last.
fn side_by_side<'a>(members: &[usize], row: impl Fn(usize) -> &'a [f64]) -> Vec<Lanes<BATCH>> {
    let mut values = vec![Lanes::splat(0.0); row(members[0]).len()];
    for place in 0..BATCH {
        let member = members[place.min(members.len() - 1)];
        for (value, x) in values.iter_mut().zip(row(member)) {
            value.set_member(place, *x);
        }
    }
    values
}

type Rows<'py> = PyReadonlyArray2<'py, f64>;

/// An ensemble about to start: `params` has a row for each member or one for all, `start` are rows of y, z and
/// perhaps a of each member, and `span` is (t0, t1, steps, every); the rest as for `mechanical_run`.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // the whole border in one call
#[pyo3(signature = (problem, method, observer, params, start, span, states, threads))]
pub(crate) fn mechanical_ensemble<'py>(
    py: Python<'py>,
    problem: &Bound<'py, PyAny>,
    method: &Bound<'py, PyAny>,
    observer: &convert::Tape,
    params: Rows<'py>,
    start: Vec<Rows<'py>>,
    span: (f64, f64, usize, usize),
    states: bool,
    threads: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let stepped = Stepped::read(problem, method)?;
    stepped.check()?;
    let (n, width) = (stepped.problem().n, stepped.problem().stage.inputs()[3]);
    let members = start.first().map_or(0, |rows| rows.shape()[0]);
    let most = if matches!(stepped, Stepped::Alpha(..)) {
        3
    } else {
        2
    };
    let fits = members > 0
        && span.2 > 0
        && span.3 > 0
        && (2..=most).contains(&start.len())
        && start.iter().all(|rows| rows.shape() == [members, n])
        && params.shape()[1] == width
        && [1, members].contains(&params.shape()[0])
        && observer.0.inputs() == [1, n, n, width];
    if !fits {
        return Err(PyValueError::new_err(format!(
            "an ensemble starts from rows of {n} values, with rows of {width} parameters"
        )));
    }
    let rows = start.iter().map(|rows| Ok(rows.as_slice()?.to_vec()));
    let begin = Begin {
        observer: Tape::clone(&observer.0),
        params: params.as_slice()?.to_vec(),
        start: rows.collect::<PyResult<_>>()?,
        span,
        states,
        stepped,
    };
    // as dispatch_simd as leaves something for each thread
    let fair = members.div_ceil(threads.max(1));
    let block = begin.stepped.width().min(fair);
    let own = usize::from(most == 3);
    let states_width = 2 * n + begin.stepped.problem().multipliers() + 2 * own * n;
    let width = usize::from(states) * states_width + own + observer.0.outputs();
    let layout = Layout::Aligned {
        times: run::times(span),
        width,
    };
    let run = Box::new(move |members: &[usize]| begin.run(members));
    let ensemble = Ensemble::new(run, (members, block), threads, layout, span.0);
    Run::handed(py, Ok(ensemble), &[members, width])
}
