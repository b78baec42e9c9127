//! The stage equations of a small system, and their corrections by node Schur.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::Fixed;
use super::layout::{Layout, larger};
use liouville_base::error::StepError;
use liouville_base::newton::{Equations, Stop, scaled_size};
use liouville_base::real::{Real, Scalar};
use liouville_base::simd::dispatch_simd;
use liouville_problem::Step;

/// The stage equations of one step, still to be linearised or not.
pub(super) struct SmallEquations<'a, L: Layout, const N: usize, const M: usize> {
    pub(super) small: &'a mut Fixed<L, N, M>,
    pub(super) step: Step<'a, L>,
    pub(super) stop: Stop,
    pub(super) is_linearized: bool,
}

impl<L: Layout, const N: usize, const M: usize> Fixed<L, N, M> {
    /// Impulses, and the residual of the momentum; `is_first` where they are the first of a step.
    #[inline(always)]
    pub(super) fn evaluate(&mut self, step: Step<L>, is_first: bool) {
        self.move_points(step, is_first);
        self.problem.stage.run_points(&mut self.stage);
        self.problem.node.run_points(&mut self.node);
        let n = self.problem.n.min(N);
        let (s, k) = (
            L::rows(self.tables.stages),
            L::rows(self.tables.intervals + 1),
        );
        let m = self.problem.m.min(M);
        let [b, b_hat] = self.weights;
        if is_first || self.has_force {
            for q in 0..n {
                let f = self.stage.value(n + q);
                for row in 0..s {
                    self.impulses[q].as_mut()[row] = f[row] * L::factor(&b, row);
                }
                let out = &mut self.forces[q].as_mut()[..s];
                L::sums(out, &self.tables.mu_f, &self.impulses[q]);
            }
        }
        for q in 0..n {
            let (p, f) = (self.stage.value(q), self.forces[q].as_ref());
            let (p0, low) = (step.state.p[q].every(), step.state.p_low[q].every());
            let out = &mut self.work.residual[q].as_mut()[..s];
            if m == 0 {
                for row in 0..s {
                    out[row] = (p[row] - p0) - (low + f[row]);
                }
                continue;
            }
            let r = self.node.value(m + q);
            for row in 0..k {
                self.reactions[q].as_mut()[row] = r[row] * L::factor(&b_hat, row);
            }
            L::product(
                out,
                &self.tables.mu_hat,
                &self.reactions[q],
                #[inline(always)]
                |row, sum| (p[row] - p0) - (low + (f[row] + sum)),
            );
        }
        if !self.is_newton() {
            self.find_velocities();
        }
    }

    /// M⁻¹ times the residual of the momentum.
    #[inline(always)]
    fn find_velocities(&mut self) {
        let (n, s) = (self.problem.n.min(N), L::rows(self.tables.stages));
        let residual = &self.work.residual;
        for i in 0..n {
            let inverse = &self.inverse_mass[i];
            for row in 0..s {
                let of = |q: usize| residual[q].as_ref()[row] * inverse[q].every();
                let mut sum = of(i);
                if !self.is_diagonal {
                    for q in (0..n).filter(|q| *q != i) {
                        sum += of(q);
                    }
                }
                self.velocity[i].as_mut()[row] = sum;
            }
        }
    }

    #[inline(always)]
    pub(super) fn linearize(&mut self, h: f64) {
        if self.problem.m > 0 {
            self.run_node_blocks();
        }
        if Self::TAKES_NEWTON
            && let Some(full) = &mut self.full
        {
            let points = [&mut self.stage, &mut self.node, &mut self.node_blocks];
            full.update(&self.problem, self.tables, points, h);
        } else if self.problem.m > 0 {
            self.update_node_schur();
        }
    }

    #[inline(always)]
    fn run_node_blocks(&mut self) {
        for place in 0..=self.problem.n + self.problem.m {
            let given = self.node.argument(place);
            self.node_blocks.argument(place).copy_from_slice(given);
        }
        self.problem.node_blocks.run_points(&mut self.node_blocks);
    }

    #[inline(always)]
    fn update_node_schur(&mut self) {
        let (n, m) = (self.problem.n.min(N), self.problem.m.min(M));
        let rows = L::rows(self.tables.intervals + 1);
        let at = &self.problem.patterns;
        for (place, &(c, q)) in at.g_y.entries().iter().enumerate() {
            let out = &mut self.linear.g_y[c % M][q % N].as_mut()[..rows];
            out.copy_from_slice(self.node_blocks.value(place));
        }
        for c in 0..m {
            self.linear.mass_r[c] = [L::zeros(); N];
        }
        for (place, &(q, c)) in at.r_lam.entries().iter().enumerate() {
            let r = self.node_blocks.value(at.g_y.len() + place);
            for i in 0..n {
                let inverse = self.inverse_mass[i][q % N].every();
                let out = &mut self.linear.mass_r[c % M][i].as_mut()[..rows];
                for row in 0..rows {
                    out[row] += inverse * r[row];
                }
            }
        }
        self.linear.invert(self.tables, (n, m));
    }

    /// Adds to g of the wanted members its rounding errors, as `Stages` in `crates/spark` does.
    #[inline(always)]
    fn compensate(&mut self, wanted: L) {
        if wanted.all(
            #[inline(always)]
            |wanted| wanted == 0.0,
        ) {
            return;
        }
        if let Some(compensated) = &mut self.compensated {
            let (low, first) = (&self.node_low, usize::from(!L::IS_SINGLE));
            compensated.add_low(
                first,
                &mut self.node,
                wanted.every(),
                #[inline(always)]
                |q, row| low[q].as_ref()[row],
            );
        }
    }

    /// Corrects λ, and writes M⁻¹ R dΛ.
    #[inline(always)]
    fn correct_multipliers(&mut self, h: f64) {
        let (n, m) = (self.problem.n.min(N), self.problem.m.min(M));
        let nodes = L::rows(self.tables.intervals + 1);
        let work = &mut self.work;
        for q in 0..n {
            L::sums(
                &mut work.at_nodes[q].as_mut()[..nodes],
                &self.tables.a_bar,
                &self.velocity[q],
            );
        }
        for c in 0..m {
            let (g, g_y) = (self.node.value(c), &self.linear.g_y[c]);
            for row in 0..nodes {
                let mut sum = -g[row] * (1.0 / h);
                for q in 0..n {
                    sum += g_y[q].as_ref()[row] * work.at_nodes[q].as_ref()[row];
                }
                work.sides[c].as_mut()[row] = sum;
            }
        }
        (self.linear).solve(self.tables, &work.sides, &mut work.d_lam, m);
        for row in 0..L::rows(self.tables.intervals) {
            for c in 0..m {
                self.lam[c].as_mut()[row] += work.d_lam[c].as_ref()[row] * (1.0 / h);
            }
            for q in 0..n {
                let mut sum = L::Row::splat(0.0);
                for c in 0..m {
                    let r = self.linear.mass_r[c][q].as_ref()[row];
                    sum += r * work.d_lam[c].as_ref()[row];
                }
                work.at_nodes[q].as_mut()[row] = sum;
            }
        }
    }

    /// Corrects the unknowns; returns the largest correction of Z, and whether all is finite.
    #[inline(always)]
    fn correct(&mut self, h: f64, wanted: L) -> (L, bool) {
        let n = self.problem.n.min(N);
        let rows = L::rows(self.tables.stages);
        let has_constraints = self.problem.m > 0;
        if has_constraints {
            self.compensate(wanted);
        }
        if self.is_newton() {
            self.solve_full(h);
        } else if has_constraints {
            self.correct_multipliers(h);
        }
        let [mut largest, mut total] = [L::Row::splat(0.0); 2];
        for q in 0..n {
            let u = self.velocity[q].as_ref();
            let d_z = &mut self.work.d_z.as_mut()[..rows];
            if Self::TAKES_NEWTON
                && let Some(full) = &self.full
            {
                let of_all = full.d_z(q, self.tables.stages);
                d_z.copy_from_slice(&of_all.as_ref()[..rows]);
            } else if has_constraints {
                L::product(
                    d_z,
                    &self.tables.a_hat,
                    &self.work.at_nodes[q],
                    #[inline(always)]
                    |row, sum| sum - u[row],
                );
            } else {
                for row in 0..rows {
                    d_z[row] = -u[row];
                }
            }
            for row in 0..rows {
                self.z[q].as_mut()[row] += d_z[row];
                total += d_z[row];
                largest = larger(largest, d_z[row]);
            }
        }
        let is_finite = total.all(
            #[inline(always)]
            |x| x.abs() < f64::INFINITY,
        );
        (L::largest(largest), is_finite)
    }

    /// The size before a first correction: infinite, or zero where all is linear and a single correction is enough.
    fn first_size(&self) -> f64 {
        if self.problem.is_affine() {
            0.0
        } else {
            f64::INFINITY
        }
    }
}

impl<L: Layout, const N: usize, const M: usize> Equations<L> for SmallEquations<'_, L, N, M> {
    fn stop(&self) -> Stop {
        self.stop
    }

    #[inline(always)]
    fn scaled_size(&self, size: L) -> L {
        scaled_size(size, self.small.speed, self.small.yardstick)
    }

    #[inline(always)]
    fn deviation(&self) -> L {
        self.small.deviation
    }

    fn reversed(&self) -> L {
        self.small.reversed()
    }

    fn correct(&mut self) -> Result<L, StepError> {
        let (small, step, stop) = (&mut *self.small, self.step, self.stop);
        let is_first = !self.is_linearized;
        self.is_linearized = true;
        let (size, is_finite) = dispatch_simd::<L::Row, _>(
            #[inline(always)]
            || {
                small.evaluate(step, is_first);
                if is_first {
                    small.size = L::splat(small.first_size());
                    small.measure_deviation(step);
                    small.linearize(step.h);
                }
                let wanted = stop.wants_roundings(small.size);
                let (size, is_finite) = small.correct(step.h, wanted);
                let size = small.relative(size);
                small.size = if small.compensated.is_some() {
                    stop.with_roundings(size, wanted)
                } else {
                    size
                };
                (small.size, is_finite)
            },
        );
        if is_finite {
            return Ok(size);
        }
        Err(StepError::NotConverged {
            iterations: 0,
            size: f64::INFINITY,
        })
    }

    #[inline(always)]
    fn keep(&mut self, members: L) {
        let Fixed { z, lam, kept, .. } = &mut *self.small;
        if let Some(kept) = kept {
            choose::<L>([&mut kept.0, &mut kept.1], [z, lam], members);
        }
    }

    #[inline(always)]
    fn put_back(&mut self, members: L) {
        let Fixed { z, lam, kept, .. } = &mut *self.small;
        if let Some(kept) = kept {
            choose::<L>([z, lam], [&kept.0, &kept.1], members);
        }
    }
}

/// Copies the chosen members of another.
#[inline(always)]
fn choose<L: Layout>(out: [&mut [L::Points]; 2], from: [&[L::Points]; 2], members: L) {
    let members = members.every();
    let pairs = out.into_iter().flatten().zip(from.into_iter().flatten());
    for (out, from) in pairs {
        for (out, from) in out.as_mut().iter_mut().zip(from.as_ref()) {
            *out = members.choose(*from, *out);
        }
    }
}
