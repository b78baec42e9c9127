//! The order in which a nearly symmetric sparse matrix is eliminated without pivoting, and where its fill-in goes.
//!
//! The next unknown is one with the fewest neighbours left, of several the one that waited longest
//! (minimum degree; davis2006, chapter 7). A chain is eliminated from both its ends in turn and a tree
//! from all its leaves, without fill-in, and steps that follow one another do not wait for each other.

use super::Pattern;
use std::collections::VecDeque;

/// Order and places of the factors of matrices of one pattern: the diagonal, the columns below it, the
/// rows right of it, step by step.
#[derive(Clone, Debug)]
pub(super) struct EliminationPlan {
    /// The unknown of each step.
    pub(super) order: Vec<u32>,
    /// Where the neighbours of each step start; one more than there are steps.
    pub(super) starts: Vec<u32>,
    /// The later steps that each step is coupled to.
    pub(super) neighbours: Vec<u32>,
    /// Where L_a U_b is subtracted, for all pairs (a, b) of neighbours of each step.
    pub(super) targets: Vec<u32>,
}

impl EliminationPlan {
    /// The plan for matrices with symmetric pattern `couplings`; `None` where an unknown costs more than
    /// `most` updates on average.
    pub(super) fn new(couplings: &Pattern, most: usize) -> Option<Self> {
        let m = couplings.shape().0;
        let (order, later) = eliminate(couplings, most)?;
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
        let mut plan = Self {
            order: order.into_iter().map(index).collect(),
            starts,
            neighbours,
            targets: Vec::new(),
        };
        for step in 0..m {
            let at = plan.range(step);
            let pairs = at.clone().flat_map(|a| at.clone().map(move |b| (a, b)));
            let targets = pairs.map(|(a, b)| {
                let at = |k: usize| plan.neighbours[k] as usize;
                index(plan.slot(at(a), at(b)))
            });
            let targets: Vec<u32> = targets.collect();
            plan.targets.extend(targets);
        }
        Some(plan)
    }

    /// How many places there are.
    pub(super) fn places(&self) -> usize {
        self.order.len() + 2 * self.neighbours.len()
    }

    /// The places of the entries of `couplings`.
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
}

#[allow(clippy::cast_possible_truncation)] // sizes of patterns, whose entries alone would fill memory
fn index(k: usize) -> u32 {
    k as u32
}

/// The unknowns in the order of their elimination, and those each is coupled to then.
fn eliminate(couplings: &Pattern, most: usize) -> Option<(Vec<usize>, Vec<Vec<usize>>)> {
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
        if updates > most * m {
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
