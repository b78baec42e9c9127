//! Zeros of a function within a step, of which a rough copy is cheap.
//!
//! With θ from 0 to 1 over the step, the rough function is e on the interpolated trajectory, and the exact one
//! e after one step of θ h from the start of this one: of the method's own accuracy, and continuous from step
//! to step. The rough one is known at equal samples, one of them beyond each end of the step. Between two of
//! opposite sign there is a zero; where |e| has a local minimum without a change of sign, it is followed
//! there, by parabolas, until the sign changes after all or it is seen not to. Whatever comes close to zero is decided by
//! the exact function, and so is where the zero is: by the iteration of [`crate::bracket`], to roundoff in t.

use super::WatchedFunction;
use crate::bracket::Bracket;
use crate::error::StepError;

/// An event's function in a step that is over, as a function of θ, rough and exact.
pub trait Scene {
    /// The function.
    fn function(&mut self) -> &mut WatchedFunction;

    /// e on the interpolated trajectory.
    ///
    /// # Errors
    /// It is not finite.
    fn rough(&mut self, x: f64) -> Result<f64, StepError>;

    /// e after a step of this part.
    ///
    /// # Errors
    /// It is not finite, or the step cannot be made.
    fn exact(&mut self, x: f64) -> Result<f64, StepError>;

    /// e at the start of the step, from numbers of the state changed by these parts of them in turn.
    ///
    /// # Errors
    /// It is not finite.
    fn near(&mut self, parts: [f64; 2]) -> Result<f64, StepError>;
}

/// A value of the function, and whether it is that of the exact one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node {
    pub(super) x: f64,
    pub(super) value: f64,
    pub(super) is_exact: bool,
}

/// A zero, and the sign of the function after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Zero {
    pub(super) x: f64,
    pub(super) sign: f64,
}

/// How far the rough function may be from the exact one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trust {
    /// A minimum is decided by the exact function where it is closer to zero than so many times what the
    /// samples around it bend.
    close: f64,
    /// And then between the samples around it, or so far beyond them.
    aside: f64,
}

impl Trust {
    /// Of an interpolation whose error is far below what a step bends.
    pub const FIRM: Self = Self {
        close: 0.5,
        aside: 0.0,
    };
    /// Of one whose error is of the same size, as with a method of order 2.
    pub const LOOSE: Self = Self {
        close: 8.0,
        aside: 0.25,
    };
}

/// A sample is, where it is smaller than this part of the difference to its neighbours.
const SMALL: f64 = 0.05;
/// So far beyond the ends of a step may a minimum lie that is looked at as one of it.
const BEYOND: f64 = 0.02;
/// Values that following a minimum may take.
const MOST_VALUES: usize = 16;
/// A minimum is found to this.
const RESOLUTION: f64 = 1e-9;
/// It is not followed further where that gains less than this part of it twice in turn.
const GAIN: f64 = 0.01;
/// Zeros of the rough function are found to this.
const ROUGHLY: f64 = 1e-7;

/// Appends the zeros within the step to `zeros`; `nodes` are its samples, those beyond its ends included,
/// and `sign` that of the last clear value before.
pub(super) fn look(
    scene: &mut impl Scene,
    nodes: &mut Vec<Node>,
    sign: &mut f64,
    (trust, resolution): (Trust, f64),
    zeros: &mut Vec<Zero>,
) -> Result<(), StepError> {
    for k in 1..nodes.len() - 1 {
        let [before, node, after] = [nodes[k - 1].value, nodes[k].value, nodes[k + 1].value];
        let change = (before - node).abs().max((after - node).abs());
        let bend = (before + after - 2.0 * node).abs();
        if node.abs() < (SMALL * change).max(trust.close * bend) {
            decide(scene, &mut nodes[k])?;
        }
    }
    for k in (1..nodes.len() - 1).rev() {
        if let Some(node) = dip(scene, [nodes[k - 1], nodes[k], nodes[k + 1]], trust)? {
            let at = nodes.partition_point(|other| other.x <= node.x);
            nodes.insert(at, node);
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
            let Some(x) = zero(scene, nodes[k - 1], nodes[k], resolution)? else {
                // the rough signs were wrong: once more with the exact ones
                for node in &mut nodes[k - 1..=k] {
                    decide(scene, node)?;
                }
                k -= 1;
                continue;
            };
            *sign = now.signum();
            zeros.push(Zero { x, sign: *sign });
        }
        k += 1;
    }
    Ok(())
}

/// Gives a node the exact value.
fn decide(scene: &mut impl Scene, node: &mut Node) -> Result<(), StepError> {
    if !node.is_exact {
        node.value = scene.exact(node.x)?;
        node.is_exact = true;
    }
    Ok(())
}

/// A node of another sign than that of three samples, if |e| has a minimum around the middle one that comes
/// so far.
fn dip(
    scene: &mut impl Scene,
    samples: [Node; 3],
    trust: Trust,
) -> Result<Option<Node>, StepError> {
    let sign = samples[2].value.signum();
    let rough = samples.map(|node| (node.x, sign * node.value));
    let [(from, left), (_, middle), (to, right)] = rough;
    let bend = left + right - 2.0 * middle;
    let is_dip = left > 0.0 && right > 0.0 && (0.0..=left.min(right)).contains(&middle);
    if !is_dip || middle > bend.max(trust.close * bend) {
        return Ok(None);
    }
    if samples.iter().all(|node| node.is_exact) {
        return turned(scene, sign, rough);
    }
    let (x, value) = lowest(|x| Ok(sign * scene.rough(x)?), rough)?;
    let beyond = trust.aside.max(BEYOND);
    if value > trust.close * bend || !(-beyond..=1.0 + beyond).contains(&x) {
        return Ok(None);
    }
    let (from, to) = ((from - trust.aside).max(0.0), (to + trust.aside).min(1.0));
    let margin = BEYOND * (to - from);
    let mut exact = [from, x.clamp(from + margin, to - margin), to].map(|x| (x, 0.0));
    for (x, value) in &mut exact {
        *value = sign * scene.exact(*x)?;
    }
    turned(scene, sign, exact)
}

/// A point of the exact function, times `sign`, that is negative, if parabolas from three lead to one.
fn turned(
    scene: &mut impl Scene,
    sign: f64,
    points: [(f64, f64); 3],
) -> Result<Option<Node>, StepError> {
    let first = points.into_iter().find(|(_, value)| *value < 0.0);
    let (x, value) = match first {
        Some(found) => found,
        None => lowest(|x| Ok(sign * scene.exact(x)?), points)?,
    };
    Ok((value < 0.0).then_some(Node {
        x,
        value: sign * value,
        is_exact: true,
    }))
}

/// The lowest point that parabolas lead to from three, or the first that is negative.
fn lowest(
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
    let bend = to_left * over_right - to_right * over_left;
    let x = middle.0
        - (to_left * to_left * over_right - to_right * to_right * over_left) / (2.0 * bend);
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
    scene: &mut impl Scene,
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
    let (mut x, slope) = roughly(scene, exact)?;
    // the rough slope may be that of the rough function's way to an exact end
    let steep = slope.abs().min((b.value - a.value).abs() / exact.width());
    let mut best = (x, f64::INFINITY);
    let most = halvings(exact.width(), resolution) + 2;
    for left in (0..=most).rev() {
        let value = scene.exact(x)?;
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
        // from the first value twice as far as it says: then the zero is between the two
        let beyond = x - 2.0 * value / slope;
        let is_between = exact.a.0 < beyond && beyond < exact.b.0;
        x = if left == most && is_between {
            beyond
        } else {
            exact.estimate(left, resolution)
        };
    }
    // an end that was never reached may have a sign that only the rough function has
    for (end, node, other) in [(exact.a, a, b), (exact.b, b, a)] {
        let is_unseen = end.0.to_bits() == node.x.to_bits() && !node.is_exact;
        if is_unseen && scene.exact(node.x)? * other.value > 0.0 {
            return Ok(None);
        }
    }
    Ok(Some(best.0))
}

/// The zero of the rough function, and its slope there.
fn roughly(scene: &mut impl Scene, ends: Bracket) -> Result<(f64, f64), StepError> {
    let mut rough = ends;
    for left in (0..=halvings(ends.width(), ROUGHLY) + 1).rev() {
        if rough.width() <= 2.0 * ROUGHLY {
            break;
        }
        let x = rough.estimate(left, ROUGHLY);
        rough.tighten(x, scene.rough(x)?);
    }
    let slope = (rough.b.1 - rough.a.1) / rough.width();
    Ok((rough.a.0 - rough.a.1 / slope, slope))
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
