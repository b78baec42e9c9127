//! The events of a step: the zeros of a function, with samples and signs of the step before.

use super::search::{FunctionInStep, InterpolationAccuracy, Node, Zero, find_zeros};
use super::{NOISE, SAMPLES};
use crate::error::StepError;

/// Where a run starts on an event, the sign of e is that after this fraction of a sample, a power of 2, or later.
const FIRST_PART: i32 = -24;

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
        found.extend(zeros.iter().map(|zero| Crossing {
            x: zero.x,
            index,
            sign: zero.sign,
            counts: function.counts(zero.sign),
        }));
        Ok(())
    }
}

/// The first point of a run where an event's function exceeds its roundoff.
fn after_start(
    in_step: &mut impl FunctionInStep,
    (t, h): (f64, f64),
    start: Node,
) -> Result<Node, StepError> {
    let slope = (in_step.function().samples[0] - start.value).abs() * SAMPLES as f64;
    let mut noise = NOISE * slope * (t / h).abs().max(1.0);
    for parts in [[NOISE, NOISE], [NOISE, -NOISE]] {
        noise = noise.max((in_step.near_start(parts)? - start.value).abs());
    }
    if start.value.abs() > noise {
        return Ok(start);
    }
    for power in FIRST_PART..0 {
        let x = f64::from(power).exp2() / SAMPLES as f64;
        let value = in_step.interpolated(x)?;
        if value.abs() > 2.0 * noise {
            return Ok(Node {
                x,
                value,
                is_exact: false,
            });
        }
    }
    Ok(Node {
        value: 0.0,
        ..start
    })
}
