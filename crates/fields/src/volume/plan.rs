//! A split, compiled.

use super::motion::{Layout, Motion};
use super::order::Order;
use crate::problem::{Piece, Split};

/// What all steppers of a split share.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) order: Order,
    pub(super) motions: Vec<Motion>,
    /// How many waves a piece has at most.
    pub(super) waves: usize,
    /// How many stages to remember.
    pub(super) stages: usize,
    pub(super) has_affine: bool,
}

impl Plan {
    /// Compiles a split; rows are joined to runs where what is stored is one trajectory.
    pub(super) fn new(split: &Split, in_runs: bool) -> Self {
        let order = Order::new(split);
        let layout = Layout {
            split,
            order: &order,
            in_runs,
        };
        let pieces = split.pieces().iter();
        let motions: Vec<Motion> = pieces.map(|piece| layout.motion(piece)).collect();
        let waves = split.pieces().iter().map(|piece| match piece {
            Piece::Natural { waves, .. } | Piece::Shear { waves, .. } => waves.len(),
            _ => 0,
        });
        let stages = motions.iter().map(|motion| match motion {
            Motion::Triangular(piece) if !piece.is_euler() => piece.stages,
            _ => 0,
        });
        Self {
            waves: waves.max().unwrap_or(0),
            stages: stages.max().unwrap_or(0),
            has_affine: motions
                .iter()
                .any(|motion| matches!(motion, Motion::Affine(_))),
            order,
            motions,
        }
    }
}
