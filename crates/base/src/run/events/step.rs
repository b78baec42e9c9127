//! The events of a step: the zeros of a function, with samples and signs of the step before.

use super::search::{FunctionInStep, InterpolationAccuracy, Node, Zero, find_zeros};
use super::{NOISE, SAMPLES};
use crate::error::StepError;

/// Where e is zero, its sign is that after this fraction of a sample, a power of 2, or later.
const FIRST_PART: i32 = -24;
/// Times that differ by so many roundings are the same.
const SAME: f64 = 4.0 * f64::EPSILON;

/// A zero of an event's function in a step.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    /// θ
    pub x: f64,
    /// Which event.
    pub index: usize,
    /// The sign after it.
    pub sign: f64,
    /// Whether its direction is the wanted one.
    pub counts: bool,
}

/// The search for zeros, with its memory.
#[derive(Clone, Debug, Default)]
pub struct Search {
    nodes: Vec<Node>,
    zeros: Vec<Zero>,
}

impl Search {
    /// Appends the zeros of the event number `index` in a step of length h from t, and keeps what the search in the
    /// next step starts from.
    ///
    /// # Errors
    /// A value that has to be known is not finite, or a part of the step cannot be made.
    pub fn find(
        &mut self,
        in_step: &mut impl FunctionInStep,
        index: usize,
        (t, h): (f64, f64),
        accuracy: InterpolationAccuracy,
        found: &mut Vec<Crossing>,
    ) -> Result<(), StepError> {
        let Self { nodes, zeros } = self;
        nodes.clear();
        zeros.clear();
        let (last, earlier, mut sign) = {
            let function = in_step.function();
            (function.last, function.earlier, function.sign)
        };
        let mut first = Node {
            x: 0.0,
            value: last,
            is_exact: true,
        };
        let mut side = None;
        let mut before = Node {
            x: -1.0 / SAMPLES as f64,
            value: f64::NAN,
            is_exact: false,
        };
        if let Some((earlier, value)) = earlier {
            (before.x, before.value) = (-earlier / h.abs(), value);
        } else {
            // before the start the function may not exist
            before.value = in_step.interpolated(before.x).unwrap_or(f64::NAN);
            first = after_start(in_step, (t, h), first)?;
            let is_on_it = first.x > 0.0 || first.value == 0.0;
            if is_on_it && sign != 0.0 && first.value * sign <= 0.0 {
                // a piece of the run that begins on the event, on a known side of it
                before.value = f64::NAN;
                side = Some(Node {
                    x: 0.0,
                    value: sign * f64::MIN_POSITIVE,
                    is_exact: true,
                });
            } else if is_on_it && in_step.function().rule.touch > 0.0 {
                before.value = f64::NAN; // a function that begins on zero does not touch it there
            }
        }
        nodes.push(before);
        nodes.extend(side);
        if side.is_none() || first.value != 0.0 {
            nodes.push(first);
        }
        let function = in_step.function();
        nodes.extend(
            (function.samples.iter().zip(1_usize..)).map(|(value, k)| Node {
                x: k as f64 / SAMPLES as f64,
                value: *value,
                is_exact: k == SAMPLES,
            }),
        );
        function.earlier = Some((h.abs() / SAMPLES as f64, function.samples[SAMPLES - 2]));
        function.last = function.samples[SAMPLES - 1];
        let resolution = f64::EPSILON / 2.0 * (t / h).abs().max(1.0);
        find_zeros(in_step, nodes, &mut sign, (accuracy, resolution), zeros)?;
        let function = in_step.function();
        function.sign = sign;
        let size = |size: f64, value: &f64| size.max(value.abs());
        let samples = &function.samples[..SAMPLES];
        function.peak = samples.iter().fold(function.peak, size);
        found.extend(zeros.iter().map(|zero| Crossing {
            x: zero.x,
            index,
            sign: zero.sign,
            counts: zero.touches || function.counts(zero.sign),
        }));
        Ok(())
    }
}

/// The first point of a run where an event's function exceeds its roundoff.
fn after_start(
    in_step: &mut impl FunctionInStep,
    step: (f64, f64),
    start: Node,
) -> Result<Node, StepError> {
    let slope = (in_step.function().samples[0] - start.value).abs() * SAMPLES as f64;
    let noise = roundoff(in_step, step, (start, slope));
    if start.value.abs() > noise {
        return Ok(start);
    }
    let clear = clear_after(in_step, start.x, noise)?;
    Ok(clear.unwrap_or(Node {
        value: 0.0,
        ..start
    }))
}

/// How much roundoff of time and state may change an event's function at the end of a part of a step of length h from t;
/// it changes by so much over the whole step.
fn roundoff(
    in_step: &mut impl FunctionInStep,
    (t, h): (f64, f64),
    (at, slope): (Node, f64),
) -> f64 {
    let mut noise = NOISE * slope * (t / h + at.x).abs().max(1.0);
    for parts in [[NOISE, NOISE], [NOISE, -NOISE]] {
        // beside the state the function need not exist
        if let Ok(value) = in_step.near(at.x, parts) {
            noise = noise.max((value - at.value).abs());
        }
    }
    noise
}

/// The first point after one where an event's function is zero at which it exceeds its roundoff.
fn clear_after(
    in_step: &mut impl FunctionInStep,
    start: f64,
    noise: f64,
) -> Result<Option<Node>, StepError> {
    for power in FIRST_PART..0 {
        let x = start + f64::from(power).exp2() / SAMPLES as f64;
        let value = in_step.interpolated(x)?;
        if value.abs() > 2.0 * noise {
            let is_exact = false;
            return Ok(Some(Node { x, value, is_exact }));
        }
    }
    Ok(None)
}

/// How much roundoff may change an event's function at the end of this part of a finished step, where that leaves nothing
/// of it.
fn zero_noise(
    in_step: &mut impl FunctionInStep,
    x: f64,
    step: (f64, f64),
) -> Result<Option<f64>, StepError> {
    let (value, is_exact) = (in_step.exact(x)?, true);
    let samples = &in_step.function().samples;
    let before = (1..SAMPLES).filter(|k| *k as f64 <= x * SAMPLES as f64);
    let k = before.count().max(1);
    let slope = (samples[k] - samples[k - 1]).abs() * SAMPLES as f64;
    let noise = roundoff(in_step, step, (Node { x, value, is_exact }, slope));
    Ok((value.abs() <= noise).then_some(noise))
}

/// How far times may be apart that are the same but for roundoff, as a part of a step of length h from t.
pub fn same_time((t, h): (f64, f64)) -> f64 {
    SAME * t.abs().max((t + h).abs()) / h.abs()
}

/// Whether an event that is met later in a step of length h from t is met at the end of this part of it but for roundoff.
///
/// # Errors
/// A value that is not finite, or a part of the step cannot be made.
pub fn is_met_at(
    in_step: &mut impl FunctionInStep,
    x: f64,
    step: (f64, f64),
    met: Crossing,
) -> Result<bool, StepError> {
    if met.x <= x + same_time(step) {
        return Ok(true);
    }
    // at x alone the function may have had another zero
    for x in [x, f64::midpoint(x, met.x)] {
        if zero_noise(in_step, x, step)?.is_none() {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The event number `index` where it is met at the end of a step of length h from t which ends the run, if it was not met
/// before. A run that goes on from there has it behind it.
///
/// # Errors
/// A value at the end is not finite.
pub fn met_at_end(
    in_step: &mut impl FunctionInStep,
    index: usize,
    step: (f64, f64),
) -> Result<Option<Crossing>, StepError> {
    let Some(noise) = zero_noise(in_step, 1.0, step)? else {
        return Ok(None);
    };
    let sign = -in_step.function().sign;
    // beyond the end the function need not exist
    let after = clear_after(in_step, 1.0, noise);
    let changes = after.map_or(true, |node| {
        node.is_some_and(|node| node.value * sign > 0.0)
    });
    if sign == 0.0 || !changes {
        return Ok(None);
    }
    let function = in_step.function();
    function.sign = sign;
    Ok(Some(Crossing {
        x: 1.0,
        index,
        sign,
        counts: function.counts(sign),
    }))
}
