//! The one Lagrange interpolation.

use crate::linalg::Matrix;

/// Values of the Lagrange basis on those `nodes` that are `knots` at each of `targets`, one row a target;
/// the columns of other nodes stay as they are.
pub fn lagrange(
    nodes: &[f64],
    knots: &[usize],
    targets: impl Iterator<Item = f64>,
    weights: &mut Matrix,
) {
    for (i, x) in targets.enumerate() {
        for k in knots {
            let others = knots.iter().filter(|l| *l != k);
            weights[(i, *k)] = others
                .map(|l| (x - nodes[*l]) / (nodes[*k] - nodes[*l]))
                .product();
        }
    }
}
