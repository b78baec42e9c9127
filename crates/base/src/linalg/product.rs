//! Products of two sparse matrices, whose places are found once.

use super::Pattern;
use crate::real::Real;

/// A place of a product, and entries of the factors that meet there.
pub(super) type Meeting = ((usize, usize), (u32, u32));

/// All pairs of entries of A and B that meet in A B, by their place.
#[allow(clippy::cast_possible_truncation)] // more entries would not fit in memory
pub(super) fn meetings(a: &Pattern, b: &Pattern) -> Vec<Meeting> {
    assert_eq!(a.shape().1, b.shape().0, "columns and rows of a product");
    let mut of_row: Vec<Vec<(usize, u32)>> = vec![Vec::new(); b.shape().0];
    for (j, (row, col)) in b.entries().iter().enumerate() {
        of_row[*row].push((*col, j as u32));
    }
    let pairs = a
        .entries()
        .iter()
        .enumerate()
        .flat_map(|(i, (row, inner))| {
            let beside = of_row[*inner].iter();
            beside.map(move |(col, j)| ((*row, *col), (i as u32, *j)))
        });
    let mut meetings: Vec<Meeting> = pairs.collect();
    meetings.sort_unstable();
    meetings
}

/// A B, of A and several B with one pattern each.
#[derive(Clone, Debug)]
pub struct Product {
    pattern: Pattern,
    /// Where the pairs of each entry start; one more than there are entries.
    starts: Vec<u32>,
    pairs: Vec<(u32, u32)>,
}

impl Product {
    /// Memory for A and B of these patterns.
    ///
    /// # Panics
    /// When A has not as many columns as B has rows.
    #[allow(clippy::cast_possible_truncation)] // as above
    pub fn new(a: &Pattern, b: &Pattern) -> Self {
        let meetings = meetings(a, b);
        let (mut entries, mut starts) = (Vec::new(), vec![0]);
        let mut end = 0;
        for group in meetings.chunk_by(|a, b| a.0 == b.0) {
            entries.push(group[0].0);
            end += group.len();
            starts.push(end as u32);
        }
        Self {
            pattern: Pattern {
                rows: a.shape().0,
                cols: b.shape().1,
                entries,
            },
            starts,
            pairs: meetings.into_iter().map(|(_, pair)| pair).collect(),
        }
    }

    /// Where the product is not zero.
    pub fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// The products of A and K matrices B, whose values stand side by side entry by entry.
    ///
    /// # Panics
    /// When there are fewer values than entries.
    pub fn multiply<R: Real, const K: usize>(&self, a: &[R], b: &[R], out: &mut [R]) {
        let (b, out) = (b.as_chunks::<K>().0, out.as_chunks_mut::<K>().0);
        if self.pairs.len() == out.len() {
            for (out, (i, j)) in out.iter_mut().zip(&self.pairs) {
                *out = b[*j as usize].map(|b| a[*i as usize] * b);
            }
            return;
        }
        let mut start = 0;
        for (out, end) in out.iter_mut().zip(&self.starts[1..]) {
            let at = start..*end as usize;
            start = at.end;
            let mut sum = [R::splat(0.0); K];
            for (i, j) in &self.pairs[at] {
                let (factor, b) = (a[*i as usize], &b[*j as usize]);
                for k in 0..K {
                    sum[k] += factor * b[k];
                }
            }
            *out = sum;
        }
    }
}
