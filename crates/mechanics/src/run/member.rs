//! The parts of a run that each member has of its own: start, parameters, observer, monitor, detector.

use super::{Begun, Starter};
use crate::events::{DenseDetector, Event};
use crate::problem::{Carried, MechanicalMonitor, Model, Observer, Path, TimeScale, Traced};
use crate::spark::BATCH;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::Composed;
use liouville_base::method::{Stepper, Symmetric};
use liouville_base::observe::Observe;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::run::{EventDetector, Fixed, Run, StepControl};
use liouville_base::tape::Tape;

/// A stepper of any kind for a type of state.
pub(super) type BoxedStepper<State> = Box<dyn Stepper<State = State>>;

impl Starter {
    /// Whether all members have the same parameters.
    pub(super) fn is_common(&self) -> bool {
        self.job.params.len() == self.system.mechanical().stage.inputs()[3]
    }

    /// A member's parameters.
    pub(super) fn params(&self, member: usize) -> &[f64] {
        let width = self.system.mechanical().stage.inputs()[3];
        let row = if self.is_common() { 0 } else { member };
        &self.job.params[row * width..(row + 1) * width]
    }

    /// A part of a member's start: y, z or a.
    pub(super) fn part(&self, part: usize, member: usize) -> &[f64] {
        let n = self.system.mechanical().n;
        &self.job.start[part][member * n..(member + 1) * n]
    }

    fn model(&self, member: usize) -> Model {
        Model::new(self.system.mechanical().clone(), self.params(member))
    }

    /// The observer of a member.
    pub(super) fn observer(&self, member: usize) -> Observer {
        let (params, tape) = (self.params(member), self.job.observer.clone());
        Observer::new(self.model(member), params, tape, self.job.states)
    }

    /// A tape with whether it depends on z', or the time scale of the acceleration.
    pub(super) fn monitor(
        &self,
        member: usize,
        monitor: Option<&(Tape, bool)>,
        first: f64,
    ) -> MechanicalMonitor {
        let (model, params) = (self.model(member), self.params(member));
        if let Some((tape, of_acceleration)) = monitor {
            let traced = Traced::new(model, params, tape.clone(), *of_acceleration);
            return MechanicalMonitor::Traced(Box::new(traced));
        }
        let (y, z) = (self.part(0, member), self.part(1, member));
        let scale = TimeScale::new(model, (self.job.span.t0, y, z), first);
        MechanicalMonitor::Own(Box::new(scale))
    }

    /// A copy of a stepper for the event detector, if there is to be one.
    pub(super) fn copy<S: Stepper + Clone + 'static>(
        &self,
        stepper: &S,
    ) -> Option<BoxedStepper<S::State>> {
        let copy = || Box::new(stepper.clone()) as BoxedStepper<S::State>;
        self.job.detection.is_some().then(copy)
    }

    /// A run of one member, with an event detector where `copy` makes its partial steps.
    pub(super) fn launch<State: Carried + Checkpoint + Clone + 'static>(
        &self,
        control: Box<dyn StepControl<State>>,
        copy: Option<BoxedStepper<State>>,
        member: usize,
        state: State,
    ) -> Begun {
        let observer = self.observer(member);
        let mut expected = match control.sizes() {
            None => self.job.span.records(),
            Some(_) => 0,
        };
        let mut events = None;
        if let (Some(detection), Some(stepper)) = (&self.job.detection, copy) {
            let params = self.params(member);
            let functions = detection.events.iter().enumerate();
            let functions = functions.map(|(k, event)| {
                let (direction, terminal) = (event.direction, event.terminal);
                let tape = event.tape.clone();
                Event::new(k, tape, params, direction, terminal, event.needs_lam)
            });
            let recorded = (observer.clone(), detection.times.clone());
            expected = detection.times.as_ref().map_or(expected, Vec::len);
            let path = Path::new(self.model(member), detection.order);
            let detector = DenseDetector::new(path, stepper, &state, functions.collect(), recorded);
            events = Some(Box::new(detector) as Box<dyn EventDetector<State>>);
        }
        let kept = (self.job.span.every, expected);
        let run = Run::with_events(control, Box::new(observer), state, kept, events)?;
        Ok(Box::new(run))
    }

    /// A run by equal steps.
    pub(super) fn fixed<State: Checkpoint + 'static>(
        &self,
        stepper: BoxedStepper<State>,
        observer: Box<dyn Observe<State>>,
        state: State,
    ) -> Begun {
        let span = self.job.span;
        let control = Box::new(Fixed::new(stepper, span.t0, span.h(), span.steps));
        let run = Run::new(control, observer, state, (span.every, span.records()))?;
        Ok(Box::new(run))
    }
}

/// A symmetric method, alone or composed.
pub(super) fn composed<S>(stepper: S, stages: Option<&[f64]>) -> BoxedStepper<S::State>
where
    S: Symmetric + 'static,
    S::State: Clone,
{
    match stages {
        None => Box::new(stepper),
        Some(stages) => Box::new(Composed::of_stages(stepper, stages)),
    }
}

/// Rows of several members in lock-step; places without a member follow the last.
pub(super) fn in_lanes<'a>(
    members: &[usize],
    row: impl Fn(usize) -> &'a [f64],
) -> Vec<Lanes<BATCH>> {
    let mut values = vec![Lanes::splat(0.0); row(members[0]).len()];
    for place in 0..BATCH {
        let member = members[place.min(members.len() - 1)];
        for (value, x) in values.iter_mut().zip(row(member)) {
            value.set_member(place, *x);
        }
    }
    values
}
