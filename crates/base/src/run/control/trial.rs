//! Reversible steps that meet a tolerance: their monitor is fitted to a trial run.
//!
//! A trial run by the PI controller gives at each of its steps the step that the tolerance allows there, h e^(−1/k).
//! c is the mean in time of the monitor's quantity x. For each p, the scale ε(p) of the steps ε (c + x)^(−p) is the
//! largest that all steps of the trial allow, and Σ h (c + x)^p / ε(p) is the number of steps over the trial. The least
//! p is taken whose number is at most 1.2 times the least one: equal steps, p = 0, where others would save little.

use super::{Adaptive, StepControl};
use crate::checkpoint::Checkpoint;
use crate::observe::Fitted;

/// The fraction of the allowed step that is taken.
const SAFETY: f64 = 0.9;
/// Steps whose error is below this, in units of the tolerance, do not bound the step allowed.
const LEAST_ERROR: f64 = 1e-3;
/// The powers p, in eighths: up to that of a passage by a centre of gravity, where steps are r^(3/2).
const EIGHTHS: std::ops::RangeInclusive<u8> = 0..=12;
/// Largest ratio of the number of steps to the least one over all p.
const MOST_STEPS_RATIO: f64 = 1.2;

/// A step of the trial.
struct TrialStep {
    h: f64,
    /// The step that the tolerance allows, if the error is large enough to give it.
    allowed: Option<f64>,
    x: f64,
}

/// A trial run from a state, made step by step.
pub(super) struct Trial<State: Checkpoint> {
    control: Adaptive<State>,
    state: State,
    monitor: Box<dyn Fitted<State>>,
    most: usize,
    /// The monitor's quantity at the start and at the present end.
    ends: [f64; 2],
    tried: Vec<TrialStep>,
    is_over: bool,
}

impl<State: Checkpoint> Trial<State> {
    /// A trial of at most so many steps for a monitor.
    pub(super) fn new(
        control: Adaptive<State>,
        most: usize,
        state: State,
        mut monitor: Box<dyn Fitted<State>>,
    ) -> Self {
        let start = monitor.quantity(control.time(), &state);
        Self {
            control,
            state,
            monitor,
            most,
            ends: [start; 2],
            tried: Vec::with_capacity(most),
            is_over: false,
        }
    }

    /// Makes a step, unless the trial is over; whether it is.
    pub(super) fn step(&mut self) -> bool {
        self.is_over |= self.tried.len() >= self.most || self.control.is_over();
        if !self.is_over {
            let t = self.control.time();
            self.is_over = self.control.step(&mut self.state).is_err();
            if !self.is_over {
                self.keep(t);
            }
        }
        self.is_over
    }

    /// Keeps the allowed step and the quantity of the step just made from `t`.
    fn keep(&mut self, t: f64) {
        let now = self.control.time();
        let after = self.monitor.quantity(now, &self.state);
        let h = (now - t).abs();
        let (error, order) = self.control.error();
        let allowed = (error >= LEAST_ERROR).then(|| SAFETY * h * error.powf(-1.0 / order));
        let x = f64::midpoint(self.ends[1], after);
        self.tried.push(TrialStep { h, allowed, x });
        self.ends[1] = after;
    }

    /// Fits the monitor, and returns it with the first step.
    pub(super) fn fit(mut self) -> (Box<dyn Fitted<State>>, Option<f64>) {
        let fitted = fit(&self.tried);
        let first = fitted.map(|(offset, power, scale)| {
            self.monitor.fit(offset, power);
            scale * density(offset + self.ends[0], power)
        });
        (self.monitor, first)
    }
}

/// c, p and ε(p).
fn fit(tried: &[TrialStep]) -> Option<(f64, f64, f64)> {
    let time: f64 = tried.iter().map(|step| step.h).sum();
    let offset = tried.iter().map(|step| step.h * step.x).sum::<f64>() / time;
    let is_usable = offset.is_finite() && offset > 0.0;
    let powers = EIGHTHS.filter(|eighths| is_usable || *eighths == 0);
    let costs = powers.filter_map(|eighths| {
        let power = f64::from(eighths) / 8.0;
        let scale = scale(tried, offset, power)?;
        let steps = tried
            .iter()
            .map(|step| step.h / step.density(offset, power));
        Some((power, scale, steps.sum::<f64>() / scale))
    });
    let costs: Vec<_> = costs.collect();
    let least = costs
        .iter()
        .map(|cost| cost.2)
        .fold(f64::INFINITY, f64::min);
    let (power, scale, _) = costs
        .into_iter()
        .find(|cost| cost.2 <= MOST_STEPS_RATIO * least)?;
    Some((offset, power, scale))
}

/// The largest scale that the tolerance allows in all steps; without an allowed step, that of the longest step made.
fn scale(tried: &[TrialStep], offset: f64, power: f64) -> Option<f64> {
    let allowed = tried
        .iter()
        .filter_map(|step| Some(step.allowed? / step.density(offset, power)));
    allowed.reduce(f64::min).or_else(|| {
        let made = tried
            .iter()
            .map(|step| step.h / step.density(offset, power));
        made.reduce(f64::max)
    })
}

/// x^(−p), 1 for p = 0.
fn density(x: f64, power: f64) -> f64 {
    if power == 0.0 { 1.0 } else { x.powf(-power) }
}

impl TrialStep {
    /// (c + x)^(−p)
    fn density(&self, offset: f64, power: f64) -> f64 {
        density(offset + self.x, power)
    }
}
