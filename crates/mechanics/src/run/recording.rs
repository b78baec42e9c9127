//! Runs whose steps are recorded as they are made, and the adjoints of their methods.

use super::Starter;
use super::member::{BoxedStepper, Member, MonitoredSteps};
use crate::events::LinearReset;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::method::{Estimating, Symmetric};
use liouville_base::recorder::{Recordable, Recorded, Recorder, SharedRecords, StepRecord};
use liouville_base::run::StepControl;
use liouville_problem::{Carried, Cotangents, Directions, ObservePoint};

/// The adjoint of the recorded steps of a method.
pub trait StepAdjoint: Send + Sync {
    /// The state that the method carries from step to step.
    type State: Carried + Checkpoint + Recorded + Clone;

    /// The adjoint of the values at a point, which takes their cotangents to y, z and τ there.
    type Point: ObservePoint;

    /// The numbers of cotangents of y, of z and of the carried state, of n coordinates.
    fn sizes(n: usize) -> [usize; 3];

    /// Takes cotangents from the end of a step to its start.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn follow(
        &mut self,
        record: &StepRecord<Self::State>,
        point: &mut Self::Point,
        of: &mut Cotangents,
    ) -> Result<(), StepError>;

    /// Takes cotangents of the carried state, where a motion begins, to y, z and τ there, unless it was given.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn leave(
        &mut self,
        at: (f64, &Self::State),
        is_given: bool,
        point: &mut Self::Point,
        of: &mut Cotangents,
    ) -> Result<(), StepError>;
}

/// Steps that are recorded as they are made.
pub(super) struct RecordedSteps<State: Checkpoint> {
    pub(super) control: Box<dyn StepControl<State>>,
    /// Makes parts of steps for an event detector.
    pub(super) copy: Option<BoxedStepper<State>>,
    /// The records of these two.
    pub(super) whole: SharedRecords<State>,
    pub(super) partial: SharedRecords<State>,
    /// How many times the method is at work in a step.
    pub(super) parts: usize,
}

/// A run whose steps are recorded, and the adjoint of its method.
pub(super) struct Recording<A: StepAdjoint> {
    pub(super) adjoint: A,
    pub(super) steps: RecordedSteps<A::State>,
    /// The model, and the solver of states after resets.
    pub(super) member: Member<A::State, <A::Point as ObservePoint>::Model>,
    pub(super) point: A::Point,
    /// The derivatives of resets.
    pub(super) reset: Box<dyn LinearReset>,
    /// Numbers of y, z and multipliers of a step.
    pub(super) sizes: [usize; 3],
    pub(super) start: A::State,
    /// Whether the whole carried state was given at the start.
    pub(super) is_given: bool,
}

/// No directions of a run, beside those that its steps follow, and no changes of y and z at its start.
pub(super) fn no_directions(n: usize, width: usize) -> (Directions, [Matrix; 2]) {
    let directions = Directions {
        tau: Matrix::zeros(0, width),
        stretch: Vec::new(),
    };
    (directions, [0, 0].map(|rows| Matrix::zeros(rows, n)))
}

impl Starter {
    /// The recorded steps of a method, alone or composed, from a start: controlled by its errors, or by a monitor if
    /// there is one, or equal. `part` makes parts of steps.
    pub(super) fn recorded_steps<M, P>(
        &self,
        (stepper, part, stages): (M, P, Option<&[f64]>),
        sizes: Option<(f64, f64)>,
        monitor: MonitoredSteps<M::State>,
        start: &M::State,
    ) -> RecordedSteps<M::State>
    where
        M: Recordable + Estimating + Symmetric + Clone + 'static,
        M::State: Recorded + Clone + Send,
        P: Recordable<State = M::State> + Symmetric + Clone + 'static,
    {
        let (whole, partial) = (SharedRecords::default(), SharedRecords::default());
        let part = Recorder::new(part, partial.clone());
        let recorder = Recorder::new(stepper, whole.clone());
        RecordedSteps {
            copy: self.composed_copy((&part, stages)),
            control: match sizes {
                None => self.symmetric_control((recorder, stages), monitor, start),
                Some(sizes) => self.adaptive_control(recorder, sizes),
            },
            whole,
            partial,
            parts: stages.map_or(1, <[f64]>::len),
        }
    }
}
