//! Dense elimination of the last unknowns of a matrix first (static condensation):
//!
//!     [ A  B ] [ x ]   [ a ]      W = D⁻¹ C,    (A − B W) x = a − B D⁻¹ b
//!     [ C  D ] [ u ] = [ b ]                     u = D⁻¹ b − W x
//!
//! A and B are the matrix's entries, D a factor of its own, often a diagonal one; W has only the columns that C has.

use crate::linalg::{Factor, Lu, Matrix, Pattern, Singular, add_scaled, dot};
use crate::real::Real;
use std::ops::Range;

/// An entry of a part of the matrix: which of its values it is, and its row and column in the part.
type Entry = (usize, usize, usize);

/// The parts of the matrix, and A − B W factored.
#[derive(Clone, Debug)]
pub(super) struct Condensed<R> {
    a: Vec<Entry>,
    b: Vec<Entry>,
    c: Vec<Entry>,
    d: Vec<Entry>,
    d_pattern: Pattern,
    d_values: Vec<R>,
    d_factor: Factor<R>,
    w: Matrix<R>,
    /// The columns in which each row of W may have entries.
    spans: Vec<Range<usize>>,
    /// A column of C, then of W.
    column: Vec<R>,
    lu: Lu<R>,
}

impl<R: Real> Condensed<R> {
    /// Memory for matrices of this pattern, sorted by columns, whose unknowns from `order` on are eliminated first.
    pub(super) fn new(pattern: &Pattern, order: usize) -> Self {
        let behind = pattern.shape().0 - order;
        let part = |is_low: bool, is_right: bool| -> Vec<Entry> {
            let (above, left) = (
                if is_low { order } else { 0 },
                if is_right { order } else { 0 },
            );
            let entries = pattern.entries().iter().enumerate();
            let own = entries
                .filter(|(_, (row, col))| (*row >= order) == is_low && (*col >= order) == is_right);
            own.map(|(slot, (row, col))| (slot, row - above, col - left))
                .collect()
        };
        let (c, d) = (part(true, false), part(true, true));
        let d_places = d.iter().map(|(_, row, col)| (*row, *col)).collect();
        let d_pattern = Pattern::new(behind, behind, d_places).expect("a part of the matrix");
        let span = |of_row: Option<usize>| {
            let entries = c
                .iter()
                .filter(|(_, row, _)| of_row.is_none_or(|own| own == *row));
            let cols = entries.map(|(_, _, col)| *col);
            cols.clone()
                .min()
                .map_or(0..0, |first| first..cols.max().unwrap_or(first) + 1)
        };
        let spans = (0..behind).map(|row| span(d_pattern.is_diagonal().then_some(row)));
        Self {
            spans: spans.collect(),
            a: part(false, false),
            b: part(false, true),
            d_values: vec![R::splat(0.0); d.len()],
            d_factor: Factor::new(&d_pattern),
            w: Matrix::zeros(behind, order),
            column: vec![R::splat(0.0); behind],
            lu: Lu::new(order),
            c,
            d,
            d_pattern,
        }
    }

    /// How many entries A − B W may have.
    pub(super) fn entries(&self) -> usize {
        let n = self.lu.order();
        let mut is_entry = vec![false; n * n];
        for (_, row, col) in &self.a {
            is_entry[row * n + col] = true;
        }
        for (_, row, col) in &self.b {
            let span = self.spans[*col].clone();
            is_entry[row * n..(row + 1) * n][span].fill(true);
        }
        is_entry.into_iter().filter(|is_entry| *is_entry).count()
    }

    /// Factors the matrix with these values on its pattern.
    pub(super) fn factor(&mut self, values: &[R]) -> Result<(), Singular> {
        let n = self.lu.order();
        for (out, (slot, ..)) in self.d_values.iter_mut().zip(&self.d) {
            *out = values[*slot];
        }
        let factored = self.d_factor.factor(&self.d_pattern, &self.d_values);
        factored.map_err(|Singular { column }| Singular { column: n + column })?;
        self.eliminate(values);
        let target = self.lu.matrix_mut();
        target.clear();
        for (slot, row, col) in &self.a {
            target[(*row, *col)] += values[*slot];
        }
        for (slot, row, col) in &self.b {
            let (factor, span) = (values[*slot], self.spans[*col].clone());
            if !factor.all(|factor| factor == 0.0) {
                let out = &mut target.row_mut(*row)[span.clone()];
                add_scaled(out, -factor, &self.w.row(*col)[span]);
            }
        }
        self.lu.factor()
    }

    /// Whether the determinant of the matrix is negative, det D det(A − B W); `None` where that is not known.
    pub(super) fn is_negative(&self) -> Option<bool> {
        Some(self.d_factor.is_negative()? ^ self.lu.is_negative())
    }

    /// W = D⁻¹ C
    fn eliminate(&mut self, values: &[R]) {
        if let Factor::Diagonal(inverse) = &self.d_factor {
            for (slot, row, col) in &self.c {
                self.w[(*row, *col)] = values[*slot] * inverse[*row];
            }
            return;
        }
        for column in self.c.chunk_by(|(.., one), (.., next)| one == next) {
            let (.., col) = column[0];
            self.column.fill(R::splat(0.0));
            for (slot, row, _) in column {
                self.column[*row] = values[*slot];
            }
            self.d_factor.solve(&mut self.column);
            for (row, value) in self.column.iter().enumerate() {
                self.w[(row, col)] = *value;
            }
        }
    }

    /// Solves in place with the matrix that was factored, and its values.
    pub(super) fn solve(&mut self, values: &[R], x: &mut [R]) {
        let (x, u) = x.split_at_mut(self.lu.order());
        self.d_factor.solve(u);
        for (slot, row, col) in &self.b {
            x[*row] -= values[*slot] * u[*col];
        }
        self.lu.solve(x);
        for (row, (u, span)) in u.iter_mut().zip(&self.spans).enumerate() {
            *u -= dot(&self.w.row(row)[span.clone()], &x[span.clone()]);
        }
    }

    /// Solves with the transposed matrix: Lᵀ x = a − Wᵀ b with L = A − B W, then Dᵀ u = b − Bᵀ x.
    pub(super) fn solve_transposed(&mut self, values: &[R], x: &mut [R]) {
        let (x, u) = x.split_at_mut(self.lu.order());
        for (row, (u, span)) in u.iter().zip(&self.spans).enumerate() {
            add_scaled(&mut x[span.clone()], -*u, &self.w.row(row)[span.clone()]);
        }
        self.lu.solve_transposed(x);
        for (slot, row, col) in &self.b {
            u[*col] -= values[*slot] * x[*row];
        }
        self.d_factor.solve_transposed(u);
    }
}
