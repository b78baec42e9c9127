//! The order of variables in memory: those changed by the same pieces are neighbours.

use crate::problem::{Piece, Split};
use std::collections::HashMap;

/// The place of each variable, and the variable at each place.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Order {
    place_of: Vec<u32>,
    variable_at: Vec<u32>,
}

/// With more classes than this, pieces are scattered in any order.
const MOST_CLASSES: usize = 64;

impl Order {
    /// The order for a split: variables changed by the same pieces in a row, otherwise as they are.
    #[allow(clippy::cast_possible_truncation)] // a split has fewer than 2^31 variables
    pub(super) fn new(split: &Split) -> Self {
        let n = split.n();
        let mut class = vec![0_u32; n];
        let mut classes = 1_u32;
        for piece in split.pieces() {
            let (Piece::Natural { rows, .. } | Piece::Scaling { rows, .. }) = piece else {
                continue;
            };
            let mut renamed = HashMap::new();
            for &row in rows {
                class[row] = *renamed.entry(class[row]).or_insert_with(|| {
                    classes += 1;
                    classes - 1
                });
            }
        }
        // classes by their first variable, without those that were split up
        let mut rank: HashMap<u32, usize> = HashMap::new();
        for class in &class {
            let next = rank.len();
            rank.entry(*class).or_insert(next);
        }
        let mut variable_at: Vec<u32> = (0..n as u32).collect();
        if rank.len() <= MOST_CLASSES {
            variable_at.sort_by_key(|variable| rank[&class[*variable as usize]]);
        }
        let mut place_of = vec![0; n];
        for (place, &variable) in variable_at.iter().enumerate() {
            place_of[variable as usize] = place as u32;
        }
        Self {
            place_of,
            variable_at,
        }
    }

    /// The place of a variable.
    #[inline]
    pub(super) fn place_of(&self, variable: usize) -> usize {
        self.place_of[variable] as usize
    }

    /// The variable at a place.
    #[inline]
    pub(super) fn variable_at(&self, place: usize) -> usize {
        self.variable_at[place] as usize
    }
}
