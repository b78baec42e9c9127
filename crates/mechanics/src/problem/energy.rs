//! Records in which the energy of a conservative system cannot be right.

/// The part of the kinetic energy that an error of the energy may be without a word.
const PART: f64 = 0.1;

/// Places in a row of records: of the energy, and of the n velocities and momenta.
#[derive(Clone, Copy, Debug)]
pub struct EnergyColumns {
    /// Number of coordinates.
    pub n: usize,
    /// The energy.
    pub energy: usize,
    /// The first velocity.
    pub v: usize,
    /// The first momentum.
    pub p: usize,
}

/// The first record, and in it the first member, whose energy has changed by more than its own size since the first.
///
/// The size of an energy that is E first is |E| and the mean so far of the kinetic energy vᵀp / 2, but not below a
/// tenth of the present one. With `rises` only a gain counts. A record has a row of this width for each member.
///
/// # Panics
/// When a column is beyond the width.
pub fn energy_change(
    rows: &[f64],
    (members, width): (usize, usize),
    at: EnergyColumns,
    rises: bool,
) -> Option<(usize, usize)> {
    let mut sums = vec![0.0; members];
    let first = rows.get(..members * width)?;
    for (k, record) in rows.chunks_exact(members * width).enumerate() {
        let pairs = record.chunks_exact(width).zip(first.chunks_exact(width));
        for (member, ((row, first), sum)) in pairs.zip(&mut sums).enumerate() {
            let (v, p) = (&row[at.v..at.v + at.n], &row[at.p..at.p + at.n]);
            let kinetic = v.iter().zip(p).map(|(v, p)| v * p).sum::<f64>().abs() / 2.0;
            *sum += kinetic;
            let change = row[at.energy] - first[at.energy];
            let change = if rises { change } else { change.abs() };
            let size = first[at.energy].abs() + *sum / (k + 1) as f64;
            if change > size.max(PART * kinetic) {
                return Some((k, member));
            }
        }
    }
    None
}
