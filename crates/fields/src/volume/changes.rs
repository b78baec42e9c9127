//! The changes of affine flows, kept by part and length.

use super::flow::PieceFlow;
use super::rows::PolynomialRows;
use liouville_base::composition::Flow;

/// The changes of affine flows, by part and length.
#[derive(Clone, Debug, Default)]
pub(super) struct Changes(Vec<(usize, u64, PolynomialRows)>);

/// The most changes remembered, unless one step has more.
const MOST_REMEMBERED: usize = 256;

impl Changes {
    /// Makes those of these flows; the first is longer by `before`.
    pub(super) fn prepare(
        &mut self,
        piece_flows: &[PieceFlow],
        flows: &[Flow],
        before: f64,
        h: f64,
    ) {
        if self.0.len() > MOST_REMEMBERED {
            self.0.clear();
        }
        let mut before = before;
        for flow in flows {
            let length = before + flow.weight * h;
            before = 0.0;
            if let PieceFlow::Affine(affine) = &piece_flows[flow.part]
                && self.position(flow.part, length).is_none()
            {
                let change = affine.change(length);
                self.0.push((flow.part, length.to_bits(), change));
            }
        }
    }

    fn position(&self, part: usize, h: f64) -> Option<usize> {
        let is_it =
            |(of, bits, _): &(usize, u64, PolynomialRows)| *of == part && *bits == h.to_bits();
        self.0.iter().position(is_it)
    }

    /// The change of a flow.
    ///
    /// # Panics
    /// When it was not made.
    pub(super) fn find(&self, part: usize, h: f64) -> &PolynomialRows {
        match self.position(part, h) {
            Some(position) => &self.0[position].2,
            None => unreachable!("affine flows are made before they are used"),
        }
    }
}
