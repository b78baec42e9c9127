//! Runs of split fields: a split, a composition and a job become one run.

mod job;
mod pullback;

pub use job::{Job, Recorded};
pub use pullback::{Cotangents, Pullback};

use crate::problem::{Piece, Split};
use crate::volume::{
    Determinant, Observer, Plane, Section, State, TangentObserver, TangentRows, Tangents, Volume,
    WithoutTangents,
};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::Composed;
use liouville_base::ensemble::{Ensemble, RecordLayout};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::observe::Observe;
use liouville_base::real::{Lanes, Real};
use liouville_base::run::{
    Advance, Fixed, Run, Span, StartError, SubstepDetector, WatchedFunction,
};
use liouville_base::simd::Stored;
use liouville_base::tableau::Scheme;
use std::sync::Arc;

/// Trajectories in lock-step: many hide the cost of deciding on their next flow ...
const BLOCK: usize = 128;
/// ... even more do where the first cache has room for their variables: with as many places as this, ...
const LARGE_BLOCK: usize = 512;
const FEW_PLACES: usize = 4;
/// ... and so many for each thread that the last block does not matter, ...
const MANY: usize = 8 * LARGE_BLOCK;
/// ... but where there are few, a block would be mostly empty, or threads would have none.
const SMALL_BLOCK: usize = 16;

/// The composition of the flows of a split.
#[derive(Clone, Copy, Debug)]
pub struct Method {
    /// Its scheme.
    pub scheme: &'static Scheme,
    /// Whether sums are compensated.
    pub is_compensated: bool,
}

/// A run about to start.
///
/// # Errors
/// The job does not fit the split, or the start of a single run failed.
pub fn start(split: Arc<Split>, method: Method, job: Job) -> Result<Box<dyn Advance>, StartError> {
    job.check(&split)?;
    let clock = job.clock(&split);
    let starter = Starter {
        split,
        method,
        job,
        clock,
    };
    match (starter.job.members, &starter.job.recorded) {
        (None, Recorded::Determinants) => Ok(starter.determinants()?),
        (None, _) if starter.has_tangents() => Ok(starter.tangents(0)?),
        (None, _) => Ok(starter.begin(starter.stepper::<f64>(starter.job.threads), &[0])?),
        (Some(members), Recorded::Section(plane)) => {
            let plane = plane.clone();
            Ok(Box::new(starter.section(members, plane)))
        }
        (Some(members), _) => Ok(Box::new(starter.ensemble(members)?)),
    }
}

/// Begins the runs of a job that fits its split.
struct Starter {
    split: Arc<Split>,
    method: Method,
    job: Job,
    clock: Option<usize>,
}

type Begun = Result<Box<dyn Advance>, StepError>;

impl Starter {
    /// A stepper of as many trajectories as `S` has members.
    fn stepper<S: Stored>(&self, threads: usize) -> Composed<Volume<S>> {
        Composed::new(self.volume().with_threads(threads), self.method.scheme)
    }

    /// The split of a member.
    fn split_of(&self, member: usize) -> &Arc<Split> {
        self.job.varied.get(member).unwrap_or(&self.split)
    }

    /// A stepper of one member.
    fn single(&self, member: usize) -> Composed<Volume<f64>> {
        let split = self.split_of(member).clone();
        let volume = Volume::new(split, self.method.is_compensated);
        Composed::new(volume, self.method.scheme)
    }

    /// The flows of the pieces.
    fn volume<S: Stored>(&self) -> Volume<S> {
        Volume::new(self.split.clone(), self.method.is_compensated).with_clock(self.clock)
    }

    /// A run of these members in lock-step.
    fn begin<S: Stored>(&self, stepper: Composed<Volume<S>>, members: &[usize]) -> Begun {
        let volume = stepper.parts();
        let state = volume.state(&self.in_lanes(members));
        let observer = self.observer(volume, members);
        if self.job.times.is_empty() && self.job.events.is_empty() {
            return self.launch(Box::new(stepper), Box::new(observer), state, members.len());
        }
        let detector = self.detector(&stepper, &observer, &state, members);
        self.launch_watched(Box::new(stepper), Box::new(observer), state, detector)
    }

    /// The detector of given times and events of these members.
    fn detector<S: Stored>(
        &self,
        stepper: &Composed<Volume<S>>,
        observer: &Observer<S>,
        state: &State<S>,
        members: &[usize],
    ) -> SubstepDetector<State<S>> {
        let (volume, variables) = (stepper.parts().clone(), self.job.variables.clone());
        let reader = Observer::of_states(volume, variables, members.len());
        SubstepDetector::new(
            Box::new(stepper.clone()),
            state,
            (Box::new(reader), self.watched(members[0])),
            (Box::new(observer.clone()), self.times()),
        )
    }

    /// The times of the records, where they are given.
    fn times(&self) -> Option<Vec<f64>> {
        Some(self.job.times.clone()).filter(|times| !times.is_empty())
    }

    fn launch_watched<X: Checkpoint + Clone + 'static>(
        &self,
        stepper: Box<dyn Stepper<State = X>>,
        observer: Box<dyn Observe<X>>,
        state: X,
        detector: SubstepDetector<X>,
    ) -> Begun {
        let span = self.job.span;
        let expected = self.times().map_or(span.records(), |times| times.len());
        let control = Box::new(Fixed::new(stepper, span.t0, span.h(), span.steps));
        let (kept, events) = ((span.every, expected), Some(Box::new(detector) as _));
        Ok(Box::new(Run::with_events(
            control, observer, state, kept, events,
        )?))
    }

    /// The functions whose zeros are events of a member.
    fn watched(&self, member: usize) -> Vec<WatchedFunction> {
        let Recorded::Observables { params, .. } = &self.job.recorded else {
            return Vec::new();
        };
        let params = self.job.params_of(params, member);
        let functions = self.job.events.iter();
        let functions =
            functions.map(|(tape, rule)| WatchedFunction::new(tape.clone(), params, *rule));
        functions.collect()
    }

    /// An observer of these members, the first trajectories that `volume` steps.
    fn observer<S: Stored>(&self, volume: &Volume<S>, members: &[usize]) -> Observer<S> {
        let Recorded::Observables {
            tape,
            params,
            states,
        } = &self.job.recorded
        else {
            unreachable!("sections and determinants have runs of their own");
        };
        let (variables, tape) = (self.job.variables.clone(), tape.clone());
        let (count, params) = (members.len(), self.job.params_of(params, members[0]));
        Observer::new(volume.clone(), variables, count, tape, params, *states)
    }

    fn has_tangents(&self) -> bool {
        !self.job.directions.is_empty()
    }

    /// A run of one member with its tangents.
    fn tangents(&self, member: usize) -> Begun {
        let (n, directions) = (self.split.n(), &self.job.directions);
        let Method {
            scheme,
            is_compensated,
        } = self.method;
        let stepper = Tangents::new(
            self.split_of(member).clone(),
            scheme,
            is_compensated,
            directions.len() / n,
        )
        .with_constants(scheme, &self.job.constants);
        let state = stepper.state(&self.in_lanes::<f64>(&[member]), directions);
        let plain = self.observer(stepper.volume(), &[member]);
        let variables = self.job.variables.clone();
        let rows = TangentRows { variables, n };
        let observer = TangentObserver::new(plain, rows.clone(), self.observed());
        if self.job.times.is_empty() && self.job.events.is_empty() {
            return self.launch(Box::new(stepper), Box::new(observer), state, 1);
        }
        let span = self.job.span;
        let (volume, variables) = (stepper.volume().clone(), rows.variables.clone());
        let reader = Box::new(WithoutTangents(Observer::of_states(volume, variables, 1)));
        let parts = (stepper.clone()).to_held_times((span.t0, span.h()), &self.job.starts);
        let detector = SubstepDetector::new(
            Box::new(parts),
            &state,
            (reader, self.watched(member)),
            (Box::new(observer.clone()), self.times()),
        )
        .beside_hits(Box::new(rows), &state);
        self.launch_watched(Box::new(stepper), Box::new(observer), state, detector)
    }

    /// How many quantities are recorded beside states and tangents.
    fn observed(&self) -> usize {
        match &self.job.recorded {
            Recorded::Observables { tape, .. } => tape.outputs(),
            _ => 0,
        }
    }

    /// Whether the first cache has room for many trajectories: those on a grid have polynomials beside their variables.
    fn is_light(&self) -> bool {
        let mut pieces = self.split.pieces().iter();
        let has_planes = pieces.any(|piece| matches!(piece, Piece::Plane { .. }));
        !has_planes && self.volume::<f64>().places() <= FEW_PLACES
    }

    /// All members, in blocks.
    fn ensemble(self, members: usize) -> Result<Ensemble, StepError> {
        let (span, threads) = (self.job.span, self.job.threads);
        let block = match members / threads {
            0..BLOCK => SMALL_BLOCK,
            MANY.. if self.is_light() => LARGE_BLOCK,
            _ => BLOCK,
        };
        let states = matches!(
            self.job.recorded,
            Recorded::Observables { states: true, .. }
        );
        let rows = usize::from(states) + self.job.directions.len() / self.split.n();
        let width = self.observed() + rows * self.job.variables.n;
        let given = Some(self.job.times.clone()).filter(|times| !times.is_empty());
        let layout = RecordLayout::Aligned {
            times: given.map_or_else(|| span.times(), Ok)?,
            width,
        };
        if self.has_tangents() || !self.job.varied.is_empty() || !self.job.events.is_empty() {
            let begin = move |members: &[usize]| {
                if self.has_tangents() {
                    self.tangents(members[0])
                } else {
                    self.begin(self.single(members[0]), members)
                }
            };
            let each = (members, 1);
            return Ok(Ensemble::new(
                Box::new(begin),
                each,
                threads,
                layout,
                span.t0,
            ));
        }
        let large = self.stepper::<Lanes<LARGE_BLOCK>>(1);
        let many = self.stepper::<Lanes<BLOCK>>(1);
        let few = self.stepper::<Lanes<SMALL_BLOCK>>(1);
        let begin = move |members: &[usize]| {
            if members.len() > BLOCK {
                self.begin(large.clone(), members)
            } else if members.len() > SMALL_BLOCK {
                self.begin(many.clone(), members)
            } else {
                self.begin(few.clone(), members)
            }
        };
        Ok(Ensemble::new(
            Box::new(begin),
            (members, block),
            threads,
            layout,
            span.t0,
        ))
    }

    /// All members, in blocks, with the points where they pass a plane.
    fn section(self, members: usize, plane: Plane) -> Ensemble {
        let Span { t0, .. } = self.job.span;
        let (threads, width) = (self.job.threads, 2 + self.job.variables.n);
        let layout = RecordLayout::Ragged { width };
        if !self.job.varied.is_empty() {
            let begin = move |members: &[usize]| {
                let single = self.single(members[0]);
                self.passages(single.parts(), single.parts(), members, &plane)
            };
            return Ensemble::new(Box::new(begin), (members, 1), threads, layout, t0);
        }
        let volume = self.volume::<Lanes<SMALL_BLOCK>>();
        let single = self.volume::<f64>();
        let begin = move |members: &[usize]| self.passages(&volume, &single, members, &plane);
        Ensemble::new(Box::new(begin), (members, SMALL_BLOCK), threads, layout, t0)
    }

    /// A run of these members with the points where they pass a plane.
    fn passages<S: Stored + Real>(
        &self,
        volume: &Volume<S>,
        single: &Volume<f64>,
        members: &[usize],
        plane: &Plane,
    ) -> Begun {
        let state = volume.state(&self.in_lanes(members));
        let alone = Composed::new(single.clone(), self.method.scheme);
        let observer = Section::new(
            volume.clone(),
            (single.clone(), alone),
            self.job.variables.clone(),
            members.to_vec(),
            plane.clone(),
        );
        let span = self.job.span;
        let stepper = Box::new(Composed::new(volume.clone(), self.method.scheme));
        let control = Box::new(Fixed::new(stepper, span.t0, span.h(), span.steps));
        let run = Run::new(control, Box::new(observer), state, (1, 0))?;
        Ok(Box::new(run.of_members(members.len())))
    }

    /// A run of one trajectory with the determinants of its steps.
    fn determinants(&self) -> Begun {
        let Method {
            scheme,
            is_compensated,
        } = self.method;
        let stepper = Determinant::new(self.split.clone(), scheme, is_compensated);
        let state = stepper.state(&self.job.x);
        let observer = Box::new(self.job.variables.clone());
        self.launch(Box::new(stepper), observer, state, 1)
    }

    fn launch<X: Checkpoint + 'static>(
        &self,
        stepper: Box<dyn Stepper<State = X>>,
        observer: Box<dyn Observe<X>>,
        state: X,
        members: usize,
    ) -> Begun {
        let span = self.job.span;
        let control = Box::new(Fixed::new(stepper, span.t0, span.h(), span.steps));
        let run = Run::new(control, observer, state, (span.every, span.records()))?;
        Ok(Box::new(run.of_members(members)))
    }

    /// Starts of members in lock-step; places without a member follow the last.
    fn in_lanes<S: Stored>(&self, members: &[usize]) -> Vec<S> {
        let n = self.split.n();
        let mut start = vec![S::splat(0.0); n];
        for (i, value) in start.iter_mut().enumerate() {
            for place in 0..S::MEMBERS {
                let member = members[place.min(members.len() - 1)];
                value.set_member(place, self.job.x[member * n + i]);
            }
        }
        start
    }
}
