//! Blocks of several nodes, eliminated as dense LU does it or refused, products at nodes, and inverses of small blocks.

use liouville_base::linalg::{Blocks, Lu, Matrix, NodeGram, Pattern, Product, Rows};

/// Numbers that look like none.
fn noise(k: usize) -> f64 {
    (k as f64 * 0.754_877_666_246_692_8).fract() - 0.5
}

/// Bonds of beads in the plane as rows, two columns a bead, in the order of the rows.
fn pattern(beads: usize, bonds: &[(usize, usize)]) -> Pattern {
    let entries = bonds
        .iter()
        .enumerate()
        .flat_map(|(row, (a, b))| [2 * a, 2 * a + 1, 2 * b, 2 * b + 1].map(|col| (row, col)));
    Pattern::new(bonds.len(), 2 * beads, entries.collect()).expect("entries lie inside")
}

fn shapes() -> [Pattern; 3] {
    let chain: Vec<_> = (1..12).map(|k| (k - 1, k)).collect();
    let ring: Vec<_> = (0..9).map(|k| (k, (k + 1) % 9)).collect();
    let tree: Vec<_> = (1..14).map(|k| ((k - 1) / 3, k)).collect();
    [pattern(12, &chain), pattern(9, &ring), pattern(14, &tree)]
}

/// P, near a multiple of nothing simple.
fn weights(nodes: usize) -> Matrix {
    Matrix::from_fn(nodes, nodes, |i, l| {
        f64::from(u8::from(i == l)) + 0.3 * noise(5 * i + l + 1)
    })
}

/// Values that differ a little from node to node, node by node within an entry.
fn values(pattern: &Pattern, nodes: usize, seed: usize) -> Vec<f64> {
    let entry = |e: usize| (0..nodes).map(move |i| noise(e + 1) + 0.02 * noise(7 * e + i + seed));
    (0..pattern.len()).flat_map(entry).collect()
}

#[test]
fn it_solves_as_dense_lu_does() {
    for pattern in shapes() {
        let (m, n) = pattern.shape();
        for nodes in 1..=8 {
            let (p, other) = (weights(nodes), pattern.transposed());
            let (a, b) = (values(&pattern, nodes, 1), values(&other, nodes, 2));
            let at = |values: &[f64], node: usize, pattern: &Pattern| {
                let (rows, cols) = pattern.shape();
                let mut dense = Matrix::zeros(rows, cols);
                let own: Vec<f64> = values.chunks(nodes).map(|entry| entry[node]).collect();
                pattern.add_to(&own, 1.0, &mut dense, 0, 0);
                dense
            };
            let mut lu = Lu::new(m * nodes);
            for i in 0..nodes {
                for l in 0..nodes {
                    let (one, two) = (at(&a, i, &pattern), at(&b, l, &other));
                    for c in 0..m {
                        for d in 0..m {
                            let sum: f64 = (0..n).map(|e| one[(c, e)] * two[(e, d)]).sum();
                            lu.matrix_mut()[(c * nodes + i, d * nodes + l)] = p[(i, l)] * sum;
                        }
                    }
                }
            }
            lu.factor().expect("it has an inverse");
            let mut gram = NodeGram::new(&pattern, &other, &p).expect("few updates");
            gram.factor(&a, &b).expect("it has an inverse");
            for is_transposed in [false, true] {
                let mut x: Vec<f64> = (0..m * nodes).map(noise).collect();
                let mut y = x.clone();
                if is_transposed {
                    lu.solve_transposed(&mut x);
                    gram.solve_transposed(&mut y);
                } else {
                    lu.solve(&mut x);
                    gram.solve(&mut y);
                }
                let largest = x.iter().fold(0.0_f64, |max, x| max.max(x.abs()));
                let apart = x.iter().zip(&y).map(|(x, y)| (x - y).abs());
                let apart = apart.fold(0.0_f64, f64::max) / largest;
                assert!(apart < 1e-11, "{apart:e} apart with {nodes} nodes");
            }
        }
    }
}

#[test]
fn a_dependent_row_is_named() {
    let chain: Vec<_> = (1..12).map(|k| (k - 1, k)).chain([(4, 5)]).collect();
    let pattern = pattern(12, &chain);
    let mut a = values(&pattern, 2, 1);
    // the bond from 4 to 5 once more
    let (head, tail) = a.split_at_mut(11 * 4 * 2);
    tail.copy_from_slice(&head[4 * 4 * 2..5 * 4 * 2]);
    let mut gram =
        NodeGram::new(&pattern, &pattern.transposed(), &weights(2)).expect("few updates");
    let singular = gram.factor(&a, &a).expect_err("a row is there twice");
    assert!([4, 11].contains(&singular.column), "{singular:?}");
}

#[test]
fn many_nodes_and_much_fill_in_are_refused() {
    let [chain, ..] = shapes();
    assert!(NodeGram::<f64>::new(&chain, &chain.transposed(), &weights(9)).is_none());
    let all: Vec<_> = (0..40).flat_map(|a| (0..a).map(move |b| (a, b))).collect();
    let mesh = pattern(40, &all);
    assert!(NodeGram::<f64>::new(&mesh, &mesh.transposed(), &weights(2)).is_none());
}

#[test]
fn scattered_blocks_are_inverted() {
    // blocks {0, 5}, {1}, {2, 3, 7}, {4, 6}, with entries in no order
    let places = [
        (5, 0),
        (0, 0),
        (0, 5),
        (5, 5),
        (1, 1),
        (7, 2),
        (2, 2),
        (3, 3),
        (2, 3),
        (7, 7),
        (3, 7),
        (6, 4),
        (4, 6),
    ];
    let pattern = Pattern::new(8, 8, places.to_vec()).expect("entries lie inside");
    let values: Vec<f64> = (0..places.len()).map(|k| 1.0 + noise(k)).collect();
    let mut blocks = Blocks::new(&pattern).expect("small blocks");
    let mut lu = Lu::new(8);
    pattern.add_to(&values, 1.0, lu.matrix_mut(), 0, 0);
    lu.factor().expect("it has an inverse");
    blocks.factor(&values).expect("it has an inverse");
    let mut x: Vec<f64> = (0..8).map(noise).collect();
    let mut y = x.clone();
    lu.solve(&mut x);
    blocks.solve(&mut y);
    for (x, y) in x.iter().zip(&y) {
        assert!((x - y).abs() < 1e-13, "{x} and {y}");
    }
    let identity = Product::new(&pattern, blocks.pattern());
    let mut product = vec![0.0; identity.pattern().len()];
    identity.multiply::<f64, 1>(1, &values, blocks.values(), &mut product);
    for ((row, col), value) in identity.pattern().entries().iter().zip(product) {
        let wanted = f64::from(u8::from(row == col));
        assert!((value - wanted).abs() < 1e-13, "{value} at ({row}, {col})");
    }
    assert_eq!(
        blocks
            .factor(&[0.0; 13])
            .map_err(|singular| singular.column),
        Err(0)
    );
    assert!(Blocks::<f64>::new(&Pattern::full(9, 9)).is_none());
}

#[test]
fn products_at_nodes_are_those_of_each_node() {
    for pattern in shapes() {
        let (rows, cols) = pattern.shape();
        let node =
            |i: usize| -> Vec<f64> { (0..pattern.len()).map(|e| noise(3 * e + i)).collect() };
        let nodes = [node(0), node(1), node(2)];
        let x: Vec<f64> = (0..cols)
            .flat_map(|k| [1, 2, 3].map(|i| noise(i * k)))
            .collect();
        let mut all = vec![1.0; 3 * rows];
        let mut matrix = Rows::of(&pattern, 3);
        matrix.set(3, |i| &nodes[i]);
        matrix.add_product::<3>(3, &x, &mut all);
        for (i, values) in nodes.iter().enumerate() {
            let own: Vec<f64> = x.iter().skip(i).step_by(3).copied().collect();
            let mut wanted = vec![1.0; rows];
            pattern.multiply_add(values, 1.0, &own, &mut wanted);
            for (row, wanted) in wanted.iter().enumerate() {
                assert!(
                    (all[3 * row + i] - wanted).abs() < 1e-15,
                    "row {row} at node {i}"
                );
            }
        }
    }
}
