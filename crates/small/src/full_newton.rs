//! Full simplified Newton, where the mass varies: Z and Λ together, by the matrix of `full_newton` in the crate above.
//!
//! Its rows are those of momenta at the stages, then P⁻¹ times those of g at the nodes: as h → 0 the blocks of Z are masses,
//! and their Schur complement is a multiple of the identity in the nodes, so that no pivots are needed.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::Fixed;
use super::blocks::{BlockLu, Columns, one_if_negative};
use super::layout::{Layout, POINTS, Weights};
use super::tables::Tables;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::tape::PointRegisters;
use liouville_problem::{Mechanical, Model};

/// The derivatives and the factored matrix.
#[derive(Clone, Debug)]
pub(super) struct FullNewton<L: Layout, const N: usize, const M: usize> {
    stage_blocks: PointRegisters<L::Row>,
    stage_jacobian: PointRegisters<L::Row>,
    node_jacobian: PointRegisters<L::Row>,
    matrix: BlockLu<L>,
    /// Places of the entries of p_z, p_y, f_y, f_z and r_y, by two coordinates.
    places: [[Places; N]; N],
    /// How many pivots of the matrix, without constraints, have other signs than those of a small step, which is the mass
    /// at the stages.
    pub(super) reversed: L,
    /// dZ, then dΛ.
    pub(super) corrections: Vec<L::Points>,
}

type Places = [Option<usize>; 5];

/// The places of the derivatives in the tapes' values.
fn places<const N: usize>(problem: &Mechanical) -> [[Places; N]; N] {
    let at = &problem.patterns;
    let parts = [
        (&at.p_z, 0),
        (&at.p_y, 0),
        (&at.f_y, at.p_y.len()),
        (&at.f_z, at.p_y.len() + at.f_y.len()),
        (&at.r_y, 0),
    ];
    let mut places = [[[None; 5]; N]; N];
    for (part, (pattern, first)) in parts.into_iter().enumerate() {
        for (place, &(row, col)) in pattern.entries().iter().enumerate() {
            places[row][col][part] = Some(first + place);
        }
    }
    places
}

/// Rows of values as points.
#[inline(always)]
fn points<L: Layout>(rows: &[L::Row]) -> L::Points {
    let mut points = L::zeros();
    points.as_mut()[..rows.len()].copy_from_slice(rows);
    points
}

impl<L: Layout, const N: usize, const M: usize> FullNewton<L, N, M> {
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
            places: places(&model.problem),
            reversed: L::splat(0.0),
            corrections: vec![L::zeros(); n + m],
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
        if problem.m > 0 {
            problem.node_jacobian.run_points(&mut self.node_jacobian);
            self.matrix.clear_from(problem.n);
            self.write_reactions(problem, tables, node_blocks);
            self.write_constraints(problem, tables, node_blocks);
        }
        for row in 0..problem.n.min(N) {
            for col in 0..problem.n.min(N) {
                self.write_block((row, col), tables, h);
            }
        }
        self.matrix.factor();
        self.reversed = self.matrix.negative;
        let is_definite = self.reversed.all(
            #[inline(always)]
            |negative| negative == 0.0,
        );
        if problem.m > 0 {
            self.reversed = L::splat(0.0);
        } else if !is_definite {
            self.reversed -= self.negative_pivots_of_mass(problem.n) * tables.stages as f64;
        }
    }

    /// How many pivots of the mass are negative, the same wherever it is not singular.
    #[cold]
    fn negative_pivots_of_mass(&self, n: usize) -> L {
        let mut mass = [[L::splat(0.0); N]; N];
        for (row, places) in mass.iter_mut().zip(&self.places) {
            for (out, [p_z, ..]) in row.iter_mut().zip(places) {
                if let Some(place) = p_z {
                    *out = L::at(&points::<L>(self.stage_blocks.value(*place)), 0);
                }
            }
        }
        let mut negative = L::splat(0.0);
        for k in 0..n.min(N) {
            let pivot = mass[k];
            negative += one_if_negative(pivot[k]);
            for row in &mut mass[k + 1..] {
                let factor = row[k] / pivot[k];
                for (out, x) in row.iter_mut().zip(&pivot) {
                    *out -= factor * *x;
                }
            }
        }
        negative
    }

    /// δ_ij p_z(i) + h aᵛ_ij p_y(i) − h Σ_l aᶠ_il (f_z(l) δ_lj + h aᵛ_lj f_y(l)) − h² Σ_k â_ik ā_kj r_y(k)
    #[inline(always)]
    fn write_block(&mut self, (row, col): (usize, usize), tables: &Tables, h: f64) {
        let (s, k, rows) = (tables.stages, tables.intervals, L::rows(tables.stages));
        let (a_v, a_f, a_bar) = (&tables.a_v, &tables.a_f, &tables.a_bar);
        let [p_z, p_y, f_y, f_z, r_y] = self.places[row][col];
        let p_z = p_z.map(|place| points::<L>(self.stage_blocks.value(place)));
        let f_z = f_z.map(|place| points::<L>(self.stage_jacobian.value(place)));
        let p_y = p_y.map(|place| self.stage_jacobian.value(place));
        let f_y = f_y.map(|place| impulses::<L>(self.stage_jacobian.value(place), a_f, rows));
        let r_y =
            r_y.map(|place| impulses::<L>(self.node_jacobian.value(place), &tables.a_hat, rows));
        let block = self.matrix.block(row, col);
        for (j, out) in block.iter_mut().enumerate().take(s) {
            let (of_v, of_f, of_node) = (&a_v.columns()[j], &a_f.columns()[j], &a_bar.columns()[j]);
            for i in 0..rows {
                let mut sum = L::Row::splat(0.0);
                if let Some(f_y) = &f_y {
                    sum -= displaced::<L>(f_y, of_v, i, s) * (h * h);
                }
                if let Some(r_y) = &r_y {
                    sum -= displaced::<L>(r_y, of_node, i, k) * (h * h);
                }
                if let Some(f_z) = &f_z {
                    sum -= L::at(f_z, j).every() * (L::factor(of_f, i) * h);
                }
                if let Some(p_y) = p_y {
                    sum += p_y[i] * (L::factor(of_v, i) * h);
                }
                out.as_mut()[i] = sum;
            }
            if let Some(p_z) = &p_z {
                L::add_point(out, p_z, j);
            }
        }
    }

    /// −â_il r_λ(l)
    #[inline(always)]
    fn write_reactions(
        &mut self,
        problem: &Mechanical,
        tables: &Tables,
        node_blocks: &PointRegisters<L::Row>,
    ) {
        let (at, n) = (&problem.patterns, problem.n);
        for (place, &(row, c)) in at.r_lam.entries().iter().enumerate() {
            let r_lam = points::<L>(node_blocks.value(at.g_y.len() + place));
            let block = self.matrix.block(row, n + c);
            for (l, (out, weights)) in block.iter_mut().zip(tables.a_hat.columns()).enumerate() {
                let r_lam = (-L::at(&r_lam, l)).every();
                let rows = out.as_mut()[..L::rows(tables.stages)].iter_mut();
                for (i, out) in rows.enumerate() {
                    *out = r_lam * L::factor(weights, i);
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
        for c in 0..m.min(M) {
            let mut sides = L::zeros();
            for (out, g) in sides.as_mut()[..nodes].iter_mut().zip(node.value(c)) {
                *out = -*g * (1.0 / h);
            }
            let out = &mut self.corrections[n + c].as_mut()[..rows];
            L::sums(out, &tables.inverse_product, &sides);
        }
        self.matrix.solve(&mut self.corrections[..n + m]);
    }

    /// dZ of one coordinate; beyond the last stage it is repeated.
    #[inline(always)]
    pub(super) fn d_z(&self, q: usize, stages: usize) -> L::Points {
        let d_z = &self.corrections[q];
        L::extended(d_z, stages, L::at(d_z, stages - 1))
    }
}

impl<L: Layout, const N: usize, const M: usize> Fixed<L, N, M> {
    /// Finds the corrections of Z and λ, and makes those of λ.
    #[inline(always)]
    pub(super) fn solve_full(&mut self, h: f64) {
        let (n, m) = (self.problem.n.min(N), self.problem.m);
        if Self::TAKES_NEWTON
            && let Some(full) = &mut self.full
        {
            let residual = &self.work.residual[..n];
            full.solve(self.tables, residual, &self.node, (m, h));
            let pairs = self.lam.iter_mut().zip(&full.corrections[n..]);
            for (lam, d_lam) in pairs.take(m) {
                let k = self.tables.intervals;
                let d_lam = L::extended(d_lam, k, L::splat(0.0));
                for row in 0..L::rows(k) {
                    lam.as_mut()[row] += d_lam.as_ref()[row] * (1.0 / h);
                }
            }
        }
    }
}

/// The impulses at the stages that a force at each point gives, a column for it.
#[inline(always)]
fn impulses<L: Layout>(force: &[L::Row], weights: &Weights, rows: usize) -> Columns<L> {
    let force = points::<L>(force);
    let mut columns = [L::zeros(); POINTS];
    for (l, (out, weights)) in columns.iter_mut().zip(weights.columns()).enumerate() {
        let force = L::at(&force, l).every();
        for (i, out) in out.as_mut()[..rows].iter_mut().enumerate() {
            *out = force * L::factor(weights, i);
        }
    }
    columns
}

/// Σ_l of `count` impulses, each times the displacement of its point.
#[inline(always)]
fn displaced<L: Layout>(impulses: &Columns<L>, moved: &Lanes, row: usize, count: usize) -> L::Row {
    let mut sums = [L::Row::splat(0.0); 2];
    let pairs = impulses.as_chunks::<2>().0.iter();
    for (l, [even, odd]) in pairs.enumerate().take(count.div_ceil(2)) {
        sums[0] += even.as_ref()[row] * moved.0[2 * l];
        sums[1] += odd.as_ref()[row] * moved.0[2 * l + 1];
    }
    sums[0] + sums[1]
}
