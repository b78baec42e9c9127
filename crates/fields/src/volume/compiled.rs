//! A split, compiled.

use super::flow::{PieceFlow, SplitLayout};
use super::order::Order;
use crate::problem::{Piece, Split};

/// A compiled split, shared by all its steppers.
#[derive(Debug)]
pub(super) struct CompiledSplit {
    pub(super) order: Order,
    pub(super) piece_flows: Vec<PieceFlow>,
    /// The most cosine factors of a piece.
    pub(super) waves: usize,
    /// The most stages of a piece.
    pub(super) stages: usize,
    pub(super) has_affine: bool,
}

impl CompiledSplit {
    /// Compiles a split; rows are joined to runs for states of one trajectory.
    pub(super) fn new(split: &Split, in_runs: bool) -> Self {
        let order = Order::new(split);
        let layout = SplitLayout {
            split,
            order: &order,
            in_runs,
        };
        let pieces = split.pieces().iter();
        let piece_flows: Vec<PieceFlow> = pieces.map(|piece| layout.flow(piece)).collect();
        let waves = split.pieces().iter().map(|piece| match piece {
            Piece::Natural { waves, .. } | Piece::Shear { waves, .. } => waves.len(),
            _ => 0,
        });
        let stages = piece_flows.iter().map(|flow| match flow {
            PieceFlow::Triangular(piece) if !piece.is_euler() => piece.stages,
            _ => 0,
        });
        Self {
            waves: waves.max().unwrap_or(0),
            stages: stages.max().unwrap_or(0),
            has_affine: piece_flows
                .iter()
                .any(|flow| matches!(flow, PieceFlow::Affine(_))),
            order,
            piece_flows,
        }
    }
}
