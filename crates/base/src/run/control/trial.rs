//! Reversible steps that meet a tolerance: their monitor is fitted to a trial stretch.
//!
//! A trial by the PI controller tells at each of its steps which step the tolerance allows there, h e^(−1/k). With x̄
//! the mean in time of the monitor's quantity x, c = x̄. For each p, the scale ε(p) of the steps ε (c + x)^(−p) is the
//! largest that all steps of the trial allow, and Σ h (c + x)^p / ε(p) is the number of steps that the stretch takes.
//! The least p is taken that takes few steps: equal steps, p = 0, where others would save little.

use super::{Adaptive, StepControl};
use crate::checkpoint::Checkpoint;
use crate::observe::Fitted;

/// The part of the allowed step that is taken.
const SAFETY: f64 = 0.9;
/// Errors below this, in units of the tolerance, say too little about the step allowed.
const TELLING: f64 = 1e-3;
/// The powers p, in eighths: up to that of a passage by a centre of gravity, where steps are r^(3/2).
const EIGHTHS: std::ops::RangeInclusive<u8> = 0..=12;
/// How many times as many steps as at best may be taken.
const FEW: f64 = 1.2;

/// A step of the trial.
struct Tried {
    h: f64,
    /// The step that the tolerance allows, if the error says it.
    allowed: Option<f64>,
    x: f64,
}

/// Fits a monitor to `most` steps of the motion from here, and returns the first step.
pub(super) fn fit<State: Checkpoint>(
    mut trial: Adaptive<State>,
    most: usize,
    mut state: State,
    monitor: &mut dyn Fitted<State>,
) -> Option<f64> {
    let start = monitor.quantity(trial.time(), &state);
    let (mut tried, mut before) = (Vec::with_capacity(most), start);
    while tried.len() < most && !trial.is_over() {
        let t = trial.time();
        if trial.step(&mut state).is_err() {
            break;
        }
        let after = monitor.quantity(trial.time(), &state);
        let h = (trial.time() - t).abs();
        let (error, order) = trial.error();
        let allowed = (error >= TELLING).then(|| SAFETY * h * error.powf(-1.0 / order));
        let x = f64::midpoint(before, after);
        tried.push(Tried { h, allowed, x });
        before = after;
    }
    let time: f64 = tried.iter().map(|step| step.h).sum();
    let offset = tried.iter().map(|step| step.h * step.x).sum::<f64>() / time;
    let is_usable = offset.is_finite() && offset > 0.0;
    let powers = EIGHTHS.filter(|eighths| is_usable || *eighths == 0);
    let costs = powers.filter_map(|eighths| {
        let power = f64::from(eighths) / 8.0;
        let scale = scale(&tried, offset, power)?;
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
    let (power, scale, _) = costs.into_iter().find(|cost| cost.2 <= FEW * least)?;
    monitor.fit(offset, power);
    Some(scale * density(offset + start, power))
}

/// The largest scale that the tolerance allows in all steps; where no error tells, that of the longest.
fn scale(tried: &[Tried], offset: f64, power: f64) -> Option<f64> {
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

impl Tried {
    /// (c + x)^(−p)
    fn density(&self, offset: f64, power: f64) -> f64 {
        density(offset + self.x, power)
    }
}
