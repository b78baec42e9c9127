//! The attempts at a step of a SPARK method.

use super::Spark;
use super::general::{General, KeptStages};
use liouville_base::error::StepError;
use liouville_base::linalg::copy;
use liouville_base::newton::{
    self, Attempts, Backoff, BranchAttempts, Continuation, Signs, Slot, Solved, Start,
};
use liouville_problem::Step;

/// A step whose stage equations are attempted.
pub(super) struct SparkAttempt<'a> {
    pub(super) spark: &'a mut Spark,
    pub(super) general: &'a mut General,
    pub(super) step: Step<'a>,
}

impl General {
    /// Solves the equations of a step, which has only to be committed then.
    pub(super) fn advance(&mut self, spark: &mut Spark, step: Step) -> Result<(), StepError> {
        let mut made = self.attempt(spark, step);
        if made.is_err() {
            let (at, motion) = ((step.t, step.h), (&step.state.y[..], &self.stages.v0[..]));
            let (_, acceleration) = spark.predictor.start();
            if acceleration.finds_length(&mut spark.model, at, motion) {
                made = self.attempt(spark, step);
            }
        }
        match made {
            Ok(()) => self.finish(spark, step),
            Err(error) => Err(self.error_of(spark, error)),
        }
    }

    fn attempt(&mut self, spark: &mut Spark, step: Step) -> Result<(), StepError> {
        self.stages.signs = Signs::Regarded;
        let mut attempt = SparkAttempt {
            spark,
            general: self,
            step,
        };
        newton::attempt(&mut attempt, step.h)
    }
}

impl Attempts for SparkAttempt<'_> {
    fn start(&mut self, h: f64, start: Start) -> Result<bool, StepError> {
        let step = Step { h, ..self.step };
        if let Start::Continued | Start::Part = start {
            self.start_at_part(step, start);
            return Ok(true);
        }
        let (model, predictor) = (&mut self.spark.model, &mut self.spark.predictor);
        let General { stages, update, .. } = &mut *self.general;
        if start == Start::Extrapolated {
            return Ok(predictor.extrapolate(stages, &mut update.z, step));
        }
        let is_uniform = start == Start::Uniform;
        predictor.start_cold(model, stages, &mut update.z, step, is_uniform)?;
        Ok(true)
    }

    fn iterate(&mut self, h: f64) -> Result<bool, StepError> {
        let step = Step { h, ..self.step };
        let solved = self.general.iterate(self.spark, step)?;
        Ok(solved.is_near)
    }

    fn count_cold_start(&mut self) {
        self.spark.stats.cold_starts += 1;
    }
}

impl SparkAttempt<'_> {
    /// Starts at the kept part of the step, or at Z_i and V_i extrapolated from it.
    fn start_at_part(&mut self, step: Step, start: Start) {
        let General {
            stages,
            update,
            kept,
            continuation,
            ..
        } = &mut *self.general;
        let Some(kept) = &kept[Slot::Part as usize] else {
            return;
        };
        stages.begin_again(step);
        let (sizes, unknowns) = ([kept.h, step.h], &mut stages.unknowns);
        unknowns.copy_from(&kept.unknowns);
        copy(&mut update.z, &kept.z1);
        if start == Start::Part {
            return;
        }
        let (c, n) = (&stages.tableau.c, step.state.z.len());
        let continuation = continuation.get_or_insert_with(|| Continuation::new(c, n).into());
        let z = &kept.unknowns.z;
        continuation.extend(sizes, &step.state.z, z, unknowns.z.flat_mut());
        if stages.velocity_is_z {
            copy(unknowns.v.flat_mut(), unknowns.z.flat());
        } else {
            let v = &kept.unknowns.v;
            continuation.extend(sizes, &stages.v0, v, unknowns.v.flat_mut());
        }
    }
}

impl BranchAttempts for SparkAttempt<'_> {
    fn iterate_full(&mut self, h: f64) -> Result<Solved, StepError> {
        let step = Step { h, ..self.step };
        self.general.iterate_full(self.spark, step)
    }

    fn keep(&mut self, h: f64, slot: Slot) {
        let General {
            stages,
            update,
            kept,
            is_by_schur,
            ..
        } = &mut *self.general;
        let kept = kept[slot as usize].get_or_insert_with(|| {
            Box::new(KeptStages {
                h,
                unknowns: stages.unknowns.clone(),
                z1: update.z.clone(),
                is_by_schur: false,
            })
        });
        kept.h = h;
        kept.unknowns.copy_from(&stages.unknowns);
        copy(&mut kept.z1, &update.z);
        kept.is_by_schur = *is_by_schur;
    }

    fn put_back(&mut self, h: f64, slot: Slot) {
        let general = &mut *self.general;
        general.stages.begin_again(Step { h, ..self.step });
        if let Some(kept) = &general.kept[slot as usize] {
            general.stages.unknowns.copy_from(&kept.unknowns);
            copy(&mut general.update.z, &kept.z1);
            general.is_by_schur = kept.is_by_schur;
        }
    }

    fn distance(&mut self, _h: f64, slot: Slot) -> (f64, usize) {
        let kept = self.general.kept[slot as usize].as_ref();
        let stages = &self.general.stages;
        kept.map_or((0.0, 0), |kept| stages.distance(&kept.unknowns))
    }

    fn tells_branches(&self) -> bool {
        let problem = &self.spark.model.problem;
        self.general.stages.signs.tell(problem.m + problem.l() > 0)
    }

    fn disregards_signs(&mut self) -> bool {
        self.general.stages.signs.disregard()
    }

    fn is_refused(&self) -> bool {
        self.spark.estimate.is_some() && !self.spark.insists
    }

    fn is_shortened(&self) -> bool {
        self.spark.is_shortened || self.is_refused()
    }

    fn backoff(&mut self) -> &mut Backoff {
        &mut self.spark.backoff
    }
}
