//! The blocks of the Newton matrix: their places, and the coefficients they are weighted with.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use self::Along::{Column, Row};
use super::super::derivatives::{Derivatives, EndDerivatives, NonholonomicDerivatives};
use liouville_base::linalg::{Matrix, Pattern, as_is, combine};
use liouville_base::newton::{BlockGrid, BlockHandle, BlockLayout, BlockMatrix};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;
use liouville_base::tableau;
use liouville_problem::{Mechanical, Model, NonholonomicPatterns};

/// Where equations and unknowns begin, counted alike: momenta and Z first, then constraints and Λ, moments of k
/// and N, and velocities and V last.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Offsets {
    /// Stages, and the end of the step where it is solved for with them.
    pub(crate) points: usize,
    /// Nodes with an unknown multiplier.
    pub(crate) nodes: usize,
    pub(crate) lam: usize,
    pub(crate) nu: usize,
    /// Behind everything but V.
    pub(crate) order: usize,
    /// Columns of V, which are those of Z where v is z.
    pub(crate) v: usize,
}

impl Offsets {
    pub(crate) fn new(problem: &Mechanical, tableau: &tableau::Spark) -> Self {
        let s = tableau.stages;
        let ends = usize::from(problem.l() > 0);
        let (points, nodes) = (s + ends, tableau.intervals + ends);
        let lam = points * problem.n;
        let nu = lam + nodes * problem.m;
        let order = nu + s * problem.l();
        Self {
            points,
            nodes,
            lam,
            nu,
            order,
            v: problem.patterns.v_z.as_ref().map_or(0, |_| order),
        }
    }

    /// Number of unknowns.
    pub(crate) fn count(&self) -> usize {
        self.order + if self.v == 0 { 0 } else { self.lam }
    }
}

/// The blocks that the derivative at a point goes to, each with its weight.
pub(super) type Targets = Vec<(BlockHandle, f64)>;

/// Adds `factor` times the weighted values to all targets.
#[inline(always)]
pub(super) fn add_to<R: Real>(
    matrix: &mut BlockMatrix<R>,
    targets: &Targets,
    values: &[R],
    factor: f64,
) {
    for (block, weight) in targets {
        matrix.add(*block, values, factor * weight);
    }
}

/// Where each derivative goes; one entry a stage, with the end behind them, or one a node.
#[derive(Clone, Debug)]
pub(super) struct SparkBlocks<R = f64> {
    pub(super) p_z: Vec<Targets>,
    pub(super) v_z: Vec<Targets>,
    pub(super) one: Vec<Targets>,
    /// dV_i itself.
    pub(super) ones: Vec<R>,
    pub(super) v_y: Vec<Targets>,
    pub(super) p_y: Vec<Targets>,
    pub(super) f_z: Vec<Targets>,
    pub(super) f_y: ByPosition<R>,
    pub(super) g_y: Vec<Targets>,
    pub(super) r_lam: Vec<Targets>,
    pub(super) r_y: ByPosition<R>,
    pub(super) own: Option<NonholonomicBlocks<R>>,
}

/// Where the derivatives of k and of its reactions go.
#[derive(Clone, Debug)]
pub(super) struct NonholonomicBlocks<R = f64> {
    pub(super) r_z: Vec<Targets>,
    pub(super) r_nu: Vec<Targets>,
    pub(super) r_y: ByPosition<R>,
    pub(super) k_z: Vec<Targets>,
    pub(super) k_y: ByPosition<R>,
    /// At the end of the step: of k and of the hidden constraints w.
    pub(super) end_k_z: Targets,
    pub(super) end_k_y: Targets,
    pub(super) end_w_y: Targets,
    pub(super) end_g_y: Targets,
    /// b_j P_{i−1}(c_j), s − 1 by s.
    pub(super) moments: Matrix,
}

/// Derivatives by y at all stages or nodes, and their sums in each block: V_j displaces all points
/// behind it.
#[derive(Clone, Debug)]
pub(super) struct ByPosition<R = f64> {
    grid: BlockGrid,
    cols: usize,
    /// Row (i, j) has the products of weights of row i of the matrix and of column j at each point.
    weights: Matrix,
    sums: Matrix<R>,
}

impl<R: Real> ByPosition<R> {
    fn new<'a>(
        layout: &mut BlockLayout<'a>,
        pattern: &'a Pattern,
        corner: (usize, usize),
        [of_row, of_col]: [&Matrix; 2],
    ) -> Self {
        let (rows, cols) = (of_row.rows(), of_col.cols());
        let weight = |ij: usize, l| of_row[(ij / cols, l)] * of_col[(l, ij % cols)];
        Self {
            grid: layout.grid(pattern, (rows, cols), corner),
            cols,
            weights: Matrix::from_fn(rows * cols, of_row.cols(), weight),
            sums: Matrix::zeros(rows * cols, pattern.len()),
        }
    }

    /// Adds `factor` times all sums of these values, a row a point.
    #[inline(always)]
    pub(super) fn add_to(&mut self, matrix: &mut BlockMatrix<R>, values: &Matrix<R>, factor: f64) {
        if values.cols() == 0 {
            return;
        }
        combine(self.sums.flat_mut(), &self.weights, values, as_is);
        for ij in 0..self.sums.rows() {
            let block = self.grid.at(ij / self.cols, ij % self.cols);
            matrix.add(block, self.sums.row(ij), factor);
        }
    }
}

/// Whether the derivative at a point is in a row of blocks or in a column of them.
#[derive(Clone, Copy, PartialEq)]
enum Along {
    Row,
    Column,
}

/// A block for each weight that is not zero, from a corner on, by the points they belong to.
fn place<'a>(
    layout: &mut BlockLayout<'a>,
    pattern: &'a Pattern,
    (row, col): (usize, usize),
    weights: &Matrix,
    along: Along,
) -> Vec<Targets> {
    let ((height, width), is_row) = (pattern.shape(), along == Along::Row);
    let points = if is_row {
        weights.rows()
    } else {
        weights.cols()
    };
    let mut targets = vec![Targets::new(); points];
    for i in 0..weights.rows() {
        for j in 0..weights.cols() {
            let weight = weights[(i, j)];
            if weight != 0.0 {
                let block = layout.place(pattern, row + i * height, col + j * width);
                targets[if is_row { i } else { j }].push((block, weight));
            }
        }
    }
    targets
}

/// `a`, and `end` below it where there are more rows.
fn extended(a: &Matrix, end: &[f64], rows: usize, cols: usize) -> Matrix {
    Matrix::from_fn(
        rows,
        cols,
        |i, j| if i < a.rows() { a[(i, j)] } else { end[j] },
    )
}

impl<R: Real> SparkBlocks<R> {
    /// The places of all blocks, and the matrix of them.
    pub(super) fn new(
        model: &Model<R>,
        tableau: &tableau::Spark,
    ) -> (Offsets, Self, BlockMatrix<R>) {
        let (problem, at) = (&model.problem, &model.problem.patterns);
        let (n, s) = (problem.n, tableau.stages);
        let offsets = Offsets::new(problem, tableau);
        let Offsets {
            points,
            nodes,
            lam,
            order,
            v,
            ..
        } = offsets;
        let a_v = extended(&tableau.a_v, &tableau.b, points, s);
        let a_f = extended(&tableau.a_f, &tableau.b, points, s);
        let a_hat = extended(&tableau.a_hat, &tableau.b_hat, points, nodes);
        let a_bar = Matrix::from_fn(nodes, s, |j, i| tableau.a_bar[(j, i)]);
        let to_nodes = Matrix::from_fn(tableau.intervals, s, |j, i| tableau.a_bar[(j + 1, i)]);
        let unit = Matrix::from_fn(points, points, |i, j| f64::from(u8::from(i == j)));
        let one = Pattern::diagonal(n);
        let mut layout = BlockLayout::default();
        let to = &mut layout;
        let none = || vec![Targets::new(); points];
        let [mut v_z, mut ones, mut v_y] = [none(), none(), none()];
        if let Some(pattern) = &at.v_z {
            v_z = place(to, pattern, (order, 0), &unit, Row);
            ones = place(to, &one, (order, v), &unit, Row);
            v_y = place(to, &at.v_y, (order, v), &tableau.a_v, Row);
        }
        let blocks = Self {
            p_z: place(to, &at.p_z, (0, 0), &unit, Row),
            p_y: place(to, &at.p_y, (0, v), &a_v, Row),
            f_y: ByPosition::new(to, &at.f_y, (0, v), [&a_f, &tableau.a_v]),
            f_z: place(to, &at.f_z, (0, 0), &a_f, Column),
            g_y: place(to, &at.g_y, (lam, v), &to_nodes, Row),
            r_lam: place(to, &at.r_lam, (0, lam), &a_hat, Column),
            r_y: ByPosition::new(to, &at.r_y, (0, v), [&a_hat, &a_bar]),
            own: (problem.nonholonomic.as_ref())
                .map(|own| NonholonomicBlocks::new(to, &at.g_y, &own.patterns, tableau, offsets)),
            v_z,
            ones: vec![R::splat(1.0); n],
            one: ones,
            v_y,
        };
        let condensed = if at.v_z.is_some() { points * n } else { 0 };
        (offsets, blocks, layout.build(order, condensed))
    }

    /// Writes the whole matrix.
    pub(super) fn write(&mut self, matrix: &mut BlockMatrix<R>, of: &Derivatives<R>, h: f64) {
        matrix.clear();
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.add_stages(matrix, of, h),
        );
        if let (Some(own), Some(of)) = (&mut self.own, &of.own) {
            own.add_stages(matrix, of, h);
        }
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.add_nodes(matrix, of, h),
        );
        if let Some(of) = &of.own {
            self.add_end(matrix, &of.end, h);
        }
    }

    /// Adds the blocks of p, f and v at the stages.
    #[inline(always)]
    fn add_stages(&mut self, matrix: &mut BlockMatrix<R>, of: &Derivatives<R>, h: f64) {
        for l in 0..of.p_z.rows() {
            add_to(matrix, &self.p_z[l], of.p_z.row(l), 1.0);
            add_to(matrix, &self.v_z[l], of.v_z.row(l), -1.0);
            add_to(matrix, &self.one[l], &self.ones, 1.0);
        }
        for l in 0..of.p_y.rows() {
            add_to(matrix, &self.p_y[l], of.p_y.row(l), h);
            if let Some(targets) = self.v_y.get(l) {
                add_to(matrix, targets, of.v_y.row(l), -h);
            }
            add_to(matrix, &self.f_z[l], of.f_z.row(l), -h);
        }
        self.f_y.add_to(matrix, &of.f_y, -h * h);
    }

    /// Adds the blocks of g and r at the nodes.
    #[inline(always)]
    fn add_nodes(&mut self, matrix: &mut BlockMatrix<R>, of: &Derivatives<R>, h: f64) {
        if of.g_y.cols() == 0 {
            return;
        }
        for k in 0..of.g_y.rows() {
            if let Some(row) = k.checked_sub(1) {
                add_to(matrix, &self.g_y[row], of.g_y.row(k), 1.0);
            }
            if let Some(targets) = self.r_lam.get(k) {
                add_to(matrix, targets, of.r_lam.row(k), -1.0);
            }
        }
        self.r_y.add_to(matrix, &of.r_y, -h * h);
    }

    /// Adds the blocks of p, v, w and k at the end, which h b_j dV_j moves.
    fn add_end(&self, matrix: &mut BlockMatrix<R>, of: &EndDerivatives<R>, h: f64) {
        let (Some(at), s) = (&self.own, self.p_z.len() - 1) else {
            return;
        };
        add_to(matrix, &self.p_z[s], &of.p_z, 1.0);
        add_to(matrix, &self.v_z[s], &of.v_z, -1.0);
        add_to(matrix, &self.one[s], &self.ones, 1.0);
        add_to(matrix, &self.p_y[s], &of.p_y, h);
        add_to(matrix, &at.end_k_z, &of.k_z, 1.0);
        add_to(matrix, &at.end_k_y, &of.k_y, h);
        add_to(matrix, &at.end_w_y, &of.w_y, h);
        add_to(matrix, &at.end_g_y, &of.g_y, 1.0);
    }
}

impl<R: Real> NonholonomicBlocks<R> {
    fn new<'a>(
        to: &mut BlockLayout<'a>,
        g_y: &'a Pattern,
        at: &'a NonholonomicPatterns,
        tableau: &tableau::Spark,
        offsets: Offsets,
    ) -> Self {
        let Offsets {
            points,
            nodes,
            lam,
            nu,
            v,
            ..
        } = offsets;
        let (s, a_v) = (tableau.stages, &tableau.a_v);
        let ((m, n), (l, _)) = (g_y.shape(), at.k_z.shape());
        let a_r = extended(&tableau.a_r, &tableau.b, points, s);
        let moments = tableau::moments(&tableau.b, &tableau.c);
        let (w, k) = (lam + (nodes - 1) * m, nu + (s - 1) * l);
        let b = Matrix::from_fn(1, s, |_, j| tableau.b[j]);
        let one = Matrix::from_fn(1, 1, |_, _| 1.0);
        Self {
            r_z: place(to, &at.r_z, (0, 0), &a_r, Column),
            r_nu: place(to, &at.r_nu, (0, nu), &a_r, Column),
            r_y: ByPosition::new(to, &at.r_y, (0, v), [&a_r, a_v]),
            k_z: place(to, &at.k_z, (nu, 0), &moments, Column),
            k_y: ByPosition::new(to, &at.k_y, (nu, v), [&moments, a_v]),
            end_k_z: place(to, &at.k_z, (k, s * n), &one, Row).concat(),
            end_k_y: place(to, &at.k_y, (k, v), &b, Row).concat(),
            end_w_y: place(to, &at.w_y, (w, v), &b, Row).concat(),
            end_g_y: place(to, g_y, (w, v + s * n), &one, Row).concat(),
            moments,
        }
    }

    /// Adds the blocks of k and its reactions at the stages.
    fn add_stages(&mut self, matrix: &mut BlockMatrix<R>, of: &NonholonomicDerivatives<R>, h: f64) {
        for j in 0..of.k_z.rows() {
            add_to(matrix, &self.k_z[j], of.k_z.row(j), 1.0);
            add_to(matrix, &self.r_z[j], of.r_z.row(j), -h);
            add_to(matrix, &self.r_nu[j], of.r_nu.row(j), -1.0);
        }
        self.k_y.add_to(matrix, &of.k_y, h);
        self.r_y.add_to(matrix, &of.r_y, -h * h);
    }
}
