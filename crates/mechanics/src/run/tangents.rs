//! Runs that carry tangents with their states.

use super::member::{BoxedStepper, Member, Observed};
use crate::events::{DenseDetector, HiddenMoves, Impulses, MotionDerivatives, TangentEvents};

use super::{Begun, MethodStart, Starter, System, SystemSensitivity, Tangents};
use liouville_alpha::{Alpha, AlphaSlopes, AlphaStartTangents, AlphaState, AlphaTangents};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::run::StepControl;
use liouville_index2::semi_explicit::{
    SemiExplicitModel, SemiExplicitPoint, SemiExplicitSensitivityModel, SemiExplicitState,
};
use liouville_index2::{Index2, Index2Tangents, SemiExplicitTangentObserver};
use liouville_problem::{
    BeginTangents, Carried, Directions, Dynamics, MomentumTangents, MotionTangents, Restart,
    Sensitivity, SensitivityModel, State, TangentObserver, TangentRestart, TangentState,
};
use liouville_spark::{Spark, SparkTangents};
use std::sync::Arc;

/// A control of steps, and the stepper of an event detector.
type Stepping<S> = (Box<dyn StepControl<S>>, Option<BoxedStepper<S>>);

/// The start of a motion after a reset: tangents of the carried state, and the state.
type Begins<S> = (Box<dyn BeginTangents<S>>, Option<Box<dyn Restart<S>>>);

/// A run whose states carry tangents, and the derivatives of its motion.
struct TangentRun<S, M: Dynamics> {
    stepping: Stepping<TangentState<S>>,
    of: Member<S, M>,
    state: TangentState<S>,
    observed: Observed<TangentState<S>>,
    derivatives: MotionDerivatives<S>,
}

impl Starter {
    /// How many numbers the tangents of a member have in a row.
    pub(super) fn tangent_width(&self) -> usize {
        let Some(tangents) = &self.job.tangents else {
            return 0;
        };
        let ([n, l], _) = self.system.sizes();
        tangents.stretch.len() * (n + l + self.tangent_multipliers())
    }

    /// The directions of a member's run, that of the length of a step among them, and its start in these.
    fn begin_tangents(
        &self,
        tangents: &Tangents,
        sizes: [usize; 2],
        member: usize,
    ) -> (Directions, [Matrix; 2]) {
        let directions = directions_of(tangents);
        let count = directions.count();
        let directions = self.with_length(directions);
        let rows = tangents.starts(sizes, member).map(|rows| {
            // that of the length of a step begins from zero
            let at = |i: usize, j: usize| if i < count { rows[(i, j)] } else { 0.0 };
            Matrix::from_fn(directions.count(), rows.cols(), at)
        });
        (directions, rows)
    }

    /// A method that carries the tangents of a member, and its state with them.
    pub(super) fn with_tangents(
        &self,
        stepper: Spark,
        tangents: &Tangents,
        state: State,
        member: usize,
    ) -> Result<(SparkTangents, TangentState), StepError> {
        let (directions, [y, z]) = self.begin_tangents(tangents, [state.y.len(); 2], member);
        let dt = (0..directions.count())
            .map(|i| directions.tau[(i, 0)])
            .collect();
        let sensitivity = self.sensitivity(tangents, member);
        let start = (self.job.span.t0, state, self.params(member));
        SparkTangents::new(stepper, sensitivity, directions, start, (y, z, dt))
    }

    /// A run of the α family with its tangents.
    pub(super) fn alpha_tangents(
        &self,
        (stepper, state, sizes): MethodStart<Alpha, AlphaState>,
        (tangents, slopes): (&Tangents, AlphaSlopes),
        number: usize,
    ) -> Begun {
        let (span, params) = (self.job.span, self.params(number));
        let (directions, rows) = self.begin_tangents(tangents, [state.y.len(); 2], number);
        let sensitivity = self.sensitivity(tangents, number);
        let of_slopes = (&slopes, params);
        let carried = AlphaStartTangents::new(&stepper, of_slopes, sensitivity.clone());
        let restart = self.alpha_member(number, &stepper).restart;
        let start = (span.t0, state, self.has_accelerations());
        let of = (sensitivity, directions);
        let (stepper, state) =
            AlphaTangents::new(stepper, (slopes, params), of, start, rows.into())?;
        let (copy, trial) = (self.copy(&stepper.alone()), Box::new(stepper.clone()));
        let control = self.alpha_control((stepper, trial), sizes, number, &state);
        let of = (Box::new(carried) as _, restart);
        self.mechanical_tangents((control, copy), tangents, of, state, number)
    }

    /// A run of an index-2 method with its tangents.
    pub(super) fn index2_tangents(
        &self,
        (start, stages): (MethodStart<Index2, SemiExplicitState>, Option<&[f64]>),
        tangents: &Tangents,
        of: Member<SemiExplicitState, SemiExplicitModel>,
    ) -> Begun {
        let (stepper, state, sizes) = start;
        let (directions, [y, _]) = self.begin_tangents(tangents, [state.y.len(), 0], of.number);
        let SystemSensitivity::SemiExplicit(sensitivity) = &tangents.sensitivity else {
            unreachable!("derivatives of a mechanical system");
        };
        let params = self.params(of.number);
        let sensitivity = SemiExplicitSensitivityModel::new(sensitivity.clone(), params);
        let (start, derivatives) = ((self.job.span.t0, state, params), sensitivity.clone());
        let (stepper, state) = Index2Tangents::new(stepper, derivatives, directions, start, y)?;
        let monitor = self.traced(of.number, || of.model.clone());
        let copy = self.composed_copy((&stepper.alone(), stages));
        let control = match sizes {
            None => self.symmetric_control((stepper, stages), monitor, &state),
            Some(sizes) => self.adaptive_control(stepper, sizes),
        };
        let inner = self.observer(of.model.clone(), of.number);
        let observer = SemiExplicitTangentObserver::new(inner, tangents.stretch.len());
        let point = SemiExplicitPoint::new(of.model.clone(), sensitivity.clone());
        let run = TangentRun {
            stepping: (control, copy),
            observed: [Box::new(observer.clone()), Box::new(observer)],
            derivatives: MotionDerivatives {
                point: Box::new(point),
                reset: Box::new(HiddenMoves::listed(of.model.clone(), sensitivity.clone())),
                carried: None,
            },
            of,
            state,
        };
        self.recording(tangents, run)
    }

    /// A run of a mechanical system whose tangents are recorded. Behind a reset `carried` writes the tangents of what
    /// the method carries, and `restart` makes the state.
    pub(super) fn mechanical_tangents<S>(
        &self,
        stepping: Stepping<TangentState<S>>,
        tangents: &Tangents,
        (carried, restart): Begins<S>,
        state: TangentState<S>,
        number: usize,
    ) -> Begun
    where
        S: Carried + Checkpoint + Clone + 'static,
    {
        let (model, sensitivity) = (self.model(number), self.sensitivity(tangents, number));
        let inner = self.observer(model.clone(), number);
        let directions = directions_of(tangents);
        let observer = TangentObserver::new(inner, sensitivity.clone(), directions);
        let point = MotionTangents::new(model.clone(), sensitivity.clone());
        let run = TangentRun {
            stepping,
            observed: [Box::new(observer.clone()), Box::new(observer)],
            derivatives: MotionDerivatives {
                point: Box::new(point),
                reset: Box::new(Impulses::listed(
                    model.clone(),
                    tangents.sensitivity.width(),
                )),
                carried: Some(carried),
            },
            of: Member {
                number,
                model: model.clone(),
                restart,
            },
            state,
        };
        self.recording(tangents, run)
    }

    /// A run whose tangents are recorded.
    fn recording<S, M: Dynamics>(&self, tangents: &Tangents, run: TangentRun<S, M>) -> Begun
    where
        S: Carried + Checkpoint + Clone + 'static,
    {
        let TangentRun {
            of, derivatives, ..
        } = run;
        let start = self.job.span.t0;
        let multipliers = self.tangent_multipliers();
        let slopes = self.slopes(of.number);
        let of = Member {
            number: of.number,
            model: of.model,
            restart: (of.restart).map(|restart| Box::new(TangentRestart(restart)) as _),
        };
        let with = |detector: DenseDetector<TangentState<S>, M>| {
            let directions = self.with_length(directions_of(tangents));
            let at = (start, multipliers);
            let events = TangentEvents::new(slopes.clone(), derivatives, directions, at);
            detector.followed(Box::new(events), slopes)
        };
        self.launch_observed(run.stepping, of, run.state, run.observed, with)
    }

    /// How many multipliers of a point have tangents.
    fn tangent_multipliers(&self) -> usize {
        match &self.system {
            System::Index2(..) => 0,
            system => system.mechanical().multipliers(),
        }
    }

    /// Whether there are events.
    pub(super) fn has_events(&self) -> bool {
        let detection = self.job.detection.as_ref();
        detection.is_some_and(|detection| !detection.events.is_empty())
    }

    /// The directions, and that of the length of a step where there are events or given times: parts of steps that lead
    /// to these change their lengths.
    fn with_length(&self, directions: Directions) -> Directions {
        if self.job.detection.is_none() {
            return directions;
        }
        let Directions { tau, mut stretch } = directions;
        let count = stretch.len();
        stretch.push(1.0);
        let at = |i: usize, j: usize| if i < count { tau[(i, j)] } else { 0.0 };
        let tau = Matrix::from_fn(count + 1, tau.cols(), at);
        Directions { tau, stretch }
    }

    /// The tangents of momenta, and the impulses of a member.
    pub(super) fn momenta(&self, tangents: &Tangents, member: usize) -> Begins<State> {
        let momenta = MomentumTangents {
            model: self.model(member),
            sensitivity: self.sensitivity(tangents, member),
        };
        (Box::new(momenta), self.member(member).restart)
    }

    fn sensitivity(&self, tangents: &Tangents, member: usize) -> SensitivityModel {
        SensitivityModel::new(tangents.mechanical().clone(), self.params(member))
    }
}

impl Starter {
    /// Whether a run has a pullback with these derivatives.
    pub(super) fn has_pullback(&self, sensitivity: &Sensitivity) -> bool {
        let job = &self.job;
        Arc::ptr_eq(&sensitivity.mechanical, self.system.mechanical())
            && job.has_slopes()
            && job.tangents.is_none()
            && job.members.is_none()
    }
}

fn directions_of(tangents: &Tangents) -> Directions {
    let width = tangents.sensitivity.width();
    Directions {
        tau: Matrix::from_fn(tangents.stretch.len(), width, |i, j| {
            tangents.tau[i * width + j]
        }),
        stretch: tangents.stretch.clone(),
    }
}

impl Tangents {
    /// Derivatives of a mechanical system.
    ///
    /// # Panics
    /// When they are those of a semi-explicit one.
    fn mechanical(&self) -> &Arc<Sensitivity> {
        match &self.sensitivity {
            SystemSensitivity::Mechanical(own) => own,
            SystemSensitivity::SemiExplicit(_) => unreachable!("a semi-explicit system"),
        }
    }

    /// The changes of y and z at the start of a member.
    fn starts(&self, sizes: [usize; 2], member: usize) -> [Matrix; 2] {
        let count = self.stretch.len();
        [0, 1].map(|part| {
            let n = sizes[part];
            let rows = &self.start[part][member * count * n..];
            Matrix::from_fn(count, n, |i, j| rows[i * n + j])
        })
    }

    /// Whether they are those of so many members of a system, and their method can carry them.
    pub(super) fn fit(&self, system: &System, members: usize) -> bool {
        use SystemSensitivity::{Mechanical, SemiExplicit};
        let width = self.sensitivity.width();
        let (sizes, fits) = match (system, &self.sensitivity) {
            (System::Spark((problem, _), spark, _), Mechanical(own)) => {
                let is_own = Arc::ptr_eq(&own.mechanical, problem);
                ([problem.n; 2], is_own && spark.newton_tol.is_none())
            }
            (System::Alpha(problem, _, reactions, newton_tol), Mechanical(own)) => {
                let problem = &problem.mechanical;
                let sizes = (problem.n, problem.m, width - 1);
                let slopes = self.alpha.as_ref();
                let fits = slopes.is_some_and(|slopes| slopes.fit(sizes, *reactions));
                let is_own = Arc::ptr_eq(&own.mechanical, problem);
                ([problem.n; 2], is_own && fits && newton_tol.is_none())
            }
            (System::Index2(problem, spark, _), SemiExplicit(own)) => {
                let is_own = Arc::ptr_eq(&own.system, problem);
                ([problem.n, 0], is_own && spark.newton_tol.is_none())
            }
            _ => return false,
        };
        let count = self.stretch.len();
        let parts = self.start.iter().zip(sizes);
        fits && self.tau.len() == count * width && { parts }
            .all(|(x, size)| x.len() == members * count * size)
    }
}
