//! How large corrections and moves are: relative to the present velocities, and in a yardstick of the step.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::stages::{Stages, Unknowns};
use liouville_base::linalg::{copy, furthest, max_norm};
use liouville_base::newton::{Borne, own_yardstick, scaled_size};
use liouville_base::real::Real;
use liouville_problem::Step;

impl<R: Real> Stages<R> {
    /// Begins a step with these velocities at its start, where so much is borne.
    pub(super) fn begin(&mut self, step: Step<R>, v: &[R], borne: Borne<R>) {
        copy(&mut self.v0, v);
        self.borne = borne;
        self.begin_again(step);
    }

    /// Begins a step of another size from the same state.
    pub(super) fn begin_again(&mut self, step: Step<R>) {
        self.size = R::splat(0.0);
        self.yardstick = if self.is_affine {
            R::splat(0.0)
        } else {
            let own = max_norm(&self.v0) + max_norm(&step.state.y) / R::splat(step.h.abs());
            own_yardstick(own, self.borne.speed(step.h))
        };
    }
}

impl Stages {
    /// How far other velocities are from the present ones, relative to the yardstick or to them, and the coordinate
    /// where they are.
    pub(super) fn distance(&self, other: &Unknowns) -> (f64, usize) {
        let (v, n) = (&self.unknowns.v, self.unknowns.v.cols());
        let (apart, k) = furthest(
            v.flat(),
            other.v.flat(),
            self.yardstick.max(max_norm(v.flat())),
        );
        (apart, k % n.max(1))
    }
}

impl<R: Real> Stages<R> {
    /// The size of a velocity correction, relative to what moves the coordinates by their own size.
    #[inline(always)]
    pub(super) fn relative(&mut self, correction: R, step: Step<R>) -> R {
        let size = self.relative_to_speed(correction, step);
        self.size = if self.compensated.is_some() {
            self.stop.with_roundings(size, self.wanted)
        } else {
            size
        };
        self.size
    }

    /// The same without regard to roundings.
    #[inline(always)]
    pub(super) fn relative_to_speed(&mut self, correction: R, step: Step<R>) -> R {
        if correction.all(|correction| correction == 0.0) {
            return correction;
        }
        self.speed = self.unit(step);
        correction.zip(
            self.speed,
            #[inline(always)]
            |correction, speed| match correction {
                0.0 => 0.0,
                _ => correction / speed,
            },
        )
    }

    /// The largest velocity plus the one that moves the coordinates by their size, and not below what is borne in a step.
    #[inline(always)]
    pub(super) fn unit(&self, step: Step<R>) -> R {
        let rest = max_norm(&step.state.y) / R::splat(step.h.abs());
        (max_norm(self.unknowns.v.flat()) + rest).zip(
            self.borne.speed(step.h),
            #[inline(always)]
            |speed: f64, borne| speed.max(borne),
        )
    }

    /// A relative size in the yardstick of the step; from rest at the origin there is none.
    #[inline(always)]
    pub(super) fn scaled_size(&self, size: R) -> R {
        scaled_size(size, self.speed, self.yardstick)
    }

    /// How far the stages are from y0 + c_i h v0, in the yardstick.
    #[inline(always)]
    pub(super) fn deviation(&self, step: Step<R>) -> R {
        let mut largest = R::splat(0.0);
        for (c, y) in self
            .tableau
            .c
            .iter()
            .zip(self.y.flat().chunks_exact(self.y.cols().max(1)))
        {
            let given = step.state.y.iter().zip(&self.v0);
            for (y, (y0, v0)) in y.iter().zip(given) {
                let moved = (*y - *y0) - *v0 * (c * step.h);
                largest = largest.zip(
                    moved,
                    #[inline(always)]
                    |largest, moved| largest.max(moved.abs()),
                );
            }
        }
        let unit = self.yardstick * step.h.abs();
        largest.zip(
            unit,
            #[inline(always)]
            |moved, unit| if unit == 0.0 { 0.0 } else { moved / unit },
        )
    }
}
