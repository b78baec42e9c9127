//! Products with a symmetric matrix by its diagonals, (H x)_i = Σ_d v_d(i) x_{i+d} + v_d(i−d) x_{i−d}.
//!
//! A diagonal is stored once for both of its sides. Where it is the same number for long, the number is
//! enough; rows that have the same diagonals in the same way are one run.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::update::update;
use super::{Block, Update};
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// So many equal numbers one after another are kept as one.
const LONG: usize = 256;

/// What a row has at some distance from the diagonal.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    /// The same number in every row.
    Constant(f64),
    /// `values[row + shift]`
    Stored { shift: isize },
}

/// An entry of each row of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry {
    offset: isize,
    source: Source,
}

/// Rows with the same entries.
#[derive(Clone, Debug)]
struct Run {
    rows: Range<usize>,
    entries: Range<usize>,
}

/// A symmetric matrix by its diagonals.
#[derive(Clone, Debug)]
pub struct Diagonals {
    n: usize,
    reach: usize,
    values: Vec<f64>,
    entries: Vec<Entry>,
    runs: Vec<Run>,
}

/// Rows that have an entry.
type Piece = (Range<usize>, Entry);

impl Diagonals {
    /// The matrix of n rows with H[i, i + d] = H[i + d, i] = `values[i]` for each (d, `values`).
    ///
    /// # Panics
    /// When a diagonal is too long or too short for its distance, or there are two at one.
    pub fn new(n: usize, diagonals: &[(usize, Vec<f64>)]) -> Self {
        let mut pieces = Vec::new();
        let mut stored = Vec::new();
        let offsets: HashSet<usize> = diagonals.iter().map(|(offset, _)| *offset).collect();
        assert_eq!(offsets.len(), diagonals.len(), "distances differ");
        for (offset, values) in diagonals {
            assert_eq!(offset + values.len(), n, "length of a diagonal");
            add_pieces(*offset, values, &mut stored, &mut pieces);
        }
        let (entries, runs) = join(n, &pieces);
        let offsets = entries.iter().map(|entry| entry.offset.unsigned_abs());
        Self {
            n,
            reach: offsets.max().unwrap_or(0),
            values: stored,
            entries,
            runs,
        }
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.n
    }

    /// The largest distance from the diagonal.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// How many bytes all rows are.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.values) + size_of_val(&*self.runs)
    }

    /// Updates a block of rows.
    pub(super) fn act<S: Stored>(
        &self,
        machine: InstructionSet,
        update: Update,
        block: Block<'_, S>,
    ) {
        let diagonals = self;
        let act = Act {
            diagonals,
            update,
            block,
        };
        S::run(machine, act);
    }
}

/// Finds where a diagonal is one number for long, and stores the rest of it.
fn add_pieces(offset: usize, values: &[f64], stored: &mut Vec<f64>, pieces: &mut Vec<Piece>) {
    let mut parts: Vec<(Range<usize>, bool)> = Vec::new();
    let mut at = 0;
    for group in values.chunk_by(|a, b| a.to_bits() == b.to_bits()) {
        let (rows, is_long) = (at..at + group.len(), group.len() >= LONG);
        at = rows.end;
        match parts.last_mut() {
            Some((last, false)) if !is_long => last.end = at,
            _ => parts.push((rows, is_long)),
        }
    }
    let is_zero = |rows: &Range<usize>| values[rows.clone()].iter().all(|value| *value == 0.0);
    parts.retain(|(rows, _)| !is_zero(rows));
    let first = stored.len();
    if parts.iter().any(|(_, is_long)| !is_long) {
        stored.extend_from_slice(values);
    }
    let distance = offset.cast_signed();
    for (rows, is_long) in parts {
        let entry = |offset: isize, shift: isize| {
            let shift = first.cast_signed() + shift;
            let source = if is_long {
                Source::Constant(values[rows.start])
            } else {
                Source::Stored { shift }
            };
            Entry { offset, source }
        };
        pieces.push((rows.clone(), entry(distance, 0)));
        if offset > 0 {
            let below = rows.start + offset..rows.end + offset;
            pieces.push((below, entry(-distance, -distance)));
        }
    }
}

/// Cuts all rows into runs, of which those with the same entries share them.
fn join(n: usize, pieces: &[Piece]) -> (Vec<Entry>, Vec<Run>) {
    let mut starts: Vec<usize> = (0..pieces.len()).collect();
    starts.sort_by_key(|k| pieces[*k].0.start);
    let mut cuts: Vec<usize> = pieces.iter().flat_map(|(r, _)| [r.start, r.end]).collect();
    cuts.extend([0, n]);
    cuts.sort_unstable();
    cuts.dedup();
    let (mut entries, mut runs) = (Vec::new(), Vec::new());
    let mut known = HashMap::new();
    let (mut next, mut active): (usize, Vec<usize>) = (0, Vec::new());
    for rows in cuts.windows(2).map(|cut| cut[0]..cut[1]) {
        active.retain(|k| pieces[*k].0.end > rows.start);
        while next < starts.len() && pieces[starts[next]].0.start == rows.start {
            active.push(starts[next]);
            next += 1;
        }
        active.sort_unstable_by_key(|k| pieces[*k].1.offset);
        let of_run: Vec<Entry> = active.iter().map(|k| pieces[*k].1).collect();
        let key: Vec<(isize, u64)> = of_run.iter().map(Entry::key).collect();
        let entries = known.entry(key).or_insert_with(|| {
            let first = entries.len();
            entries.extend(of_run);
            first..entries.len()
        });
        let entries = entries.clone();
        runs.push(Run { rows, entries });
    }
    (entries, runs)
}

impl Entry {
    /// What tells entries apart: a diagonal is stored or constant where it is, not both in one row.
    fn key(&self) -> (isize, u64) {
        let bits = match self.source {
            Source::Constant(value) => value.to_bits(),
            Source::Stored { .. } => u64::MAX,
        };
        (self.offset, bits)
    }
}

/// The product for a block.
struct Act<'a, S> {
    diagonals: &'a Diagonals,
    update: Update,
    block: Block<'a, S>,
}

impl<S> Kernel<S> for Act<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, windows: W) {
        let Block { row, out, place, x } = self.block;
        let Diagonals {
            runs,
            values,
            entries,
            ..
        } = self.diagonals;
        let end = row + out.len();
        let first = runs.partition_point(|run| run.rows.end <= row);
        for run in &runs[first..] {
            let start = run.rows.start.max(row);
            if start >= end {
                break;
            }
            let mut rows = Rows {
                entries: &entries[run.entries.clone()],
                values,
                update: self.update,
                row: start.cast_signed(),
                before: place.cast_signed(),
                x,
                out: &mut out[start - row..],
            };
            windows.each(run.rows.end.min(end) - start, &mut rows);
        }
    }
}

/// Rows of a run.
struct Rows<'a, S> {
    entries: &'a [Entry],
    values: &'a [f64],
    update: Update,
    row: isize,
    before: isize,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> Rows<'_, S> {
    #[inline(always)]
    fn term<W: SimdView<Stored = S>>(&self, window: W, entry: Entry) -> W::Number {
        let place = self.row + entry.offset - self.before;
        let x = window.load(self.x, place.cast_unsigned());
        match entry.source {
            Source::Constant(value) => x.scaled(value),
            Source::Stored { shift } => {
                x * window.shared(self.values, (self.row + shift).cast_unsigned())
            }
        }
    }
}

impl<S> ForEach<S> for Rows<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let mut sum = window.constant(0.0);
        if let Some((first, others)) = self.entries.split_first() {
            sum = self.term(window, *first);
            for entry in others {
                sum = sum + self.term(window, *entry);
            }
        }
        let from = (self.row - self.before).cast_unsigned();
        update(window, self.update, (self.x, from), (self.out, 0), sum);
        true
    }
}
