//! A sparse matrix at several nodes: one pattern, the values of the nodes side by side within an entry.
//!
//! Entries are kept row by row, so that a row of a product is summed in registers.

use super::Pattern;
use crate::real::Real;

/// The matrix.
#[derive(Clone, Debug)]
pub struct NodeRows<R = f64> {
    pattern: Pattern,
    /// Which entry of the pattern it was made of each of its own is.
    from: Vec<u32>,
    /// Where the entries of each row start; one more than there are rows.
    starts: Vec<u32>,
    cols: Vec<u32>,
    values: Vec<R>,
}

impl<R: Real> NodeRows<R> {
    /// A matrix of zeros of this pattern at so many nodes.
    #[allow(clippy::cast_possible_truncation)] // more entries would not fit in memory
    pub fn new(pattern: &Pattern, nodes: usize) -> Self {
        let entries = pattern.entries();
        let mut from: Vec<u32> = (0..entries.len() as u32).collect();
        from.sort_by_key(|k| entries[*k as usize]);
        let entries: Vec<_> = from.iter().map(|k| entries[*k as usize]).collect();
        let (rows, cols) = pattern.shape();
        let starts = (0..=rows).map(|i| entries.partition_point(|(row, _)| *row < i) as u32);
        Self {
            starts: starts.collect(),
            cols: entries.iter().map(|(_, col)| *col as u32).collect(),
            values: vec![R::splat(0.0); nodes * from.len()],
            from,
            pattern: Pattern {
                rows,
                cols,
                entries,
            },
        }
    }

    /// Where it is not zero, row by row.
    pub fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// The values, in the order of that pattern, node by node within an entry.
    pub fn values(&self) -> &[R] {
        &self.values
    }

    /// Takes the values of each node, in the order of the pattern it was made of.
    ///
    /// # Panics
    /// When there are fewer values than entries.
    pub fn set<const K: usize>(&mut self, nodes: [&[R]; K]) {
        let values = self.values.as_chunks_mut::<K>().0;
        for (out, from) in values.iter_mut().zip(&self.from) {
            *out = nodes.map(|node| node[*from as usize]);
        }
    }

    /// `out += A x` at each node.
    ///
    /// # Panics
    /// When `x` is too short.
    #[allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for
    #[inline(always)]
    pub fn multiply_add<const K: usize>(&self, x: &[[R; K]], out: &mut [[R; K]]) {
        let values = self.values.as_chunks::<K>().0;
        let ends = self.starts[1..].iter();
        let mut start = 0;
        for (out, end) in out.iter_mut().zip(ends) {
            let at = start..*end as usize;
            start = at.end;
            for (value, col) in values[at.clone()].iter().zip(&self.cols[at]) {
                let x = &x[*col as usize];
                for i in 0..K {
                    out[i] += value[i] * x[i];
                }
            }
        }
    }
}
