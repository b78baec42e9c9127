//! Spins 1/2 with H = Σ J/2 (S⁺_i S⁻_j + S⁻_i S⁺_j) + Δ S^z_i S^z_j + Σ h_i S^z_i, without a matrix.
//!
//! A state is a number whose bit i is 1 where spin i is down. The full space has all 2^L of them, a sector of fixed
//! magnetisation those with so many spins down, in ascending order.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

mod full;
mod sector;

use super::row_product::{RowBlock, Update, update_rows};
pub use full::Bond;
use full::{Flip, Full};
use liouville_base::simd::{InstructionSet, Stored};
use sector::Sector;

/// Spins on at most 32 sites.
#[derive(Clone, Debug)]
pub struct Spins(Space);

#[derive(Clone, Debug)]
enum Space {
    Full(Full),
    Sector(Sector),
}

impl Spins {
    /// Spins with a field for each, all states or those with so many spins up.
    ///
    /// # Panics
    /// When there are more than 32 spins or less than are up, or a bond is not between two of them.
    pub fn new(bonds: &[Bond], fields: &[f64], up: Option<u32>) -> Self {
        let length = u32::try_from(fields.len()).unwrap_or(u32::MAX);
        assert!(length <= 32, "number of spins");
        let is_inside = |(i, j): (u32, u32)| i != j && i < length && j < length;
        assert!(bonds.iter().all(|bond| is_inside(bond.sites)), "a bond");
        let flips = bonds.iter().map(Flip::new).filter(|flip| flip.half != 0.0);
        let flips: Vec<Flip> = flips.collect();
        let energy = |state: usize| energy(bonds, fields, state);
        Self(match up {
            None => {
                let diagonal = (0..1 << length).map(energy).collect();
                Space::Full(Full::new(length, &flips, diagonal))
            }
            Some(up) => {
                assert!(up <= length, "spins that are up");
                Space::Sector(Sector::new(length, length - up, &flips, energy))
            }
        })
    }

    fn diagonal(&self) -> &[f64] {
        match &self.0 {
            Space::Full(full) => &full.diagonal,
            Space::Sector(sector) => &sector.diagonal,
        }
    }

    /// Number of states.
    pub fn size(&self) -> usize {
        self.diagonal().len()
    }

    /// Bytes of all rows.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.diagonal())
    }

    /// Updates a block of rows.
    pub(super) fn act<S: Stored>(
        &self,
        machine: InstructionSet,
        update: Update,
        block: RowBlock<'_, S>,
    ) {
        match &self.0 {
            Space::Full(full) => update_rows(full, machine, update, block),
            Space::Sector(sector) => update_rows(sector, machine, update, block),
        }
    }
}

/// The energy of a state without flips.
fn energy(bonds: &[Bond], fields: &[f64], state: usize) -> f64 {
    let spin = |site: usize| if state >> site & 1 == 1 { -0.5 } else { 0.5 };
    let bonds = bonds.iter().map(|bond| {
        let (i, j) = bond.sites;
        bond.z * spin(i as usize) * spin(j as usize)
    });
    let fields = fields.iter().enumerate().map(|(i, field)| field * spin(i));
    bonds.sum::<f64>() + fields.sum::<f64>()
}
