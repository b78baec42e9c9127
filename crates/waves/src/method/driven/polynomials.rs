//! Polynomials of time on a window by their values at Chebyshev's nodes.

use liouville_base::linalg::add_scaled;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// The highest degree in time.
pub(super) const DEGREE: usize = 14;

/// Nodes of the interpolation.
pub(super) const NODES: usize = DEGREE + 7;

/// Coefficients of polynomials by values at nodes: first those of Chebyshev's polynomials, by each of which the powers
/// have theirs. The two are not multiplied out, as what roundings add to high degrees has no part in smooth functions.
#[derive(Clone, Debug, Default)]
pub(in crate::method) struct NodeMap {
    /// A weight for each node, by polynomial.
    pub(in crate::method) series: Vec<f64>,
    /// A weight for each polynomial, by power.
    pub(in crate::method) powers: Vec<f64>,
}

impl NodeMap {
    /// A constant, by its value at one node.
    pub(in crate::method) fn constant() -> Self {
        Self {
            series: vec![1.0],
            powers: vec![1.0],
        }
    }

    /// Coefficients of powers, from rows of values at the nodes.
    pub(in crate::method) fn apply(&self, values: &[f64], width: usize, degree: usize) -> Vec<f64> {
        let nodes = self.series.len() / (degree + 1);
        let middle = combined(&self.series, nodes, values, width);
        combined(&self.powers, degree + 1, &middle, width)
    }

    /// The transpose of this: cotangents of the values from those of the coefficients.
    pub(in crate::method) fn transposed(
        &self,
        values: &[f64],
        width: usize,
        degree: usize,
    ) -> Vec<f64> {
        let nodes = self.series.len() / (degree + 1);
        let middle = combined_transposed(&self.powers, degree + 1, values, width);
        combined_transposed(&self.series, nodes, &middle, width)
    }
}

/// Changes of H at the nodes of a piece, or cotangents of H there: those at one node after those at another, and nothing
/// where there are none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtNodes {
    /// Changes or cotangents of the weights of all groups.
    pub weights: Vec<f64>,
    /// Changes or cotangents of the potential, at all rows of H.
    pub potential: Vec<f64>,
}

/// Which cotangents of H are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Whether cotangents of the weights are wanted.
    pub weights: bool,
    /// Whether cotangents of the potential are wanted.
    pub potential: bool,
}

/// The product of a matrix of so many columns with rows of a width.
fn combined(matrix: &[f64], columns: usize, rows: &[f64], width: usize) -> Vec<f64> {
    let mut found = vec![0.0; matrix.len() / columns * width];
    for (weights, out) in matrix.chunks(columns).zip(found.chunks_mut(width)) {
        for (weight, row) in weights.iter().zip(rows.chunks(width)) {
            add_scaled(out, *weight, row);
        }
    }
    found
}

/// The product of its transpose.
fn combined_transposed(matrix: &[f64], columns: usize, rows: &[f64], width: usize) -> Vec<f64> {
    let mut found = vec![0.0; columns * width];
    for (weights, row) in matrix.chunks(columns).zip(rows.chunks(width)) {
        for (weight, out) in weights.iter().zip(found.chunks_mut(width)) {
            add_scaled(out, *weight, row);
        }
    }
    found
}

/// A Chebyshev node of so many, as part of an interval.
pub(in crate::method) fn chebyshev_node(node: usize, count: usize) -> f64 {
    0.5 * (1.0 + angle(node, count).cos())
}

/// The weight of the value at a node of so many in the coefficient of Chebyshev's polynomial `T_j`.
pub(in crate::method) fn chebyshev_weight(j: usize, node: usize, count: usize) -> f64 {
    let last = count - 1;
    let half = |place: usize| {
        if place == 0 || place == last {
            0.5
        } else {
            1.0
        }
    };
    let scale = 2.0 * half(j) / last as f64;
    scale * half(node) * (j as f64 * angle(node, count)).cos()
}

fn angle(node: usize, count: usize) -> f64 {
    PI * node as f64 / (count - 1) as f64
}

/// The nodes of all windows, as parts of them.
pub(in crate::method) fn nodes() -> Vec<f64> {
    (0..NODES).map(|node| chebyshev_node(node, NODES)).collect()
}

/// A polynomial of a degree by its values at the nodes.
pub(in crate::method) fn by_nodes(degree: usize) -> NodeMap {
    let unit: Vec<f64> = (0..NODES * NODES)
        .map(|place| f64::from(u8::from(place % (NODES + 1) == 0)))
        .collect();
    let mut series = Vec::new();
    coefficients(&unit, NODES, &mut series);
    series.truncate((degree + 1) * NODES);
    let terms = degree + 1;
    let unit: Vec<f64> = (0..terms * terms)
        .map(|place| f64::from(u8::from(place % (terms + 1) == 0)))
        .collect();
    NodeMap {
        powers: powers(&unit, degree, terms),
        series,
    }
}

/// Chebyshev's coefficients of rows of values at so many nodes as there are.
pub(super) fn coefficients(samples: &[f64], width: usize, series: &mut Vec<f64>) {
    let count = samples.len() / width;
    series.clear();
    series.resize(samples.len(), 0.0);
    for (j, out) in series.chunks_mut(width).enumerate() {
        for (node, row) in samples.chunks(width).enumerate() {
            let factor = match count {
                NODES => WEIGHTS[j * NODES + node],
                _ => chebyshev_weight(j, node, count),
            };
            add_scaled(out, factor, row);
        }
    }
}

/// Takes the rounding errors out of the series of a column that does not change.
pub(super) fn settle(column: usize, samples: &[f64], width: usize, series: &mut [f64]) {
    let first = samples[column];
    let mut values = samples.chunks(width).map(|row| row[column]);
    if values.all(|value| value.to_bits() == first.to_bits()) {
        for (j, row) in series.chunks_mut(width).enumerate() {
            row[column] = if j == 0 { first } else { 0.0 };
        }
    }
}

/// Weights of values at the nodes in the coefficient of each of Chebyshev's polynomials.
static WEIGHTS: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let place = |k: usize| chebyshev_weight(k / NODES, k % NODES, NODES);
    (0..NODES * NODES).map(place).collect()
});

/// Coefficients of the powers of y up to a degree.
pub(super) fn powers(series: &[f64], degree: usize, width: usize) -> Vec<f64> {
    let mut powers = vec![0.0; (degree + 1) * width];
    // Chebyshev's polynomials of 2y − 1 in powers of y
    let (mut before, mut now) = (vec![0.0; degree + 2], vec![0.0; degree + 2]);
    now[0] = 1.0;
    for (j, row) in series.chunks(width).take(degree + 1).enumerate() {
        for (factor, out) in now.iter().zip(powers.chunks_mut(width)) {
            for (out, x) in out.iter_mut().zip(row) {
                *out += factor * x;
            }
        }
        let twice = if j == 0 { 1.0 } else { 2.0 };
        let next = (0..degree + 2).map(|l| {
            let lower = if l == 0 { 0.0 } else { now[l - 1] };
            twice * (2.0 * lower - now[l]) - if j == 0 { 0.0 } else { before[l] }
        });
        let next = next.collect();
        before = std::mem::replace(&mut now, next);
    }
    powers
}
