//! A sparse matrix at several nodes: one pattern, the values of the nodes side by side within an entry.
//!
//! Entries are kept row by row, so that a row of a product is summed in registers, and rows of as many entries
//! one after another, so that their loops have one length.

use super::Pattern;
use crate::real::Real;

/// The matrix.
#[derive(Clone, Debug)]
pub struct NodeRows<R = f64> {
    pattern: Pattern,
    /// Which entry of the pattern it was made of each of its own is.
    from: Vec<u32>,
    /// How many rows there are of as many entries, with those.
    groups: Vec<(usize, usize)>,
    /// The row of each, and the columns of its entries.
    rows: Vec<u32>,
    cols: Vec<u32>,
    values: Vec<R>,
}

impl<R: Real> NodeRows<R> {
    /// A matrix of zeros of this pattern at so many nodes.
    #[allow(clippy::cast_possible_truncation)] // more entries would not fit in memory
    pub fn new(pattern: &Pattern, nodes: usize) -> Self {
        let (entries, (height, width)) = (pattern.entries(), pattern.shape());
        let mut count = vec![0; height];
        for (row, _) in entries {
            count[*row] += 1;
        }
        let mut from: Vec<u32> = (0..entries.len() as u32).collect();
        from.sort_by_key(|k| (count[entries[*k as usize].0], entries[*k as usize]));
        let entries: Vec<_> = from.iter().map(|k| entries[*k as usize]).collect();
        let mut rows: Vec<u32> = entries.iter().map(|(row, _)| *row as u32).collect();
        rows.dedup();
        let alike = rows.chunk_by(|a, b| count[*a as usize] == count[*b as usize]);
        Self {
            groups: alike
                .map(|rows| (rows.len(), count[rows[0] as usize]))
                .collect(),
            cols: entries.iter().map(|(_, col)| *col as u32).collect(),
            values: vec![R::splat(0.0); nodes * from.len()],
            rows,
            from,
            pattern: Pattern {
                rows: height,
                cols: width,
                entries,
            },
        }
    }

    /// Where it is not zero, in the order of the values.
    pub fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// The values, node by node within an entry.
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

    /// `out += A x` of a single node.
    ///
    /// # Panics
    /// When `x` or `out` is too short.
    pub fn add_product(&self, x: &[R], out: &mut [R]) {
        self.multiply_add::<1>(x.as_chunks().0, out.as_chunks_mut().0);
    }

    /// `out += A x` at each node.
    ///
    /// # Panics
    /// When `x` or `out` is too short.
    #[allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for
    #[inline(always)]
    pub fn multiply_add<const K: usize>(&self, x: &[[R; K]], out: &mut [[R; K]]) {
        let (mut rows, mut cols) = (&self.rows[..], &self.cols[..]);
        let mut values = self.values.as_chunks::<K>().0;
        for &(count, width) in &self.groups {
            let (now, rows_left) = rows.split_at(count);
            let (at, cols_left) = cols.split_at(count * width);
            let (own, values_left) = values.split_at(count * width);
            match width {
                1 => add_rows::<R, K, 1>(now, at, own, x, out),
                2 => add_rows::<R, K, 2>(now, at, own, x, out),
                4 => add_rows::<R, K, 4>(now, at, own, x, out),
                _ => {
                    let rows = now.iter().zip(at.chunks_exact(width));
                    for ((row, cols), values) in rows.zip(own.chunks_exact(width)) {
                        add_row(&mut out[*row as usize], cols, values, x);
                    }
                }
            }
            (rows, cols, values) = (rows_left, cols_left, values_left);
        }
    }
}

/// Rows of N entries each.
#[allow(clippy::inline_always)]
#[inline(always)]
fn add_rows<R: Real, const K: usize, const N: usize>(
    rows: &[u32],
    cols: &[u32],
    values: &[[R; K]],
    x: &[[R; K]],
    out: &mut [[R; K]],
) {
    let (cols, values) = (cols.as_chunks::<N>().0, values.as_chunks::<N>().0);
    for ((row, cols), values) in rows.iter().zip(cols).zip(values) {
        add_row(&mut out[*row as usize], cols, values, x);
    }
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn add_row<R: Real, const K: usize>(
    out: &mut [R; K],
    cols: &[u32],
    values: &[[R; K]],
    x: &[[R; K]],
) {
    let mut sum = *out;
    for (col, value) in cols.iter().zip(values) {
        let x = &x[*col as usize];
        for i in 0..K {
            sum[i] += value[i] * x[i];
        }
    }
    *out = sum;
}
