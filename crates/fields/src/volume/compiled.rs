//! A split, compiled.

use super::flow::PieceFlow;
use super::functions::Functions;
use super::layout::SplitLayout;
use super::order::Order;
use crate::problem::Split;

/// A compiled split, shared by all its steppers.
#[derive(Debug)]
pub(super) struct CompiledSplit {
    pub(super) order: Order,
    pub(super) piece_flows: Vec<PieceFlow>,
    pub(super) functions: Functions,
    /// The most stages of a piece.
    pub(super) stages: usize,
    pub(super) has_affine: bool,
    pub(super) has_planes: bool,
}

impl CompiledSplit {
    /// Compiles a split; rows are joined to runs for states of one trajectory.
    pub(super) fn new(split: &Split, in_runs: bool) -> Self {
        let order = Order::new(split);
        let mut functions = Functions::default();
        let pieces = split.pieces().iter().enumerate();
        let pieces = pieces.map(|(number, piece)| {
            let layout = SplitLayout {
                split,
                order: &order,
                functions: &functions.place(piece, split.n(), &order),
                number,
                in_runs,
            };
            PieceFlow::new(&layout, piece)
        });
        let piece_flows: Vec<PieceFlow> = pieces.collect();
        functions.link(split.n());
        let stages = piece_flows.iter().map(|flow| match flow {
            PieceFlow::Triangular(piece) if !piece.is_euler() => piece.stages,
            _ => 0,
        });
        Self {
            functions,
            stages: stages.max().unwrap_or(0),
            has_affine: piece_flows
                .iter()
                .any(|flow| matches!(flow, PieceFlow::Affine(_))),
            has_planes: piece_flows
                .iter()
                .any(|flow| matches!(flow, PieceFlow::Plane(_))),
            order,
            piece_flows,
        }
    }
}
