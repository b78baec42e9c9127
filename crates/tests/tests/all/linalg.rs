//! Factorisations against plain multiplication, and what is said of matrices that have none. All kinds
//! of factors are tried on the same families of matrices, hence in one file.

#![allow(clippy::float_cmp)] // what is compared here is exact

use liouville_base::linalg::{
    Assembly, Factor, Lu, Matrix, Pattern, PatternError, Singular, Sparse, SparseOf, add_scaled,
    combine, copy, dependent_rows, max_norm,
};
use liouville_tests::properties::properties;
use proptest::prelude::*;

/// A square matrix of order `least` to 12 and a vector that fits.
fn systems(least: usize) -> impl Strategy<Value = (Matrix, Vec<f64>)> {
    (least..=12).prop_flat_map(|n| {
        (
            prop::collection::vec(-1.0..1.0, n * n).prop_map(move |data| square(n, &data)),
            prop::collection::vec(-1.0..1.0, n),
        )
    })
}

fn square(n: usize, data: &[f64]) -> Matrix {
    Matrix::from_fn(n, n, |i, j| data[i * n + j])
}

fn transposed(a: &Matrix, n: usize) -> Matrix {
    Matrix::from_fn(n, n, |i, j| a[(j, i)])
}

fn factored(a: &Matrix, n: usize) -> Result<Lu, Singular> {
    let mut lu = Lu::new(n);
    lu.matrix_mut().flat_mut().copy_from_slice(a.flat());
    lu.factor().map(|()| lu)
}

/// The largest residual of a row, |b_i - Σ a_ij x_j|, relative to the size of what was summed.
fn residual(a: &Matrix, x: &[f64], b: &[f64]) -> f64 {
    let row = |i: usize| a.row(i).iter().zip(x).map(|(a, x)| a * x);
    (0..b.len())
        .map(|i| {
            let size: f64 = row(i).map(f64::abs).sum();
            (row(i).sum::<f64>() - b[i]).abs() / (size + b[i].abs())
        })
        .fold(0.0, f64::max)
}

/// A sparse saddle-point matrix [[K, -R], [G, 0]]: its pattern, and values for it from a seed.
///
/// K is banded, each constraint joins two coordinates with its own and shares one with the next.
#[derive(Clone, Debug)]
struct Kkt {
    pattern: Pattern,
    n: usize,
}

impl Kkt {
    fn new(n: usize, m: usize, band: usize) -> Self {
        let order = n + m;
        let mut entries = Vec::new();
        for i in 0..n {
            entries.extend((i.saturating_sub(band)..(i + band + 1).min(n)).map(|j| (i, j)));
        }
        for k in 0..m {
            for i in [k * n / m, (k * n / m + 1) % n, (k * n / m + n / 2) % n] {
                if !entries.contains(&(n + k, i)) {
                    entries.push((n + k, i));
                    entries.push((i, n + k));
                }
            }
        }
        let pattern = Pattern::new(order, order, entries).expect("entries inside");
        Self { pattern, n }
    }

    /// Values in (-1, 1), with `stiffness` on K, whose diagonal is strong.
    fn values(&self, seed: u64, stiffness: f64) -> Vec<f64> {
        let mut random = noise(seed);
        let value = |&(i, j): &(usize, usize)| {
            let strong = if i == j { 8.0 } else { 0.0 };
            let factor = if i.max(j) < self.n { stiffness } else { 1.0 };
            factor * (random() + strong)
        };
        self.pattern.entries().iter().map(value).collect()
    }
}

/// Numbers in (-1, 1) that look random.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        #[allow(clippy::cast_precision_loss)]
        let unit = (state >> 11) as f64 / (1_u64 << 53) as f64;
        2.0 * unit - 1.0
    }
}

/// The largest residual of a row relative to what was summed, as [`residual`], by the pattern.
fn sparse_residual(pattern: &Pattern, values: &[f64], x: &[f64], b: &[f64]) -> f64 {
    let mut left: Vec<f64> = b.iter().map(|b| -b).collect();
    let mut size: Vec<f64> = b.iter().map(|b| b.abs()).collect();
    for (&(i, j), value) in pattern.entries().iter().zip(values) {
        left[i] += value * x[j];
        size[i] += (value * x[j]).abs();
    }
    left.iter()
        .zip(size)
        .map(|(left, size)| left.abs() / size)
        .fold(0.0, f64::max)
}

fn both(pattern: &Pattern) -> [Factor; 2] {
    let order = pattern.shape().0;
    [
        Factor::Dense(Lu::new(order)),
        Factor::Sparse(Box::new(SparseOf::new::<f64>(pattern))),
    ]
}

/// A tridiagonal matrix with a strong diagonal, but for a column `last` that is a combination of two others.
fn dependent(
    order: usize,
    [first, second, last]: [usize; 3],
    seed: u64,
    weights: [f64; 2],
) -> (Pattern, Vec<f64>) {
    let mut random = noise(seed);
    let strong = |k: usize| if k % 3 == 1 { 4.0 } else { 0.0 };
    let tridiagonal: Vec<f64> = (0..3 * order).map(|k| random() + strong(k)).collect();
    let at = |i: usize, j: usize| match i.abs_diff(j) {
        0 | 1 => tridiagonal[3 * j + i + 1 - j],
        _ => 0.0,
    };
    let value = |&(i, j): &(usize, usize)| {
        if j == last {
            weights[0] * at(i, first) + weights[1] * at(i, second)
        } else {
            at(i, j)
        }
    };
    let entries: Vec<_> = (0..order)
        .flat_map(|i| (0..order).map(move |j| (i, j)))
        .filter(|(i, j)| *j == last || i.abs_diff(*j) <= 1)
        .collect();
    let values = entries.iter().map(value).collect();
    let pattern = Pattern::new(order, order, entries).expect("entries inside");
    (pattern, values)
}

proptest! {
    #![proptest_config(properties(1000))]

    #[test]
    fn a_solution_multiplies_back((a, b) in systems(0)) {
        if let Ok(lu) = factored(&a, b.len()) {
            let mut x = b.clone();
            lu.solve(&mut x);
            prop_assert!(residual(&a, &x, &b) < 1e-12);
        }
    }

    #[test]
    fn a_transposed_solution_multiplies_back((a, b) in systems(0)) {
        if let Ok(lu) = factored(&a, b.len()) {
            let mut x = b.clone();
            lu.solve_transposed(&mut x);
            // the error of a transposed solve is bounded by whole matrix norms, not row by row
            let size = max_norm(&x) + max_norm(&b);
            let a = transposed(&a, b.len());
            for (row, b) in (0..b.len()).map(|i| a.row(i)).zip(&b) {
                let sum: f64 = row.iter().zip(&x).map(|(a, x)| a * x).sum();
                prop_assert!((sum - b).abs() <= 1e-12 * size);
            }
        }
    }

    #[test]
    fn sparse_equals_dense_and_forgets_what_it_factored_before(
        (n, m, band) in (6..40_usize).prop_flat_map(|n| (Just(n), 0..n / 2, 0..4_usize)),
        seeds in prop::collection::vec(any::<u64>(), 3),
    ) {
        let kkt = Kkt::new(n, m, band);
        let [mut dense, mut sparse] = both(&kkt.pattern);
        for seed in seeds {
            let values = kkt.values(seed, 1.0);
            let factored = [&mut dense, &mut sparse].map(|factor| factor.factor(&kkt.pattern, &values));
            prop_assert_eq!(factored[0].is_ok(), factored[1].is_ok());
            if factored[0].is_ok() {
                let b: Vec<f64> = std::iter::repeat_with(noise(seed)).take(n + m).collect();
                let (mut x, mut y) = (b.clone(), b.clone());
                dense.solve(&mut x);
                sparse.solve(&mut y);
                let size = max_norm(&x);
                prop_assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() <= 1e-9 * size));
                prop_assert!(sparse_residual(&kkt.pattern, &values, &y, &b) < 1e-11);
            }
        }
    }

    #[test]
    fn sparse_names_a_column_that_depends_on_those_before_it(
        order in 8..40_usize,
        picks in (any::<prop::sample::Index>(), any::<prop::sample::Index>(), any::<prop::sample::Index>()),
        seed in any::<u64>(),
        exactly in any::<bool>(),
    ) {
        let mut places = [picks.0.index(order), picks.1.index(order), picks.2.index(order)];
        places.sort_unstable();
        let [first, second, last] = places;
        prop_assume!(first < second && second < last);
        let (pattern, values) = dependent(order, places, seed, if exactly { [1.0, 0.0] } else { [0.7, -1.3] });
        let [mut dense, mut sparse] = both(&pattern);
        prop_assert_eq!(dense.factor(&pattern, &values), Err(Singular { column: last }));
        prop_assert_eq!(sparse.factor(&pattern, &values), Err(Singular { column: last }));
    }

    #[test]
    fn the_units_of_a_row_do_not_matter(
        (a, b) in systems(0),
        powers in prop::collection::vec(-300..300_i32, 12),
    ) {
        // by powers of two, so that nothing but the choice of pivots could differ
        let unit = |i: usize| 2.0_f64.powi(powers[i]);
        let n = b.len();
        let scaled = Matrix::from_fn(n, n, |i, j| unit(i) * a[(i, j)]);
        let mut x = b.clone();
        let mut y: Vec<f64> = b.iter().enumerate().map(|(i, b)| unit(i) * b).collect();
        match (factored(&a, n), factored(&scaled, n)) {
            (Ok(plain), Ok(scaled)) => {
                plain.solve(&mut x);
                scaled.solve(&mut y);
                prop_assert_eq!(x, y);
            }
            (plain, scaled) => prop_assert_eq!(plain.err(), scaled.err()),
        }
    }

    #[test]
    fn the_first_column_without_a_pivot_is_named(
        (mut a, b) in systems(1),
        column in any::<prop::sample::Index>(),
    ) {
        let n = b.len();
        let column = column.index(n);
        // sixteenths multiply exactly, and a strong diagonal keeps the other columns independent
        for i in 0..n {
            for j in 0..n {
                a[(i, j)] = (16.0 * a[(i, j)]).round() / 16.0;
            }
            a[(i, i)] += 16.0;
        }
        for i in 0..n {
            a[(i, column)] = (0..column).map(|j| (16.0 * b[j]).round() / 16.0 * a[(i, j)]).sum();
        }
        prop_assert_eq!(factored(&a, n).err(), Some(Singular { column }));
    }

    #[test]
    fn dependent_rows_are_named(
        coefficients in prop::collection::vec(prop_oneof![Just(0.0), 0.25..4.0, -4.0..-0.25], 0..6),
        extra in 0..3_usize,
    ) {
        // unit rows with some noise to the right, then their combination, then anything
        let k = coefficients.len();
        let noise = |i: usize, j: usize| 0.1 * f64::from(u8::try_from((5 * i + 3 * j) % 7).unwrap_or(0));
        let independent = |i: usize, j: usize| if i == j { 1.0 } else { noise(i, j) };
        let rows = Matrix::from_fn(k + 1 + extra, k + 3, |i, j| match i {
            i if i < k => independent(i, j),
            i if i == k => (0..k).map(|l| coefficients[l] * independent(l, j)).sum(),
            i => noise(i, j),
        });
        let mut wanted: Vec<usize> = (0..k).filter(|l| coefficients[*l] != 0.0).collect();
        wanted.push(k);
        prop_assert_eq!(dependent_rows(rows), Some(wanted));
    }

    #[test]
    fn combinations_are_the_plain_loop(
        (rows, inner, cols) in (0..5_usize, 1..6_usize, 1..80_usize),
        values in prop::collection::vec(-1.0..1.0, 5 * 6 + 6 * 80),
    ) {
        let weights = Matrix::from_fn(rows, inner, |i, j| values[i * inner + j]);
        let x = Matrix::from_fn(inner, cols, |i, j| values[30 + i * cols + j]);
        let mut out = vec![f64::NAN; rows * cols];
        #[allow(clippy::cast_precision_loss)]
        combine(&mut out, &weights, &x, |i, first, sums| {
            for (k, sum) in (first..).zip(sums) {
                *sum += (10 * i + k) as f64;
            }
        });
        for i in 0..rows {
            for k in 0..cols {
                let sum: f64 = (0..inner).fold(0.0, |sum, j| sum + weights[(i, j)] * x[(j, k)]);
                #[allow(clippy::cast_precision_loss)]
                let wanted = sum + (10 * i + k) as f64;
                prop_assert_eq!(out[i * cols + k], wanted);
            }
        }
    }
}

/// The left null vectors of these matrices, of norm 1, have products of 1.6e-5 and 4.3e-5 with the probe; the second
/// matrix has a pivot that is zero.
#[test]
fn sparse_sees_a_dependent_column_that_the_probe_hides() {
    let copied = dependent(11, [2, 3, 4], 5_388_881_673_262_292_156, [1.0, 0.0]);
    let combined = dependent(28, [0, 1, 23], 3_927_385_638_796_903_277, [0.7, -1.3]);
    for ((pattern, values), column) in [(copied, 4), (combined, 23)] {
        for mut factor in both(&pattern) {
            assert_eq!(factor.factor(&pattern, &values), Err(Singular { column }));
        }
    }
}

#[test]
fn columns_of_hilbert_s_matrix_are_independent_until_roundoff() {
    let hilbert = |n: usize| {
        Matrix::from_fn(n, n, |i, j| {
            1.0 / f64::from(u8::try_from(i + j + 1).unwrap_or(1))
        })
    };
    assert!(factored(&hilbert(8), 8).is_ok()); // condition number 1.5e10
    assert!(factored(&hilbert(14), 14).is_err()); // beyond 1e16
}

#[test]
fn a_zero_row_and_values_that_are_not_finite_have_no_factors() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for place in 0..4 {
            let mut data = [2.0, 1.0, 1.0, 3.0];
            data[place] = bad;
            assert!(factored(&square(2, &data), 2).is_err(), "{data:?}");
        }
    }
    assert_eq!(
        factored(&square(2, &[0.0, 0.0, 1.0, 1.0]), 2).err(),
        Some(Singular { column: 1 })
    );
    assert_eq!(
        factored(&square(1, &[0.0]), 1).err(),
        Some(Singular { column: 0 })
    );
}

#[test]
fn a_matrix_of_order_zero_is_solved_with() {
    let lu = factored(&Matrix::zeros(0, 0), 0).expect("nothing is singular in it");
    lu.solve(&mut []);
    lu.solve_transposed(&mut []);
    assert_eq!(lu.order(), 0);
}

#[test]
fn a_second_factorisation_forgets_the_first() {
    let mut lu = Lu::new(2);
    lu.matrix_mut()
        .flat_mut()
        .copy_from_slice(&[0.0, 1.0, 1.0, 0.0]);
    lu.factor().expect("a permutation");
    lu.matrix_mut()
        .flat_mut()
        .copy_from_slice(&[2.0, 0.0, 0.0, 4.0]);
    lu.factor().expect("a diagonal");
    let mut x = [2.0, 2.0];
    lu.solve(&mut x);
    assert_eq!(x, [1.0, 0.5]);
}

#[test]
fn independent_rows_have_no_combination() {
    assert_eq!(
        dependent_rows(Matrix::from_fn(3, 3, |i, j| f64::from(u8::from(
            i + j == 2
        )))),
        None
    );
    assert_eq!(dependent_rows(Matrix::zeros(0, 3)), None);
}

#[test]
fn more_rows_than_columns_depend() {
    let rows = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    assert_eq!(
        dependent_rows(Matrix::from_fn(3, 2, |i, j| rows[i][j])),
        Some(vec![0, 1, 2])
    );
}

#[test]
fn a_zero_row_depends_on_nothing_else() {
    let rows = [[1.0, 2.0], [0.0, 0.0], [1.0, 2.0]];
    assert_eq!(
        dependent_rows(Matrix::from_fn(3, 2, |i, j| rows[i][j])),
        Some(vec![1])
    );
}

#[test]
fn dependent_rows_are_named_in_any_units() {
    for unit in [1e-12, 1e12] {
        let rows = [[unit, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
        let named = dependent_rows(Matrix::from_fn(3, 3, |i, j| rows[i][j]));
        assert_eq!(
            named,
            Some(vec![0, 1, 2]),
            "with the first row in units of {unit:e}"
        );
    }
}

#[test]
fn a_pattern_lies_inside_its_matrix() {
    let wanted = PatternError {
        row: 1,
        col: 3,
        rows: 2,
        cols: 3,
    };
    let refused = Pattern::new(2, 3, vec![(0, 0), (1, 3), (5, 5)]).expect_err("(1, 3) is outside");
    assert_eq!(refused, wanted);
    assert_eq!(
        refused.to_string(),
        "entry (1, 3) is outside a 2 by 3 matrix"
    );
    assert!(Pattern::new(2, 3, vec![(2, 0)]).is_err());
    assert!(Pattern::new(0, 0, vec![(0, 0)]).is_err());
}

#[test]
fn a_pattern_multiplies_as_the_matrix_it_stands_for() {
    let pattern = Pattern::new(2, 3, vec![(1, 2), (0, 0), (1, 0)]).expect("entries inside");
    assert_eq!((pattern.shape(), pattern.len()), ((2, 3), 3));
    let values = [5.0, 2.0, -1.0];
    let mut out = [10.0, 20.0];
    pattern.multiply_add(&values, 0.5, &[1.0, 7.0, 3.0], &mut out);
    assert_eq!(out, [11.0, 27.0]);
    let mut dense = Matrix::from_fn(3, 4, |_, _| 1.0);
    pattern.add_to(&values, 2.0, &mut dense, 1, 1);
    assert_eq!(dense.row(0), [1.0, 1.0, 1.0, 1.0]);
    assert_eq!(dense.row(1), [1.0, 5.0, 1.0, 1.0]);
    assert_eq!(dense.row(2), [1.0, -1.0, 1.0, 11.0]);
    assert!(!pattern.is_diagonal() && !pattern.is_empty());
}

#[test]
fn blocks_add_up_where_they_overlap() {
    let square = Pattern::new(2, 2, vec![(0, 0), (1, 1), (0, 1)]).expect("entries inside");
    let row = Pattern::new(1, 3, vec![(0, 2), (0, 0)]).expect("entries inside");
    let mut sum = Assembly::new((3, 4), &[(&square, 0, 0), (&square, 1, 1), (&row, 1, 1)]);
    sum.add(0, &[1.0, 2.0, 3.0], 1.0);
    sum.add(1, &[10.0, 20.0, 30.0], -1.0);
    sum.add(2, &[100.0, 200.0], 0.5);
    let mut dense = Matrix::zeros(3, 4);
    sum.pattern().add_to(sum.values(), 1.0, &mut dense, 0, 0);
    assert_eq!(dense.row(0), [1.0, 3.0, 0.0, 0.0]);
    assert_eq!(dense.row(1), [0.0, 2.0 - 10.0 + 100.0, -30.0, 50.0]);
    assert_eq!(dense.row(2), [0.0, 0.0, -20.0, 0.0]);
    let entries = sum.pattern().entries();
    assert_eq!(entries, [(0, 0), (0, 1), (1, 1), (1, 2), (2, 2), (1, 3)]);
    sum.clear();
    assert_eq!(
        (sum.values(), sum.pattern().shape()),
        (&[0.0; 6][..], (3, 4))
    );
}

#[test]
#[should_panic(expected = "a 2 by 2 block at (2, 0) lies in a 3 by 2 matrix")]
fn a_block_outside_its_matrix_is_refused() {
    let square = Pattern::new(2, 2, vec![]).expect("no entries");
    Assembly::<f64>::new((3, 2), &[(&square, 0, 0), (&square, 2, 0)]);
}

#[test]
#[should_panic(expected = "values of block 0")]
fn a_block_with_values_missing_is_refused() {
    let square = Pattern::new(2, 2, vec![(0, 0), (1, 1)]).expect("entries inside");
    Assembly::new((2, 2), &[(&square, 0, 0)]).add(0, &[1.0], 1.0);
}

#[test]
fn a_diagonal_pattern_is_solved_as_blocks_are() {
    let entries = vec![(2, 2), (0, 0), (1, 1)];
    let diagonal = Pattern::new(3, 3, entries.clone()).expect("entries inside");
    let coupled = Pattern::new(3, 3, [entries, vec![(0, 2)]].concat()).expect("entries inside");
    let (mut fast, mut blocks) = (Factor::new(&diagonal), Factor::new(&coupled));
    assert!(matches!(
        (&fast, &blocks),
        (Factor::Diagonal(_), Factor::Blocks(_))
    ));
    fast.factor(&diagonal, &[4.0, 2.0, -8.0]).expect("regular");
    blocks
        .factor(&coupled, &[4.0, 2.0, -8.0, 0.0])
        .expect("regular");
    let (mut a, mut b) = ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]);
    fast.solve(&mut a);
    blocks.solve(&mut b);
    assert_eq!((a, b), ([0.5, -0.25, 0.75], [0.5, -0.25, 0.75]));
}

#[test]
fn large_sparse_matrices_are_factored_sparse() {
    let large = Kkt::new(40, 10, 1).pattern;
    assert!(matches!(Factor::<f64>::new(&large), Factor::Sparse(_)));
    let small = Kkt::new(10, 5, 0).pattern;
    assert!(matches!(Factor::<f64>::new(&small), Factor::Dense(_)));
}

#[test]
fn stiffness_and_constraints_far_apart_are_solved_as_well() {
    let kkt = Kkt::new(200, 60, 2);
    for stiffness in [1e-8, 1.0, 1e6, 1e11, 1e16] {
        let values = kkt.values(7, stiffness);
        let mut factor = Factor::new(&kkt.pattern);
        factor.factor(&kkt.pattern, &values).expect("regular");
        let b: Vec<f64> = std::iter::repeat_with(noise(3)).take(260).collect();
        let mut x = b.clone();
        factor.solve(&mut x);
        let residual = sparse_residual(&kkt.pattern, &values, &x, &b);
        assert!(residual < 1e-12, "{residual:e} at {stiffness:e}");
    }
}

#[test]
fn a_sparse_matrix_without_factors_is_refused_at_a_column() {
    let kkt = Kkt::new(40, 12, 1);
    let mut sparse = Sparse::new(&kkt.pattern);
    let regular = kkt.values(1, 1.0);
    let entries = kkt.pattern.entries();
    let with = |change: &dyn Fn(usize, usize) -> Option<f64>| -> Vec<f64> {
        let each = entries.iter().zip(&regular);
        each.map(|(&(i, j), value)| change(i, j).unwrap_or(*value))
            .collect()
    };
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let values = with(&|i, j| ((i, j) == (17, 18)).then_some(bad));
        assert_eq!(
            sparse.factor(&values),
            Err(Singular { column: 18 }),
            "{bad}"
        );
    }
    let no_column = with(&|_, j| (j == 5).then_some(0.0));
    assert_eq!(sparse.factor(&no_column), Err(Singular { column: 5 }));
    let no_row = with(&|i, _| (i == 5).then_some(0.0));
    assert!(sparse.factor(&no_row).is_err());
    assert_eq!(
        sparse.factor(&vec![0.0; regular.len()]),
        Err(Singular { column: 0 })
    );
    assert_eq!(sparse.factor(&regular), Ok(()));
    let b = vec![1.0; 52];
    let mut x = b.clone();
    sparse.solve(&mut x);
    assert!(sparse_residual(&kkt.pattern, &regular, &x, &b) < 1e-13);
}

#[test]
fn a_constraint_given_twice_makes_a_sparse_matrix_singular() {
    for (n, exactly) in [(60, true), (60, false), (4000, true), (4000, false)] {
        // each constraint holds the distance of neighbours; the last is the first again, or twice it and noise
        let mut entries: Vec<_> = (0..n).map(|i| (i, i)).collect();
        let mut values = vec![1.5; n];
        for k in 0..n / 2 {
            let (at, factor) = if k + 1 == n / 2 {
                (0, 2.0)
            } else {
                (2 * k, 1.0)
            };
            for (place, value) in [(at, 0.3), (at + 1, 0.7)] {
                let rounded = if exactly {
                    value
                } else {
                    value * (1.0 + 1e-15)
                };
                let value = factor * if factor == 1.0 { value } else { rounded };
                entries.extend([(n + k, place), (place, n + k)]);
                values.extend([value, -value]);
            }
        }
        let pattern = Pattern::new(n + n / 2, n + n / 2, entries).expect("entries inside");
        let singular = Sparse::new(&pattern).factor(&values);
        assert_eq!(
            singular,
            Err(Singular {
                column: n + n / 2 - 1
            })
        );
    }
}

#[test]
fn panels_factor_as_single_entries_do() {
    // five-point stencils: dense panels pay from some size on
    for side in [4, 12, 40] {
        let order = side * side;
        let near = |k: usize| {
            [Some(k), k.checked_sub(side), Some(k + side)]
                .into_iter()
                .flatten()
                .chain((!k.is_multiple_of(side)).then(|| k - 1))
                .chain((k % side + 1 < side).then_some(k + 1))
        };
        let entries: Vec<_> = (0..order)
            .flat_map(|i| near(i).map(move |j| (i, j)))
            .filter(|(_, j)| *j < order)
            .collect();
        let mut random = noise(5);
        let values: Vec<f64> = entries
            .iter()
            .map(|(i, j)| if i == j { 5.0 } else { random() })
            .collect();
        let pattern = Pattern::new(order, order, entries).expect("entries inside");
        let mut sparse = Sparse::new(&pattern);
        for _ in 0..2 {
            sparse.factor(&values).expect("diagonally dominant");
            let b = vec![1.0; order];
            let mut x = b.clone();
            sparse.solve(&mut x);
            assert!(sparse_residual(&pattern, &values, &x, &b) < 1e-13);
        }
        let zero: Vec<f64> = pattern
            .entries()
            .iter()
            .zip(&values)
            .map(|((_, j), value)| if j % side == 2 { 0.0 } else { *value })
            .collect();
        assert_eq!(sparse.factor(&zero), Err(Singular { column: 2 }));
        assert!(sparse.factor(&values).is_ok());
    }
}

#[test]
fn a_diagonal_without_an_entry_is_singular_there() {
    let pattern = Pattern::new(3, 3, vec![(0, 0), (2, 2)]).expect("entries inside");
    let mut factor = Factor::new(&pattern);
    assert_eq!(
        factor.factor(&pattern, &[1.0, 1.0]),
        Err(Singular { column: 1 })
    );
    let whole = Pattern::new(2, 2, vec![(0, 0), (1, 1)]).expect("entries inside");
    let mut factor = Factor::new(&whole);
    for bad in [0.0, -0.0, f64::NAN, f64::INFINITY] {
        assert_eq!(
            factor.factor(&whole, &[1.0, bad]),
            Err(Singular { column: 1 }),
            "{bad}"
        );
    }
    assert_eq!(factor.factor(&whole, &[1.0, 2.0]), Ok(()));
}

#[test]
fn vectors_of_every_length_are_copied_and_added() {
    for n in 0..20_u8 {
        let x: Vec<f64> = (0..n).map(f64::from).collect();
        let mut out = vec![1.0; x.len()];
        add_scaled(&mut out, 2.0, &x);
        assert!(
            out.iter()
                .zip(&x)
                .all(|(out, x)| (out - (1.0 + 2.0 * x)).abs() < 1e-15)
        );
        copy(&mut out, &x);
        assert_eq!(out, x);
    }
}

#[test]
#[should_panic(expected = "sizes of a copy")]
fn a_copy_of_another_size_is_refused() {
    copy(&mut [0.0; 3], &[0.0; 2]);
}

#[test]
fn the_largest_magnitude_of_a_nan_is_infinite() {
    assert_eq!(max_norm(&[1.0, -3.0, 2.0]).to_bits(), 3.0_f64.to_bits());
    assert_eq!(max_norm::<f64>(&[]).to_bits(), 0.0_f64.to_bits());
    assert!(max_norm(&[1.0, f64::NAN, 2.0]).is_infinite());
    assert!(max_norm(&[f64::NEG_INFINITY]).is_infinite());
}

/// Run with `cargo test --release -p liouville-py -p liouville-tests -- --ignored --nocapture sparse_factor`.
#[test]
#[ignore = "a measurement"]
#[allow(clippy::print_stdout)]
fn time_of_a_sparse_factor_and_solve_grows_as_the_chain_does() {
    for links in [334_usize, 1_000, 3_334, 10_000, 33_334] {
        let (n, order) = (2 * links, 3 * links);
        let mut entries: Vec<_> = (0..n).map(|i| (i, i)).collect();
        for k in 0..links {
            let of_link = (2 * k).saturating_sub(2)..2 * k + 2;
            entries.extend(of_link.flat_map(|i| [(n + k, i), (i, n + k)]));
        }
        let mut random = noise(1);
        let values: Vec<f64> = entries.iter().map(|_| 1.5 + random()).collect();
        let pattern = Pattern::new(order, order, entries).expect("entries inside");
        let start = std::time::Instant::now();
        let mut factor = Factor::new(&pattern);
        let ordering = start.elapsed();
        let mut x = vec![1.0; order];
        let mut least = [std::time::Duration::MAX; 2];
        for _ in 0..20 {
            let start = std::time::Instant::now();
            factor.factor(&pattern, &values).expect("regular");
            least[0] = least[0].min(start.elapsed());
            let start = std::time::Instant::now();
            factor.solve(&mut x);
            least[1] = least[1].min(start.elapsed());
        }
        println!(
            "order {order}: ordering {ordering:.1?}, factor {:.1?}, solve {:.1?}",
            least[0], least[1]
        );
    }
}
