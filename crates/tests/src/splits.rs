//! Random splits of every kind of piece, and their flows by plain loops. One file, since each kind is made and
//! followed here alone.

use liouville_base::tape::{Line, Op, Tape};
use liouville_fields::problem::{Formula, Function, Piece, Polynomials, Split};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// A generator of its own, so that a seed is a field.
pub struct Draw(u64);

impl Draw {
    pub fn new(seed: u64) -> Self {
        Self(seed ^ 0x9e37_79b9_7f4a_7c15)
    }

    pub fn below(&mut self, most: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 >> 33).unwrap_or(0) % most
    }

    /// Between -1 and 1.
    pub fn real(&mut self) -> f64 {
        self.below(1 << 20) as f64 / f64::from(1 << 19) - 1.0
    }

    pub fn reals(&mut self, count: usize) -> Vec<f64> {
        (0..count).map(|_| self.real()).collect()
    }

    pub fn permutation(&mut self, n: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..n).collect();
        for k in (1..n).rev() {
            order.swap(k, self.below(k + 1));
        }
        order
    }
}

/// A term as a front end has it: row, coefficient, factors.
pub type Term = (usize, f64, Vec<usize>);

/// The degree of the terms is at most 4.
const WIDTH: usize = 4;

pub fn polynomials(rows: usize, variables: usize, terms: &[Term]) -> Polynomials {
    let term_rows: Vec<usize> = terms.iter().map(|(row, ..)| *row).collect();
    let coefficients: Vec<f64> = terms
        .iter()
        .map(|(_, coefficient, _)| *coefficient)
        .collect();
    let factors = terms.iter().flat_map(|(.., factors)| {
        let mut padded = [-1; WIDTH];
        for (place, factor) in padded.iter_mut().zip(factors) {
            *place = i64::try_from(*factor).unwrap_or(-1);
        }
        padded
    });
    let factors: Vec<i64> = factors.collect();
    Polynomials::new(rows, variables, &term_rows, &coefficients, &factors, WIDTH)
        .expect("well-formed terms")
}

/// Terms in these variables for each row; coefficients 1 and -1 among them.
fn terms(draw: &mut Draw, rows: usize, of: &[usize]) -> Vec<Term> {
    let mut terms = Vec::new();
    for row in 0..rows {
        for _ in 0..draw.below(7) {
            let degree = if of.is_empty() {
                0
            } else {
                draw.below(WIDTH + 1)
            };
            let factors = (0..degree).map(|_| of[draw.below(of.len())]).collect();
            let coefficient = [1.0, -1.0, draw.real(), draw.real()][draw.below(4)];
            terms.push((row, coefficient, factors));
        }
    }
    terms
}

/// A cosine, or the sine of the same where there is one already.
fn wave(draw: &mut Draw, of: &[usize], like: Option<&Function>) -> Function {
    if let Some(Function {
        places,
        formula: Formula::Cosine { k, .. },
    }) = like
    {
        let (k, phase) = (k.clone(), -FRAC_PI_2);
        return cosine(places.clone(), k, phase);
    }
    let places: Vec<usize> = of.iter().take(2).copied().collect();
    let phase = [0.0, 3.0 * draw.real()][draw.below(2)];
    cosine(places.clone(), draw.reals(places.len()), phase)
}

/// cos(k x + phase)
pub fn cosine(places: Vec<usize>, k: Vec<f64>, phase: f64) -> Function {
    let formula = Formula::Cosine { k, phase };
    Function { places, formula }
}

/// y exp(x) of two variables.
pub fn growth(places: [usize; 2]) -> Function {
    let input = |element| Line::Input {
        slot: element,
        group: 0,
        element,
    };
    let apply = |op, slot, a, b| Line::Apply { op, slot, a, b };
    let output = |element, slot| Line::Output { element, slot };
    let lines = [
        input(0),
        input(1),
        apply(Op::Exp, 2, 0, 0),
        apply(Op::Mul, 3, 2, 1),
        output(0, 3),
    ];
    let tape =
        |outputs, lines: &[Line]| Arc::new(Tape::new(&[2, 0], outputs, lines).expect("a program"));
    Function {
        places: places.to_vec(),
        formula: Formula::Tape {
            value: tape(1, &lines),
            slopes: tape(2, &[&lines[..], &[output(1, 2)]].concat()),
            output: 0,
        },
    }
}

pub fn natural(draw: &mut Draw, n: usize, with_functions: bool) -> Piece {
    let mut rows = draw.permutation(n);
    let others = rows.split_off(1 + draw.below(n - 1));
    let mut change = terms(draw, rows.len(), &others);
    let mut functions = Vec::new();
    if with_functions {
        let first = wave(draw, &others, None);
        let second = wave(draw, &others, Some(&first));
        functions.extend([first, second]);
        change.push((0, draw.real(), vec![n + 1]));
        change.push((0, draw.real(), vec![others[0], n]));
        if let [x, y, ..] = others[..] {
            functions.push(growth([x, y]));
            change.push((0, 0.01 * draw.real(), vec![others[0], n + 2]));
        }
    }
    Piece::Natural {
        change: polynomials(rows.len(), n + functions.len(), &change),
        rows,
        functions,
    }
}

/// g of other variables, and of a_2 x_1 − a_1 x_2.
pub fn shear(draw: &mut Draw, n: usize) -> Piece {
    let mut places = draw.permutation(n);
    let others = places.split_off(2);
    let direction = draw.reals(2);
    let mut change = terms(draw, 1, &others);
    let (a, b) = (direction[1], -direction[0]);
    for (coefficient, factors) in [
        (a * a, [places[0], places[0]]),
        (2.0 * a * b, [places[0], places[1]]),
        (b * b, [places[1], places[1]]),
    ] {
        let common = others.first().copied();
        change.push((0, coefficient, factors.into_iter().chain(common).collect()));
    }
    let functions = vec![wave(draw, &others, None)];
    change.push((0, draw.real(), vec![n]));
    Piece::Shear {
        change: polynomials(1, n + 1, &change),
        places,
        direction,
        functions,
    }
}

pub fn scaling(draw: &mut Draw, n: usize) -> Piece {
    let mut rows = draw.permutation(n);
    let others = rows.split_off(2);
    let mut rate = terms(draw, 1, &others);
    rate.extend(
        rate.clone()
            .into_iter()
            .map(|(_, c, factors)| (1, -c, factors)),
    );
    let functions = vec![wave(draw, &others, None)];
    for (row, sign) in [(0, 1.0), (1, -1.0)] {
        rate.push((row, sign, vec![n]));
    }
    Piece::Scaling {
        rate: polynomials(2, n + 1, &rate),
        rows,
        functions,
    }
}

/// Of degree below 4; with small integer rates or without.
pub fn exponential(draw: &mut Draw, n: usize, with_integers: bool) -> Piece {
    let rows: Vec<usize> = draw.permutation(n).into_iter().take(3).collect();
    let mut monomial: Vec<usize> = (0..draw.below(4)).map(|_| draw.below(n)).collect();
    let weight = |row: &usize| monomial.iter().filter(|place| *place == row).count() as f64 + 1.0;
    let mut rates = if with_integers {
        let power = weight(&rows[2]);
        vec![
            power * (draw.below(7) as f64 - 3.0),
            power * (draw.below(7) as f64 - 3.0),
        ]
    } else {
        draw.reals(2)
    };
    let sum: f64 = rates
        .iter()
        .zip(&rows)
        .map(|(rate, row)| rate * weight(row))
        .sum();
    rates.push(-sum / weight(&rows[2]));
    let others: Vec<usize> = (0..n).filter(|v| !rows.contains(v)).collect();
    let functions = vec![wave(draw, &others, None)];
    monomial.push(n);
    Piece::Exponential {
        rows,
        rates,
        monomial,
        functions,
    }
}

/// Explicit methods: Euler's, the midpoint rule, and the classical one.
pub fn tableau(stages: usize) -> (Vec<f64>, Vec<f64>) {
    match stages {
        1 => (vec![0.0], vec![1.0]),
        2 => (vec![0.0, 0.0, 0.5, 0.0], vec![0.0, 1.0]),
        _ => {
            let mut a = vec![0.0; 16];
            (a[4], a[9], a[14]) = (0.5, 0.5, 1.0);
            (a, vec![1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0])
        }
    }
}

pub fn triangular(draw: &mut Draw, n: usize, stages: usize) -> Piece {
    let mut order = draw.permutation(n);
    let outside: Vec<usize> = order.split_off(n - draw.below(2));
    let mut change = Vec::new();
    for row in 0..order.len() {
        let known = [&outside[..], &order[..row]].concat();
        let mine = terms(draw, 1, &known);
        change.extend(mine.into_iter().map(|(_, c, factors)| (row, c, factors)));
    }
    let (a, b) = tableau(stages);
    Piece::Triangular {
        change: polynomials(order.len(), n, &change),
        order,
        a,
        b,
    }
}

pub fn affine(draw: &mut Draw, n: usize) -> Piece {
    let mut matrix = draw.reals(n * n);
    let trace: f64 = matrix.iter().step_by(n + 1).sum();
    matrix[0] -= trace;
    Piece::Affine {
        matrix,
        vector: draw.reals(n),
    }
}

/// w and e of other variables, and of a wave of these where there are any.
pub fn turn(draw: &mut Draw, n: usize) -> Piece {
    let mut rows = draw.permutation(n);
    let others = rows.split_off(3);
    let mut change = terms(draw, 6, &others);
    let mut functions = Vec::new();
    if !others.is_empty() {
        functions.push(wave(draw, &others, None));
        change.push((draw.below(6), draw.real(), vec![n]));
    }
    Piece::Turn {
        change: polynomials(6, n + functions.len(), &change),
        rows,
        functions,
        is_cayley: false,
    }
}

/// A piece of each kind.
pub fn every_kind(draw: &mut Draw, n: usize) -> Vec<Piece> {
    vec![
        natural(draw, n, false),
        natural(draw, n, true),
        shear(draw, n),
        scaling(draw, n),
        exponential(draw, n, false),
        exponential(draw, n, true),
        triangular(draw, n, 1),
        triangular(draw, n, 2),
        triangular(draw, n, 4),
        affine(draw, n),
        turn(draw, n),
    ]
}

/// x_i' = (x_{i+1} − x_{i−2}) x_{i−1} on a ring, every so many variables one piece.
pub fn lorenz(n: usize, colours: usize) -> Split {
    let piece = |colour: usize| {
        let rows: Vec<usize> = (colour..n).step_by(colours).collect();
        let mut terms = Vec::new();
        for (row, i) in rows.iter().enumerate() {
            let at = |d: usize| (i + n + d - 2) % n;
            terms.push((row, 1.0, vec![at(3), at(1)]));
            terms.push((row, -1.0, vec![at(0), at(1)]));
        }
        Piece::Natural {
            change: polynomials(rows.len(), n, &terms),
            rows,
            functions: Vec::new(),
        }
    };
    Split::new(n, (0..colours).map(piece).collect()).expect("independent rows")
}

/// The polynomials of a piece at x, term by term.
fn values(polynomials: &Polynomials, functions: &[Function], x: &[f64]) -> Vec<f64> {
    let factor = |factor: &u32| factor_at(*factor as usize, functions, x);
    let row = |row| {
        let terms = polynomials.row(row);
        terms
            .map(|(c, factors)| c * factors.iter().map(factor).product::<f64>())
            .sum()
    };
    (0..polynomials.rows()).map(row).collect()
}

/// A variable, or a function numbered after them.
fn factor_at(factor: usize, functions: &[Function], x: &[f64]) -> f64 {
    let Some(q) = factor.checked_sub(x.len()) else {
        return x[factor];
    };
    let arguments = functions[q].places.iter().map(|place| x[*place]);
    match &functions[q].formula {
        Formula::Cosine { k, phase } => {
            let argument: f64 = arguments.zip(k).map(|(x, k)| k * x).sum();
            (argument + phase).cos()
        }
        Formula::Tape { value, output, .. } => {
            let arguments: Vec<f64> = arguments.collect();
            value.eval(&mut value.bind(&[]), [&arguments])[*output]
        }
    }
}

/// h over the time in which a flow reaches infinity.
pub fn reach(piece: &Piece, h: f64, x: &[f64]) -> f64 {
    let Piece::Exponential {
        rows,
        rates,
        monomial,
        functions,
    } = piece
    else {
        return 0.0;
    };
    let factors = monomial.iter();
    let m: f64 = factors
        .map(|factor| factor_at(*factor, functions, x))
        .product();
    let power = |row| monomial.iter().filter(|place| *place == row).count() as f64;
    let parts = rows.iter().zip(rates).map(|(row, rate)| rate * power(row));
    parts.sum::<f64>() * h * m
}

/// The flow of a piece as its definition has it.
pub fn plain(piece: &Piece, is_adjoint: bool, h: f64, x: &mut [f64]) {
    match piece {
        Piece::Natural {
            rows,
            change,
            functions,
        } => {
            let change = values(change, functions, x);
            rows.iter()
                .zip(change)
                .for_each(|(row, change)| x[*row] += h * change);
        }
        Piece::Shear {
            places,
            direction,
            change,
            functions,
        } => {
            let g = values(change, functions, x)[0];
            places
                .iter()
                .zip(direction)
                .for_each(|(place, a)| x[*place] += h * g * a);
        }
        Piece::Scaling {
            rows,
            rate,
            functions,
        } => {
            let rate = values(rate, functions, x);
            rows.iter()
                .zip(rate)
                .for_each(|(row, rate)| x[*row] *= (h * rate).exp());
        }
        Piece::Exponential {
            rows,
            rates,
            monomial,
            functions,
        } => {
            let factors = monomial.iter();
            let m: f64 = factors
                .map(|factor| factor_at(*factor, functions, x))
                .product();
            let z = reach(piece, h, x);
            let phi = if z.abs() < 1e-12 {
                1.0 + z / 2.0
            } else {
                -(-z).ln_1p() / z
            };
            rows.iter()
                .zip(rates)
                .for_each(|(row, rate)| x[*row] *= (rate * h * m * phi).exp());
        }
        Piece::Triangular {
            order,
            change,
            a,
            b,
        } if is_adjoint => {
            adjoint(order, change, (a, b), h, x);
        }
        Piece::Triangular {
            order,
            change,
            a,
            b,
        } => {
            let mut slopes: Vec<Vec<f64>> = Vec::new();
            for r in 0..b.len() {
                let mut z = x.to_vec();
                for (k, row) in order.iter().enumerate() {
                    let earlier = slopes.iter().zip(&a[r * b.len()..]);
                    z[*row] += h * earlier.map(|(slope, a)| a * slope[k]).sum::<f64>();
                }
                slopes.push(values(change, &[], &z));
            }
            for (k, row) in order.iter().enumerate() {
                x[*row] += h * b
                    .iter()
                    .zip(&slopes)
                    .map(|(b, slope)| b * slope[k])
                    .sum::<f64>();
            }
        }
        Piece::Affine { matrix, vector } => affine_flow(matrix, vector, h, x),
        Piece::Turn {
            rows,
            change,
            functions,
            ..
        } => {
            let rates = values(change, functions, x);
            let (w, e) = rates.split_at(3);
            let matrix = [0.0, -w[2], w[1], w[2], 0.0, -w[0], -w[1], w[0], 0.0];
            let mut v: Vec<f64> = rows.iter().map(|row| x[*row]).collect();
            affine_flow(&matrix, e, h, &mut v);
            rows.iter().zip(v).for_each(|(row, v)| x[*row] = v);
        }
        Piece::Plane { .. } => unreachable!("random splits have no planes"),
    }
}

/// Forward substitution.
fn adjoint(order: &[usize], change: &Polynomials, (a, b): (&[f64], &[f64]), h: f64, x: &mut [f64]) {
    let s = b.len();
    let mut stages = vec![x.to_vec(); s];
    for (k, &row) in order.iter().enumerate() {
        let slopes: Vec<f64> = stages.iter().map(|z| values(change, &[], z)[k]).collect();
        x[row] += h * b
            .iter()
            .zip(&slopes)
            .map(|(b, slope)| b * slope)
            .sum::<f64>();
        for r in 0..s {
            let back: f64 = (0..r).map(|q| a[r * s + q] * slopes[q]).sum();
            stages[r][row] = x[row] - h * back;
        }
    }
}

/// The Taylor series, in many small steps.
fn affine_flow(matrix: &[f64], vector: &[f64], h: f64, x: &mut [f64]) {
    let (n, parts) = (x.len(), 64.0);
    for _ in 0..64 {
        let row = |i: usize, x: &[f64]| {
            matrix[i * n..][..n]
                .iter()
                .zip(x)
                .map(|(a, x)| a * x)
                .sum::<f64>()
        };
        let mut term: Vec<f64> = (0..n)
            .map(|i| h / parts * (row(i, x) + vector[i]))
            .collect();
        for order in 2..14 {
            x.iter_mut().zip(&term).for_each(|(x, term)| *x += term);
            term = (0..n)
                .map(|i| h / parts / f64::from(order) * row(i, &term))
                .collect();
        }
    }
}
