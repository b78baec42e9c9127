//! Products of Hamiltonians by rows: against dense ones, member by member, and many in one sweep. One file, since all
//! are tried on the same random families of matrices.

use liouville_base::linalg::Rows;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::simd::{InstructionSet, Stored};
use liouville_tests::properties::properties;
use liouville_waves::method::{Move, Outputs, Sink, Sweeper, TermBlock};
use liouville_waves::problem::{
    Bond, Dense, Diagonals, Hamiltonian, Operator, RowBlock, Spins, Update,
};
use proptest::prelude::*;
use std::sync::Arc;

/// A matrix row by row.
type Matrix = Vec<Vec<f64>>;

/// Numbers in (−1, 1) that look random.
struct Draw(u64);

impl Draw {
    fn below(&mut self, most: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 33) as usize % most
    }

    fn next(&mut self) -> f64 {
        self.below(1 << 30) as f64 / f64::from(1 << 29) - 1.0
    }

    fn vector(&mut self, n: usize) -> Vec<f64> {
        (0..n).map(|_| self.next()).collect()
    }
}

/// Diagonals of which some are one number, some have holes, and some change from one number to another.
fn diagonals(draw: &mut Draw, n: usize) -> Vec<(usize, Vec<f64>)> {
    let mut offsets: Vec<usize> = (0..4).map(|_| draw.below(n.min(70))).collect();
    offsets.push(n - 1 - draw.below(n.min(5)));
    offsets.sort_unstable();
    offsets.dedup();
    let mut diagonals = Vec::new();
    for offset in offsets {
        let (kind, value, hole) = (draw.below(5), draw.next(), 2 + draw.below(400));
        let value = |i: usize| match kind {
            1 if i % hole == hole - 1 => 0.0,
            0 | 1 => value,
            2 if i > hole => value,
            3 if !i.is_multiple_of(hole) => 0.0,
            _ => draw.next(),
        };
        diagonals.push((offset, (0..n - offset).map(value).collect()));
    }
    diagonals
}

fn of_diagonals(n: usize, diagonals: &[(usize, Vec<f64>)]) -> Matrix {
    let mut matrix = vec![vec![0.0; n]; n];
    for (offset, values) in diagonals {
        for (i, value) in values.iter().enumerate() {
            matrix[i][i + offset] = *value;
            matrix[i + offset][i] = *value;
        }
    }
    matrix
}

fn sparse(matrix: &Matrix) -> Rows {
    let n = matrix.len();
    let (mut row, mut col, mut values) = (vec![], vec![], vec![]);
    for (i, of_row) in matrix.iter().enumerate() {
        for (j, value) in of_row
            .iter()
            .enumerate()
            .filter(|(_, value)| **value != 0.0)
        {
            row.push(i);
            col.push(j);
            values.push(*value);
        }
    }
    Rows::new((n, n), &row, &col, &values).expect("entries inside")
}

/// Bonds between any spins, in a field.
fn bonds(draw: &mut Draw, length: u8) -> (Vec<Bond>, Vec<f64>) {
    let mut bonds = Vec::new();
    for k in 0..u32::from(length) {
        let site = |draw: &mut Draw| (0..u32::from(length)).nth(draw.below(length.into()));
        let (i, j) = match draw.below(2) {
            0 => (k, (k + 1) % u32::from(length)),
            _ => (k, site(draw).expect("a site")),
        };
        if i != j {
            let (sites, xy, z) = ((i, j), draw.next(), draw.next());
            bonds.push(Bond { sites, xy, z });
        }
    }
    (bonds, draw.vector(length.into()))
}

/// The chain's matrix by products of spin matrices, S⁺ S⁻ among them, on the states of a sector.
fn chain(bonds: &[Bond], fields: &[f64], up: Option<u32>) -> Matrix {
    let length = fields.len();
    let is_up = |state: usize, site: usize| state & 1 << site == 0;
    let count = |state: usize| (0..length).filter(|site| is_up(state, *site)).count();
    let is_inside = |state: &usize| up.is_none_or(|up| count(*state) == up as usize);
    let states: Vec<usize> = (0..1 << length).filter(is_inside).collect();
    let z = |state, site| if is_up(state, site) { 0.5 } else { -0.5 };
    let mut matrix = vec![vec![0.0; states.len()]; states.len()];
    for (col, &state) in states.iter().enumerate() {
        for (site, field) in fields.iter().enumerate() {
            matrix[col][col] += field * z(state, site);
        }
        for bond in bonds {
            let (i, j) = (bond.sites.0 as usize, bond.sites.1 as usize);
            matrix[col][col] += bond.z * z(state, i) * z(state, j);
            for (raised, lowered) in [(i, j), (j, i)] {
                if !is_up(state, raised) && is_up(state, lowered) {
                    let to = state - (1 << raised) + (1 << lowered);
                    let row = states.binary_search(&to).expect("a state of the sector");
                    matrix[row][col] += 0.5 * bond.xy;
                }
            }
        }
    }
    matrix
}

fn product(matrix: &Matrix, x: &[f64]) -> Vec<f64> {
    let dot = |row: &Vec<f64>| row.iter().zip(x).map(|(a, x)| a * x).sum();
    matrix.iter().map(dot).collect()
}

const UPDATES: [Update; 4] = [
    Update {
        keep: 1.0,
        factor: 0.7,
        diagonal: -0.4,
    },
    Update {
        keep: -1.0,
        factor: 2.0,
        diagonal: 0.0,
    },
    Update {
        keep: 0.0,
        factor: -0.3,
        diagonal: 0.2,
    },
    Update {
        keep: 1.0,
        factor: 1.0,
        diagonal: 0.0,
    },
];

/// Makes all rows in blocks, each with no more of x around it than it may have.
fn updated<S: Stored>(
    (operator, machine): (&Operator, InstructionSet),
    update: Update,
    block: usize,
    x: &[S],
    out: &[S],
) -> Vec<S> {
    let (n, mut out) = (operator.size(), out.to_vec());
    let reach = operator.reach().expect("a term by rows");
    for (k, out) in out.chunks_mut(block).enumerate() {
        let row = k * block;
        let place = row.saturating_sub(reach);
        let x = &x[place..n.min(row + out.len() + reach)];
        operator.act(machine, update, RowBlock { row, out, place, x });
    }
    out
}

fn lanes(draw: &mut Draw, n: usize) -> Vec<Lanes> {
    let lanes = |_| Lanes(std::array::from_fn(|_| draw.next()));
    (0..n).map(lanes).collect()
}

/// Compares an operator with a matrix, blocks with all rows, members with numbers, machines with each other.
fn check(draw: &mut Draw, operator: &Operator, matrix: &Matrix) {
    let n = matrix.len();
    assert_eq!(operator.size(), n);
    let (x, out) = (lanes(draw, n), lanes(draw, n));
    let of = |x: &[Lanes], member| x.iter().map(|x| x.member(member)).collect::<Vec<f64>>();
    let update = UPDATES[draw.below(4)];
    let block = 1 + draw.below(n);
    let all = updated(
        (operator, InstructionSet::default()),
        update,
        block,
        &x,
        &out,
    );
    for machine in InstructionSet::all() {
        let same = updated((operator, machine), update, n, &x, &out);
        assert_eq!(all, same, "{machine:?}");
    }
    for member in 0..2 {
        let (x, out) = (of(&x, member), of(&out, member));
        let one = updated((operator, InstructionSet::default()), update, n, &x, &out);
        assert_eq!(one, of(&all, member));
        for machine in InstructionSet::all() {
            let block = 1 + draw.below(n);
            let same = updated((operator, machine), update, block, &x, &out);
            assert_eq!(one, same, "{machine:?}, block {block}");
        }
        let product = product(matrix, &x);
        for i in 0..n {
            let want = update.keep * out[i] + update.factor * product[i] + update.diagonal * x[i];
            let scale: f64 = 1.0 + matrix[i].iter().map(|a| a.abs()).sum::<f64>();
            assert!(
                (one[i] - want).abs() < 1e-14 * scale,
                "row {i}: {} {want}",
                one[i]
            );
        }
    }
}

proptest! {
    #![proptest_config(properties(32))]

    #[test]
    fn rows_are_those_of_the_matrix(seed: u64, n in 1_usize..900) {
        let mut draw = Draw(seed);
        let diagonals = diagonals(&mut draw, n);
        let matrix = of_diagonals(n, &diagonals);
        check(&mut draw, &Operator::Rows(Arc::new(sparse(&matrix))), &matrix);
        check(&mut draw, &Operator::sparse(Arc::new(sparse(&matrix))), &matrix);
        check(&mut draw, &Operator::Diagonals(Arc::new(Diagonals::new(n, &diagonals))), &matrix);
    }

    #[test]
    fn dense_rows_are_those_of_the_matrix(seed: u64, n in 1_usize..200) {
        let mut draw = Draw(seed);
        let mut matrix: Matrix = (0..n).map(|_| draw.vector(n)).collect();
        for i in 0..n {
            for j in 0..i {
                matrix[i][j] = matrix[j][i];
            }
        }
        let dense = Dense::new(n, &matrix.concat());
        check(&mut draw, &Operator::Dense(Arc::new(dense)), &matrix);
    }

    #[test]
    fn spins_turn_as_their_matrix_says(seed: u64, length in 1_u8..11, up: u32) {
        let mut draw = Draw(seed);
        let (bonds, fields) = bonds(&mut draw, length);
        for up in [None, Some(up % u32::from(length + 1))] {
            let spins = Operator::Spins(Arc::new(Spins::new(&bonds, &fields, up)));
            check(&mut draw, &spins, &chain(&bonds, &fields, up));
        }
    }
}

fn moves(draw: &mut Draw, count: usize) -> Vec<Move> {
    let mut one = |k| Move {
        into_second: if draw.below(8) == 0 {
            k % 2 == 0
        } else {
            k % 2 == 1
        },
        update: UPDATES[draw.below(4)],
        weight: draw.next(),
        copy: k,
    };
    (0..count).map(&mut one).collect()
}

/// a, b and their sums after some moves, of which each is made by itself.
fn one_by_one<S: Stored>(operator: &Operator, moves: &[Move], start: &[Vec<S>; 4]) -> [Vec<S>; 4] {
    let [mut a, mut b, mut sum_a, mut sum_b] = start.clone();
    for step in moves {
        let (x, out, sum) = if step.into_second {
            (&a, &mut b, &mut sum_b)
        } else {
            (&b, &mut a, &mut sum_a)
        };
        *out = updated(
            (operator, InstructionSet::default()),
            step.update,
            x.len(),
            x,
            out,
        );
        for (sum, out) in sum.iter_mut().zip(&*out) {
            for m in 0..S::MEMBERS {
                sum.set_member(m, sum.member(m) + step.weight * out.member(m));
            }
        }
    }
    [a, b, sum_a, sum_b]
}

fn swept<S: Stored>(sweeper: &mut Sweeper<S>, moves: &[Move], start: &[Vec<S>; 4]) -> [Vec<S>; 4] {
    let mut all = start.clone();
    let [a, b, sum_a, sum_b] = &mut all;
    sweeper
        .run(moves, a, b, Sink::Sums(sum_a, sum_b))
        .expect("products can be made");
    all
}

/// Sums of what moves make at some outputs, those of even places apart from those of odd ones.
fn summed<S: Stored>(
    sweeper: &mut Sweeper<S>,
    moves: &[Move],
    [a, b, ..]: &[Vec<S>; 4],
    weights: &[Vec<f64>],
) -> Vec<[Vec<S>; 2]> {
    let (n, count) = (a.len(), moves.len().next_multiple_of(2));
    let (mut block, mut outputs) = (TermBlock::default(), Outputs::default());
    block.reset(n, count).expect("memory");
    outputs.reset(n, weights.len()).expect("memory");
    let (mut a, mut b) = (a.clone(), b.clone());
    let made = sweeper.run(moves, &mut a, &mut b, block.sink());
    made.expect("products can be made");
    for weights in weights {
        block.push_weights(weights.iter().copied());
    }
    let added = sweeper.add_terms(&block, &mut outputs, false);
    added.expect("sums can be made");
    let read = |output: usize| {
        [0, 1].map(|part| {
            let mut sum = vec![S::splat(0.0); n];
            outputs.read(output, part, &mut sum);
            sum
        })
    };
    (0..weights.len()).map(read).collect()
}

/// The same by a sum for each output and move.
fn summed_one_by_one<S: Stored>(
    operator: &Operator,
    moves: &[Move],
    start: &[Vec<S>; 4],
    weights: &[Vec<f64>],
) -> Vec<[Vec<S>; 2]> {
    let zeros = || vec![S::splat(0.0); start[0].len()];
    let of = |weights: &Vec<f64>| {
        let mut sums = [zeros(), zeros()];
        for (k, weight) in weights.iter().enumerate() {
            let [a, b, ..] = one_by_one(operator, &moves[..=k], start);
            let made = if moves[k].into_second { b } else { a };
            for (sum, made) in sums[k % 2].iter_mut().zip(&made) {
                for m in 0..S::MEMBERS {
                    sum.set_member(m, sum.member(m) + weight * made.member(m));
                }
            }
        }
        sums
    };
    weights.iter().map(of).collect()
}

/// Compares sweeps in any way with moves one by one.
fn check_sweeps<S: Stored + PartialEq + std::fmt::Debug>(
    draw: &mut Draw,
    operator: &Operator,
    vector: impl Fn(&mut Draw) -> Vec<S>,
) {
    let start = std::array::from_fn(|_| vector(draw));
    let count = 1 + draw.below(12);
    let moves = moves(draw, count);
    let want = one_by_one(operator, &moves, &start);
    let mut of_output = |k: usize| {
        let taken = if k == 0 { count } else { draw.below(count) };
        draw.vector(taken)
    };
    let weights: Vec<_> = (0..3).map(&mut of_output).collect();
    let sums = summed_one_by_one(operator, &moves, &start, &weights);
    let hamiltonian = Arc::new(Hamiltonian::new(vec![operator.clone()]));
    for threads in [1, 2, 3] {
        let sweeper = Sweeper::new(Arc::clone(&hamiltonian)).with_threads(threads);
        assert_eq!(swept(&mut sweeper.clone(), &moves, &start), want);
        for _ in 0..4 {
            let (rows, at_once) = (1 + draw.below(operator.size()), 1 + draw.below(12));
            let mut sweeper = sweeper.clone().with_blocking(rows, at_once);
            let got = swept(&mut sweeper, &moves, &start);
            assert_eq!(got, want, "{rows} rows, {at_once} moves, {threads} threads");
            assert_eq!(summed(&mut sweeper.clone(), &moves, &start, &weights), sums);
            assert_eq!(sweeper.products(), count, "of each member");
        }
    }
}

proptest! {
    #![proptest_config(properties(32))]

    #[test]
    fn sweeps_are_moves_one_by_one(seed: u64, n in 1_usize..3000, most in 0_usize..40) {
        let mut draw = Draw(seed);
        let mut diagonals = diagonals(&mut draw, n);
        diagonals.retain(|(offset, _)| *offset <= most);
        let operator = Operator::Diagonals(Arc::new(Diagonals::new(n, &diagonals)));
        check_sweeps(&mut draw, &operator, |draw| draw.vector(n));
        check_sweeps(&mut draw, &operator, |draw| lanes(draw, n));
    }
}

#[test]
fn sweeps_of_far_reaching_terms_are_moves_one_by_one() {
    let mut draw = Draw(3);
    let (bonds, fields) = bonds(&mut draw, 9);
    for up in [None, Some(4)] {
        let spins = Operator::Spins(Arc::new(Spins::new(&bonds, &fields, up)));
        let n = spins.size();
        check_sweeps(&mut draw, &spins, |draw| draw.vector(n));
    }
}
