//! The events of a step: the zeros of a function, from what the step before has left.

use super::search::{Node, Scene, Trust, Zero, look};
use super::{NOISE, SAMPLES};
use crate::error::StepError;

/// A start on an event is left for this part of the first step, as a power of 2, or more.
const LEAVING: i32 = -24;

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
    /// Appends the zeros of the event number `index` in a step of length h from t, and remembers what the next
    /// step has to know.
    ///
    /// # Errors
    /// A value that has to be known is not finite, or a part of the step cannot be made.
    pub fn find(
        &mut self,
        scene: &mut impl Scene,
        index: usize,
        (t, h): (f64, f64),
        trust: Trust,
        found: &mut Vec<Crossing>,
    ) -> Result<(), StepError> {
        let Self { nodes, zeros } = self;
        nodes.clear();
        zeros.clear();
        let (last, earlier, mut sign) = {
            let function = scene.function();
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
            before.value = scene.rough(before.x).unwrap_or(f64::NAN);
            first = leaving(scene, (t, h), first)?;
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
        let function = scene.function();
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
        look(scene, nodes, &mut sign, (trust, resolution), zeros)?;
        let function = scene.function();
        function.sign = sign;
        found.extend(zeros.iter().map(|zero| Crossing {
            x: zero.x,
            index,
            sign: zero.sign,
            counts: function.wants(zero.sign),
        }));
        Ok(())
    }
}

/// The start of a run for an event: where its function is nothing but roundoff, shortly after it.
fn leaving(scene: &mut impl Scene, (t, h): (f64, f64), start: Node) -> Result<Node, StepError> {
    let slope = (scene.function().samples[0] - start.value).abs() * SAMPLES as f64;
    let mut noise = NOISE * slope * (t / h).abs().max(1.0);
    for parts in [[NOISE, NOISE], [NOISE, -NOISE]] {
        noise = noise.max((scene.near(parts)? - start.value).abs());
    }
    if start.value.abs() > noise {
        return Ok(start);
    }
    for power in LEAVING..0 {
        let x = f64::from(power).exp2() / SAMPLES as f64;
        let value = scene.rough(x)?;
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
