//! Runs of mechanical systems: a system, a method and a job become one run.
//!
//! A single run is made as a member of an ensemble is; it may have control of its steps and events too.

mod alpha;
mod alpha_pullback;
mod check;
mod event_adjoint;
mod given_times;
mod index2;
mod index2_pullback;
mod job;
mod journal;
mod member;
mod members_pullback;
mod parts;
mod pool;
mod pullback;
mod recording;
mod shared;
mod spark_pullback;
mod tangents;

pub use job::{
    Control, Detection, EventFunction, Job, Method, Problem, Recorded, SparkMethod,
    SystemSensitivity, Tangents,
};
pub use members_pullback::{KeptRows, MembersPullback};
pub use parts::Part;
pub use pool::Pools;
pub use pullback::{Follow, Pullback};
pub use recording::StepAdjoint;
pub use shared::SharedRun;

use liouville_alpha::Reactions;
use liouville_base::ensemble::{Ensemble, RecordLayout};
use liouville_base::error::StepError;
use liouville_base::newton::Stop;
use liouville_base::real::{BATCH, Real};
use liouville_base::run::{Advance, StartError};
use liouville_base::tableau;
use liouville_index2::semi_explicit::SemiExplicit;
use liouville_problem::{
    Mechanical, Model, Observer, Observers, SecondOrder, Separable, SeparableModel, State,
    StepWatch, Turning,
};
use liouville_spark::rattle::Rattle;
use liouville_spark::{Spark, SparkBatch, supports_batch};
use member::{composed, in_lanes};
use pool::Lent;
use std::sync::Arc;

/// A run about to start.
///
/// # Errors
/// The method does not step the system, the job does not fit them, or the start of a single run failed.
pub fn start(problem: Problem, method: Method, job: Job) -> Result<Box<dyn Advance>, StartError> {
    let starter = Starter::new(problem, method, job)?;
    if !starter.job.parts.is_empty() {
        return Ok(Box::new(parts::Parts::new(starter)));
    }
    match starter.job.members {
        None => Ok(starter.begin(&[0])?),
        Some(members) => Ok(Box::new(starter.ensemble(members)?)),
    }
}

/// A system with its method; composed methods have stages.
enum System {
    Spark(
        (Arc<Mechanical>, Arc<Pools>),
        Box<SparkMethod>,
        Option<Vec<f64>>,
    ),
    Rattle(Arc<Separable>, Option<Vec<f64>>),
    Alpha(Arc<SecondOrder>, tableau::Alpha, Reactions, Option<f64>),
    Index2(Arc<SemiExplicit>, Box<SparkMethod>, Option<Vec<f64>>),
}

impl System {
    /// The mechanical system in it.
    ///
    /// # Panics
    /// When it is semi-explicit.
    fn mechanical(&self) -> &Arc<Mechanical> {
        match self {
            Self::Spark((problem, _), ..) => problem,
            Self::Rattle(problem, ..) => &problem.mechanical,
            Self::Alpha(problem, ..) => &problem.mechanical,
            Self::Index2(..) => unreachable!("a semi-explicit system"),
        }
    }

    /// How many holonomic constraints there are.
    fn holonomic(&self) -> usize {
        match self {
            Self::Index2(problem, ..) => problem.l,
            _ => self.mechanical().m,
        }
    }
}

/// The part of the tolerance of errors that stage equations are solved to, and the largest that any are.
const PART_OF_ERRORS: f64 = 1e-2;
const ROUGHEST: f64 = 1e-3;

/// Begins the runs of a job that fits its system.
struct Starter {
    system: System,
    job: Job,
}

/// A SPARK method of a mechanical system, with what earlier runs have left.
type PooledSpark<'a> = (&'a Arc<Mechanical>, &'a Pools, &'a SparkMethod);

type Begun = Result<Box<dyn Advance>, StepError>;

/// A method, the state that it starts from, and the first step and the least where errors control the steps.
type MethodStart<M, S> = (M, S, Option<(f64, f64)>);

impl Starter {
    /// A starter of the runs of a job by this method.
    ///
    /// # Errors
    /// The method does not step the system, or the job does not fit them.
    fn new(problem: Problem, method: Method, job: Job) -> Result<Self, StartError> {
        let system = System::new(problem, method)?;
        job.check(&system)?;
        Ok(Self { system, job })
    }

    /// To which fraction equations are solved: to this one if it is given, else to roundoff, or, where errors control the
    /// steps, to this part of their tolerance.
    fn tolerance(&self, given: Option<f64>, part: f64, roundoff: f64) -> f64 {
        given.unwrap_or_else(|| match &self.job.control {
            Control::Adaptive { tolerance, .. }
                if !self.job.is_differentiated && !self.job.is_reversible =>
            {
                (part * tolerance.least()).clamp(roundoff, ROUGHEST)
            }
            _ => roundoff,
        })
    }

    /// All members, in blocks.
    fn ensemble(self, members: usize) -> Result<Ensemble, StepError> {
        let (span, threads) = (self.job.span, self.job.threads);
        // blocks no larger than leaves one for each thread
        let fair = members.div_ceil(threads.max(1));
        let block = self.block().min(fair);
        let detection = self.job.detection.as_ref();
        let given = detection.and_then(|detection| detection.times.clone());
        let layout = RecordLayout::Aligned {
            times: given.map_or_else(|| span.times(), Ok)?,
            width: self.width(),
        };
        let begin = Box::new(move |members: &[usize]| self.begin(members));
        Ok(Ensemble::new(
            begin,
            (members, block),
            threads,
            layout,
            span.t0,
        ))
    }

    /// How many members advance in lock-step.
    fn block(&self) -> usize {
        match &self.system {
            // events part the steps of each member in its own way, and tangents are those of one
            _ if self.job.detection.is_some() || self.job.tangents.is_some() => 1,
            System::Spark((problem, _), spark, _) if supports_batch(problem, spark.solver) => BATCH,
            _ => 1,
        }
    }

    /// How many numbers a member of an ensemble has in a row.
    fn width(&self) -> usize {
        let ([n, l], _) = self.system.sizes();
        let is_alpha = usize::from(matches!(self.system, System::Alpha(..)));
        let states = n + l + self.system.multipliers() + 2 * is_alpha * n;
        let recorded = &self.job.recorded;
        let angles = recorded.turning.as_ref().map_or(0, Turning::count);
        let own = usize::from(recorded.states) * states + is_alpha;
        own + recorded.tape.outputs() + angles + self.tangent_width()
    }

    /// A run of these members, in lock-step where there are several.
    fn begin(&self, members: &[usize]) -> Begun {
        match &self.system {
            System::Spark((problem, _), spark, stages) if members.len() > 1 => {
                self.batch((problem, spark), stages.as_deref(), members)
            }
            System::Spark((problem, pools), spark, stages) => {
                self.spark((problem, pools, spark), stages.as_deref(), members[0])
            }
            System::Rattle(problem, stages) => self.rattle(problem, stages.as_deref(), members[0]),
            System::Alpha(problem, weights, reactions, newton_tol) => {
                self.alpha((problem, *weights, *reactions, *newton_tol), members[0])
            }
            System::Index2(problem, spark, stages) => {
                self.index2((problem, &spark.tableau), stages.as_deref(), members[0])
            }
        }
    }

    /// To which fraction of the velocities stage equations are solved.
    fn newton_tol(&self, spark: &SparkMethod) -> f64 {
        self.tolerance(spark.newton_tol, PART_OF_ERRORS, self.spark_roundoff())
    }

    fn spark_roundoff(&self) -> f64 {
        let span = self.job.span;
        let steps = match self.job.control {
            Control::Fixed => span.steps as f64,
            Control::Reversible { h_first, .. } => ((span.t1 - span.t0) / h_first).abs(),
            Control::Held(_) | Control::Adaptive { .. } => 0.0, // their errors are larger than the sum of what the iteration leaves
        };
        Stop::of_run(steps).tolerance
    }

    fn batch(
        &self,
        (problem, spark): (&Arc<Mechanical>, &SparkMethod),
        stages: Option<&[f64]>,
        members: &[usize],
    ) -> Begun {
        let params = in_lanes(members, |member| self.params(member));
        let y = in_lanes(members, |member| self.part(0, member));
        let z = in_lanes(members, |member| self.part(1, member));
        let (tableau, filled) = (spark.tableau.clone(), (&params[..], members.len()));
        let mut stepper = SparkBatch::of(problem, filled, tableau, spark.solver)
            .to_tolerance(self.newton_tol(spark));
        let state = stepper.state(self.job.span.t0, &y, &z);
        let observer = Box::new(self.observers(problem, filled));
        let watch = StepWatch::new(problem, &params, &self.job.watched, members)
            .map(|watch| Box::new(watch) as _);
        let stepper = composed(stepper, stages);
        self.fixed(stepper, observer, state, (members.len(), watch))
    }

    /// A SPARK method at the start of a member's run; it estimates errors where these control the steps.
    fn spark_at(
        &self,
        (problem, pools, spark): PooledSpark,
        member: usize,
    ) -> Result<MethodStart<Lent<Spark>, State>, StepError> {
        let (span, params) = (self.job.span, self.params(member));
        let kind = (spark.tableau.key, spark.solver);
        let stepper = pools.steppers.lend(problem, params, &kind, || {
            let model = Model::new(problem.clone(), params);
            Spark::of(model, spark.tableau.clone(), spark.solver)
        });
        let mut stepper = stepper.map(|stepper| stepper.to_tolerance(self.newton_tol(spark)));
        let state = stepper.state(span.t0, self.part(0, member), self.part(1, member));
        let Control::Adaptive {
            tolerance,
            h_first,
            h_min,
        } = &self.job.control
        else {
            return Ok((stepper, state, None));
        };
        stepper = stepper.map(|stepper| stepper.estimating(tolerance.clone()));
        if spark.newton_tol.is_none() {
            // an iteration that goes on within roundoff leaves more of it, which short steps take for errors
            let least = self.spark_roundoff().max(4.0 * f64::EPSILON);
            stepper = stepper.map(|stepper| stepper.to_tolerance_of_velocities(least));
        }
        let h_first = match h_first {
            Some(h_first) => *h_first,
            None => stepper.first_step(span.t0, &state)?,
        };
        Ok((stepper, state, Some((h_first, *h_min))))
    }

    fn spark(&self, method: PooledSpark, stages: Option<&[f64]>, member: usize) -> Begun {
        let (stepper, state, sizes) = self.spark_at(method, member)?;
        if let Some(tangents) = &self.job.tangents {
            let (stepper, state) = self.with_tangents(stepper.keep(), tangents, state, member)?;
            let copy = self.composed_copy((&stepper.alone(), stages));
            let control = match sizes {
                None => self.symmetric_control((stepper, stages), self.monitor(member), &state),
                Some(sizes) => self.adaptive_control(stepper, sizes),
            };
            let of = self.momenta(tangents, member);
            return self.mechanical_tangents((control, copy), tangents, of, state, member);
        }
        let detection = self.job.detection.as_ref();
        let has_switch = detection.is_some_and(|own| own.events.iter().any(|x| x.is_switch));
        let stepper = match sizes {
            Some(_) if has_switch => stepper.map(Spark::shortened),
            _ => stepper,
        };
        let copy = self.composed_copy((&stepper, stages));
        let control = match sizes {
            None => self.symmetric_control((stepper, stages), self.monitor(member), &state),
            Some(sizes) => self.adaptive_control(stepper, sizes),
        };
        if detection.is_some() {
            return self.launch(control, copy, self.member(member), state);
        }
        let observer = self.pooled_observer(method, member);
        self.recorded(control, Box::new(observer), state, member)
    }

    fn observers<R: Real>(&self, problem: &Arc<Mechanical>, filled: (&[R], usize)) -> Observers<R> {
        let own = &self.job.recorded;
        let observers = Observers::new(problem, filled, (own.tape.clone(), own.states));
        observers.turning(own.turning.as_ref())
    }

    fn pooled_observer(&self, (problem, pools, _): PooledSpark, member: usize) -> Lent<Observer> {
        let make = || self.observer(self.model(member), member);
        let params = self.params(member);
        pools
            .observers
            .lend(problem, params, &self.job.recorded, make)
    }

    fn rattle(&self, problem: &Arc<Separable>, stages: Option<&[f64]>, member: usize) -> Begun {
        let mut model = SeparableModel::new(problem.clone(), self.params(member));
        let (y, z) = (self.part(0, member), self.part(1, member));
        let state = model.general.state(self.job.span.t0, y, z);
        let stepper = Rattle::new(model)?;
        let (monitor, of) = (self.monitor(member), self.member(member));
        self.symmetric((stepper, stages), monitor, of, state)
    }
}
