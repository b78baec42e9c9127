//! Slopes of an event's function on the two sides of its zero.
//!
//! The time at which e = 0 moves by dt = −(e_x · dx)/(e_x · x'), with x = (t, y, z, λ, θ). Where e bends in its zero it has two
//! e_x. These lead to the same dt where they are parallel, as they are where e is zero on the same surface; elsewhere dt is
//! that of neither. Where e jumps, its change of sign is no zero at all.

use super::function::noise;
use super::hits::HOLDS;
use super::slopes::{Before, SlopesModel};
use super::{DenseDetector, SAMPLES};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Obstacle, StepError};
use liouville_base::linalg::dot;
use liouville_problem::{Carried, Dynamics, Nearby};

/// Sides are looked at so far from a zero, as parts of a step, ...
const NEAR: f64 = 1.0 / (1 << 14) as f64;
/// ... or where it is more, in roundings of the time, ...
const ROUNDINGS: f64 = (1 << 12) as f64 * f64::EPSILON;
/// ... and so many times as far.
const FARTHER: f64 = 16.0;
/// A function is zero where it is this part of what it is beside, ...
const ZERO: f64 = 0.25;
/// ... and jumps where it grows by so many times what the steepest of its slopes makes of it.
const STEEP: f64 = 4.0;
/// Derivatives of the time are two that differ by so much of themselves, ...
const DIFFER: f64 = 1e-6;
/// ... and of the largest among them, ...
const ROUNDOFF: f64 = 1e-9;
/// ... where they do not come this much nearer to each other nearer to the zero, FARTHER times if e is smooth.
const SHRINKS: f64 = 0.5;

impl<State: Carried + Checkpoint + Clone, M: Dynamics> DenseDetector<State, M> {
    /// Takes an event with a reset, on which a motion begins or rests, for one that comes from the side it is met from,
    /// where the motion now leaves to the other one: it is met at once. Returns whether the motion rests on it through
    /// the step, so that its signs are those of roundoff.
    ///
    /// Bodies that touch and then approach meet, though their distance has had no sign before. A law that lets the
    /// motion pass holds no side.
    pub(super) fn take_side(&mut self, index: usize) -> Result<bool, StepError> {
        let (t, start) = (self.substep.t, &self.substep.start);
        let event = &mut self.events[index];
        let function = &event.function;
        let way = f64::from(function.rule.direction);
        let (last, samples) = (function.last, &function.samples[..SAMPLES]);
        let is_clear = last * way < 0.0 && samples.iter().all(|e| e * way < 0.0);
        if event.reset.is_none() || way == 0.0 || is_clear {
            return Ok(false);
        }
        let roundoff = HOLDS * noise(&mut self.path, event, t, start)?;
        let function = &mut event.function;
        let rests = |value: f64| value.abs() <= roundoff;
        let before = function.earlier.map_or(0.0, |(_, value)| value);
        if !rests(last) || !rests(before) {
            return Ok(false);
        }
        let samples = &function.samples[..SAMPLES];
        let Some(side) = samples.iter().find(|e| !rests(**e)) else {
            let step = self.substep.h.abs() / SAMPLES as f64;
            function.earlier = Some((step, samples[SAMPLES - 2]));
            (function.sign, function.last) = (0.0, samples[SAMPLES - 1]);
            return Ok(true);
        };
        if side * way <= 0.0 || function.sign * way < 0.0 {
            return Ok(false);
        }
        self.path.solve(t, start)?;
        if let Some(reset) = event.reset.as_mut().filter(|reset| !reset.is_impact) {
            let [y, z] = &mut self.jump;
            let at = (start.y(), start.z());
            if reset.rate(t, at, index)?.is_none() {
                return Ok(false);
            }
            let (values, n) = (reset.at(t, at, (self.path.lam(), index))?, at.0.len());
            y.clear();
            z.clear();
            y.extend_from_slice(&values[..n]);
            z.extend_from_slice(&values[n..]);
            let after = reset.rate(t, (y, z), index)?;
            if after.is_none_or(|after| after * self.substep.h * way > 0.0) {
                return Ok(false);
            }
        }
        (event.function.sign, event.function.earlier) = (-way, None);
        Ok(false)
    }

    /// Why the event that a part of the step has led to has no derivative, where that is seen beside it.
    ///
    /// Nothing is seen where e does not exist.
    pub(super) fn obstacle(&mut self, index: usize, t: f64) -> Option<Obstacle> {
        let (event, state) = (&mut self.events[index], &self.substep.state);
        let slopes = self.slopes.get_mut(index)?;
        let near = (NEAR * self.substep.h.abs()).max(ROUNDINGS * t.abs());
        let near = near.copysign(self.substep.h);
        let times = [-near, near, -FARTHER * near, FARTHER * near];
        let around = self.path.around((t, state), times, event.needs_lam);
        let (points, [y_dot, z_dot]) = around.ok()?;
        let (y, z, lam) = (state.y(), state.z(), self.path.lam());
        let there = event.at(t, (y, z), lam).ok()?;
        let mut values = [0.0; 2];
        for (value, Nearby { t, y, z, lam }) in values.iter_mut().zip(&points) {
            *value = event.at(*t, (y, z), lam).ok()?;
        }
        let along = [0, 2].map(|k| {
            let [before, after] = [&points[k], &points[k + 1]];
            let changes = after.lam.iter().zip(&before.lam);
            let of_lam = changes.map(|(b, a)| (b - a) / (after.t - before.t));
            [&[1.0], &y_dot[..], &z_dot, &of_lam.collect::<Vec<_>>()].concat()
        });
        let mut at = |k: usize, along: &[f64]| {
            let Nearby { t, y, z, lam } = &points[k];
            Side::new(slopes, (*t, [y, z, lam]), along)
        };
        let (before, after) = (at(0, &along[0])?, at(1, &along[0])?);
        let far = [at(2, &along[1])?, at(3, &along[1])?];
        let own = Side::new(slopes, (t, [y, z, lam]), &along[0])?;
        let steepest = [&before, &after, &own].map(|side| side.rate.abs());
        let most = steepest.into_iter().fold(0.0, f64::max) * 2.0 * near.abs();
        let least = values[0].abs().min(values[1].abs());
        let jumps = there.abs() > ZERO * least || (values[1] - values[0]).abs() > STEEP * most;
        // a function that touches zero has the same sign on both sides
        if jumps && values[0] * values[1] <= 0.0 {
            return Some(Obstacle::Jump);
        }
        let is_bent = match [before.rate == 0.0, after.rate == 0.0] {
            [false, false] => before.differs(&after, &far),
            [of_before, of_after] => of_before != of_after,
        };
        is_bent.then_some(Obstacle::Kink)
    }
}

/// Slopes of an event's function on one side of its zero.
struct Side {
    /// Its rate along the motion.
    rate: f64,
    /// The derivatives of the time at which it would be zero, but for their sign; not finite where it is flat.
    of_time: Vec<f64>,
}

impl Side {
    /// At a point of a motion along this; nothing where there is no derivative.
    fn new(slopes: &mut SlopesModel, point: Before<'_>, along: &[f64]) -> Option<Self> {
        let gradient = slopes.gradient(point).ok()?;
        let rate = dot(&gradient[..along.len()], along);
        let of_time = gradient.iter().map(|slope| slope / rate).collect();
        Some(Self { rate, of_time })
    }

    /// Whether the derivatives are others than those on the other side, and those of two sides farther from the zero say
    /// that this is not because they turn.
    fn differs(&self, other: &Self, [before, after]: &[Self; 2]) -> bool {
        let own = || self.of_time.iter().zip(&other.of_time);
        let most = own().fold(0.0, |most: f64, (a, b)| most.max(a.abs()).max(b.abs()));
        let far = before.of_time.iter().zip(&after.of_time);
        own().zip(far).any(|((a, b), (far_a, far_b))| {
            let apart = (a - b).abs();
            let is_seen = apart > DIFFER * a.abs().max(b.abs()) && apart > ROUNDOFF * most;
            is_seen && apart > SHRINKS * (far_a - far_b).abs()
        })
    }
}
