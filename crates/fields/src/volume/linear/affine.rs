//! The derivatives of affine flows: exp(h M), and by the entries of M
//!
//!     d exp(h M) = h ∫ exp((1 − s) h M) dM exp(s h M) ds,   0 ≤ s ≤ 1,
//!
//! by Gauss' rule on parts of the interval, exact to roundoff.

use super::{LinearFlow, LinearFlows, LinearMap};
use crate::volume::affine::exponential_less_one;
use liouville_base::linalg::Matrix;

/// Nodes and weights on (−1, 1), of which there are two each, of opposite signs.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_47),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];
/// The norm of h M up to which one part is enough.
const LARGEST: f64 = 1.0;
/// The most flows remembered.
const MOST_REMEMBERED: usize = 256;

/// Affine flows by piece and length.
#[derive(Clone, Debug, Default)]
pub(super) struct AffineFlows(Vec<((usize, u64), AffineFlow)>);

#[derive(Clone, Debug)]
struct AffineFlow {
    /// exp(h M) − 1
    change: Matrix,
    /// For each node its weight times h, exp((1 − s) h M) − 1 and exp(s h M) − 1.
    nodes: Vec<(f64, [Matrix; 2])>,
}

impl AffineFlow {
    fn new(generator: &Matrix, h: f64, has_coefficients: bool) -> Self {
        let change = exponential_less_one(generator, h);
        let n = generator.rows();
        let sum = |i: usize| (0..n).map(|j| (h * generator[(i, j)]).abs()).sum::<f64>();
        let norm = (0..n).map(sum).fold(0.0, f64::max);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a cast saturates
        let parts = ((norm / LARGEST).ceil() as usize).max(1);
        let mut nodes = Vec::new();
        for part in 0..if has_coefficients { parts } else { 0 } {
            for (x, weight) in GAUSS {
                for x in [x, -x] {
                    let s = (part as f64 + 0.5 + 0.5 * x) / parts as f64;
                    let ends = [1.0 - s, s].map(|s| exponential_less_one(generator, s * h));
                    nodes.push((0.5 * h * weight / parts as f64, ends));
                }
            }
        }
        Self { change, nodes }
    }
}

impl LinearFlows {
    /// (x; 1) ← exp(h M) (x; 1),   M = (A c; 0 0)
    pub(super) fn affine(
        &mut self,
        (matrix, vector): (&[f64], &[f64]),
        flow: LinearFlow,
        map: &mut LinearMap,
    ) {
        let (n, key) = (vector.len(), (flow.part, flow.h.to_bits()));
        let mut end = std::mem::take(&mut self.scratch.arguments);
        end.clear();
        let known = &mut self.scratch.affine.0;
        if known.len() > MOST_REMEMBERED {
            known.clear();
        }
        let position = known.iter().position(|(other, _)| *other == key);
        let position = position.unwrap_or_else(|| {
            let entry = |i: usize, j: usize| match (i, j) {
                (i, _) if i == n => 0.0,
                (i, j) if j == n => vector[i],
                (i, j) => matrix[i * n + j],
            };
            let generator = Matrix::from_fn(n + 1, n + 1, entry);
            known.push((
                key,
                AffineFlow::new(&generator, flow.h, self.has_coefficients),
            ));
            known.len() - 1
        });
        let made = &known[position].1;
        let x = &self.scratch.values;
        let moved = |change: &Matrix, i: usize| {
            let row = (0..n).map(|j| change[(i, j)] * x[j]);
            x[i] + row.sum::<f64>() + change[(i, n)]
        };
        let (first, results) = (self.first[flow.part], self.results);
        for i in 0..n {
            map.scale(results + i, 0.0);
            for j in 0..n {
                let one = f64::from(u8::from(i == j));
                map.add(results + i, j, one + made.change[(i, j)]);
            }
        }
        for (weight, [after, before]) in &made.nodes {
            for a in 0..n {
                let of_row = results + n + a;
                map.scale(of_row, 0.0);
                for b in 0..n {
                    map.add(of_row, first + a * n + b, moved(before, b));
                }
                map.add(of_row, first + n * n + a, 1.0);
            }
            for i in 0..n {
                for a in 0..n {
                    let one = f64::from(u8::from(i == a));
                    map.add(results + i, results + n + a, weight * (one + after[(i, a)]));
                }
            }
        }
        end.extend((0..n).map(|i| moved(&made.change, i)));
        if self.has_coefficients {
            for i in 0..n {
                let row = matrix[i * n..(i + 1) * n].iter().zip(&end);
                let rate = row.map(|(a, x)| a * x).sum::<f64>() + vector[i];
                self.by_length(results + i, flow.weight * rate, map);
            }
        }
        for i in 0..n {
            map.scale(i, 0.0);
            map.add(i, results + i, 1.0);
        }
        self.scratch.values[..n].copy_from_slice(&end);
        self.scratch.arguments = end;
    }
}
