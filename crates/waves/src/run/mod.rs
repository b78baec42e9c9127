//! Runs of Schrödinger equations: a Hamiltonian, a method and a job become one run.

mod method;
mod steppers;

pub use method::{
    Beginning, Method, chebyshev_degree, magnus_cost, nodes, processor_degree, shears, turns,
};

use crate::method::{Observable, Observer, Recorder, Sweeper, Wave};
use crate::problem::Hamiltonian;
use liouville_base::cancel::CancelToken;
use liouville_base::ensemble::{Ensemble, RecordLayout};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::real::{Lanes, WIDTH};
use liouville_base::run::{Advance, BetweenTimes, Run, StartError, resize};
use liouville_base::simd::Stored;
use std::sync::Arc;

/// Most bytes of the outputs of a window of members in lock-step.
const LOCKSTEP: usize = 1 << 26;

/// A run, or an ensemble of runs.
#[derive(Clone)]
pub struct Job {
    /// Real parts and imaginary parts at the start: rows of the members, one after another.
    pub psi: [Vec<f64>; 2],
    /// The number of members of an ensemble; none for a single run.
    pub members: Option<usize>,
    /// The number of places of a wave function: half the order of a Hamiltonian that acts on real and imaginary
    /// parts one after the other.
    pub n: usize,
    /// Where the run starts.
    pub t0: f64,
    /// The times whose states are recorded, with the steps to each.
    pub stops: Vec<(f64, usize)>,
    /// Observables recorded beside the norm.
    pub observables: Vec<Observable>,
    /// Whether states are recorded.
    pub states: bool,
    /// Where each member leaves what its derivatives need; none if they are not to be differentiated.
    pub recorders: Vec<Recorder>,
    /// Threads: of an ensemble, or of one large state.
    pub threads: usize,
}

/// A run about to start; a single one stops within a step where `cancel` says so, members where the token of the thread does.
///
/// # Errors
/// The method or the job does not fit the Hamiltonian, or the start of a single run failed.
pub fn start(
    hamiltonian: Arc<Hamiltonian>,
    method: Method,
    job: Job,
    cancel: CancelToken,
) -> Result<Box<dyn Advance>, StartError> {
    let mut starter = Starter::new(hamiltonian, method, job)?;
    match starter.job.members {
        None => Ok(starter.only(cancel)?),
        Some(members) => Ok(Box::new(starter.ensemble(members))),
    }
}

/// Single runs side by side as an ensemble, each of its own Hamiltonian by its own method, with states at the same times.
///
/// # Errors
/// There are none, one does not fit its Hamiltonian, or they record other things or at other times.
pub fn start_each(
    runs: Vec<(Arc<Hamiltonian>, Method, Job)>,
    threads: usize,
) -> Result<Box<dyn Advance>, StartError> {
    let starters = runs.into_iter();
    let starters =
        starters.map(|(hamiltonian, method, job)| Starter::new(hamiltonian, method, job));
    let starters: Vec<Starter> = starters.collect::<Result<_, _>>()?;
    let layouts: Vec<RecordLayout> = starters.iter().map(Starter::layout).collect();
    let is_single = starters.iter().all(|each| each.job.members.is_none());
    let Some(layout) = layouts.first().filter(|_| is_single) else {
        return Err(StartError::invalid("single runs, at least one"));
    };
    if layouts.iter().any(|other| other != layout) {
        return Err(StartError::invalid(
            "members record the same at the same times",
        ));
    }
    let (layout, count, t0) = (layout.clone(), starters.len(), starters[0].job.t0);
    let begin = move |members: &[usize]| {
        let own = &starters[members[0]];
        own.single(0, 1, CancelToken::of_thread(), own.in_lanes(&[0])?)
    };
    let ensemble = Ensemble::new(Box::new(begin), (count, 1), threads, layout, t0);
    Ok(Box::new(ensemble))
}

/// Begins the runs of a job that fits its Hamiltonian.
struct Starter {
    hamiltonian: Arc<Hamiltonian>,
    method: Method,
    job: Job,
}

type Begun = Result<Box<dyn Advance>, StepError>;

impl Starter {
    fn new(hamiltonian: Arc<Hamiltonian>, method: Method, job: Job) -> Result<Self, StartError> {
        let (n, members) = (job.n, job.members.unwrap_or(1));
        let fits = n == hamiltonian.places()
            && members > 0
            && job.psi.iter().all(|part| part.len() == members * n);
        if !fits || n == 0 || job.stops.iter().any(|(_, steps)| *steps == 0) {
            return Err(StartError::Invalid(format!(
                "wave functions are rows of {n} values, and steps at least one"
            )));
        }
        let is_back = job.stops.first().is_some_and(|(t, _)| *t < job.t0);
        let times = job.stops.iter().map(|(t, _)| *t).collect();
        Ok(Self {
            method: method.fitted(&hamiltonian, times, is_back)?,
            hamiltonian,
            job,
        })
    }

    /// The times of the records of an ensemble, and how many numbers a member has in each.
    fn layout(&self) -> RecordLayout {
        let ends = self.job.stops.iter().map(|(t, _)| *t);
        RecordLayout::Aligned {
            times: std::iter::once(self.job.t0).chain(ends).collect(),
            width: self.observer(1).columns(self.job.n),
        }
    }

    fn sweeper<S: Stored>(&self, threads: usize) -> Sweeper<S> {
        Sweeper::new(self.hamiltonian.clone()).with_threads(threads)
    }

    /// The only run, which takes the state as it is.
    fn only(&mut self, cancel: CancelToken) -> Begun {
        let [q, p] = std::mem::take(&mut self.job.psi);
        self.single(0, self.job.threads, cancel, Wave::new(q, p))
    }

    /// A run of one member.
    fn single(
        &self,
        member: usize,
        threads: usize,
        cancel: CancelToken,
        state: Wave<f64>,
    ) -> Begun {
        let sweeper = self.sweeper(threads);
        let sweeper = sweeper.with_recorder(self.job.recorders.get(member).cloned());
        let stepper = self.method.single(sweeper, cancel)?;
        self.launch(stepper, 1, state)
    }

    /// A run of these members in lock-step.
    fn block(&self, members: &[usize]) -> Begun {
        let stepper = self.method.lockstep::<Lanes<WIDTH>>(self.sweeper(1));
        self.launch(stepper, members.len(), self.in_lanes(members)?)
    }

    /// All members: in lock-step if they share a matrix by rows and are not too few.
    fn ensemble(self, members: usize) -> Ensemble {
        let bytes = self.method.states() * size_of::<[Lanes<WIDTH>; 2]>() * self.job.n;
        let is_lockstep = !self.method.is_single()
            && self.job.recorders.is_empty()
            && self.hamiltonian.reach().is_some()
            && bytes <= LOCKSTEP;
        let block = if is_lockstep && 2 * members >= WIDTH {
            WIDTH
        } else {
            1
        };
        let (t0, threads) = (self.job.t0, self.job.threads);
        let layout = self.layout();
        let begin = move |members: &[usize]| match members {
            [member] => {
                let state = self.in_lanes(&[*member])?;
                self.single(*member, 1, CancelToken::of_thread(), state)
            }
            _ => self.block(members),
        };
        Ensemble::new(Box::new(begin), (members, block), threads, layout, t0)
    }

    fn observer(&self, members: usize) -> Observer {
        Observer::new(members, self.job.states, self.job.observables.clone())
    }

    fn launch<S: Stored>(
        &self,
        stepper: Box<dyn Stepper<State = Wave<S>>>,
        members: usize,
        state: Wave<S>,
    ) -> Begun {
        let control = BetweenTimes::new(stepper, self.job.t0, self.job.stops.clone());
        let state = state.with_phase(self.method.shift() * self.job.t0);
        let observer = Box::new(self.observer(members));
        let records = self.job.stops.len() + 1;
        let run = Run::new(Box::new(control), observer, state, (1, records))?;
        Ok(Box::new(run.of_members(members)))
    }

    /// Wave functions in lock-step; places without a member follow the last.
    fn in_lanes<S: Stored>(&self, members: &[usize]) -> Result<Wave<S>, StepError> {
        let n = self.job.n;
        let part = |part: usize| {
            let mut values = Vec::new();
            resize(&mut values, n, S::splat(0.0))?;
            for (i, value) in values.iter_mut().enumerate() {
                for place in 0..S::MEMBERS {
                    let member = members[place.min(members.len() - 1)];
                    value.set_member(place, self.job.psi[part][member * n + i]);
                }
            }
            Ok(values)
        };
        Ok(Wave::new(part(0)?, part(1)?))
    }
}
