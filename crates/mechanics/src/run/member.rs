//! The parts of a run that each member has of its own: start, parameters, observer, monitor, detector.

use super::{Begun, Control, Starter, System};
use crate::events::{DenseDetector, Event, Reset, SlopesModel};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::Composed;
use liouville_base::method::{Estimating, Stepper, Symmetric};
use liouville_base::observe::{Monitor, Observe, Watch};
use liouville_base::real::{BATCH, Lanes, Scalar};
use liouville_base::run::{Adaptive, EventDetector, Fixed, Reversible, Run, StepControl};
use liouville_problem::{
    Carried, Dynamics, Impulse, Model, Observer, Path, Restart, State, StepWatch, TimeScale, Traced,
};

/// A stepper of any kind for a type of state.
pub(super) type BoxedStepper<State> = Box<dyn Stepper<State = State>>;

/// The monitor that reversible steps follow, with the first step and the least; none where steps are equal.
pub(super) type MonitoredSteps<State> = Option<(Box<dyn Monitor<State>>, [f64; 2])>;

/// The observers of a member's states at steps, and at given times.
pub(super) type Observed<State> = [Box<dyn Observe<State>>; 2];

/// A member: its number, its model, and the solver of its states after resets, where events have them.
pub(super) struct Member<State, M: Dynamics = Model> {
    pub(super) number: usize,
    pub(super) model: M,
    pub(super) restart: Option<Box<dyn Restart<State>>>,
}

impl Starter {
    /// Whether events have resets.
    pub(super) fn has_resets(&self) -> bool {
        let detection = self.job.detection.iter();
        detection
            .flat_map(|detection| &detection.events)
            .any(|event| event.reset.is_some())
    }

    /// The derivatives of a member's events, if there are any.
    pub(super) fn slopes(&self, member: usize) -> Vec<SlopesModel> {
        let (detection, params) = (self.job.detection.iter(), self.params(member));
        let events = detection.flat_map(|detection| &detection.events);
        let events = events.enumerate().filter_map(|(k, event)| {
            let law = event.reset.as_ref().map(|(law, _)| law);
            let slopes = event.slopes.as_ref()?;
            Some(SlopesModel::new(k, slopes, law, params))
        });
        events.collect()
    }

    /// The impulses of a mechanical member.
    pub(super) fn impulse(&self, member: usize) -> Option<Impulse> {
        self.has_resets().then(|| Impulse::new(self.model(member)))
    }

    /// A member whose states have coordinates and momenta.
    pub(super) fn member(&self, number: usize) -> Member<State> {
        let impulse = self.impulse(number);
        Member {
            number,
            model: self.model(number),
            restart: impulse.map(|impulse| Box::new(impulse) as _),
        }
    }

    /// Whether all members have the same parameters.
    pub(super) fn is_common(&self) -> bool {
        self.job.params.len() == self.system.sizes().1
    }

    /// A member's parameters.
    pub(super) fn params(&self, member: usize) -> &[f64] {
        let (_, width) = self.system.sizes();
        let row = if self.is_common() { 0 } else { member };
        &self.job.params[row * width..(row + 1) * width]
    }

    /// The watch over the steps of a member.
    pub(super) fn watch<S: Carried>(&self, member: usize) -> Option<Box<dyn Watch<S>>> {
        if let System::Index2(..) = self.system {
            return None;
        }
        let (problem, params) = (self.system.mechanical(), self.params(member));
        let watch = StepWatch::new(problem, params, &self.job.watched, &[member])?;
        Some(Box::new(watch))
    }

    /// A part of a member's start: y, z or a.
    pub(super) fn part(&self, part: usize, member: usize) -> &[f64] {
        let ([n, l], _) = self.system.sizes();
        let width = [n, l, n][part];
        &self.job.start[part][member * width..(member + 1) * width]
    }

    /// The mechanical model of a member.
    pub(super) fn model(&self, member: usize) -> Model {
        Model::new(self.system.mechanical().clone(), self.params(member))
    }

    /// The observer of a member with this model.
    pub(super) fn observer<M: Dynamics>(&self, model: M, member: usize) -> Observer<M> {
        let (params, own) = (self.params(member), &self.job.recorded);
        Observer::new(model, params, own.tape.clone(), own.states)
            .turning(own.turning.as_ref(), params)
    }

    /// The monitor of a mechanical member, if its steps follow one: a function of the user's, or the time scale
    /// of the acceleration.
    pub(super) fn monitor<S: Carried>(&self, member: usize) -> MonitoredSteps<S> {
        let traced = self.traced(member, || self.model(member));
        let Control::Reversible { h_first, h_min, .. } = self.job.control else {
            return None;
        };
        traced.or_else(|| {
            let at = (self.job.span.t0, self.part(0, member), self.part(1, member));
            let scale = TimeScale::new(self.model(member), at, h_first);
            Some((Box::new(scale) as Box<dyn Monitor<S>>, [h_first, h_min]))
        })
    }

    /// The monitor that is a function of the user's, if the steps follow one.
    pub(super) fn traced<S: Carried, M: Dynamics>(
        &self,
        member: usize,
        model: impl FnOnce() -> M,
    ) -> MonitoredSteps<S> {
        let Control::Reversible {
            h_first,
            h_min,
            monitor: Some((tape, of_z_dot)),
        } = &self.job.control
        else {
            return None;
        };
        let traced = Traced::new(model(), self.params(member), tape.clone(), *of_z_dot);
        Some((Box::new(traced), [*h_first, *h_min]))
    }

    /// A copy of a stepper for the event detector, if there is to be one.
    pub(super) fn copy<S: Stepper + Clone + 'static>(
        &self,
        stepper: &S,
    ) -> Option<BoxedStepper<S::State>> {
        let copy = || Box::new(stepper.clone()) as BoxedStepper<S::State>;
        self.job.detection.is_some().then(copy)
    }

    /// A copy of a symmetric stepper, alone or composed.
    pub(super) fn composed_copy<S>(
        &self,
        (stepper, stages): (&S, Option<&[f64]>),
    ) -> Option<BoxedStepper<S::State>>
    where
        S: Symmetric + Clone + 'static,
        S::State: Clone,
    {
        match stages {
            None => self.copy(stepper),
            Some(_) if self.job.detection.is_none() => None,
            Some(stages) => self.copy(&Composed::of_stages(stepper.clone(), stages)),
        }
    }

    /// A run by steps that an estimate of their errors controls, from a first one.
    pub(super) fn adaptive<S, M: Dynamics>(
        &self,
        stepper: S,
        (h_first, h_min): (f64, f64),
        member: Member<S::State, M>,
        state: S::State,
    ) -> Begun
    where
        S: Estimating + Clone + 'static,
        S::State: Carried + Clone,
    {
        let copy = self.copy(&stepper);
        let control = self.adaptive_control(stepper, (h_first, h_min));
        self.launch(control, copy, member, state)
    }

    /// The control of a method by an estimate of its errors.
    pub(super) fn adaptive_control<S: Estimating + 'static>(
        &self,
        stepper: S,
        (h_first, h_min): (f64, f64),
    ) -> Box<dyn StepControl<S::State>> {
        let ends = (self.job.span.t0, self.job.span.t1);
        Box::new(Adaptive::new(Box::new(stepper), ends, h_first, h_min))
    }

    /// A run of a symmetric method, alone or composed, by steps that follow a monitor, if there is one, or by equal
    /// steps.
    pub(super) fn symmetric<S, M: Dynamics>(
        &self,
        (stepper, stages): (S, Option<&[f64]>),
        monitor: MonitoredSteps<S::State>,
        of: Member<S::State, M>,
        state: S::State,
    ) -> Begun
    where
        S: Symmetric + Clone + 'static,
        S::State: Carried + Clone,
    {
        let copy = self.composed_copy((&stepper, stages));
        let control = self.symmetric_control((stepper, stages), monitor, &state);
        self.launch(control, copy, of, state)
    }

    /// The control of a symmetric method, alone or composed, that follows a monitor or makes equal steps.
    pub(super) fn symmetric_control<S>(
        &self,
        (stepper, stages): (S, Option<&[f64]>),
        monitor: MonitoredSteps<S::State>,
        state: &S::State,
    ) -> Box<dyn StepControl<S::State>>
    where
        S: Symmetric + 'static,
        S::State: Clone,
    {
        match stages {
            None => self.following(stepper, monitor, state),
            Some(stages) => self.following(Composed::of_stages(stepper, stages), monitor, state),
        }
    }

    fn following<S: Symmetric + 'static>(
        &self,
        stepper: S,
        monitor: MonitoredSteps<S::State>,
        state: &S::State,
    ) -> Box<dyn StepControl<S::State>> {
        let (span, stepper) = (self.job.span, Box::new(stepper));
        match monitor {
            Some((monitor, [h_first, h_min])) => {
                let (ends, sizes) = ((span.t0, span.t1), (h_first, h_min));
                Box::new(Reversible::new(stepper, ends, sizes, monitor, state))
            }
            None => Box::new(self.fixed_steps(stepper)),
        }
    }

    /// Equal steps, or those of another run.
    pub(super) fn fixed_steps<State: Checkpoint>(
        &self,
        stepper: BoxedStepper<State>,
    ) -> Fixed<State> {
        let span = self.job.span;
        match &self.job.control {
            Control::Held(ends) => Fixed::between(stepper, ends.clone()),
            _ => Fixed::new(stepper, span.t0, span.h(), span.steps),
        }
    }

    /// A run of one member, with an event detector where `copy` makes its partial steps.
    pub(super) fn launch<State: Carried + Checkpoint + Clone + 'static, M: Dynamics>(
        &self,
        control: Box<dyn StepControl<State>>,
        copy: Option<BoxedStepper<State>>,
        member: Member<State, M>,
        state: State,
    ) -> Begun {
        if self.job.detection.is_none() {
            let observer = self.observer(member.model, member.number);
            return self.recorded(control, Box::new(observer), state, member.number);
        }
        let observer = self.observer(member.model.clone(), member.number);
        let observed = [Box::new(observer.clone()) as _, Box::new(observer) as _];
        let stepping = (control, copy);
        self.launch_observed(stepping, member, state, observed, |detector| detector)
    }

    /// The same with other observers, and a detector that `with` makes of one.
    pub(super) fn launch_observed<State: Carried + Checkpoint + Clone + 'static, M: Dynamics>(
        &self,
        (control, copy): (Box<dyn StepControl<State>>, Option<BoxedStepper<State>>),
        Member {
            number: member,
            model,
            restart,
        }: Member<State, M>,
        state: State,
        [observer, at_times]: Observed<State>,
        with: impl FnOnce(DenseDetector<State, M>) -> DenseDetector<State, M>,
    ) -> Begun {
        let mut expected = match control.sizes() {
            None => self.job.span.records(),
            Some(_) => 0,
        };
        let mut events = None;
        if let (Some(detection), Some(stepper)) = (&self.job.detection, copy) {
            let params = self.params(member);
            let functions = detection.events.iter().enumerate();
            let functions = functions.map(|(k, event)| {
                if event.is_switch {
                    return Event::switch(k, event.tape.clone(), params);
                }
                let tape = event.tape.clone();
                let reset = event.reset.clone();
                let reset = reset.map(|(law, rate)| Reset::new(law, rate, params));
                Event::new(tape, params, event.rule, event.needs_lam).with_reset(reset)
            });
            let recorded = (at_times, detection.times.clone());
            expected = detection.times.as_ref().map_or(expected, Vec::len);
            let path = Path::new(model, detection.order);
            let functions = functions.collect();
            let mut detector = DenseDetector::new(path, stepper, &state, functions, recorded);
            if let Some(restart) = restart {
                detector = detector.resetting(restart, self.system.holonomic());
            }
            events = Some(Box::new(with(detector)) as Box<dyn EventDetector<State>>);
        }
        let kept = (self.job.span.every, expected);
        let run = Run::with_events(control, observer, state, kept, events)?;
        Ok(Box::new(run.watched(self.watch(member))?))
    }

    /// A run of several members by equal steps.
    pub(super) fn fixed<State: Checkpoint + 'static>(
        &self,
        stepper: BoxedStepper<State>,
        observer: Box<dyn Observe<State>>,
        state: State,
        (members, watch): (usize, Option<Box<dyn Watch<State>>>),
    ) -> Begun {
        let span = self.job.span;
        let control = Box::new(Fixed::new(stepper, span.t0, span.h(), span.steps));
        let run = Run::new(control, observer, state, (span.every, span.records()))?;
        Ok(Box::new(run.of_members(members).watched(watch)?))
    }

    /// A run without events by steps of this control.
    pub(super) fn recorded<State: Carried + Checkpoint + 'static>(
        &self,
        control: Box<dyn StepControl<State>>,
        observer: Box<dyn Observe<State>>,
        state: State,
        member: usize,
    ) -> Begun {
        let expected = match control.sizes() {
            None => self.job.span.records(),
            Some(_) => 0,
        };
        let run = Run::new(control, observer, state, (self.job.span.every, expected))?;
        Ok(Box::new(run.watched(self.watch(member))?))
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
