//! The points of a step of a small system: nodes and stages, as its displacements lead there.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::Fixed;
use super::layout::Layout;
use liouville_base::linalg::sum_compensated;
use liouville_base::real::Scalar;
use liouville_problem::Step;

impl<L: Layout, const N: usize, const M: usize> Fixed<L, N, M> {
    /// Writes the points where the tapes read them: Ŷ_j with λ_j, and Z_i, with Y_i where they are read.
    #[inline(always)]
    pub(super) fn move_points(&mut self, step: Step<L>, is_first: bool) {
        let (s, k) = (
            L::rows(self.tables.stages),
            L::rows(self.tables.intervals + 1),
        );
        let n = self.problem.n.min(N);
        let wants_y = is_first || self.depends_on_y;
        let [b, _] = self.weights;
        for row in 0..s {
            self.stage.argument(0)[row] =
                L::Row::splat(step.t) + L::factor(&self.tables.c, row) * step.h;
        }
        for row in 0..k {
            self.node.argument(0)[row] =
                L::Row::splat(step.t) + L::factor(&self.tables.c_hat, row) * step.h;
        }
        for q in 0..n {
            for row in 0..s {
                let z = self.z[q].as_ref()[row];
                self.stage.argument(1 + n + q)[row] = z;
                if wants_y {
                    self.displacements[q].as_mut()[row] = z * L::factor(&b, row);
                }
            }
        }
        for q in 0..n {
            if is_first {
                self.start_nodes(step, q);
            } else {
                self.move_nodes(q);
            }
            if wants_y {
                let (y, low) = (step.state.y[q].every(), step.state.y_low[q].every());
                let out = self.stage.argument(1 + q);
                L::product(
                    out,
                    &self.tables.mu_v,
                    &self.displacements[q],
                    #[inline(always)]
                    |_, sum| y + (low + sum),
                );
            }
        }
        for c in 0..self.problem.m.min(M) {
            let out = self.node.argument(1 + n + c);
            out.copy_from_slice(&self.lam[c].as_ref()[..k]);
        }
    }

    /// One coordinate of Ŷ_j at the start of the iteration, from which its corrections move it.
    #[inline(always)]
    fn start_nodes(&mut self, step: Step<L>, q: usize) {
        let (y, low) = (step.state.y[q].every(), step.state.y_low[q].every());
        let nodes = self.node.argument(1 + q);
        let node_low = &mut self.node_low[q].as_mut()[..nodes.len()];
        L::product(
            node_low,
            &self.tables.mu_bar,
            &self.displacements[q],
            #[inline(always)]
            |_, sum| low + sum,
        );
        let start = &mut self.start_of_iteration;
        for (row, (out, low)) in nodes.iter_mut().zip(node_low).enumerate() {
            sum_compensated(&[y], std::slice::from_mut(low), std::slice::from_mut(out));
            start.node[q].as_mut()[row] = *out;
            start.node_low[q].as_mut()[row] = *low;
        }
        start.z[q] = self.z[q];
    }

    /// Moves it by as much as Z has moved. Roundings of displacements and sums, made anew for each iterate, would depend
    /// on the side from which the iteration comes: they stay those of its start, which it cannot choose.
    #[inline(always)]
    fn move_nodes(&mut self, q: usize) {
        let (start, b) = (&self.start_of_iteration, &self.weights[0]);
        let nodes = self.node.argument(1 + q);
        for row in 0..L::rows(self.tables.stages) {
            let moved = self.z[q].as_ref()[row] - start.z[q].as_ref()[row];
            self.moved[q].as_mut()[row] = moved * L::factor(b, row);
        }
        let node_low = &mut self.node_low[q].as_mut()[..nodes.len()];
        L::product(
            node_low,
            &self.tables.mu_bar,
            &self.moved[q],
            #[inline(always)]
            |row, sum| start.node_low[q].as_ref()[row] + sum,
        );
        let highs = start.node[q].as_ref();
        for ((out, low), high) in nodes.iter_mut().zip(node_low).zip(highs) {
            sum_compensated(
                &[*high],
                std::slice::from_mut(low),
                std::slice::from_mut(out),
            );
        }
    }
}
