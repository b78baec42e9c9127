//! Records in which an energy that is kept, or can only fall, changes as only steps that are too large change it.

use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use std::collections::VecDeque;

/// The part of the kinetic energy that an error of the energy may be without a word.
const PART: f64 = 0.1;
/// The part of the energy's size that is a jump, if it is so many times the median change.
const JUMP: f64 = 1e-3;
const CONSPICUOUS: f64 = 1e3;
/// The part of the energy's size by which one that can only fall may rise without a word.
const RISE: f64 = 0.2;
/// Gaps that are kept of one sign.
const MOST_GAPS: usize = 1 << 12;
/// A change is counted by its exponent and so many bits more: its median is known to an eighth.
const BITS: u32 = 2;

/// Places in a row of records.
#[derive(Clone, Copy, Debug)]
pub struct EnergyColumns {
    /// The energy.
    pub energy: usize,
    /// The kinetic energy vᵀp / 2.
    pub kinetic: KineticColumns,
}

/// Columns from which the kinetic energy is computed.
#[derive(Clone, Copy, Debug)]
pub enum KineticColumns {
    /// It has a column.
    Recorded(usize),
    /// Of `n` velocities and momenta, the first of them.
    Product {
        /// The first velocity.
        v: usize,
        /// The first momentum.
        p: usize,
        /// Number of coordinates.
        n: usize,
    },
}

impl KineticColumns {
    fn of(self, row: &[f64]) -> f64 {
        match self {
            Self::Recorded(at) => row[at].abs(),
            Self::Product { v, p, n } => {
                let pairs = row[v..v + n].iter().zip(&row[p..p + n]);
                pairs.map(|(v, p)| v * p).sum::<f64>().abs() / 2.0
            }
        }
    }
}

/// A change of the energy that errors of good steps do not make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EnergyChange {
    /// By more than its own size.
    Large {
        /// Number and time of the record that shows it.
        record: usize,
        /// Its time.
        t: f64,
        /// The energy at the start, and there.
        energies: [f64; 2],
    },
    /// All energies before are off all those after.
    Jump {
        /// The times of the records around it.
        between: [f64; 2],
        /// By how much at least, as a part of the energy's size.
        part: f64,
    },
    /// From the lowest so far, of an energy that can only fall.
    Rise {
        /// The times of the lowest and of the highest after it.
        between: [f64; 2],
        /// The energies there.
        energies: [f64; 2],
    },
}

/// Follows the energy of one motion, record by record, in memory that does not grow with their number.
///
/// The size of an energy that is E at the start is |E| and the mean so far of the kinetic energy, but not below a
/// tenth of the present one. A change by more than that is a large one. A jump parts all energies before from all
/// after it by a thousandth of the size, and by a thousand times the median change, as a change that the others are
/// like is no jump. An error that comes and goes, as that of a symplectic method, parts no energies. An energy that
/// can only fall rises where it is above the lowest before by a fifth of the size, in however many records. Changes
/// that roundings make are none of these.
#[derive(Clone, Debug)]
pub struct EnergyWatch {
    at: EnergyColumns,
    /// Whether the energy can only fall, as of methods that damp or of friction: only a gain counts.
    falls: bool,
    start: Option<f64>,
    /// What roundings of the states change the energy by: no change up to this counts.
    roundoff: f64,
    records: usize,
    kinetic: f64,
    large: Option<(usize, (f64, f64))>,
    /// Time and energy of the last record, of the lowest energy, and the lowest and highest of the largest rise.
    last: (f64, f64),
    lowest: (f64, f64),
    rise: [(f64, f64); 2],
    /// The highest energy, and the highest of −E.
    highest: [f64; 2],
    gaps: [Vec<Gap>; 2],
    changes: Changes,
    is_finite: bool,
    /// Changes by resets that no record has shown yet, with their times; and the sum of the others.
    resets: VecDeque<(f64, f64)>,
    by_resets: f64,
}

/// Energies that all records before stay below, and all those after above, with the times of the records around.
#[derive(Clone, Copy, Debug, Default)]
struct Gap {
    below: f64,
    above: f64,
    from: f64,
    to: f64,
}

/// How many changes of the energy are of which size.
#[derive(Clone, Debug, Default)]
struct Changes {
    zeros: usize,
    first: usize,
    counts: VecDeque<usize>,
}

impl EnergyWatch {
    /// A watch over a motion with this energy at the start; without it, that of the first record counts. Changes up to
    /// `roundoff` do not.
    pub fn new(at: EnergyColumns, start: Option<f64>, roundoff: f64, falls: bool) -> Self {
        Self {
            at,
            falls,
            start,
            roundoff,
            records: 0,
            kinetic: 0.0,
            large: None,
            last: (0.0, 0.0),
            lowest: (0.0, f64::INFINITY),
            rise: [(0.0, 0.0); 2],
            highest: [f64::NEG_INFINITY; 2],
            gaps: [Vec::new(), Vec::new()],
            changes: Changes::default(),
            is_finite: true,
            resets: VecDeque::new(),
            by_resets: 0.0,
        }
    }

    /// The same watch over another motion, which has this energy at the start.
    #[must_use]
    pub fn of_another(&self, start: Option<f64>) -> Self {
        Self::new(self.at, start, self.roundoff, self.falls)
    }

    /// Excludes the change by a reset at a time; to be called in their order and before the records after
    /// them.
    pub fn reset(&mut self, t: f64, change: f64) {
        self.resets.push_back((t, change));
    }

    /// Looks at the next record.
    ///
    /// # Panics
    /// When a column is beyond the row.
    pub fn add(&mut self, t: f64, row: &[f64]) {
        while self.resets.front().is_some_and(|(reset, _)| *reset <= t) {
            self.by_resets += self.resets.pop_front().map_or(0.0, |(_, change)| change);
        }
        let (energy, kinetic) = (
            row[self.at.energy] - self.by_resets,
            self.at.kinetic.of(row),
        );
        let first = *self.start.get_or_insert(energy);
        self.records += 1;
        self.kinetic += kinetic;
        let change = energy - first;
        let change = if self.falls { change } else { change.abs() };
        if self.large.is_none() && change > self.size(first).max(PART * kinetic).max(self.roundoff)
        {
            self.large = Some((self.records - 1, (t, energy)));
        }
        self.is_finite &= energy.is_finite();
        if !self.is_finite {
            return;
        }
        self.follow_rise(t, energy, kinetic);
        if self.records > 1 {
            self.changes.count((energy - self.last.1).abs());
        }
        for (sign, (highest, gaps)) in [1.0, -1.0]
            .into_iter()
            .zip(self.highest.iter_mut().zip(&mut self.gaps))
            .take(if self.falls { 1 } else { 2 })
        {
            part(gaps, *highest, sign * energy, [self.last.0, t]);
            *highest = highest.max(sign * energy);
        }
        self.last = (t, energy);
    }

    fn follow_rise(&mut self, t: f64, energy: f64, kinetic: f64) {
        if energy < self.lowest.1 {
            self.lowest = (t, energy);
        }
        let rise = energy - self.lowest.1;
        let [low, high] = self.rise;
        if rise > high.1 - low.1 && rise > PART * kinetic {
            self.rise = [self.lowest, (t, energy)];
        }
    }

    fn size(&self, first: f64) -> f64 {
        first.abs() + self.kinetic / self.records as f64
    }

    /// The change to report of the records so far; a single record has none.
    pub fn found(&self) -> Option<EnergyChange> {
        let first = self.start.filter(|_| self.records > 1)?;
        if let Some((record, (t, energy))) = self.large {
            let energies = [first, energy];
            return Some(EnergyChange::Large {
                record,
                t,
                energies,
            });
        }
        let size = first.abs().max(self.kinetic / self.records as f64);
        let gaps = self.gaps.iter().filter_map(|gaps| gaps.last());
        let widest = gaps.max_by(|a, b| a.width().total_cmp(&b.width()))?;
        let (width, between) = (widest.width(), [widest.from, widest.to]);
        let least = (JUMP * size).max(CONSPICUOUS * self.changes.median());
        let is_jump = self.is_finite && width > least.max(self.roundoff);
        if is_jump {
            return Some(EnergyChange::Jump {
                between,
                part: width / size,
            });
        }
        let [low, high] = self.rise;
        let least = (RISE * self.size(first)).max(self.roundoff);
        let rises = self.falls && high.1 - low.1 > least;
        (rises && self.is_finite).then_some(EnergyChange::Rise {
            between: [low.0, high.0],
            energies: [low.1, high.1],
        })
    }
}

impl Gap {
    fn width(&self) -> f64 {
        self.above - self.below
    }
}

/// Brings gaps up to date with an energy that follows others of which none is higher than `highest`.
///
/// Later gaps lie higher and go first when the energy falls. So one that is narrower than one before it is never the
/// widest, and is not kept: the last is the widest.
fn part(gaps: &mut Vec<Gap>, highest: f64, energy: f64, [from, to]: [f64; 2]) {
    while gaps.last().is_some_and(|gap| energy <= gap.below) {
        gaps.pop();
    }
    if let Some(gap) = gaps.last_mut() {
        gap.above = gap.above.min(energy);
    }
    if let [.., before, last] = gaps.as_slice()
        && last.width() <= before.width()
    {
        gaps.pop();
    }
    let new = Gap {
        below: highest,
        above: energy,
        from,
        to,
    };
    let is_first = highest == f64::NEG_INFINITY;
    let widest = gaps.last().map_or(0.0, Gap::width);
    if !is_first && new.width() > widest {
        if gaps.len() == MOST_GAPS {
            gaps.drain(..MOST_GAPS / 2); // the narrower ones
        }
        gaps.push(new);
    }
}

impl Changes {
    fn count(&mut self, change: f64) {
        if change == 0.0 {
            self.zeros += 1;
            return;
        }
        let place = (change.to_bits() >> (f64::MANTISSA_DIGITS - 1 - BITS)) as usize;
        if self.counts.is_empty() {
            self.first = place;
        }
        while place < self.first {
            self.counts.push_front(0);
            self.first -= 1;
        }
        let place = place - self.first;
        if place >= self.counts.len() {
            self.counts.resize(place + 1, 0);
        }
        self.counts[place] += 1;
    }

    /// The median, as the middle of the range in which it is counted.
    fn median(&self) -> f64 {
        let all = self.zeros + self.counts.iter().sum::<usize>();
        let mut before = self.zeros;
        if all / 2 < before {
            return 0.0;
        }
        for (place, count) in self.counts.iter().enumerate() {
            before += count;
            if all / 2 < before {
                let half = 1 << (f64::MANTISSA_DIGITS - 2 - BITS);
                let bits = (self.first + place) as u64;
                return f64::from_bits((bits << (f64::MANTISSA_DIGITS - 1 - BITS)) + half);
            }
        }
        0.0
    }
}

liouville_base::checkpoint!(Gap {
    below,
    above,
    from,
    to
});

impl Checkpoint for EnergyWatch {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.start, self.records).save(member, out);
        (self.kinetic, self.large).save(member, out);
        (self.last, self.highest).save(member, out);
        (self.lowest, self.rise).save(member, out);
        self.is_finite.save(member, out);
        for gaps in &self.gaps {
            gaps.len().save(member, out);
            gaps.save(member, out);
        }
        let Changes {
            zeros,
            first,
            counts,
        } = &self.changes;
        (*zeros, (*first, counts.len())).save(member, out);
        for count in counts {
            count.save(member, out);
        }
        (self.by_resets, self.resets.len()).save(member, out);
        for reset in &self.resets {
            reset.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.start.restore(member, saved)?;
        self.records.restore(member, saved)?;
        self.kinetic.restore(member, saved)?;
        self.large.restore(member, saved)?;
        self.last.restore(member, saved)?;
        self.highest.restore(member, saved)?;
        self.lowest.restore(member, saved)?;
        self.rise.restore(member, saved)?;
        self.is_finite.restore(member, saved)?;
        for gaps in &mut self.gaps {
            *gaps = restored(member, saved)?;
        }
        self.changes.zeros.restore(member, saved)?;
        self.changes.first.restore(member, saved)?;
        self.changes.counts = restored::<usize>(member, saved)?.into();
        self.by_resets.restore(member, saved)?;
        self.resets = restored::<(f64, f64)>(member, saved)?.into();
        Ok(())
    }
}

/// As many as were saved behind their number.
fn restored<M: Checkpoint + Default>(
    member: usize,
    saved: &mut &[f64],
) -> Result<Vec<M>, CheckpointMismatch> {
    let mut count = 0_usize;
    count.restore(member, saved)?;
    if count > saved.len() {
        return Err(CheckpointMismatch);
    }
    let mut found = Vec::new();
    for _ in 0..count {
        let mut one = M::default();
        one.restore(member, saved)?;
        found.push(one);
    }
    Ok(found)
}
