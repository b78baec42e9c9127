//! Linear maps as lists: the transposed list is the transpose, exactly.

use liouville_base::linalg::Pattern;
use liouville_base::linear::{LinearMap, Operators, Segments};
use liouville_tests::properties::properties;
use proptest::collection::vec;
use proptest::prelude::*;
use std::convert::Infallible;

/// Solves with matrices of whole numbers whose inverses are whole: sums of what is above, with or without a sign.
struct Sums;

impl Operators for Sums {
    type Error = Infallible;

    fn solve<const TRANSPOSED: bool>(
        &mut self,
        matrix: usize,
        x: &mut [f64],
    ) -> Result<(), Infallible> {
        for i in 1..x.len() {
            if TRANSPOSED {
                let i = x.len() - i;
                x[i - 1] += x[i] * sign(matrix);
            } else {
                x[i] += x[i - 1] * sign(matrix);
            }
        }
        Ok(())
    }
}

fn sign(matrix: usize) -> f64 {
    if matrix == 0 { 1.0 } else { -1.0 }
}

proptest! {
    #![proptest_config(properties(100))]

    #[test]
    fn lists_are_transposed_exactly(whole in vec(-3_i32..=3, 40)) {
        let values: Vec<f64> = whole.iter().copied().map(f64::from).collect();
        let (values, rest) = values.split_at(16);
        let (weights, rest) = rest.split_at(8);
        let mut segments = Segments::default();
        let (start, one, between, end) =
            (segments.take(3), segments.take(1), segments.take(4), segments.take(3));
        let mut list = LinearMap::default();
        let block = list.pattern(&Pattern::full(3, 4));
        let split = list.split(&Pattern::full(4, 4));
        list.add(between.cut(1, 3), weights[0], start);
        list.add_column(between, weights[1], &values[..4], one);
        list.add_split(between, (&split, values), weights[2], [one, start]);
        list.solve(0, between);
        list.add(end, weights[3], start);
        list.add_product(end, (&block, &values[..12]), weights[4], between);
        list.solve(1, end);
        // what was solved for is read, and written again
        list.add(between.cut(0, 3), weights[5], end);
        list.add_product(end, (&block, &values[2..14]), weights[6], between);
        let (mut forwards, mut back) = (segments.memory::<f64>(), segments.memory::<f64>());
        forwards[..4].copy_from_slice(&rest[..4]);
        back[end.range()].copy_from_slice(&rest[4..7]);
        let Ok(()) = list.apply::<false, _>(&mut forwards, &mut Sums);
        let Ok(()) = list.apply::<true, _>(&mut back, &mut Sums);
        let pairing = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        let [ends, starts] =
            [pairing(&forwards[end.range()], &rest[4..7]), pairing(&rest[..4], &back[..4])];
        assert_eq!((ends + 0.0).to_bits(), (starts + 0.0).to_bits());
    }
}
