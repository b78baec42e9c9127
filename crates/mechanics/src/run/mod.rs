//! Runs of mechanical systems: a system, a method and a job become one run.
//!
//! A single run is made as a member of an ensemble is; it may have control of its steps and events too.

mod alpha_pullback;
mod at_times;
mod check;
mod index2_pullback;
mod job;
mod journal;
mod member;
mod pullback;
mod tangents;

pub use alpha_pullback::AlphaPullback;
pub use index2_pullback::Index2Pullback;
pub use job::{
    Control, Detection, EventFunction, Job, Method, Problem, SparkMethod, SystemSensitivity,
    Tangents,
};
pub use pullback::{Follow, Pullback};

use liouville_alpha::{Alpha, AlphaRestart, AlphaState, Reactions};
use liouville_base::ensemble::{Ensemble, Layout};
use liouville_base::error::StepError;
use liouville_base::method::Estimating;
use liouville_base::newton::Stop;
use liouville_base::real::BATCH;
use liouville_base::run::{Advance, Fixed, Reversible, StartError, StepControl};
use liouville_base::tableau;
use liouville_index2::Index2;
use liouville_index2::semi_explicit::{
    SemiExplicit, SemiExplicitModel, SemiExplicitRestart, SemiExplicitState,
};
use liouville_problem::{
    Carried, Kinetic, Mechanical, Model, Observers, SecondOrder, SecondOrderModel, Separable,
    SeparableModel, State,
};
use liouville_spark::rattle::Rattle;
use liouville_spark::{Spark, SparkBatch, supports_batch};
use member::{Member, composed, in_lanes};
use std::sync::Arc;

/// The least and the most steps of a trial by which reversible steps meet a tolerance ...
const TRIAL: [usize; 2] = [20, 500];
/// ... and this many coordinates in all beyond the least: a trial of a large system takes no minutes.
const TRIAL_COORDINATES: usize = 100_000;

/// A run about to start.
///
/// # Errors
/// The method does not step the system, the job does not fit them, or the start of a single run failed.
pub fn start(problem: Problem, method: Method, job: Job) -> Result<Box<dyn Advance>, StartError> {
    let system = System::new(problem, method)?;
    job.check(&system)?;
    let starter = Starter { system, job };
    match starter.job.members {
        None => Ok(starter.begin(&[0])?),
        Some(members) => Ok(Box::new(starter.ensemble(members)?)),
    }
}

/// A system with its method; composed methods have stages.
enum System {
    Spark(Arc<Mechanical>, Box<SparkMethod>, Option<Vec<f64>>),
    Rattle(Arc<Separable>, Option<Vec<f64>>),
    Alpha(Arc<SecondOrder>, tableau::Alpha, Reactions),
    Index2(Arc<SemiExplicit>, Box<SparkMethod>, Option<Vec<f64>>),
}

impl System {
    /// The mechanical system in it.
    ///
    /// # Panics
    /// When it is semi-explicit.
    fn mechanical(&self) -> &Arc<Mechanical> {
        match self {
            Self::Spark(problem, ..) => problem,
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

/// Begins the runs of a job that fits its system.
struct Starter {
    system: System,
    job: Job,
}

type Begun = Result<Box<dyn Advance>, StepError>;

/// A method, the state that it starts from, and the first step and the least where errors control the steps.
type MethodStart<M, S> = (M, S, Option<(f64, f64)>);

impl Starter {
    /// All members, in blocks.
    fn ensemble(self, members: usize) -> Result<Ensemble, StepError> {
        let (span, threads) = (self.job.span, self.job.threads);
        // blocks no larger than leaves one for each thread
        let fair = members.div_ceil(threads.max(1));
        let block = self.block().min(fair);
        let layout = Layout::Aligned {
            times: span.times()?,
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
            System::Spark(problem, spark, _) if supports_batch(problem, spark.solver) => BATCH,
            _ => 1,
        }
    }

    /// How many numbers a member of an ensemble has in a row.
    fn width(&self) -> usize {
        let ([n, l], _) = self.system.sizes();
        let is_alpha = usize::from(matches!(self.system, System::Alpha(..)));
        let states = n + l + self.system.multipliers() + 2 * is_alpha * n;
        let own = usize::from(self.job.states) * states + is_alpha;
        own + self.job.observer.outputs() + self.tangent_width()
    }

    /// A run of these members, in lock-step where there are several.
    fn begin(&self, members: &[usize]) -> Begun {
        match &self.system {
            System::Spark(problem, spark, stages) if members.len() > 1 => {
                self.batch((problem, spark), stages.as_deref(), members)
            }
            System::Spark(problem, spark, stages) => {
                self.spark((problem, spark), stages.as_deref(), members[0])
            }
            System::Rattle(problem, stages) => self.rattle(problem, stages.as_deref(), members[0]),
            System::Alpha(problem, weights, reactions) => {
                self.alpha((problem, *weights, *reactions), members[0])
            }
            System::Index2(problem, spark, stages) => {
                self.index2((problem, &spark.tableau), stages.as_deref(), members[0])
            }
        }
    }

    /// To which fraction of the velocities stage equations are solved.
    fn newton_tol(&self, spark: &SparkMethod) -> f64 {
        let span = self.job.span;
        let steps = match self.job.control {
            Control::Fixed => span.steps as f64,
            Control::Reversible { first, .. } => ((span.t1 - span.t0) / first).abs(),
            Control::Adaptive { .. } => 0.0, // their errors exceed what adds up
        };
        (spark.newton_tol).unwrap_or_else(|| Stop::of_run(steps).tolerance)
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
        let each = if self.is_common() {
            &members[..1]
        } else {
            members
        };
        let observers = each.iter();
        let observers = observers.map(|member| self.observer(self.model(*member), *member));
        let observers = observers.collect();
        let observer = Box::new(Observers::new(observers, members.len()));
        self.fixed(composed(stepper, stages), observer, state)
    }

    /// A SPARK method at the start of a member's run; it estimates errors where these control the steps.
    fn spark_at(
        &self,
        (problem, spark): (&Arc<Mechanical>, &SparkMethod),
        member: usize,
    ) -> Result<MethodStart<Spark, State>, StepError> {
        let span = self.job.span;
        let mut model = Model::new(problem.clone(), self.params(member));
        let state = model.state(span.t0, self.part(0, member), self.part(1, member));
        let mut stepper = Spark::of(model, spark.tableau.clone(), spark.solver)
            .to_tolerance(self.newton_tol(spark));
        let Control::Adaptive {
            tolerance,
            first,
            least,
        } = &self.job.control
        else {
            return Ok((stepper, state, None));
        };
        stepper = stepper.estimating(tolerance.clone());
        let first = match first {
            Some(first) => *first,
            None => stepper.first_step(span.t0, &state, span.t1 - span.t0)?,
        };
        Ok((stepper, state, Some((first, *least))))
    }

    fn spark(
        &self,
        method: (&Arc<Mechanical>, &SparkMethod),
        stages: Option<&[f64]>,
        member: usize,
    ) -> Begun {
        let (stepper, state, sizes) = self.spark_at(method, member)?;
        if let Some(tangents) = &self.job.tangents {
            let (stepper, state) = self.with_tangents(stepper, tangents, state, member)?;
            let copy = self.composed_copy((&stepper, stages));
            let control = match sizes {
                None => self.symmetric_control((stepper, stages), self.monitor(member), &state),
                Some(sizes) => self.adaptive_control(stepper, sizes),
            };
            return self.recording((control, copy), tangents, state, member);
        }
        let of = self.member(member);
        match sizes {
            None => self.symmetric((stepper, stages), self.monitor(member), of, state),
            Some(sizes) => self.adaptive(stepper, sizes, of, state),
        }
    }

    fn rattle(&self, problem: &Arc<Separable>, stages: Option<&[f64]>, member: usize) -> Begun {
        let mut model = SeparableModel::new(problem.clone(), self.params(member));
        let (y, z) = (self.part(0, member), self.part(1, member));
        let state = model.general.state(self.job.span.t0, y, z);
        let stepper = Rattle::new(model)?;
        let (monitor, of) = (self.monitor(member), self.member(member));
        self.symmetric((stepper, stages), monitor, of, state)
    }

    fn alpha(
        &self,
        method: (&Arc<SecondOrder>, tableau::Alpha, Reactions),
        member: usize,
    ) -> Begun {
        let (stepper, state, sizes) = self.alpha_at(method, member)?;
        let tangents = self.job.tangents.as_ref();
        if let Some((tangents, slopes)) = tangents.and_then(|of| Some((of, of.alpha.clone()?))) {
            let start = (stepper, state, sizes);
            return self.alpha_tangents(start, (tangents, slopes), member);
        }
        let (copy, of) = (self.copy(&stepper), self.alpha_member(member, &stepper));
        let trial = Box::new(stepper.clone());
        let control = self.alpha_control((stepper, trial), sizes, member, &state);
        self.launch(control, copy, of, state)
    }

    /// A method of the α family where a member starts.
    fn alpha_at(
        &self,
        (problem, weights, reactions): (&Arc<SecondOrder>, tableau::Alpha, Reactions),
        member: usize,
    ) -> Result<MethodStart<Alpha, AlphaState>, StepError> {
        let span = self.job.span;
        let model = SecondOrderModel::new(problem.clone(), self.params(member));
        let (y, z) = (self.part(0, member), self.part(1, member));
        let a = self.has_accelerations().then(|| self.part(2, member));
        let (tolerance, sizes) = match &self.job.control {
            Control::Adaptive {
                tolerance,
                first,
                least,
            } => (Some(tolerance.clone()), Some((*first, *least))),
            _ => (None, None),
        };
        let mut stepper = Alpha::new(model, weights, reactions, tolerance);
        let state = stepper.start(span.t0, y, z, a)?;
        let sizes = sizes.map(|(first, least)| {
            let first = first.unwrap_or_else(|| stepper.first_step(&state, span.t1 - span.t0));
            (first, least)
        });
        Ok((stepper, state, sizes))
    }

    /// Whether accelerations are given at the start.
    fn has_accelerations(&self) -> bool {
        self.job.start.len() > 2
    }

    /// The control of a method of the α family: equal steps, or those that its errors allow. `trial` is the method
    /// again, by which reversible steps are found.
    fn alpha_control<S>(
        &self,
        (stepper, trial): (S, Box<dyn Estimating<State = S::State>>),
        sizes: Option<(f64, f64)>,
        member: usize,
        state: &S::State,
    ) -> Box<dyn StepControl<S::State>>
    where
        S: Estimating + 'static,
        S::State: Carried + Clone,
    {
        let span = self.job.span;
        let Some(sizes) = sizes else {
            let stepper = Box::new(stepper);
            return Box::new(Fixed::new(stepper, span.t0, span.h(), span.steps));
        };
        if !self.job.is_reversible {
            return self.adaptive_control(stepper, sizes);
        }
        let monitor = Box::new(Kinetic::new(self.model(member)));
        let most = TRIAL[1].min(TRIAL[0] + TRIAL_COORDINATES / self.system.mechanical().n);
        let (ends, pair) = ((span.t0, span.t1), [Box::new(stepper) as _, trial]);
        let control = Reversible::within_tolerance(pair, most, ends, sizes, monitor, state);
        Box::new(control)
    }

    /// A member whose states have accelerations of their own.
    fn alpha_member(&self, number: usize, stepper: &Alpha) -> Member<AlphaState> {
        let impulse = self.impulse(number);
        let restart = |impulse| Box::new(AlphaRestart::new(impulse, stepper.clone())) as _;
        Member {
            number,
            model: self.model(number),
            restart: impulse.map(restart),
        }
    }

    fn index2_at(
        &self,
        (problem, tableau): (&Arc<SemiExplicit>, &tableau::Spark),
        member: usize,
    ) -> Result<MethodStart<Index2, SemiExplicitState>, StepError> {
        let span = self.job.span;
        let mut model = SemiExplicitModel::new(problem.clone(), self.params(member));
        let (y, z) = (self.part(0, member), self.part(1, member));
        let state = model.state(span.t0, y, z, span.h())?;
        let stepper = Index2::of(model, tableau.clone());
        let Control::Adaptive {
            tolerance,
            first,
            least,
        } = &self.job.control
        else {
            return Ok((stepper, state, None));
        };
        let mut stepper = stepper.estimating(tableau, tolerance.clone());
        let first = match first {
            Some(first) => *first,
            None => stepper.first_step(span.t0, &state, span.t1 - span.t0)?,
        };
        Ok((stepper, state, Some((first, *least))))
    }

    /// A member of a semi-explicit system.
    fn semi_explicit_member(
        &self,
        problem: &Arc<SemiExplicit>,
        number: usize,
    ) -> Member<SemiExplicitState, SemiExplicitModel> {
        let model = SemiExplicitModel::new(problem.clone(), self.params(number));
        let restart = self.has_resets();
        let restart = restart.then(|| Box::new(SemiExplicitRestart::new(model.clone())) as _);
        Member {
            number,
            model,
            restart,
        }
    }

    fn index2(
        &self,
        (problem, tableau): (&Arc<SemiExplicit>, &tableau::Spark),
        stages: Option<&[f64]>,
        member: usize,
    ) -> Begun {
        let start = self.index2_at((problem, tableau), member)?;
        let of = self.semi_explicit_member(problem, member);
        if let Some(tangents) = &self.job.tangents {
            return self.index2_tangents((start, stages), tangents, of);
        }
        let (stepper, state, sizes) = start;
        match sizes {
            None => {
                let monitor = self.traced(member, || of.model.clone());
                self.symmetric((stepper, stages), monitor, of, state)
            }
            Some(sizes) => self.adaptive(stepper, sizes, of, state),
        }
    }
}
