//! A linear map as a list of operations on a memory of numbers: forwards for tangents, transposed for cotangents.
//!
//! An operation adds A x to other numbers of the memory, or solves with a matrix in place. The transposed list takes the
//! operations last one first, each with Aᵀ from where it leads to where it comes from, so that a derivative is listed once.
//! Where all segments between the ends are zero at the start, it is the exact transpose.
//!
//! Where a list would cost too much the operations are called as they stand, by a function that is generic over the
//! direction: it takes its parts by [`in_order`], and none of the operations of a part writes what another one reads.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use crate::linalg::{Matrix, Pattern, add_scaled, combine_rows, copy_scaled, dot};
use crate::real::Real;
use std::ops::Range;

/// The numbers 0 to `count` − 1, last one first where a map is transposed.
#[inline(always)]
pub fn in_order<const TRANSPOSED: bool>(count: usize) -> impl Iterator<Item = usize> {
    (0..count).map(move |k| if TRANSPOSED { count - 1 - k } else { k })
}

/// `to += weight from`; transposed, `from += weight to`.
#[inline(always)]
pub fn add<const TRANSPOSED: bool, R: Real>(to: &mut [R], weight: f64, from: &mut [R]) {
    if TRANSPOSED {
        add_scaled(from, weight, to);
    } else {
        add_scaled(to, weight, from);
    }
}

/// `to = weight from`; transposed, `from += weight to`.
#[inline(always)]
pub fn set<const TRANSPOSED: bool, R: Real>(to: &mut [R], weight: f64, from: &mut [R]) {
    if TRANSPOSED {
        add_scaled(from, weight, to);
    } else {
        copy_scaled(to, weight, from);
    }
}

/// `to += weight values from`; transposed, `from += weight values · to`.
#[inline(always)]
pub fn add_column<const TRANSPOSED: bool, R: Real>(
    to: &mut [R],
    weight: f64,
    values: &[R],
    from: &mut R,
) {
    if TRANSPOSED {
        *from += dot(to, values) * weight;
    } else {
        add_scaled(to, *from * weight, values);
    }
}

/// `to += weight A from`; transposed, `from += weight Aᵀ to`; A has these values on its pattern.
#[inline(always)]
pub fn add_product<const TRANSPOSED: bool, R: Real>(
    to: &mut [R],
    (pattern, values): (&Pattern, &[R]),
    weight: f64,
    from: &mut [R],
) {
    if TRANSPOSED {
        pattern.multiply_add_transposed(values, weight, to, from);
    } else {
        pattern.multiply_add(values, weight, from, to);
    }
}

/// A small matrix that combines rows of numbers, with its transpose.
#[derive(Clone, Debug)]
pub struct RowWeights {
    weights: Matrix,
    transposed: Matrix,
}

impl RowWeights {
    /// The map of these weights.
    pub fn new(weights: Matrix) -> Self {
        let (rows, cols) = (weights.rows(), weights.cols());
        Self {
            transposed: Matrix::from_fn(cols, rows, |j, i| weights[(i, j)]),
            weights,
        }
    }

    /// `to = factor weights from`, of rows of `cols` numbers; transposed, `from = factor weightsᵀ to`. Rows beyond the
    /// weights are left alone.
    #[inline(always)]
    pub fn combine<const TRANSPOSED: bool, R: Real>(
        &self,
        to: &mut [R],
        factor: f64,
        from: &mut [R],
        cols: usize,
    ) {
        let (out, weights, x) = if TRANSPOSED {
            (from, &self.transposed, to)
        } else {
            (to, &self.weights, from)
        };
        combine_rows(
            out,
            weights,
            (x, cols),
            #[inline(always)]
            |_, _, sums| {
                for sum in sums {
                    *sum = *sum * factor;
                }
            },
        );
    }
}

/// A place of some numbers in the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    first: usize,
    len: usize,
}

impl Segment {
    /// The part number `k` of `len` numbers each.
    #[must_use]
    pub fn part(self, k: usize, len: usize) -> Self {
        self.cut(k * len, len)
    }

    /// `len` numbers from `first` on.
    ///
    /// # Panics
    /// When they are not all in the segment.
    #[must_use]
    pub fn cut(self, first: usize, len: usize) -> Self {
        assert!(first + len <= self.len, "a part beyond its segment");
        let first = self.first + first;
        Self { first, len }
    }

    /// Where it is in the memory.
    pub fn range(self) -> Range<usize> {
        self.first..self.first + self.len
    }
}

/// Lays segments side by side.
#[derive(Clone, Copy, Debug, Default)]
pub struct Segments(usize);

impl Segments {
    /// The next `len` numbers.
    pub fn take(&mut self, len: usize) -> Segment {
        let first = self.0;
        self.0 += len;
        Segment { first, len }
    }

    /// The memory of all segments.
    pub fn memory<R: Real>(self) -> Vec<R> {
        vec![R::splat(0.0); self.0]
    }
}

/// A pattern that a list knows, and which of its tape's values it takes.
#[derive(Clone, Debug)]
pub struct BlockPattern {
    pattern: usize,
    values: Range<usize>,
}

/// The matrices that a list solves with.
pub trait Operators<R = f64> {
    /// Error of an operator.
    type Error;

    /// Solves with the matrix of this number in place, or with the transposed matrix.
    ///
    /// # Errors
    /// Where the matrix is singular, or an iteration does not converge.
    fn solve<const TRANSPOSED: bool>(
        &mut self,
        matrix: usize,
        x: &mut [R],
    ) -> Result<(), Self::Error>;
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// to += weight from
    Scale,
    /// to += weight values x, of one number x
    Column { first: usize },
    /// to += weight A from
    Block { pattern: usize, first: usize },
    /// from becomes its solution.
    Solve { matrix: usize },
}

#[derive(Clone, Copy, Debug)]
struct LinearOperation {
    kind: Kind,
    weight: f64,
    from: Segment,
    to: Segment,
}

/// The list. Its memory is kept when it is cleared: it is listed anew for each step without allocation.
#[derive(Clone, Debug, Default)]
pub struct LinearMap<R = f64> {
    patterns: Vec<Pattern>,
    values: Vec<R>,
    operations: Vec<LinearOperation>,
}

impl<R: Real> LinearMap<R> {
    /// Makes a pattern known.
    pub fn pattern(&mut self, pattern: &Pattern) -> BlockPattern {
        self.patterns.push(pattern.clone());
        BlockPattern {
            pattern: self.patterns.len() - 1,
            values: 0..pattern.len(),
        }
    }

    /// Makes the first column of a pattern known, and the others: derivatives by time, and by parameters.
    ///
    /// # Panics
    /// When its entries are not in the order of columns.
    pub fn split(&mut self, pattern: &Pattern) -> [BlockPattern; 2] {
        let (entries, (rows, cols)) = (pattern.entries(), pattern.shape());
        assert!(
            entries.is_sorted_by_key(|(_, col)| *col),
            "entries column by column"
        );
        let of_first = entries.partition_point(|(_, col)| *col == 0);
        let moved = entries[of_first..].iter().map(|(row, col)| (*row, col - 1));
        [
            (1, entries[..of_first].to_vec(), 0..of_first),
            (cols - 1, moved.collect(), of_first..entries.len()),
        ]
        .map(|(cols, entries, values)| {
            let inside = Pattern::new(rows, cols, entries);
            self.patterns.push(inside.expect("entries of a pattern"));
            let pattern = self.patterns.len() - 1;
            BlockPattern { pattern, values }
        })
    }

    /// Clears the list, and keeps its patterns.
    pub fn clear(&mut self) {
        self.operations.clear();
        self.values.clear();
    }

    /// `to += weight from`
    pub fn add(&mut self, to: Segment, weight: f64, from: Segment) {
        self.push(Kind::Scale, (to, weight, from));
    }

    /// `to += weight values from`, of a segment of one number.
    pub fn add_column(&mut self, to: Segment, weight: f64, values: &[R], from: Segment) {
        let first = self.values.len();
        self.values.extend_from_slice(values);
        self.push(Kind::Column { first }, (to, weight, from));
    }

    /// `to += weight A from`, A of these values of a tape on its pattern.
    pub fn add_product(
        &mut self,
        to: Segment,
        (of, values): (&BlockPattern, &[R]),
        weight: f64,
        from: Segment,
    ) {
        if of.values.is_empty() {
            return;
        }
        let first = self.values.len();
        self.values.extend_from_slice(&values[of.values.clone()]);
        let pattern = of.pattern;
        self.push(Kind::Block { pattern, first }, (to, weight, from));
    }

    /// The same with the number of the first column apart: `to += weight (A_0 from_0 + A_1 from_1)`.
    pub fn add_split(
        &mut self,
        to: Segment,
        (of, values): (&[BlockPattern; 2], &[R]),
        weight: f64,
        from: [Segment; 2],
    ) {
        for (of, from) in of.iter().zip(from) {
            self.add_product(to, (of, values), weight, from);
        }
    }

    /// Solves in place with the matrix of this number.
    pub fn solve(&mut self, matrix: usize, at: Segment) {
        self.push(Kind::Solve { matrix }, (at, 1.0, at));
    }

    fn push(&mut self, kind: Kind, (to, weight, from): (Segment, f64, Segment)) {
        self.operations.push(LinearOperation {
            kind,
            weight,
            from,
            to,
        });
    }

    /// Takes the memory through the list, or back through the transposed list.
    ///
    /// # Errors
    /// Errors of the operators.
    pub fn apply<const TRANSPOSED: bool, O: Operators<R>>(
        &self,
        memory: &mut [R],
        by: &mut O,
    ) -> Result<(), O::Error> {
        for k in in_order::<TRANSPOSED>(self.operations.len()) {
            let operation = &self.operations[k];
            let LinearOperation { weight, to, .. } = *operation;
            if let Kind::Solve { matrix } = operation.kind {
                by.solve::<TRANSPOSED>(matrix, &mut memory[to.range()])?;
                continue;
            }
            let (from, to) = apart(memory, operation.from, to);
            match operation.kind {
                Kind::Scale => add::<TRANSPOSED, _>(to, weight, from),
                Kind::Column { first } => {
                    add_column::<TRANSPOSED, _>(to, weight, &self.values[first..], &mut from[0]);
                }
                Kind::Block { pattern, first } => {
                    let block = (&self.patterns[pattern], &self.values[first..]);
                    add_product::<TRANSPOSED, _>(to, block, weight, from);
                }
                Kind::Solve { .. } => {}
            }
        }
        Ok(())
    }
}

/// Two segments of a memory, which do not overlap.
fn apart<R>(memory: &mut [R], from: Segment, to: Segment) -> (&mut [R], &mut [R]) {
    let (low, high) = memory.split_at_mut(from.first.max(to.first));
    if from.first < to.first {
        (&mut low[from.range()], &mut high[..to.len])
    } else {
        (&mut high[..from.len], &mut low[to.range()])
    }
}
