//! Products of two sparse matrices, whose places are found once.

use super::Pattern;
use super::node_block::at;
use crate::real::Real;

/// For each place of A B, the pairs of entries of A and B whose products add up there.
#[derive(Clone, Debug)]
pub(super) struct Pairs {
    /// Where the pairs of each place start; one more than there are places.
    starts: Vec<u32>,
    pairs: Vec<(u32, u32)>,
}

#[allow(clippy::cast_possible_truncation)] // more entries would not fit in memory
impl Pairs {
    /// The places of A B, row by row, and their pairs.
    ///
    /// # Panics
    /// When A has not as many columns as B has rows.
    pub(super) fn new(a: &Pattern, b: &Pattern) -> (Vec<(usize, usize)>, Self) {
        assert_eq!(a.shape().1, b.shape().0, "columns and rows of a product");
        let mut of_row: Vec<Vec<(usize, u32)>> = vec![Vec::new(); b.shape().0];
        for (j, (row, col)) in b.entries().iter().enumerate() {
            of_row[*row].push((*col, j as u32));
        }
        let entries = a.entries().iter().enumerate();
        let terms = entries.flat_map(|(i, (row, inner))| {
            let factors = of_row[*inner].iter();
            factors.map(move |(col, j)| ((*row, *col), (i as u32, *j)))
        });
        let mut terms: Vec<_> = terms.collect();
        terms.sort_unstable();
        let (mut places, mut starts) = (Vec::new(), vec![0]);
        for group in terms.chunk_by(|a, b| a.0 == b.0) {
            places.push(group[0].0);
            starts.push(starts[starts.len() - 1] + group.len() as u32);
        }
        let pairs = terms.into_iter().map(|(_, pair)| pair).collect();
        (places, Self { starts, pairs })
    }

    /// The same with place k moved to `slots[k]` of `count`; those that are left have no pairs.
    pub(super) fn moved(&self, slots: &[usize], count: usize) -> Self {
        let mut of_slot = vec![&self.pairs[..0]; count];
        for (slot, pairs) in slots.iter().zip(self.each()) {
            of_slot[*slot] = pairs;
        }
        let mut starts = vec![0];
        for pairs in &of_slot {
            starts.push(starts[starts.len() - 1] + pairs.len() as u32);
        }
        Self {
            starts,
            pairs: of_slot.concat(),
        }
    }

    /// The pairs of each place.
    #[inline]
    pub(super) fn each(&self) -> impl Iterator<Item = &[(u32, u32)]> {
        let starts = self.starts.iter().zip(&self.starts[1..]);
        starts.map(|(start, end)| &self.pairs[*start as usize..*end as usize])
    }
}

/// A B, of A and several B with one pattern each.
#[derive(Clone, Debug)]
pub struct Product {
    pattern: Pattern,
    pairs: Pairs,
}

impl Product {
    /// Memory for A and B of these patterns.
    ///
    /// # Panics
    /// When A has not as many columns as B has rows.
    pub fn new(a: &Pattern, b: &Pattern) -> Self {
        let (entries, pairs) = Pairs::new(a, b);
        let pattern = Pattern {
            rows: a.shape().0,
            cols: b.shape().1,
            entries,
        };
        Self { pattern, pairs }
    }

    /// Where the product is not zero.
    pub fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// The products of A and k matrices B, whose values stand side by side entry by entry, in memory for K.
    ///
    /// # Panics
    /// When there are fewer values than entries.
    #[allow(clippy::inline_always)] // loops over the nodes are unrolled where k is known
    #[inline(always)]
    pub fn multiply<R: Real, const K: usize>(&self, k: usize, a: &[R], b: &[R], out: &mut [R]) {
        let mut sum = [R::splat(0.0); K];
        for (out, pairs) in out.chunks_exact_mut(k).zip(self.pairs.each()) {
            sum[..k].fill(R::splat(0.0));
            for (i, j) in pairs {
                let (factor, b) = (a[*i as usize], at::<R, K>(k, b, *j as usize));
                for i in 0..k {
                    sum[i] += factor * b[i];
                }
            }
            out.copy_from_slice(&sum[..k]);
        }
    }
}
