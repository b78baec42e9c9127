//! Zeros of a function e within a step.
//!
//! With θ from 0 to 1 over the step, the interpolated function is e on the interpolated trajectory, and the exact one
//! is e after one step of θ h from the start of this one: of the method's own accuracy, and continuous from step
//! to step. The interpolated function is sampled at equal distances, once beyond each end of the step. Between two
//! samples of opposite sign there is a zero. Where |e| has a local minimum without a change of sign, parabolas locate
//! the minimum, until the sign changes or the minimum is found not to reach zero; where the event has a size that still
//! counts as zero, it is one if it is that small. Values near zero are replaced by those of the exact function, on which
//! the zero is located by the iteration of [`crate::bracket`], to roundoff in t.

use super::WatchedFunction;
use crate::bracket::Bracket;
use crate::error::StepError;

/// An event's function e in a finished step, as a function of θ, interpolated and exact.
pub trait FunctionInStep {
    /// The function.
    fn function(&mut self) -> &mut WatchedFunction;

    /// e on the interpolated trajectory.
    ///
    /// # Errors
    /// It is not finite.
    fn interpolated(&mut self, x: f64) -> Result<f64, StepError>;

    /// e after a substep of this fraction.
    ///
    /// # Errors
    /// It is not finite, or the step cannot be made.
    fn exact(&mut self, x: f64) -> Result<f64, StepError>;

    /// e after a substep of this fraction, each number of the state changed by a part of itself, by these two in turn.
    ///
    /// # Errors
    /// It is not finite, or the step cannot be made.
    fn near(&mut self, x: f64, parts: [f64; 2]) -> Result<f64, StepError>;
}

/// A value of the function, and whether it is that of the exact one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node {
    pub(super) x: f64,
    pub(super) value: f64,
    pub(super) is_exact: bool,
}

/// A zero, the sign of the function after it, and whether it was that before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Zero {
    pub(super) x: f64,
    pub(super) sign: f64,
    pub(super) touches: bool,
}

/// How far the interpolated function may be from the exact one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterpolationAccuracy {
    /// A minimum is located on the exact function where it is closer to zero than so many second differences of the
    /// samples around it.
    near_zero: f64,
    /// The range of that search beyond the samples around the minimum.
    margin: f64,
}

impl InterpolationAccuracy {
    /// Accuracy of an interpolation whose error is far below the second differences of its samples.
    pub const FINE: Self = Self {
        near_zero: 0.5,
        margin: 0.0,
    };
    /// Of one whose error is of the same size, as with a method of order 2.
    pub const COARSE: Self = Self {
        near_zero: 8.0,
        margin: 0.25,
    };
}

/// A sample is evaluated exactly where it is smaller than this fraction of the difference to its neighbours.
const NEAR_ZERO: f64 = 0.05;
/// Minima beyond an end of the step by this fraction of it still count as those of the step.
const BEYOND: f64 = 0.02;
/// Evaluations that locating a minimum may take.
const MOST_VALUES: usize = 16;
/// Resolution of a minimum, in θ.
const RESOLUTION: f64 = 1e-9;
/// The search for a minimum ends where two steps in a row lower it by less than this fraction.
const GAIN: f64 = 0.01;
/// Resolution of the zeros of the interpolated function, in θ.
const INTERPOLATED_RESOLUTION: f64 = 1e-7;

/// Appends the zeros within the step to `zeros`; `nodes` are its samples, those beyond its ends included,
/// and `sign` that of the last clear value before.
pub(super) fn find_zeros(
    in_step: &mut impl FunctionInStep,
    nodes: &mut Vec<Node>,
    sign: &mut f64,
    (accuracy, resolution): (InterpolationAccuracy, f64),
    zeros: &mut Vec<Zero>,
) -> Result<(), StepError> {
    for k in 1..nodes.len() - 1 {
        let [before, node, after] = [nodes[k - 1].value, nodes[k].value, nodes[k + 1].value];
        let change = (before - node).abs().max((after - node).abs());
        let curvature = (before + after - 2.0 * node).abs();
        if node.abs() < (NEAR_ZERO * change).max(accuracy.near_zero * curvature) {
            make_exact(in_step, &mut nodes[k])?;
        }
    }
    for k in (1..nodes.len() - 1).rev() {
        let touch = in_step.function().rule.touch;
        if let Some(node) =
            turning_point(in_step, [nodes[k - 1], nodes[k], nodes[k + 1]], accuracy)?
        {
            let sign = nodes[k + 1].value.signum();
            if node.value * sign < 0.0 {
                let at = nodes.partition_point(|other| other.x <= node.x);
                nodes.insert(at, node);
            } else if touch > 0.0 && node.value.abs() <= touch && touch < peak(in_step, &nodes[..k])
            {
                let (x, touches) = (node.x, true);
                zeros.push(Zero { x, sign, touches });
            }
        }
    }
    nodes.retain(|node| (0.0..=1.0).contains(&node.x));
    let mut k = 0;
    while k < nodes.len() {
        let now = nodes[k].value;
        if now != 0.0 && (k == 0 || *sign == 0.0) {
            *sign = now.signum();
        }
        if now * *sign < 0.0 {
            let Some(x) = zero(in_step, nodes[k - 1], nodes[k], resolution)? else {
                // the interpolated signs were wrong: repeat with the exact ones
                for node in &mut nodes[k - 1..=k] {
                    make_exact(in_step, node)?;
                }
                k -= 1;
                continue;
            };
            *sign = now.signum();
            zeros.push(Zero {
                x,
                sign: *sign,
                touches: false,
            });
        }
        k += 1;
    }
    Ok(())
}

/// The largest size of the function so far, to the last of these nodes.
fn peak(in_step: &mut impl FunctionInStep, nodes: &[Node]) -> f64 {
    let peak = in_step.function().peak;
    let here = nodes.iter().filter(|node| node.x >= 0.0); // before the step may be before the start
    here.fold(peak, |peak, node| peak.max(node.value.abs()))
}

/// Gives a node the exact value.
fn make_exact(in_step: &mut impl FunctionInStep, node: &mut Node) -> Result<(), StepError> {
    if !node.is_exact {
        node.value = in_step.exact(node.x)?;
        node.is_exact = true;
    }
    Ok(())
}

/// The lowest exact node found, if |e| of three samples has a minimum around the middle one that may reach zero: the
/// first one whose sign is not theirs.
fn turning_point(
    in_step: &mut impl FunctionInStep,
    samples: [Node; 3],
    accuracy: InterpolationAccuracy,
) -> Result<Option<Node>, StepError> {
    let sign = samples[2].value.signum();
    let points = samples.map(|node| (node.x, sign * node.value));
    let [(from, left), (_, middle), (to, right)] = points;
    let curvature = left + right - 2.0 * middle;
    let is_minimum = left > 0.0 && right > 0.0 && (0.0..=left.min(right)).contains(&middle);
    if !is_minimum || middle > curvature.max(accuracy.near_zero * curvature) {
        return Ok(None);
    }
    if samples.iter().all(|node| node.is_exact) {
        return lowest_point(in_step, sign, points).map(Some);
    }
    let (x, value) = minimize(|x| Ok(sign * in_step.interpolated(x)?), points)?;
    let beyond = accuracy.margin.max(BEYOND);
    if value > accuracy.near_zero * curvature || !(-beyond..=1.0 + beyond).contains(&x) {
        return Ok(None);
    }
    let (from, to) = (
        (from - accuracy.margin).max(0.0),
        (to + accuracy.margin).min(1.0),
    );
    let margin = BEYOND * (to - from);
    let mut exact = [from, x.clamp(from + margin, to - margin), to].map(|x| (x, 0.0));
    for (x, value) in &mut exact {
        *value = sign * in_step.exact(*x)?;
    }
    lowest_point(in_step, sign, exact).map(Some)
}

/// The first point where `sign` times the exact function is negative, or the lowest that parabolas through three points
/// lead to.
fn lowest_point(
    in_step: &mut impl FunctionInStep,
    sign: f64,
    points: [(f64, f64); 3],
) -> Result<Node, StepError> {
    let first = points.into_iter().find(|(_, value)| *value < 0.0);
    let (x, value) = match first {
        Some(found) => found,
        None => minimize(|x| Ok(sign * in_step.exact(x)?), points)?,
    };
    Ok(Node {
        x,
        value: sign * value,
        is_exact: true,
    })
}

/// The minimum that parabolas through three points lead to, or the first negative point.
fn minimize(
    mut f: impl FnMut(f64) -> Result<f64, StepError>,
    [mut left, mut middle, mut right]: [(f64, f64); 3],
) -> Result<(f64, f64), StepError> {
    let mut was_slow = false;
    for _ in 0..MOST_VALUES {
        let x = vertex(left, middle, right);
        if (x - middle.0).abs() < RESOLUTION {
            break;
        }
        let next = (x, f(x)?);
        let gain = middle.1 - next.1;
        let side = if x < middle.0 { &mut right } else { &mut left };
        if gain > 0.0 {
            *side = middle;
            middle = next;
        } else if x < middle.0 {
            left = next;
        } else {
            right = next;
        }
        let is_slow = (0.0..GAIN * middle.1).contains(&gain);
        if middle.1 < 0.0 || is_slow && was_slow {
            break;
        }
        was_slow = is_slow;
    }
    Ok(middle)
}

/// Where the parabola through three points is the lowest; where that is not between them, a point in the
/// longer half.
fn vertex(left: (f64, f64), middle: (f64, f64), right: (f64, f64)) -> f64 {
    let (to_left, to_right) = (middle.0 - left.0, middle.0 - right.0);
    let (over_left, over_right) = (middle.1 - left.1, middle.1 - right.1);
    let curvature = to_left * over_right - to_right * over_left;
    let x = middle.0
        - (to_left * to_left * over_right - to_right * to_right * over_left) / (2.0 * curvature);
    if left.0 < x && x < right.0 {
        x
    } else if to_left > -to_right {
        middle.0 - 0.4 * to_left
    } else {
        middle.0 - 0.4 * to_right
    }
}

/// The zero between two nodes of opposite sign, if the exact function has one.
fn zero(
    in_step: &mut impl FunctionInStep,
    a: Node,
    b: Node,
    resolution: f64,
) -> Result<Option<f64>, StepError> {
    if a.value == 0.0 && a.is_exact {
        return Ok(Some(a.x));
    }
    let mut exact = Bracket {
        a: (a.x, a.value),
        b: (b.x, b.value),
    };
    let (mut x, slope) = interpolated_zero(in_step, exact)?;
    // between an interpolated node and an exact one the slope may be that of their difference
    let steep = slope.abs().min((b.value - a.value).abs() / exact.width());
    let mut best = (x, f64::INFINITY);
    let most = halvings(exact.width(), resolution) + 2;
    for left in (0..=most).rev() {
        let value = in_step.exact(x)?;
        if value.abs() < best.1 {
            best = (x, value.abs());
        }
        if value.abs() <= steep * resolution {
            return Ok(Some(x));
        }
        exact.tighten(x, value);
        if exact.width() <= 2.0 * resolution {
            break;
        }
        // twice the first Newton step, so that the zero is bracketed
        let beyond = x - 2.0 * value / slope;
        let is_between = exact.a.0 < beyond && beyond < exact.b.0;
        x = if left == most && is_between {
            beyond
        } else {
            exact.estimate(left, resolution)
        };
    }
    // an end of the bracket may have a sign that only the interpolated function has
    for (end, node, other) in [(exact.a, a, b), (exact.b, b, a)] {
        let is_unseen = end.0.to_bits() == node.x.to_bits() && !node.is_exact;
        if is_unseen && in_step.exact(node.x)? * other.value > 0.0 {
            return Ok(None);
        }
    }
    Ok(Some(best.0))
}

/// The zero of the interpolated function, and its slope there.
fn interpolated_zero(
    in_step: &mut impl FunctionInStep,
    ends: Bracket,
) -> Result<(f64, f64), StepError> {
    let mut bracket = ends;
    for left in (0..=halvings(ends.width(), INTERPOLATED_RESOLUTION) + 1).rev() {
        if bracket.width() <= 2.0 * INTERPOLATED_RESOLUTION {
            break;
        }
        let x = bracket.estimate(left, INTERPOLATED_RESOLUTION);
        bracket.tighten(x, in_step.interpolated(x)?);
    }
    let slope = (bracket.b.1 - bracket.a.1) / bracket.width();
    let x = bracket.a.0 - bracket.a.1 / slope;
    // both ends may be the same roundoff
    let is_between = (bracket.a.0..=bracket.b.0).contains(&x);
    let middle = f64::midpoint(bracket.a.0, bracket.b.0);
    Ok((if is_between { x } else { middle }, slope))
}

/// How many halvings lead from a width to twice a tolerance.
fn halvings(width: f64, tolerance: f64) -> i32 {
    let mut count = 0;
    let mut left = width;
    while left > 2.0 * tolerance {
        left /= 2.0;
        count += 1;
    }
    count
}
