//! Steps of a split operator to a tolerance.
//!
//! A step is made as two halves and as one; their difference tells the error of the halves. H is Hermitian, or damps, so that
//! errors of steps add: each step has the share of the tolerance that its length has of the run. What errors later undo is not
//! taken off, as differences of whole runs miss what fast waves of rough potentials do. Where H does not depend on time every
//! second step of the same length is made as two halves alone, and again by shorter ones where the next one has a larger error.
//!
//! An equation that is not linear takes as few of the wave numbers as hold the state, since resonances with all others bound
//! the step: from the start on so little is beyond two thirds of them that what flows of T leave out is a part of the error
//! that the step may have. A step after which there is more is taken back, and made again with more of the wave numbers.
//!
//! Where V jumps in time the error of a step is as long as the step, and no step has its share. The jump is then found to
//! the last digits of its time, and a step goes up to it and another one across.

use super::Phases;
use super::jumps::{Jump, JumpSearch};
use super::order::{SeenOrder, parted};
use super::tolerance::{Band, ShortSteps, SplitTolerance};
use crate::method::Wave;
use crate::method::doubling::Doubling;
use crate::method::driven::{Sampler, next_break, next_time};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::composition::{Composed, Flow};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use std::f64::consts::PI;
use std::sync::{Arc, Mutex};

/// The part of the tolerance that estimates may add up to.
const SHARE: f64 = 0.8;

/// The part of it that a state may have beyond two thirds of the wave numbers that are taken.
const BEYOND: f64 = 0.1;

/// Rounding errors of a step for each unit of its phase, ...
const ROUNDING: f64 = 8.0 * f64::EPSILON;
/// ... and those of its transforms: the root of those of six lists of flows and of the stages of each, times this number.
/// Steps of 1e-14 on grids of 64 to 65536 points in one and two dimensions were off by at most 0.4 of it.
const TRANSFORMS: f64 = 2.0 * f64::EPSILON;

/// A step is shortened by this factor where a polynomial at so many nodes is off, at any time that was looked at, by so many
/// times the error that the step may have in a unit of time.
const SHORTER: f64 = 0.3;
const NODES: usize = 9;
const UNSEEN: f64 = 10.0;

/// A step of so many roundings of the time is taken as it is.
const LEAST: f64 = 64.0 * f64::EPSILON;

/// A step up to a jump is shorter than the refused one by this factor.
const NEARER: f64 = 0.99;

/// A split operator with steps as long as a tolerance allows.
#[derive(Clone)]
pub struct SplitSteps {
    composed: Composed<Phases>,
    doubling: Doubling,
    tolerance: SplitTolerance,
    /// The length of the next step at most, and that of the last one.
    next: f64,
    last: f64,
    order: SeenOrder,
    /// Roundings of the transforms of a step.
    noise: f64,
    search: JumpSearch,
    band: Band,
    /// Functions of time as they were looked at over the run.
    scan: Option<Sampler>,
    /// A jump ahead within this step of the run.
    jump: Option<Jump>,
    /// Whether H is linear and does not depend on time: every second step of a length is looked at then.
    is_steady: bool,
    /// The start of the last step, which may be taken back, and whether it was looked at.
    held: Option<(f64, bool)>,
    /// The last time from which one that was looked at was taken back: only beyond it another one is.
    back: f64,
    /// Short ones in this step of the run.
    short: ShortSteps,
    /// The ends of this step of the run, and the next time up to which a jump was looked for.
    ends: (f64, f64),
    stop: f64,
    /// The beginning of a run that was made before.
    begun: BegunRun,
}

/// The beginning of a run, until the run with its start goes on from there: the start, the stepper, the state and its time.
pub type BegunRun = Arc<Mutex<Option<Box<(Wave<f64>, SplitSteps, Wave<f64>, f64)>>>>;

impl SplitSteps {
    /// Steps by a list of flows.
    ///
    /// # Errors
    /// It was interrupted.
    pub fn new(
        mut phases: Phases,
        program: Vec<Flow>,
        mut tolerance: SplitTolerance,
    ) -> Result<Self, StepError> {
        let points = phases.psi.len();
        let drifts = program.iter().filter(|flow| flow.part == 0).count();
        let roundings = 6.0 * drifts as f64 * (points as f64).log2();
        let kicks = &phases.kicks;
        let is_steady = !kicks.is_driven() && !kicks.is_nonlinear();
        let parts = kicks.parts(std::mem::take(&mut tolerance.looks));
        let sampler = Sampler::new(kicks.hamiltonian().clone(), parts);
        let band = Band::new(&tolerance);
        let prepare = |sampler: Sampler| sampler.with_breaks(&tolerance.breaks).with_scan();
        phases.set_band(band.part());
        Ok(Self {
            scan: sampler.transpose()?.map(prepare).transpose()?,
            doubling: Doubling::new(points).keeping(),
            noise: TRANSFORMS * roundings.sqrt(),
            search: JumpSearch::default(),
            order: SeenOrder::new(tolerance.order),
            jump: None,
            is_steady,
            held: None,
            back: 0.0,
            short: ShortSteps::default(),
            ends: (0.0, 0.0),
            stop: f64::NAN,
            begun: BegunRun::default(),
            composed: Composed::following(phases, program),
            next: tolerance.first.min(band.longest()),
            band,
            last: 0.0,
            tolerance,
        })
    }

    /// The same, which goes on from the beginning of a run.
    #[must_use]
    pub fn after(self, begun: BegunRun) -> Self {
        Self { begun, ..self }
    }

    /// Begins a run from a state, with so many flows of T or more, up to its first output.
    ///
    /// # Errors
    /// A step failed, or was interrupted.
    pub fn begin_run(
        mut self,
        (t, end): (f64, f64),
        flows: usize,
        start: Wave<f64>,
    ) -> Result<(Self, BegunRun, f64), StepError> {
        let mut state = start.clone();
        let mut now = self.begin((t, end), &mut state);
        while now.to_bits() != end.to_bits() && self.stats().evaluations / 2 < flows {
            now = self.go_on(now, &mut state)?;
        }
        let begun = Box::new((start, self.clone(), state, now));
        Ok((self, Arc::new(Mutex::new(Some(begun))), now))
    }

    /// The length of the next step.
    pub fn next(&self) -> f64 {
        self.next
    }

    /// Begins a step of the run, and returns the time of the state, a later one where the run was begun before.
    fn begin(&mut self, ends: (f64, f64), state: &mut Wave<f64>) -> f64 {
        let begun = self.begun.lock().ok();
        let begun = begun
            .and_then(|mut begun| begun.take_if(|begun| begun.1.ends == ends && begun.0 == *state));
        if let Some((_, steps, reached, now)) = begun.map(|begun| *begun) {
            let cancel = self.composed.parts().cancel.clone();
            *self = steps;
            self.composed.parts_mut().cancel = cancel;
            *state = reached;
            return now;
        }
        (self.ends, self.stop) = (ends, f64::NAN);
        (self.jump, self.held, self.back) = (None, None, ends.0);
        self.short = ShortSteps::new(ends);
        ends.0
    }

    /// One step on the way to the end of a step of the run, and where it leads.
    fn go_on(&mut self, now: f64, state: &mut Wave<f64>) -> Result<f64, StepError> {
        let end = self.ends.1;
        let stop = next_break(self.tolerance.breaks.iter(), now, end);
        if stop.to_bits() != self.stop.to_bits() {
            self.stop = stop;
            self.expect_jump((now, stop, end))?;
        }
        while !self.band.is_tried && self.widens(self.next, state)? {}
        self.band.is_tried = true;
        self.advance(now, stop, state)
    }

    /// One step to at most `end`, and where it leads.
    fn advance(&mut self, t: f64, end: f64, state: &mut Wave<f64>) -> Result<f64, StepError> {
        let least = LEAST * t.abs().max(end.abs());
        let next = self.next;
        loop {
            let (stop, crossed) = match self.jump {
                Some(jump) if t.to_bits() == jump.before.to_bits() => (jump.after, Some(jump)),
                Some(jump) => (jump.before, None),
                None => (end, None),
            };
            let h = match crossed {
                Some(_) => stop - t,
                None => parted((t, stop - t), self.next, self.last),
            };
            if crossed.is_none() && h.abs() > least && self.passes_over(t, h) {
                self.next = SHORTER * h.abs();
                self.look_for_jump((t, h), stop, next)?;
                continue;
            }
            let goes_on = h.to_bits() == self.last.to_bits();
            let is_seen = !matches!(self.held, Some((_, false)));
            if goes_on && self.is_steady && is_seen && (stop - t).abs() > h.abs() {
                self.held = Some((t, false));
                self.doubling.pass(&mut self.composed, (t, h), state)?;
                return Ok(next_time(t, h, stop));
            }
            if !goes_on {
                self.composed.parts_mut().forget_tables();
            }
            let apart = match self.doubling.step(&mut self.composed, (t, h), state) {
                // the state loses the norm of waves beyond the wave numbers that are taken
                Err(StepError::Norm { .. } | StepError::Unresolved { .. })
                    if !self.band.is_all() =>
                {
                    self.begin_anew();
                    self.doubling.put_back(state);
                    self.take_more();
                    continue;
                }
                // shorter steps may be in no resonance with waves of the state
                Err(StepError::Unresolved { .. }) if h.abs() * 2.0 * self.tolerance.beta > PI => {
                    self.begin_anew();
                    self.doubling.put_back(state);
                    self.next = SHORTER * h.abs();
                    continue;
                }
                made => made?,
            };
            if crossed.is_none() && self.widens(h, state)? {
                self.doubling.put_back(state);
                continue;
            }
            let error = self.error(apart, (t, h), state.start);
            let allowed = SHARE * self.tolerance.rate * h.abs();
            self.last = h;
            self.next = self.order.next(h, allowed / error).min(self.band.longest());
            if let Some(jump) = crossed {
                (self.next, self.jump, self.held) = (jump.next.max(next), None, None);
                return Ok(stop);
            }
            if error <= allowed || h.abs() <= least {
                self.short.count(h, error)?;
                self.doubling.keep();
                self.held = Some((t, true));
                return Ok(next_time(t, h, stop));
            }
            // nor was the step before seen to be short enough, or by an order that errors do not have
            if let Some((before, is_seen)) = self.held
                && (!is_seen || self.order.is_low() && (t - self.back) * h > 0.0)
            {
                (self.held, self.back) = (None, t);
                self.doubling.put_back_passed(state);
                return Ok(before);
            }
            self.doubling.put_back(state);
            self.look_for_jump((t, h), stop, next)?;
        }
    }

    /// Takes more of the wave numbers where a state that a step is to end with has too much beyond two thirds of them.
    fn widens(&mut self, h: f64, state: &Wave<f64>) -> Result<bool, StepError> {
        let most = BEYOND * self.tolerance.rate * h.abs();
        if self.composed.parts_mut().share_beyond(state)? <= most * most {
            return Ok(false);
        }
        self.take_more();
        Ok(true)
    }

    /// Takes the next larger part of the wave numbers.
    fn take_more(&mut self) {
        self.band.widen();
        self.composed.parts_mut().set_band(self.band.part());
        (self.next, self.last, self.held) = (self.next.min(self.band.longest()), 0.0, None);
    }

    /// Forgets a step that failed.
    fn begin_anew(&mut self) {
        let (phases, program) = (self.composed.parts().clone(), self.composed.program());
        self.composed = Composed::following(phases, program.to_vec());
    }

    /// Whether a step passes over a value of V, or of W at some densities, that was seen before the run.
    fn passes_over(&mut self, t: f64, h: f64) -> bool {
        let rounded = ROUNDING * self.tolerance.energy;
        let unseen = SHARE * self.tolerance.rate * UNSEEN + rounded;
        let nodes = (NODES, NODES);
        (self.scan.as_mut()).is_some_and(|scan| scan.passes_over((t, h), nodes, unseen))
    }

    /// Looks for a jump within a step that was refused, on the way to `stop`; behind it steps are as long as before.
    fn look_for_jump(&mut self, (t, h): (f64, f64), stop: f64, next: f64) -> Result<(), StepError> {
        let kicks = &mut self.composed.parts_mut().kicks;
        if !kicks.is_driven() {
            return Ok(());
        }
        // a smaller one has no more than the share of the step
        let least = SHARE * self.tolerance.rate;
        let Some((before, after)) = self.search.find(kicks, (t, h), least)? else {
            return Ok(());
        };
        // one at the end of a step up to another is found again by shorter steps
        if self.jump.is_none() || (before - t).abs() < NEARER * h.abs() {
            let is_past = (after - t).abs() >= (stop - t).abs();
            let after = if is_past { stop } else { after };
            self.jump = Some(Jump {
                before,
                after,
                next,
            });
            self.next = next;
        }
        Ok(())
    }

    /// Looks for a jump where steps end on the way to `end`.
    fn expect_jump(&mut self, (t, edge, end): (f64, f64, f64)) -> Result<(), StepError> {
        let kicks = &mut self.composed.parts_mut().kicks;
        if kicks.is_driven() {
            let least = SHARE * self.tolerance.rate;
            let next = self.next;
            let found = self.search.around(kicks, (t, edge, end), least)?;
            self.jump = found.map(|(before, after)| Jump {
                before,
                after,
                next,
            });
        }
        Ok(())
    }

    /// The error of two halves that are so far off a step made as one, relative to the norm at the start.
    fn error(&mut self, apart: f64, (t, h): (f64, f64), start: f64) -> f64 {
        let noise = self.noise + ROUNDING * self.tolerance.energy * h.abs();
        let found = if start > 0.0 {
            apart / start.sqrt()
        } else {
            0.0
        };
        self.order.error((t, h), (found - noise).max(0.0))
    }
}

impl Stepper for SplitSteps {
    type State = Wave<f64>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        let end = t + h;
        let mut now = self.begin((t, end), state);
        while now.to_bits() != end.to_bits() {
            now = self.go_on(now, state)?;
        }
        Ok(())
    }

    fn synchronize(&mut self, state: &mut Wave<f64>) -> Result<(), StepError> {
        self.composed.synchronize(state)
    }

    fn stats(&self) -> Stats {
        self.composed.stats()
    }
}

impl Checkpoint for SplitSteps {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.next, self.last).save(member, out);
        self.band.save(member, out);
        self.order.save(member, out);
        self.composed.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut lengths = (0.0, 0.0);
        lengths.restore(member, saved)?;
        self.band.restore(member, saved)?;
        self.composed.parts_mut().set_band(self.band.part());
        (self.next, self.last) = lengths;
        self.order.restore(member, saved)?;
        self.composed.restore(member, saved)
    }
}
