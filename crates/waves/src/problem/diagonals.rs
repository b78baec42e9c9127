//! Products with a symmetric matrix by its diagonals, (H x)_i = Σ_d v_d(i) x_{i+d} + v_d(i−d) x_{i−d}.
//!
//! A diagonal is stored once for both of its sides. A long stretch of one number is stored as that number; rows with the
//! same entries are one run.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::row_product::{Input, MatrixRows};
use liouville_base::simd::{Number, SimdView};
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// Equal numbers in sequence from this length on are stored as one.
const LONG: usize = 256;

/// The value of a row at some distance from the diagonal.
#[derive(Clone, Copy, Debug, PartialEq)]
enum DiagonalValue {
    /// The same number in every row.
    Constant(f64),
    /// `values[row + shift]`
    Stored { shift: isize },
}

/// An entry of each row of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DiagonalEntry {
    offset: isize,
    source: DiagonalValue,
}

/// Rows with the same entries.
#[derive(Clone, Debug)]
struct DiagonalRun {
    rows: Range<usize>,
    entries: Range<usize>,
}

/// A symmetric matrix by its diagonals.
#[derive(Clone, Debug)]
pub struct Diagonals {
    n: usize,
    reach: usize,
    values: Vec<f64>,
    entries: Vec<DiagonalEntry>,
    runs: Vec<DiagonalRun>,
}

/// Rows that have an entry.
type DiagonalPiece = (Range<usize>, DiagonalEntry);

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

    /// Bytes of all rows.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.values) + size_of_val(&*self.runs)
    }
}

/// Finds where a diagonal is one number for long, and stores the rest of it.
fn add_pieces(
    offset: usize,
    values: &[f64],
    stored: &mut Vec<f64>,
    pieces: &mut Vec<DiagonalPiece>,
) {
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
                DiagonalValue::Constant(values[rows.start])
            } else {
                DiagonalValue::Stored { shift }
            };
            DiagonalEntry { offset, source }
        };
        pieces.push((rows.clone(), entry(distance, 0)));
        if offset > 0 {
            let below = rows.start + offset..rows.end + offset;
            pieces.push((below, entry(-distance, -distance)));
        }
    }
}

/// Cuts all rows into runs, of which those with the same entries share them.
fn join(n: usize, pieces: &[DiagonalPiece]) -> (Vec<DiagonalEntry>, Vec<DiagonalRun>) {
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
        let of_run: Vec<DiagonalEntry> = active.iter().map(|k| pieces[*k].1).collect();
        let key: Vec<(isize, u64)> = of_run.iter().map(DiagonalEntry::key).collect();
        let entries = known.entry(key).or_insert_with(|| {
            let first = entries.len();
            entries.extend(of_run);
            first..entries.len()
        });
        let entries = entries.clone();
        runs.push(DiagonalRun { rows, entries });
    }
    (entries, runs)
}

impl DiagonalEntry {
    /// The identity of an entry: a diagonal is stored or constant in a row, not both.
    fn key(&self) -> (isize, u64) {
        let bits = match self.source {
            DiagonalValue::Constant(value) => value.to_bits(),
            DiagonalValue::Stored { .. } => u64::MAX,
        };
        (self.offset, bits)
    }
}

impl MatrixRows for Diagonals {
    type Stretch<'a> = &'a [DiagonalEntry];

    #[inline(always)]
    fn stretches<'a>(
        &'a self,
        rows: Range<usize>,
        mut visit: impl FnMut(Range<usize>, &'a [DiagonalEntry]),
    ) {
        let first = self.runs.partition_point(|run| run.rows.end <= rows.start);
        for run in &self.runs[first..] {
            let start = run.rows.start.max(rows.start);
            if start >= rows.end {
                break;
            }
            let entries = &self.entries[run.entries.clone()];
            visit(start..run.rows.end.min(rows.end), entries);
        }
    }

    #[inline(always)]
    fn product<V: SimdView>(
        &self,
        entries: &[DiagonalEntry],
        view: V,
        row: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        let Some((first, others)) = entries.split_first() else {
            return view.constant(0.0);
        };
        let mut sum = self.term(*first, view, row, x);
        for entry in others {
            sum = sum + self.term(*entry, view, row, x);
        }
        sum
    }
}

impl Diagonals {
    /// v_d(i) x_{i+d} for i = `row`.
    #[inline(always)]
    fn term<V: SimdView>(
        &self,
        entry: DiagonalEntry,
        view: V,
        row: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        let x = x.load(view, row.wrapping_add_signed(entry.offset));
        match entry.source {
            DiagonalValue::Constant(value) => x.scaled(value),
            DiagonalValue::Stored { shift } => {
                x * view.shared(&self.values, row.wrapping_add_signed(shift))
            }
        }
    }
}
