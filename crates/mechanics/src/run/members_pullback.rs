//! Pullbacks of members of an ensemble in lock-step, a block at a time: their run is made again, recorded, and followed
//! back, each member with the bits that it has alone.

use super::member::in_lanes;
use super::{Job, Method, Problem, Starter, System};
use liouville_base::cancel;
use liouville_base::composition::Composed;
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::real::{BATCH, Scalar};
use liouville_base::recorder::{Recorder, SharedRecords, StepRecord};
use liouville_base::run::StartError;
use liouville_problem::{
    Cotangents, MemberLanes, Model, PointAdjoint, Sensitivity, SensitivityModel, State,
};
use liouville_spark::{BatchAdjoint, SparkBatch, supports_batch};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Numbers of the recorded steps of a block; the steps of a longer run are repeated piece by piece.
const RECORDED: usize = 1 << 21;

/// Steps between two looks at whether to stop.
const BETWEEN: usize = 64;

/// The pullbacks of an ensemble by equal steps without events.
pub struct MembersPullback {
    starter: Starter,
    sensitivity: Arc<Sensitivity>,
    is_stopped: AtomicBool,
}

/// Cotangents of the states of a block that are kept.
#[derive(Clone, Copy, Debug)]
pub struct KeptRows<'a> {
    /// The steps that end with them, in their order.
    pub steps: &'a [usize],
    /// For each of these a row for each member, of (y, z, λ).
    pub rows: &'a [f64],
}

/// A block at work, and the adjoint of its steps.
struct Block<M> {
    stepper: M,
    state: State<MemberLanes>,
    records: SharedRecords<State<MemberLanes>>,
    adjoint: BatchAdjoint,
    point: PointAdjoint<MemberLanes>,
    of: Cotangents<MemberLanes>,
}

impl MembersPullback {
    /// The pullbacks of a job's runs, whose derivatives by τ are `sensitivity`; `None` where members do not run in
    /// lock-step.
    ///
    /// # Errors
    /// The job is no such ensemble.
    pub fn new(
        problem: Problem,
        method: Method,
        job: Job,
        sensitivity: &Arc<Sensitivity>,
    ) -> Result<Option<Self>, StartError> {
        let starter = Starter::new(problem, method, job)?;
        let System::Spark((problem, _), spark, _) = &starter.system else {
            return Ok(None);
        };
        let job = &starter.job;
        let is_plain = job.detection.is_none() && job.tangents.is_none() && job.members.is_some();
        let fits = Arc::ptr_eq(&sensitivity.mechanical, problem) && spark.newton_tol.is_none();
        if !(is_plain && fits && supports_batch(problem, spark.solver)) {
            return Ok(None);
        }
        let pullback = Self {
            sensitivity: sensitivity.clone(),
            is_stopped: AtomicBool::new(false),
            starter,
        };
        let is_small = pullback.start(&[0]).is_some();
        Ok(is_small.then_some(pullback))
    }

    /// How many members there are.
    pub fn members(&self) -> usize {
        self.starter.job.members.unwrap_or(1)
    }

    /// Lets all pullbacks under way end, and those to come.
    pub fn stop(&self) {
        self.is_stopped.store(true, Ordering::Relaxed);
    }

    /// Looks now and then whether to stop.
    fn check(&self, step: usize) -> Result<(), StepError> {
        let is_stopped = || self.is_stopped.load(Ordering::Relaxed) || cancel::is_cancelled();
        if step.is_multiple_of(BETWEEN) && is_stopped() {
            return Err(StepError::Interrupted);
        }
        Ok(())
    }

    /// A block before its first step; `None` where its steps are too large to be followed back in lock-step.
    fn start(&self, members: &[usize]) -> Option<Block<Recorder<SparkBatch>>> {
        let System::Spark((problem, _), spark, _) = &self.starter.system else {
            return None;
        };
        let params = in_lanes(members, |member| self.starter.params(member));
        let y = in_lanes(members, |member| self.starter.part(0, member));
        let z = in_lanes(members, |member| self.starter.part(1, member));
        let (tableau, filled) = (spark.tableau.clone(), (&params[..], members.len()));
        let mut stepper = SparkBatch::of(problem, filled, tableau, spark.solver)
            .to_tolerance(self.starter.newton_tol(spark));
        let sensitivity = SensitivityModel::new(self.sensitivity.clone(), &params);
        let model = Model::new(problem.clone(), &params);
        let records = SharedRecords::default();
        Some(Block {
            state: stepper.state(self.starter.job.span.t0, &y, &z),
            adjoint: BatchAdjoint::new(&stepper, sensitivity.clone())?,
            point: PointAdjoint::new(model, sensitivity),
            of: Cotangents::zeros([problem.n; 3], self.sensitivity.width()),
            stepper: Recorder::new(stepper, records.clone()),
            records,
        })
    }

    /// The cotangents of the starts of some members, at most as many as are in lock-step, from those of the states kept;
    /// none of these comes after the step `last`.
    ///
    /// # Errors
    /// A step cannot be repeated, its adjoint fails, or the thread is cancelled; the member is not named.
    ///
    /// # Panics
    /// When there are other numbers of rows.
    pub fn pull(
        &self,
        members: &[usize],
        last: usize,
        kept: KeptRows,
    ) -> Result<Vec<Cotangents>, StepError> {
        let System::Spark(_, _, stages) = &self.starter.system else {
            return Ok(Vec::new());
        };
        let Some(block) = self.start(members) else {
            return Ok(Vec::new());
        };
        let of = match stages {
            None => self.follow(block, 1, last, kept)?,
            Some(stages) => {
                let composed = Block {
                    stepper: Composed::of_stages(block.stepper, stages),
                    state: block.state,
                    records: block.records,
                    adjoint: block.adjoint,
                    point: block.point,
                    of: block.of,
                };
                self.follow(composed, stages.len(), last, kept)?
            }
        };
        Ok((0..members.len()).map(|place| of.member(place)).collect())
    }

    /// Makes the steps of a block, `parts` records each, and follows them back.
    fn follow<M: Stepper<State = State<MemberLanes>> + Clone>(
        &self,
        mut block: Block<M>,
        parts: usize,
        last: usize,
        kept: KeptRows,
    ) -> Result<Cotangents<MemberLanes>, StepError> {
        let span = self.starter.job.span;
        let start = block.state.clone();
        let (mut stride, mut saved) = (last.max(1), Vec::new());
        for step in 0..last {
            if step % stride == 0 {
                block.records.lock().clear();
                saved.push((block.stepper.clone(), block.state.clone()));
            }
            self.check(step)?;
            block.step(span.t0, (step, span.h()))?;
            if step == 0 {
                stride = (RECORDED / block.records.lock().numbers().max(1)).max(1);
            }
        }
        let mut record = StepRecord::like(&start);
        let mut end = last;
        for (place, (stepper, state)) in saved.into_iter().enumerate().rev() {
            let first = place * stride;
            if end < last {
                (block.stepper, block.state) = (stepper, state);
                block.records.lock().clear();
                for step in first..end {
                    self.check(step)?;
                    block.step(span.t0, (step, span.h()))?;
                }
            }
            block.leave(self, (first, end), parts, (kept, &mut record))?;
            end = first;
        }
        let at = (span.t0, &start.y[..], &start.z[..]);
        block.observe(0, at, kept)?;
        block.point.leave_momenta(at, &mut block.of)?;
        Ok(block.of)
    }
}

impl<M: Stepper<State = State<MemberLanes>>> Block<M> {
    fn step(&mut self, t0: f64, (step, h): (usize, f64)) -> Result<(), StepError> {
        self.stepper.step(t0 + step as f64 * h, h, &mut self.state)
    }

    /// Follows the recorded steps back, those from `first` to `end`.
    fn leave(
        &mut self,
        by: &MembersPullback,
        (first, end): (usize, usize),
        parts: usize,
        (kept, record): (KeptRows, &mut StepRecord<State<MemberLanes>>),
    ) -> Result<(), StepError> {
        let shared = self.records.clone();
        let records = shared.lock();
        for step in (first..end).rev() {
            by.check(step)?;
            for part in (0..parts).rev() {
                records.read((step - first) * parts + part, record);
                if part == parts - 1 {
                    let at = (record.time(), &record.end.y[..], &record.end.z[..]);
                    self.observe(step + 1, at, kept)?;
                }
                self.adjoint.follow(record, &mut self.of)?;
            }
        }
        Ok(())
    }

    /// Adds the cotangents of the state that a step ends with, if it is kept.
    fn observe(
        &mut self,
        step: usize,
        at: (f64, &[MemberLanes], &[MemberLanes]),
        kept: KeptRows,
    ) -> Result<(), StepError> {
        let Ok(place) = kept.steps.binary_search(&step) else {
            return Ok(());
        };
        let per_step = kept.rows.len() / kept.steps.len();
        let rows = &kept.rows[place * per_step..(place + 1) * per_step];
        let problem = &self.point.model.problem;
        let width = 2 * problem.n + problem.multipliers();
        let count = per_step / width;
        let row: Vec<MemberLanes> = (0..width)
            .map(|k| {
                let mut lanes = MemberLanes::splat(0.0);
                for member in 0..BATCH {
                    // places without a member follow the last
                    lanes.set_member(member, rows[member.min(count - 1) * width + k]);
                }
                lanes
            })
            .collect();
        self.point.observe_at(at, &row, &mut self.of)
    }
}
