//! Transposed systems, by every kind of factors.

use liouville_base::linalg::{Factor, Pattern};
use liouville_base::newton::BlockLayout;

/// Numbers between −1 and 1 that follow no pattern.
fn noise(count: usize, seed: f64) -> Vec<f64> {
    let each = (0..count).map(|k| ((k as f64 + seed) * 0.618_033_988_749_895).fract());
    each.map(|x| 2.0 * x - 1.0).collect()
}

/// The largest part of `Aᵀ x − b`.
fn residual(pattern: &Pattern, values: &[f64], x: &[f64], b: &[f64]) -> f64 {
    let mut left: Vec<f64> = b.iter().map(|b| -b).collect();
    pattern.multiply_add_transposed(values, 1.0, x, &mut left);
    left.iter().fold(0.0, |size: f64, x| size.max(x.abs()))
}

#[test]
fn every_kind_of_factors_solves_transposed_systems() {
    let pairs = (0..12).flat_map(|k| [(k, k), (k, k ^ 1)]).collect();
    let near = |i: usize| [(i, i), (i, (i + 1) % 60), (i, (i + 7) % 60)];
    let patterns = [
        Pattern::diagonal(5),
        Pattern::new(12, 12, pairs).expect("entries inside"),
        Pattern::full(9, 9),
        Pattern::new(60, 60, (0..60).flat_map(near).collect()).expect("entries inside"),
    ];
    let kinds = patterns.map(|pattern| {
        let entries = pattern.entries().iter();
        let parts = entries.zip(noise(pattern.len(), 0.3));
        let values: Vec<f64> = parts
            .map(|((i, j), x)| x + if i == j { 8.0 } else { 0.0 })
            .collect();
        let b = noise(pattern.shape().0, 0.7);
        let mut factor = Factor::new(&pattern);
        factor.factor(&pattern, &values).expect("a strong diagonal");
        let mut x = b.clone();
        factor.solve_transposed(&mut x);
        assert!(residual(&pattern, &values, &x, &b) < 1e-14);
        match factor {
            Factor::Diagonal(_) => 0,
            Factor::Blocks(_) => 1,
            Factor::Dense(_) => 2,
            Factor::Sparse(_) => 3,
        }
    });
    assert_eq!(kinds, [0, 1, 2, 3]);
}

#[test]
fn a_condensed_matrix_solves_transposed_systems() {
    let (corner, low) = (Pattern::full(4, 4), Pattern::full(6, 4));
    for behind in [Pattern::diagonal(6), Pattern::full(6, 6)] {
        let (right, mut layout) = (Pattern::full(4, 6), BlockLayout::default());
        let places = [
            (&corner, 0, 0),
            (&right, 0, 4),
            (&low, 4, 0),
            (&behind, 4, 4),
        ];
        let blocks = places.map(|(pattern, i, j)| layout.place(pattern, i, j));
        let mut matrix = layout.build::<f64>(4, 6);
        for ((pattern, row, col), block) in places.into_iter().zip(blocks) {
            let entries = pattern.entries().iter();
            let parts = entries.zip(noise(pattern.len(), 0.1 + row as f64));
            let values: Vec<f64> = parts
                .map(|((i, j), x)| x + if row + i == col + j { 8.0 } else { 0.0 })
                .collect();
            matrix.add(block, &values, 1.0);
        }
        matrix.factor().expect("a strong diagonal");
        let b = noise(10, 0.5);
        let mut x = b.clone();
        matrix.solve_transposed(&mut x);
        let dense = matrix.to_dense();
        assert!(residual(&Pattern::full(10, 10), &columns(&dense), &x, &b) < 1e-14);
    }
}

/// The entries of a dense matrix, column by column.
fn columns(dense: &liouville_base::linalg::Matrix) -> Vec<f64> {
    let entries = (0..dense.cols()).flat_map(|j| (0..dense.rows()).map(move |i| (i, j)));
    entries.map(|place| dense[place]).collect()
}
