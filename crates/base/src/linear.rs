//! A linear map as a list of operations on a memory of numbers: forwards for tangents, transposed for cotangents.
//!
//! An operation adds A x to other numbers of the memory, or solves with a matrix in place. The transposed list takes the
//! operations last one first, each with Aᵀ from where it leads to where it comes from, so that a derivative is listed once.
//! Where all segments between the ends are zero at the start, it is the exact transpose.

use crate::linalg::{Pattern, add_scaled, dot};
use crate::real::Real;
use std::ops::Range;

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

    /// Solves with the matrix of this number in place.
    ///
    /// # Errors
    /// Where the matrix is singular, or an iteration does not converge.
    fn solve(&mut self, matrix: usize, x: &mut [R]) -> Result<(), Self::Error>;

    /// The same with the transposed matrix.
    ///
    /// # Errors
    /// As [`Operators::solve`].
    fn solve_transposed(&mut self, matrix: usize, x: &mut [R]) -> Result<(), Self::Error>;
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

    /// Takes the memory through the list.
    ///
    /// # Errors
    /// Errors of the operators.
    pub fn apply<O: Operators<R>>(&self, memory: &mut [R], by: &mut O) -> Result<(), O::Error> {
        for LinearOperation {
            kind,
            weight,
            from,
            to,
        } in &self.operations
        {
            if let Kind::Solve { matrix } = kind {
                by.solve(*matrix, &mut memory[to.range()])?;
                continue;
            }
            let (x, out) = apart(memory, *from, *to);
            match *kind {
                Kind::Scale => add_scaled(out, *weight, x),
                Kind::Column { first } => add_scaled(out, x[0] * *weight, &self.values[first..]),
                Kind::Block { pattern, first } => {
                    self.patterns[pattern].multiply_add(&self.values[first..], *weight, x, out);
                }
                Kind::Solve { .. } => {}
            }
        }
        Ok(())
    }

    /// Takes the memory back through the transposed list.
    ///
    /// # Errors
    /// Errors of the operators.
    pub fn apply_transposed<O: Operators<R>>(
        &self,
        memory: &mut [R],
        by: &mut O,
    ) -> Result<(), O::Error> {
        for LinearOperation {
            kind,
            weight,
            from,
            to,
        } in self.operations.iter().rev()
        {
            if let Kind::Solve { matrix } = kind {
                by.solve_transposed(*matrix, &mut memory[to.range()])?;
                continue;
            }
            let (out, x) = apart(memory, *from, *to);
            match *kind {
                Kind::Scale => add_scaled(out, *weight, x),
                Kind::Column { first } => out[0] += dot(x, &self.values[first..]) * *weight,
                Kind::Block { pattern, first } => {
                    let (pattern, values) = (&self.patterns[pattern], &self.values[first..]);
                    pattern.multiply_add_transposed(values, *weight, x, out);
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
