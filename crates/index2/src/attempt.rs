//! The attempts at a step of an index-2 method.

use super::stages::{CollocationStep, KeptCollocation};
use super::{Index2, predictor};
use liouville_base::error::StepError;
use liouville_base::linalg::{furthest, max_norm};
use liouville_base::newton::{
    Attempts, Backoff, BranchAttempts, Continuation, Slot, Solved, Start,
};

/// A step whose stage equations are attempted.
pub(super) struct CollocationAttempt<'a> {
    pub(super) index2: &'a mut Index2,
    pub(super) step: CollocationStep<'a>,
}

impl Attempts for CollocationAttempt<'_> {
    fn start(&mut self, h: f64, start: Start) -> Result<bool, StepError> {
        let (at, step) = (&mut *self.index2, CollocationStep { h, ..self.step });
        at.is_far = start != Start::Extrapolated;
        match start {
            Start::Extrapolated => {
                let (held, stages) = (&mut at.predictor, &mut at.stages);
                if !predictor::extrapolate(held, stages, &mut at.slope, h) {
                    return Ok(false);
                }
            }
            Start::Cold => at.start_by_euler(step),
            Start::Uniform => {
                at.start_by_euler(step);
                at.start_constant(step);
            }
            Start::Continued | Start::Part => at.start_at_part(h, start),
        }
        self.measure(h);
        Ok(true)
    }

    fn is_reusable(&self, h: f64) -> bool {
        self.index2.matrix.reuse.is_reusable(h)
    }

    fn discard(&mut self) {
        self.index2.matrix.reuse.discard();
    }

    fn iterate(&mut self, h: f64) -> Result<bool, StepError> {
        let solved = (self.index2).iterate(CollocationStep { h, ..self.step }, false)?;
        Ok(solved.is_near)
    }

    fn count_cold_start(&mut self) {
        self.index2.stats.cold_starts += 1;
    }
}

impl CollocationAttempt<'_> {
    /// Sets the yardstick of a step of `h`.
    fn measure(&mut self, h: f64) {
        let speed = max_norm(&self.index2.slope);
        self.index2.stages.yardstick = speed + max_norm(&self.step.state.y) / h.abs();
    }
}

impl Index2 {
    /// The unknowns of the part of the step that is kept, or V_i where it leads.
    fn start_at_part(&mut self, h: f64, start: Start) {
        let Some(kept) = &self.kept[Slot::Part as usize] else {
            return;
        };
        let (stages, slope) = (&mut self.stages, &self.slope);
        kept.put_back(stages);
        if start == Start::Part {
            return;
        }
        let continuation = (self.continuation)
            .get_or_insert_with(|| Continuation::new(&stages.c, slope.len()).into());
        continuation.extend([kept.h, h], slope, &kept.v, stages.v.flat_mut());
    }
}

impl BranchAttempts for CollocationAttempt<'_> {
    fn iterate_full(&mut self, h: f64) -> Result<Solved, StepError> {
        self.index2
            .iterate(CollocationStep { h, ..self.step }, true)
    }

    fn keep(&mut self, h: f64, slot: Slot) {
        let stages = &self.index2.stages;
        let kept = self.index2.kept[slot as usize]
            .get_or_insert_with(|| Box::new(KeptCollocation::new(stages)));
        kept.h = h;
        kept.copy_from(stages);
    }

    fn put_back(&mut self, h: f64, slot: Slot) {
        self.measure(h);
        if let Some(kept) = &self.index2.kept[slot as usize] {
            kept.put_back(&mut self.index2.stages);
        }
    }

    fn distance(&mut self, _h: f64, slot: Slot) -> (f64, usize) {
        let stages = &self.index2.stages;
        let unit = stages.yardstick.max(max_norm(stages.v.flat()));
        self.index2.kept[slot as usize]
            .as_ref()
            .map_or((0.0, 0), |kept| {
                let (apart, k) = furthest(stages.v.flat(), kept.v.flat(), unit);
                (apart, k % stages.v.cols().max(1))
            })
    }

    fn backoff(&mut self) -> &mut Backoff {
        &mut self.index2.backoff
    }
}
