//! The records of an ensemble, put together from those of its runs.

use crate::error::StepError;
use crate::run::reserve;
use std::mem;

/// How the records of the runs are laid out, and with it the order in which the runs advance.
#[derive(Clone, Debug, PartialEq)]
pub enum RecordLayout {
    /// Each member has records at these times: at each time a row of all members, one beside another, NaN after the
    /// end of a member's records. A run is carried to its end before the next begins.
    Aligned {
        /// The times.
        times: Vec<f64>,
        /// How many numbers a member has in a row.
        width: usize,
    },
    /// Each member has records at its own times, whose rows begin with the number of the member: all rows of the
    /// first, then of the second and so on, up to the time that all have reached. Runs take short turns, to stay
    /// within a few steps of one another.
    Ragged {
        /// How many numbers a row has.
        width: usize,
    },
}

/// Times and rows.
type TimesAndRows = (Vec<f64>, Vec<f64>);

/// Records of all members so far.
pub(super) struct MemberRecords {
    layout: RecordLayout,
    members: usize,
    t0: f64,
    /// Rows of all members, where they are aligned.
    table: Vec<f64>,
    /// Times and rows of each run by its first member, where they differ; and room to join them.
    ragged: Vec<(usize, TimesAndRows)>,
    joined: TimesAndRows,
    /// How many numbers they have in all.
    counts: (usize, usize),
}

impl MemberRecords {
    pub(super) fn new(layout: RecordLayout, members: usize, t0: f64) -> Self {
        Self {
            layout,
            members,
            t0,
            table: Vec::new(),
            ragged: Vec::new(),
            joined: TimesAndRows::default(),
            counts: (0, 0),
        }
    }

    /// The shape of a record.
    pub(super) fn shape(&self) -> Vec<usize> {
        match &self.layout {
            RecordLayout::Aligned { width, .. } => vec![self.members, *width],
            RecordLayout::Ragged { width } => vec![*width],
        }
    }

    /// Keeps the records of these members, or of the one at a place among so many in lock-step.
    ///
    /// # Errors
    /// There is no memory for them.
    pub(super) fn keep(
        &mut self,
        members: &[usize],
        (times, rows): TimesAndRows,
        one: Option<(usize, usize)>,
    ) -> Result<(), StepError> {
        let RecordLayout::Aligned { times: all, width } = &self.layout else {
            let records = match one {
                None => (times, rows),
                Some(_) => rows_of(members[0], &times, &rows)?,
            };
            self.counts.0 += records.0.len();
            self.counts.1 += records.1.len();
            reserve(&mut self.joined.0, self.counts.0)?;
            reserve(&mut self.joined.1, self.counts.1)?;
            self.ragged.push((members[0], records));
            return Ok(());
        };
        let total = self.members * width;
        if self.table.is_empty() {
            reserve(&mut self.table, all.len().saturating_mul(total))?;
            self.table.resize(all.len() * total, f64::NAN);
        }
        let (first, count) = one.unwrap_or((0, members.len()));
        let same = times.iter().zip(all);
        let same = same.take_while(|(a, b)| a.to_bits() == b.to_bits()).count();
        if *width == 0 {
            return Ok(());
        }
        let rows = rows.chunks_exact(count * width).take(same);
        for (to, row) in self.table.chunks_exact_mut(total).zip(rows) {
            for (member, values) in members
                .iter()
                .zip(row[first * width..].chunks_exact(*width))
            {
                to[member * width..(member + 1) * width].copy_from_slice(values);
            }
        }
        Ok(())
    }

    /// All records up to a time this far from the start; none are left.
    pub(super) fn take(&mut self, reached: f64) -> TimesAndRows {
        match &mut self.layout {
            RecordLayout::Aligned { times, width } => {
                let total = self.members * *width;
                let mut rows = mem::take(&mut self.table);
                let is_there = |row: &[f64]| row.iter().any(|value| !value.is_nan());
                let count = match total {
                    0 => times.len(),
                    _ => rows.chunks(total).rposition(is_there).map_or(0, |k| k + 1),
                };
                rows.truncate(count * total);
                let mut times = mem::take(times);
                times.truncate(count);
                (times, rows)
            }
            RecordLayout::Ragged { .. } => {
                self.ragged.sort_by_key(|(member, _)| *member);
                let room = mem::take(&mut self.joined);
                joined(mem::take(&mut self.ragged), room, reached, self.t0)
            }
        }
    }
}

/// The rows of one member, whose number comes first in each.
///
/// # Errors
/// There is no memory for them.
#[allow(clippy::float_cmp, clippy::cast_precision_loss)] // it is a small integer
fn rows_of(member: usize, times: &[f64], rows: &[f64]) -> Result<TimesAndRows, StepError> {
    let width = (rows.len() / times.len().max(1)).max(1);
    let both = times.iter().zip(rows.chunks_exact(width));
    let own = || both.clone().filter(|(_, row)| row[0] == member as f64);
    let count = own().count();
    let (mut own_times, mut own_rows) = (Vec::new(), Vec::new());
    reserve(&mut own_times, count)?;
    reserve(&mut own_rows, count * width)?;
    for (t, row) in own() {
        own_times.push(*t);
        own_rows.extend_from_slice(row);
    }
    Ok((own_times, own_rows))
}

/// Rows of one run after those of another, up to a time this far from the start, in room for them.
fn joined(
    records: Vec<(usize, TimesAndRows)>,
    room: TimesAndRows,
    reached: f64,
    t0: f64,
) -> TimesAndRows {
    let (mut all_times, mut all_rows) = room;
    for (_, (times, rows)) in records {
        let width = rows.len() / times.len().max(1);
        let count = times.partition_point(|t| (t - t0).abs() <= reached);
        all_times.extend_from_slice(&times[..count]);
        all_rows.extend_from_slice(&rows[..count * width]);
    }
    (all_times, all_rows)
}
