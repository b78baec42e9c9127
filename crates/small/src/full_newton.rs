//! Full simplified Newton, where the mass varies: Z and Λ together, by the matrix of `full_newton` in the crate above.
//!
//! Its rows are those of momenta at the stages, then P⁻¹ times those of g at the nodes: as h → 0 the blocks of Z are masses,
//! and what is left when they are eliminated is a multiple of the identity in the nodes, so that no pivots are needed.
#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for

use super::blocks::BlockLu;
use super::layout::{Layout, Weights};
use super::tables::Tables;
use super::{CONSTRAINTS, COORDINATES, Small};
use liouville_base::tape::PointRegisters;
use liouville_problem::{Mechanical, Model};

/// The derivatives and the factored matrix.
#[derive(Clone, Debug)]
pub(super) struct FullNewton<L: Layout> {
    stage_blocks: PointRegisters<L::Row>,
    stage_jacobian: PointRegisters<L::Row>,
    node_jacobian: PointRegisters<L::Row>,
    matrix: BlockLu<L>,
    /// dZ, then dΛ.
    pub(super) corrections: [L::Points; COORDINATES + CONSTRAINTS],
}

/// Values in rows as points.
#[inline(always)]
fn points<L: Layout>(rows: &[L::Row]) -> L::Points {
    let mut points = L::zeros();
    points.as_mut()[..rows.len()].copy_from_slice(rows);
    points
}

impl<L: Layout> FullNewton<L> {
    /// Memory for a model at so many stages and nodes; `None` where its tapes are large.
    pub(super) fn new(model: &Model<L>, tables: &Tables) -> Option<Self> {
        let (n, m) = (model.problem.n, model.problem.m);
        let rows = [tables.stages, tables.intervals + 1].map(L::rows);
        let [stage_blocks, stage_jacobian, node_jacobian] =
            model.jacobians_at_points(rows, Layout::every)?;
        let sizes = [vec![tables.stages; n], vec![tables.intervals; m]];
        Some(Self {
            stage_blocks,
            stage_jacobian,
            node_jacobian,
            matrix: BlockLu::new(sizes.concat()),
            corrections: [L::zeros(); COORDINATES + CONSTRAINTS],
        })
    }

    /// Makes the matrix where the stages and nodes are, and factors it; there are g_y and r_λ already.
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        problem: &Mechanical,
        tables: &Tables,
        [stage, node, node_blocks]: [&mut PointRegisters<L::Row>; 3],
        h: f64,
    ) {
        for place in 0..=2 * problem.n {
            let given = stage.argument(place);
            for out in [&mut self.stage_blocks, &mut self.stage_jacobian] {
                out.argument(place).copy_from_slice(given);
            }
        }
        for place in 0..=problem.n + problem.m {
            let out = self.node_jacobian.argument(place);
            out.copy_from_slice(node.argument(place));
        }
        problem.stage_blocks.run_points(&mut self.stage_blocks);
        problem.stage_jacobian.run_points(&mut self.stage_jacobian);
        self.matrix.clear();
        self.write_momenta(problem, tables, h);
        self.write_forces(problem, tables, h);
        if problem.m > 0 {
            problem.node_jacobian.run_points(&mut self.node_jacobian);
            self.write_reactions(problem, tables, (node_blocks, h));
            self.write_constraints(problem, tables, node_blocks);
        }
        self.matrix.factor();
    }

    /// δ_ij p_z(i) + h aᵛ_ij p_y(i)
    #[inline(always)]
    fn write_momenta(&mut self, problem: &Mechanical, tables: &Tables, h: f64) {
        let (at, s) = (&problem.patterns, tables.stages);
        for (place, &(row, col)) in at.p_z.entries().iter().enumerate() {
            let p_z = points::<L>(self.stage_blocks.value(place));
            let block = self.matrix.block(row, col);
            for (j, out) in block.iter_mut().enumerate().take(s) {
                L::set(out, j, L::at(&p_z, j));
            }
        }
        for (place, &(row, col)) in at.p_y.entries().iter().enumerate() {
            let p_y = self.stage_jacobian.value(place);
            let block = self.matrix.block(row, col);
            for (out, weights) in block.iter_mut().zip(tables.a_v.columns()) {
                for (i, out) in out.as_mut()[..L::rows(s)].iter_mut().enumerate() {
                    *out += p_y[i] * (L::factor(weights, i) * h);
                }
            }
        }
    }

    /// −h Σ_l aᶠ_il (f_z(l) δ_lj + h aᵛ_lj f_y(l))
    #[inline(always)]
    fn write_forces(&mut self, problem: &Mechanical, tables: &Tables, h: f64) {
        let (at, rows) = (&problem.patterns, L::rows(tables.stages));
        let first = at.p_y.len();
        for (place, &(row, col)) in at.f_y.entries().iter().enumerate() {
            let f_y = self.stage_jacobian.value(first + place);
            let block = self.matrix.block(row, col);
            for (out, weights) in block.iter_mut().zip(tables.a_v.columns()) {
                let mut moved = L::zeros();
                for (i, out) in moved.as_mut()[..rows].iter_mut().enumerate() {
                    *out = f_y[i] * (L::factor(weights, i) * h);
                }
                subtract_moved::<L>(&mut out.as_mut()[..rows], &tables.a_f, &moved, h);
            }
        }
        let first = first + at.f_y.len();
        for (place, &(row, col)) in at.f_z.entries().iter().enumerate() {
            let f_z = points::<L>(self.stage_jacobian.value(first + place));
            let block = self.matrix.block(row, col);
            for (j, (out, weights)) in block.iter_mut().zip(tables.a_f.columns()).enumerate() {
                let f_z = L::at(&f_z, j).every();
                for (i, out) in out.as_mut()[..rows].iter_mut().enumerate() {
                    *out -= f_z * (L::factor(weights, i) * h);
                }
            }
        }
    }

    /// −h² Σ_k â_ik ā_kj r_y(k), and −â_il r_λ(l) for Λ
    #[inline(always)]
    fn write_reactions(
        &mut self,
        problem: &Mechanical,
        tables: &Tables,
        (node_blocks, h): (&PointRegisters<L::Row>, f64),
    ) {
        let (at, n) = (&problem.patterns, problem.n);
        let [rows, nodes] = [tables.stages, tables.intervals + 1].map(L::rows);
        for (place, &(row, col)) in at.r_y.entries().iter().enumerate() {
            let r_y = self.node_jacobian.value(place);
            let block = self.matrix.block(row, col);
            for (out, weights) in block.iter_mut().zip(tables.a_bar.columns()) {
                let mut moved = L::zeros();
                for (k, out) in moved.as_mut()[..nodes].iter_mut().enumerate() {
                    *out = r_y[k] * (L::factor(weights, k) * h);
                }
                subtract_moved::<L>(&mut out.as_mut()[..rows], &tables.a_hat, &moved, h);
            }
        }
        for (place, &(row, c)) in at.r_lam.entries().iter().enumerate() {
            let r_lam = points::<L>(node_blocks.value(at.g_y.len() + place));
            let block = self.matrix.block(row, n + c);
            for (l, (out, weights)) in block.iter_mut().zip(tables.a_hat.columns()).enumerate() {
                let r_lam = L::at(&r_lam, l).every();
                for (i, out) in out.as_mut()[..rows].iter_mut().enumerate() {
                    *out -= r_lam * L::factor(weights, i);
                }
            }
        }
    }

    /// P⁻¹ ā_kj g_y(k)
    #[inline(always)]
    fn write_constraints(
        &mut self,
        problem: &Mechanical,
        tables: &Tables,
        node_blocks: &PointRegisters<L::Row>,
    ) {
        let [rows, nodes] = [tables.intervals, tables.intervals + 1].map(L::rows);
        for (place, &(c, col)) in problem.patterns.g_y.entries().iter().enumerate() {
            let g_y = node_blocks.value(place);
            let block = self.matrix.block(problem.n + c, col);
            for (out, weights) in block.iter_mut().zip(tables.a_bar.columns()) {
                let mut moved = L::zeros();
                for (k, out) in moved.as_mut()[..nodes].iter_mut().enumerate() {
                    *out = g_y[k] * L::factor(weights, k);
                }
                L::sums(&mut out.as_mut()[..rows], &tables.inverse_product, &moved);
            }
        }
    }

    /// Corrections for these residuals of momenta, and for g at the nodes.
    #[inline(always)]
    pub(super) fn solve(
        &mut self,
        tables: &Tables,
        residual: &[L::Points],
        node: &PointRegisters<L::Row>,
        (m, h): (usize, f64),
    ) {
        let (n, k) = (residual.len(), tables.intervals);
        let [stages, rows, nodes] = [tables.stages, k, k + 1].map(L::rows);
        for (out, residual) in self.corrections.iter_mut().zip(residual) {
            for row in 0..stages {
                out.as_mut()[row] = -residual.as_ref()[row];
            }
        }
        for c in 0..m.min(CONSTRAINTS) {
            let mut sides = L::zeros();
            for (out, g) in sides.as_mut()[..nodes].iter_mut().zip(node.value(c)) {
                *out = -*g * (1.0 / h);
            }
            let out = &mut self.corrections[n + c].as_mut()[..rows];
            L::sums(out, &tables.inverse_product, &sides);
        }
        self.matrix.solve(&mut self.corrections[..n + m]);
        let (d_z, d_lam) = self.corrections[..n + m].split_at_mut(n);
        for d_z in d_z {
            L::extend(d_z, tables.stages, L::at(d_z, tables.stages - 1));
        }
        for d_lam in d_lam {
            L::extend(d_lam, k, L::splat(0.0));
        }
    }
}

impl<L: Layout> Small<L> {
    /// Finds the corrections of Z and λ, and makes those of λ.
    #[inline(always)]
    pub(super) fn solve_full(&mut self, h: f64) {
        let (n, m) = (self.problem.n.min(COORDINATES), self.problem.m);
        if let Some(full) = &mut self.full {
            let residual = &self.work.residual[..n];
            full.solve(&self.tables, residual, &self.node, (m, h));
            let pairs = self.lam.iter_mut().zip(&full.corrections[n..]);
            for (lam, d_lam) in pairs.take(m) {
                for row in 0..L::rows(self.tables.intervals) {
                    lam.as_mut()[row] += d_lam.as_ref()[row] * (1.0 / h);
                }
            }
        }
    }
}

/// `out -= h A x`
#[inline(always)]
fn subtract_moved<L: Layout>(out: &mut [L::Row], weights: &Weights, moved: &L::Points, h: f64) {
    let mut sums = L::zeros();
    let sums = &mut sums.as_mut()[..out.len()];
    L::sums(sums, weights, moved);
    for (out, sum) in out.iter_mut().zip(sums) {
        *out -= *sum * h;
    }
}
