//! A W Bᵀ of chains, rings, trees and meshes, at one node: solved as dense LU does, or refused.

use liouville_base::linalg::{Lu, Matrix, NodeGram, Pattern};

/// Numbers that look like none.
fn noise(k: usize) -> f64 {
    (k as f64 * 0.754_877_666_246_692_8).fract() - 0.5
}

/// The bonds' rows over the beads' columns, three columns a bead, column by column.
fn pattern(beads: usize, bonds: &[(usize, usize)]) -> Pattern {
    let columns = (0..3 * beads).flat_map(|col| {
        let ends = bonds.iter().enumerate();
        ends.filter(move |(_, bond)| bond.0 == col / 3 || bond.1 == col / 3)
            .map(move |(row, _)| (row, col))
    });
    let entries = columns.collect();
    Pattern::new(bonds.len(), 3 * beads, entries).expect("entries lie inside")
}

fn chain(beads: usize) -> Vec<(usize, usize)> {
    (1..beads).map(|k| (k - 1, k)).collect()
}

fn ring(beads: usize) -> Vec<(usize, usize)> {
    (0..beads).map(|k| (k, (k + 1) % beads)).collect()
}

fn tree(beads: usize) -> Vec<(usize, usize)> {
    (1..beads).map(|k| ((k - 1) / 3, k)).collect()
}

fn mesh(side: usize) -> Vec<(usize, usize)> {
    let beads = (0..side).flat_map(|i| (0..side).map(move |j| i * side + j));
    let right = move |k: usize| (k % side + 1 < side).then_some((k, k + 1));
    let down = move |k: usize| (k / side + 1 < side).then_some((k, k + side));
    beads
        .flat_map(|k| right(k).into_iter().chain(down(k)))
        .collect()
}

fn gram(pattern: &Pattern) -> NodeGram {
    let one = Matrix::from_fn(1, 1, |_, _| 1.0);
    NodeGram::new(pattern, &pattern.transposed(), &one).expect("few updates")
}

/// The largest difference from what dense LU finds, relative to the largest number it finds.
fn difference(pattern: &Pattern) -> f64 {
    let m = pattern.shape().0;
    let a: Vec<f64> = (0..pattern.len()).map(|k| noise(k + 1)).collect();
    let b: Vec<f64> = (0..pattern.len())
        .map(|k| noise(k + 1) + 0.05 * noise(3 * k + 2))
        .collect();
    let mut lu = Lu::new(m);
    lu.matrix_mut().clear();
    for (one, a) in pattern.entries().iter().zip(&a) {
        for (other, b) in pattern.entries().iter().zip(&b) {
            if one.1 == other.1 {
                lu.matrix_mut()[(one.0, other.0)] += a * b;
            }
        }
    }
    lu.factor().expect("it has an inverse");
    let mut gram = gram(pattern);
    gram.factor(&a, &b).expect("it has an inverse");
    let mut x: Vec<f64> = (0..m).map(noise).collect();
    let mut y = x.clone();
    lu.solve(&mut x);
    gram.solve(&mut y);
    let largest = x.iter().fold(0.0_f64, |max, x| max.max(x.abs()));
    let apart = x.iter().zip(&y).map(|(x, y)| (x - y).abs());
    apart.fold(0.0_f64, f64::max) / largest
}

#[test]
fn it_solves_as_dense_lu_does() {
    let shapes = [
        pattern(2, &chain(2)),
        pattern(30, &chain(30)),
        pattern(30, &ring(30)),
        pattern(40, &tree(40)),
        pattern(100, &mesh(10)),
    ];
    for (k, pattern) in shapes.iter().enumerate() {
        let apart = difference(pattern);
        assert!(apart < 1e-10, "{apart:e} with shape {k}");
    }
}

#[test]
fn rows_that_depend_on_each_other_are_refused() {
    let pattern = pattern(3, &[(0, 1), (1, 2), (0, 1)]);
    let entries = pattern.entries().iter();
    let values: Vec<f64> = entries
        .map(|(row, col)| noise(col + 9 * (row % 2) + 1))
        .collect();
    assert!(gram(&pattern).factor(&values, &values).is_err());
}
