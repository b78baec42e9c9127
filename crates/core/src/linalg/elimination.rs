//! LU of nearly symmetric sparse matrices without pivoting, in an order that keeps them sparse.
//!
//! The next unknown is one with the fewest neighbours left, of several the one that waited longest
//! (minimum degree; davis2006, chapter 7). A chain is eliminated from both its ends in turn and a tree
//! from all its leaves, without fill-in, and steps that follow one another do not wait for each other.

use super::{Pattern, Singular};
use std::collections::VecDeque;

/// Pivots below this fraction of what stood in their place are roundoff.
const TINY: f64 = 1e3 * f64::EPSILON;

/// Updates an unknown may cost on average; other methods take matrices of more fill-in.
const MOST_UPDATES: usize = 40;

/// Order, places and factors of matrices of one pattern.
#[derive(Clone, Debug)]
pub(super) struct Elimination {
    /// The unknown of each step.
    order: Vec<u32>,
    /// Where the neighbours of each step start; one more than there are steps.
    starts: Vec<u32>,
    /// The later steps that each step is coupled to.
    neighbours: Vec<u32>,
    /// Where L_a U_b is taken away, for all pairs (a, b) of neighbours of each step.
    targets: Vec<u32>,
    /// The diagonal, the columns below it, the rows right of it, step by step.
    values: Vec<f64>,
    x: Vec<f64>,
}

impl Elimination {
    /// Memory for matrices with symmetric pattern `couplings`; `None` where fill-in would be large.
    pub(super) fn new(couplings: &Pattern) -> Option<Self> {
        let m = couplings.shape().0;
        let (order, later) = eliminate(couplings)?;
        let mut rank = vec![0; m];
        for (step, unknown) in order.iter().enumerate() {
            rank[*unknown] = step;
        }
        let mut starts = vec![0];
        let mut neighbours = Vec::new();
        for unknowns in later {
            let mut steps: Vec<u32> = unknowns.into_iter().map(|k| index(rank[k])).collect();
            steps.sort_unstable();
            neighbours.extend(steps);
            starts.push(index(neighbours.len()));
        }
        let mut elimination = Self {
            x: vec![0.0; m],
            values: vec![0.0; m + 2 * neighbours.len()],
            order: order.into_iter().map(index).collect(),
            starts,
            neighbours,
            targets: Vec::new(),
        };
        for step in 0..m {
            let at = elimination.range(step);
            let pairs = at.clone().flat_map(|a| at.clone().map(move |b| (a, b)));
            let targets = pairs.map(|(a, b)| {
                let at = |k: usize| elimination.neighbours[k] as usize;
                index(elimination.slot(at(a), at(b)))
            });
            let targets: Vec<u32> = targets.collect();
            elimination.targets.extend(targets);
        }
        Some(elimination)
    }

    /// Where the entries of `couplings` are among the values.
    pub(super) fn slots(&self, couplings: &Pattern) -> Vec<usize> {
        let mut rank = vec![0; self.order.len()];
        for (step, unknown) in self.order.iter().enumerate() {
            rank[*unknown as usize] = step;
        }
        let entries = couplings.entries().iter();
        entries
            .map(|(row, col)| self.slot(rank[*row], rank[*col]))
            .collect()
    }

    /// The values to factor, to be overwritten.
    #[inline]
    pub(super) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// The diagonal and what is below it, to be overwritten; [`Elimination::mirror`] does the rest.
    #[inline]
    pub(super) fn lower_mut(&mut self) -> &mut [f64] {
        let above = self.values.len() - self.neighbours.len();
        &mut self.values[..above]
    }

    /// Writes above the diagonal what stands below.
    pub(super) fn mirror(&mut self) {
        let (m, count) = (self.order.len(), self.neighbours.len());
        self.values.copy_within(m..m + count, m + count);
    }

    fn range(&self, step: usize) -> std::ops::Range<usize> {
        self.starts[step] as usize..self.starts[step + 1] as usize
    }

    /// The place of an entry whose row and column are steps.
    fn slot(&self, row: usize, col: usize) -> usize {
        let first = row.min(col);
        if row == col {
            return row;
        }
        let at = self.range(first);
        let other = index(row.max(col));
        let place = at.start + self.neighbours[at].partition_point(|k| *k < other);
        let above = if row < col { self.neighbours.len() } else { 0 };
        self.order.len() + above + place
    }

    /// Factors the matrix that was written to the values.
    ///
    /// # Errors
    /// The first unknown whose pivot is at roundoff.
    pub(super) fn factor(&mut self) -> Result<(), Singular> {
        let m = self.order.len();
        let (diagonal, beside) = self.values.split_at_mut(m);
        self.x.copy_from_slice(diagonal);
        let (lower, upper) = beside.split_at_mut(self.neighbours.len());
        let mut targets = &self.targets[..];
        let mut start = 0;
        for (step, end) in self.starts[1..].iter().enumerate() {
            let at = start..*end as usize;
            start = at.end;
            let pivot = diagonal[step];
            if !(pivot.abs() > TINY * self.x[step].abs() && pivot.is_finite()) {
                let column = self.order[step] as usize;
                return Err(Singular { column });
            }
            let inverse = 1.0 / pivot;
            diagonal[step] = inverse; // solves multiply
            let (now, rest) = targets.split_at(at.len() * at.len());
            targets = rest;
            if let [target] = now {
                let factor = lower[at.start] * inverse;
                lower[at.start] = factor;
                diagonal[*target as usize] -= factor * upper[at.start];
                continue;
            }
            for (row, targets) in at.clone().zip(now.chunks_exact(at.len().max(1))) {
                let factor = lower[row] * inverse;
                lower[row] = factor;
                for (col, target) in at.clone().zip(targets) {
                    let change = factor * upper[col];
                    let target = *target as usize;
                    if let Some(place) = target.checked_sub(m) {
                        match place.checked_sub(lower.len()) {
                            Some(place) => upper[place] -= change,
                            None => lower[place] -= change,
                        }
                    } else {
                        diagonal[target] -= change;
                    }
                }
            }
        }
        Ok(())
    }

    /// Solves `A x = b` in place.
    pub(super) fn solve(&mut self, b: &mut [f64]) {
        let m = self.order.len();
        let (diagonal, beside) = self.values.split_at(m);
        let (lower, upper) = beside.split_at(self.neighbours.len());
        let x = &mut self.x[..];
        for (x, unknown) in x.iter_mut().zip(&self.order) {
            *x = b[*unknown as usize];
        }
        let mut start = 0;
        for (step, end) in self.starts[1..].iter().enumerate() {
            let at = start..*end as usize;
            start = at.end;
            let value = x[step];
            match (&self.neighbours[at.clone()], &lower[at]) {
                ([k], [factor]) => x[*k as usize] -= factor * value,
                (neighbours, factors) => {
                    for (k, factor) in neighbours.iter().zip(factors) {
                        x[*k as usize] -= factor * value;
                    }
                }
            }
        }
        for (step, start) in self.starts[..m].iter().enumerate().rev() {
            let at = *start as usize..self.starts[step + 1] as usize;
            let mut value = x[step];
            match (&self.neighbours[at.clone()], &upper[at]) {
                ([k], [factor]) => value -= factor * x[*k as usize],
                (neighbours, factors) => {
                    for (k, factor) in neighbours.iter().zip(factors) {
                        value -= factor * x[*k as usize];
                    }
                }
            }
            value *= diagonal[step];
            x[step] = value;
            b[self.order[step] as usize] = value;
        }
    }
}

#[allow(clippy::cast_possible_truncation)] // sizes of patterns, whose entries alone would fill memory
fn index(k: usize) -> u32 {
    k as u32
}

/// The unknowns in the order of their elimination, and those each is coupled to then.
fn eliminate(couplings: &Pattern) -> Option<(Vec<usize>, Vec<Vec<usize>>)> {
    let m = couplings.shape().0;
    let mut near: Vec<Vec<usize>> = vec![Vec::new(); m];
    for (row, col) in couplings.entries() {
        if row != col {
            near[*row].push(*col);
        }
    }
    let mut waiting: Vec<VecDeque<usize>> = Vec::new();
    let wait = |waiting: &mut Vec<VecDeque<usize>>, unknown, degree: usize| {
        if waiting.len() <= degree {
            waiting.resize_with(degree + 1, VecDeque::new);
        }
        waiting[degree].push_back(unknown);
    };
    for (unknown, near) in near.iter_mut().enumerate() {
        near.sort_unstable();
        near.dedup();
        wait(&mut waiting, unknown, near.len());
    }
    let (mut order, mut later) = (Vec::with_capacity(m), Vec::with_capacity(m));
    let (mut is_done, mut updates) = (vec![false; m], 0);
    while order.len() < m {
        let degree = waiting.iter().position(|queue| !queue.is_empty())?;
        let unknown = waiting[degree].pop_front()?;
        if is_done[unknown] || near[unknown].len() != degree {
            continue;
        }
        updates += degree * degree;
        if updates > MOST_UPDATES * m {
            return None;
        }
        is_done[unknown] = true;
        let around = std::mem::take(&mut near[unknown]);
        for one in &around {
            let before = near[*one].len();
            near[*one].extend(around.iter().filter(|other| *other != one));
            near[*one].retain(|other| *other != unknown);
            near[*one].sort_unstable();
            near[*one].dedup();
            if near[*one].len() != before {
                wait(&mut waiting, *one, near[*one].len());
            }
        }
        order.push(unknown);
        later.push(around);
    }
    Some((order, later))
}
