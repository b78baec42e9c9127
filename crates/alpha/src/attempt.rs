//! The attempts at a step of the α family.

use super::Alpha;
use super::unknowns::{AlphaSolver, AlphaStep, KeptAlpha};
use liouville_base::error::StepError;
use liouville_base::linalg::{furthest, max_norm};
use liouville_base::newton::{Attempts, Backoff, BranchAttempts, Slot, Solved, Start};

/// A step whose equations are attempted.
pub(super) struct AlphaAttempt<'a> {
    pub(super) alpha: &'a mut Alpha,
    pub(super) step: AlphaStep<'a>,
    /// Where the unknowns were started from last.
    pub(super) from: Start,
}

impl<'a> AlphaAttempt<'a> {
    pub(super) fn new(alpha: &'a mut Alpha, step: AlphaStep<'a>) -> Self {
        let from = Start::Cold;
        Self { alpha, step, from }
    }
}

impl Attempts for AlphaAttempt<'_> {
    fn start(&mut self, h: f64, start: Start) -> Result<bool, StepError> {
        self.from = start;
        let (at, step) = (&mut *self.alpha, AlphaStep { h, ..self.step });
        at.solver.prepare(step);
        if let Start::Continued | Start::Part = start {
            if let Some(kept) = &at.kept_solutions[Slot::Part as usize] {
                let part = if start == Start::Part { kept.h } else { h };
                at.solver.start_at_part(step, kept, part);
            }
            return Ok(true);
        }
        match start {
            Start::Extrapolated if !at.is_warm => return Ok(false),
            Start::Extrapolated => at.extrapolate(step),
            _ => at.start_cold(step)?,
        }
        if start == Start::Uniform {
            at.solver.start_still(step);
        }
        Ok(true)
    }

    fn is_reusable(&self, h: f64) -> bool {
        self.alpha.matrix.reuse.is_reusable(h)
    }

    fn discard(&mut self) {
        self.alpha.matrix.reuse.discard();
    }

    /// A split matrix is split no more where this fails with new factors of it, and not without.
    fn iterate(&mut self, h: f64) -> Result<bool, StepError> {
        let step = AlphaStep { h, ..self.step };
        let has_new_factors = !self.is_reusable(h);
        let mut solved = self.alpha.iterate(step, false);
        if solved.is_err() && has_new_factors && self.alpha.matrix.is_split {
            self.alpha.matrix.split(false);
            self.start(h, self.from)?;
            solved = self.alpha.iterate(step, false);
            self.alpha.matrix.split(solved.is_err());
        }
        solved.map(|solved| solved.is_near)
    }

    fn count_cold_start(&mut self) {
        self.alpha.stats.cold_starts += 1;
    }
}

impl BranchAttempts for AlphaAttempt<'_> {
    fn iterate_full(&mut self, h: f64) -> Result<Solved, StepError> {
        self.alpha.iterate(AlphaStep { h, ..self.step }, true)
    }

    fn keep(&mut self, h: f64, slot: Slot) {
        let kept = self.alpha.kept_solutions[slot as usize].get_or_insert_default();
        self.alpha.solver.place(h);
        kept.copy_from(&self.alpha.solver);
        kept.h = h;
    }

    fn put_back(&mut self, h: f64, slot: Slot) {
        self.alpha.solver.prepare(AlphaStep { h, ..self.step });
        if let Some(kept) = &self.alpha.kept_solutions[slot as usize] {
            kept.put_back(&mut self.alpha.solver);
        }
    }

    fn distance(&mut self, h: f64, slot: Slot) -> (f64, usize) {
        self.alpha.solver.place(h);
        let y = &self.alpha.solver.y;
        let kept = self.alpha.kept_solutions[slot as usize].as_ref();
        kept.map_or((0.0, 0), |kept| {
            furthest(y, &kept.y, max_norm(y).max(max_norm(&kept.y)))
        })
    }

    fn tells_branches(&self) -> bool {
        let at = &self.alpha.solver;
        at.signs.tell(self.alpha.model.problem.mechanical.m > 0)
    }

    fn disregards_signs(&mut self) -> bool {
        self.alpha.solver.signs.disregard()
    }

    fn is_refused(&self) -> bool {
        self.alpha.tolerance.is_some() && !self.alpha.insists
    }

    fn is_shortened(&self) -> bool {
        self.is_refused()
    }

    fn backoff(&mut self) -> &mut Backoff {
        &mut self.alpha.backoff
    }
}

impl AlphaSolver {
    /// φ1 such that y1 is where y0 and z0 alone lead, with the reactions there are.
    fn start_still(&mut self, step: AlphaStep) {
        let n = self.y.len();
        self.delta[..n].copy_from_slice(&self.predicted);
        self.start_at(step.h);
    }

    /// φ1 such that y1 is where the acceleration over a part of the step leads in a time of `h`.
    fn start_at_part(&mut self, step: AlphaStep, kept: &KeptAlpha, h: f64) {
        kept.put_back(self);
        let (times, state) = (h / kept.h, step.state);
        for (k, delta) in self.delta[..kept.y.len()].iter_mut().enumerate() {
            let (y, z) = (state.y[k], state.z[k]);
            *delta = y + h * z + times * times * (kept.y[k] - y - kept.h * z);
        }
        self.start_at(step.h);
    }

    /// φ1 such that y1 is what `delta` holds.
    fn start_at(&mut self, h: f64) {
        self.phi.fill(0.0);
        self.place(h);
        let unit = h * h * self.coupling.phi[0];
        for ((phi, y), wanted) in self.phi.iter_mut().zip(&self.y).zip(&self.delta) {
            *phi = (wanted - y) / unit;
        }
    }
}
