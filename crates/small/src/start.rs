//! The start of a step of a small system, from the step before or cold; the yardstick and the sizes of its corrections.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::layout::{Layout, larger};
use super::{Fixed, LAM, Z};
use liouville_base::linalg::max_norm;
use liouville_base::newton::{self, Borne};
use liouville_base::real::Scalar;
use liouville_base::simd::dispatch_simd;
use liouville_problem::{Acceleration, Model, State, Step};

impl<L: Layout, const N: usize, const M: usize> Fixed<L, N, M> {
    /// Z, λ and z1 from the step before, and v0.
    pub(super) fn extrapolate(
        &mut self,
        held: &newton::Predictor<L>,
        borne: Borne<L>,
        step: Step<L>,
    ) {
        let (s, k) = (self.tables.stages, self.tables.intervals);
        let (n, m) = (self.problem.n, self.problem.m);
        let [z, lam] = [Z, LAM].map(|curve| &held.curves[curve].values);
        let first = if held.is_undone() { 0 } else { z.rows() - 1 };
        dispatch_simd::<L::Row, _>(
            #[inline(always)]
            || {
                for q in 0..n.min(N) {
                    let out = &mut self.z[q].as_mut()[..L::rows(s)];
                    L::product_of(
                        out,
                        &self.start.z,
                        #[inline(always)]
                        |j| z[(j, q)],
                    );
                    let mut sum = L::splat(0.0);
                    for (j, weight) in self.start.end.iter().enumerate() {
                        sum += z[(j, q)] * *weight;
                    }
                    self.end.z[q] = sum;
                    self.v0[q] = z[(first, q)];
                }
                for c in 0..m.min(M) {
                    let out = &mut self.lam[c].as_mut()[..L::rows(k + 1)];
                    L::product_of(
                        out,
                        &self.start.lam,
                        #[inline(always)]
                        |j| lam[(j, c)],
                    );
                }
                self.measure(step, borne);
            },
        );
    }

    /// Z, λ and z1 with the accelerations of the start; `None` where there are none.
    pub(super) fn start_cold(
        &mut self,
        model: &mut Model<L>,
        solver: &mut Acceleration<L>,
        step: Step<L>,
    ) -> Option<()> {
        let State { y, z, .. } = step.state;
        solver.begin(model, (step.t, step.h), y, z).ok()?;
        for (q, (z, rate)) in z.iter().zip(&solver.z_dot).enumerate() {
            for row in 0..L::rows(self.tables.stages) {
                let moved = rate.every() * (L::factor(&self.tables.c, row) * step.h);
                self.z[q].as_mut()[row] = z.every() + moved;
            }
            self.end.z[q] = *z + *rate * step.h;
            self.v0[q] = *z;
        }
        for (out, lam) in self.lam.iter_mut().zip(&solver.lam) {
            out.as_mut().fill(lam.every());
        }
        self.measure(step, solver.borne);
        Some(())
    }

    /// The speed that moves the coordinates by their size, and the yardstick, as in `yardstick` of `crates/spark`.
    #[inline(always)]
    fn measure(&mut self, step: Step<L>, borne: Borne<L>) {
        self.borne = borne.speed(step.h);
        self.rest = max_norm(&step.state.y) / L::splat(step.h.abs());
        self.yardstick = if self.problem.is_affine() {
            L::splat(0.0)
        } else {
            newton::own_yardstick(max_norm(&self.v0) + self.rest, self.borne)
        };
    }

    /// How far the stages are from y0 + c_i h v0, in the yardstick.
    #[inline(always)]
    pub(super) fn measure_deviation(&mut self, step: Step<L>) {
        let n = self.problem.n.min(N);
        let mut largest = L::Row::splat(0.0);
        let rows = L::rows(self.tables.stages);
        for q in 0..n {
            let (y, y0, v0) = (self.stage.argument(1 + q), step.state.y[q], self.v0[q]);
            for row in 0..rows {
                let uniform = v0.every() * (L::factor(&self.tables.c, row) * step.h);
                largest = larger(largest, (y[row] - y0.every()) - uniform);
            }
        }
        let unit = self.yardstick * step.h.abs();
        self.deviation = L::largest(largest).zip(
            unit,
            #[inline(always)]
            |moved, unit| if unit == 0.0 { 0.0 } else { moved / unit },
        );
    }

    /// The size of a correction, relative to the largest velocity plus the one that moves the coordinates by their size,
    /// or to what is borne in a step where that is larger.
    #[inline(always)]
    pub(super) fn relative(&mut self, size: L) -> L {
        let rows = L::rows(self.tables.stages);
        let mut largest = L::Row::splat(0.0);
        for z in &self.z[..self.problem.n.min(N)] {
            for z in &z.as_ref()[..rows] {
                largest = larger(largest, *z);
            }
        }
        self.speed = (L::largest(largest) + self.rest).zip(
            self.borne,
            #[inline(always)]
            |speed: f64, borne| speed.max(borne),
        );
        size.zip(
            self.speed,
            #[inline(always)]
            |size, speed| if size == 0.0 { 0.0 } else { size / speed },
        )
    }
}
