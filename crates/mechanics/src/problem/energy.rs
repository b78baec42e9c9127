//! Records in which the energy of a conservative system changes as only steps that are too large change it.

/// The part of the kinetic energy that an error of the energy may be without a word.
const PART: f64 = 0.1;
/// The part of the energy's size that is a jump, if it is so many times the median change.
const JUMP: f64 = 1e-3;
const CONSPICUOUS: f64 = 1e3;

/// Places in a row of records.
#[derive(Clone, Copy, Debug)]
pub struct EnergyColumns {
    /// The energy.
    pub energy: usize,
    /// The kinetic energy vᵀp / 2.
    pub kinetic: KineticColumns,
}

/// Places of what makes the kinetic energy.
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
pub struct EnergyChange {
    /// The record where it has changed, or the one before a jump.
    pub record: usize,
    /// The member.
    pub member: usize,
    /// The energy at the start.
    pub first: f64,
    /// Of a jump, its part of the energy's size.
    pub jump: Option<f64>,
}

/// The first record whose energy has changed by more than its own size, else the first member with a jump.
///
/// The size of an energy that is E at the start is |E| and the mean so far of the kinetic energy, but not below a
/// tenth of the present one. A jump parts all energies before from all after it, see [`largest_jump`]. With `rises`
/// only a gain counts, as of methods that damp. A record has a row of this width for each member; without energies at
/// the start, one for each member, those of the first record count.
///
/// # Panics
/// When a column is beyond the width, or there is not a start for each member.
pub fn energy_change(
    rows: &[f64],
    (members, width): (usize, usize),
    at: EnergyColumns,
    start: Option<&[f64]>,
    rises: bool,
) -> Option<EnergyChange> {
    let records = rows.chunks_exact(members * width);
    let count = records.len();
    if count < 2 {
        return None;
    }
    let first_of = |member: usize| match start {
        Some(start) => start[member],
        None => rows[member * width + at.energy],
    };
    let mut sums = vec![0.0; members];
    for (record, row) in records.enumerate() {
        for (member, (row, sum)) in row.chunks_exact(width).zip(&mut sums).enumerate() {
            let (kinetic, first) = (at.kinetic.of(row), first_of(member));
            *sum += kinetic;
            let change = row[at.energy] - first;
            let change = if rises { change } else { change.abs() };
            let size = first.abs() + *sum / (record + 1) as f64;
            if change > size.max(PART * kinetic) {
                let jump = None;
                return Some(EnergyChange {
                    record,
                    member,
                    first,
                    jump,
                });
            }
        }
    }
    (0..members).find_map(|member| {
        let of_member = rows.iter().skip(member * width + at.energy);
        let energies: Vec<f64> = of_member.step_by(members * width).copied().collect();
        let first = first_of(member);
        let size = first.abs().max(sums[member] / count as f64);
        let (record, jump) = largest_jump(&energies, rises)?;
        (jump > JUMP * size).then_some(EnergyChange {
            record,
            member,
            first,
            jump: Some(jump / size),
        })
    })
}

/// By how much all energies up to a record are at least off those after it, where that is most; `None` unless it is a
/// thousand times the median change, as a change that the others are like is no jump.
///
/// An error that comes and goes, as that of a symplectic method, parts no energies. Energies that are not all finite
/// have no jump.
fn largest_jump(energies: &[f64], rises: bool) -> Option<(usize, f64)> {
    if !energies.iter().all(|energy| energy.is_finite()) {
        return None;
    }
    let widen = |(low, high): (f64, f64), x: &f64| (x.min(low), x.max(high));
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    let mut after: Vec<(f64, f64)> = energies
        .iter()
        .rev()
        .scan(none, |range, energy| {
            *range = widen(*range, energy);
            Some(*range)
        })
        .collect();
    after.reverse();
    let (mut before, mut most) = (none, (0, f64::NEG_INFINITY));
    for (record, (energy, (lowest, highest))) in energies.iter().zip(&after[1..]).enumerate() {
        before = widen(before, energy);
        let fall = if rises {
            f64::NEG_INFINITY
        } else {
            before.0 - highest
        };
        let gap = fall.max(lowest - before.1);
        if gap > most.1 {
            most = (record, gap);
        }
    }
    let mut changes: Vec<f64> = energies
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .collect();
    let middle = changes.len() / 2;
    let (_, median, _) = changes.select_nth_unstable_by(middle, f64::total_cmp);
    (most.1 > CONSPICUOUS * *median).then_some(most)
}
