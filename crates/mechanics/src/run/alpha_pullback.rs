//! Pullbacks of the α family.

use super::pullback::Pullback;
use super::recording::{RecordedSteps, Recording, StepAdjoint, no_directions};
use super::{Job, Method, Problem, Starter, System};
use liouville_alpha::{AlphaAdjoint, AlphaSlopes, AlphaState, AlphaTangents, AlphaTransposed};
use liouville_base::error::StepError;
use liouville_base::recorder::{Recorder, SharedRecords, StepRecord};
use liouville_base::run::StartError;
use liouville_problem::{Cotangents, PointAdjoint, Sensitivity, SensitivityModel, TangentLed};
use std::sync::Arc;

impl StepAdjoint for AlphaAdjoint {
    type State = AlphaState;
    type Point = PointAdjoint;

    fn sizes(n: usize) -> [usize; 3] {
        [n, n, Self::carried(n)]
    }

    fn follow(
        &mut self,
        record: &StepRecord<AlphaState>,
        point: &mut PointAdjoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.follow(record, point, of)
    }

    fn leave(
        &mut self,
        (t, state): (f64, &AlphaState),
        is_given: bool,
        point: &mut PointAdjoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.leave((t, state, is_given), point, of)
    }
}

impl Pullback<AlphaAdjoint> {
    /// The pullback of a job's run, whose derivatives by τ are `sensitivity`, and those of a step with their transposes.
    ///
    /// # Errors
    /// The job is no such run, or its start failed.
    pub fn of_alpha(
        problem: Problem,
        method: Method,
        job: Job,
        sensitivity: &Arc<Sensitivity>,
        (slopes, transposed): (AlphaSlopes, AlphaTransposed),
    ) -> Result<Self, StartError> {
        let starter = Starter::new(problem, method, job)?;
        let System::Alpha(problem, weights, reactions, newton_tol) = &starter.system else {
            let sentence = "these are derivatives of a step of the α family";
            return Err(StartError::Invalid(sentence.into()));
        };
        let (n, m) = (problem.mechanical.n, problem.mechanical.m);
        let width = sensitivity.width() - 1;
        let fits = starter.has_pullback(sensitivity)
            && newton_tol.is_none()
            && slopes.fit((n, m, width), *reactions)
            && transposed.fit(&slopes, n, width);
        if !fits {
            let sentence =
                "a pullback of the α family is that of a single run, of events with derivatives";
            return Err(StartError::Invalid(sentence.into()));
        }
        let (stepper, start, sizes) = starter.alpha_at((problem, *weights, *reactions, None), 0)?;
        let params = starter.params(0);
        let of_led = slopes.clone();
        let adjoint = AlphaAdjoint::new((slopes, transposed), *reactions, params, n);
        let (whole, partial) = (SharedRecords::default(), SharedRecords::default());
        let member = starter.alpha_member(0, &stepper);
        let copy = starter.copy(&Recorder::new(stepper.clone(), partial.clone()));
        let control = if sizes.is_some() {
            let at = (
                starter.job.span.t0,
                start.clone(),
                starter.has_accelerations(),
            );
            let (directions, [y, z]) = no_directions(n, sensitivity.width());
            let derivatives = SensitivityModel::new(sensitivity.clone(), params);
            let (of, along) = ((of_led, params), (derivatives, directions));
            let led = TangentLed::new(AlphaTangents::new(stepper, of, along, at, (y, z))?);
            let trial = Box::new(led.clone());
            starter.alpha_control((Recorder::new(led, whole.clone()), trial), sizes, 0, &start)
        } else {
            let trial = Box::new(stepper.clone());
            starter.alpha_control(
                (Recorder::new(stepper, whole.clone()), trial),
                sizes,
                0,
                &start,
            )
        };
        let (point, reset, sizes) = starter.mechanical_adjoints(sensitivity);
        let method = Recording {
            point,
            reset,
            sizes,
            adjoint,
            steps: RecordedSteps {
                control,
                copy,
                whole,
                partial,
                parts: 1,
            },
            member,
            start,
            is_given: starter.has_accelerations(),
        };
        Ok(Self::of(&starter, sensitivity.width(), method)?)
    }
}
