//! Rows of a matrix that depend on one another, to name in an error or to leave out.

use super::choice::LARGEST_DENSE_RANK;
use super::{Matrix, Pattern, Sparse, add_scaled, dot, max_norm};

/// The part of a row of length one that makes it clearly independent of those before it.
const CLEAR: f64 = 1e-3;

/// The rows of a matrix that are kept as independent of one another.
#[derive(Clone, Debug, PartialEq)]
pub struct IndependentRows {
    /// Which they are, in their order.
    pub kept: Vec<usize>,
    /// The least part of a kept row, of length one, that is orthogonal to the rows kept before it.
    pub least: f64,
    /// Largest orthogonal part of a rejected row.
    pub left: f64,
}

/// Rows that are independent of one another, as many as there are: of dependent ones the first.
///
/// Each row has length one; a row whose part orthogonal to the rows kept is at most `cutoff` counts as dependent.
/// Rows that are clearly independent of those before them go first, so that which are kept does not depend on small
/// changes of the matrix.
///
/// Modified Gram–Schmidt, each part taken off twice, since once leaves roundoff times the condition.
/// Source: Björck, BIT 7 (1967), 1–21.
pub fn independent_rows(mut matrix: Matrix, cutoff: f64) -> IndependentRows {
    let rows = matrix.rows();
    let length = |matrix: &Matrix, i: usize| dot(matrix.row(i), matrix.row(i)).sqrt();
    for i in 0..rows {
        let size = length(&matrix, i);
        let unit = if size > 0.0 { size.recip() } else { 0.0 };
        matrix.row_mut(i).iter_mut().for_each(|x| *x *= unit);
    }
    let (mut kept, mut least) = (Vec::new(), 1.0_f64);
    let mut is_open = vec![true; rows];
    for enough in [CLEAR.max(cutoff), cutoff] {
        for i in 0..rows {
            let size = length(&matrix, i);
            if !is_open[i] || size <= enough {
                continue;
            }
            is_open[i] = false;
            least = least.min(size);
            kept.push(i);
            let along: Vec<f64> = matrix.row(i).iter().map(|x| x / size).collect();
            for row in (0..rows).filter(|row| is_open[*row]) {
                for _ in 0..2 {
                    let row = matrix.row_mut(row);
                    add_scaled(row, -dot(row, &along), &along);
                }
            }
        }
    }
    let open = (0..rows).filter(|i| is_open[*i]);
    let left = open.fold(0.0, |left, i| length(&matrix, i).max(left));
    kept.sort_unstable();
    IndependentRows { kept, least, left }
}

/// Rows whose combination vanishes: the first row that depends on those before it, and those it needs.
///
/// Each row is measured by its own largest entry, and roundoff is taken to be √ε of it.
pub fn dependent_rows(mut matrix: Matrix) -> Option<Vec<usize>> {
    let (rows, cols) = (matrix.rows(), matrix.cols());
    let tiny = f64::EPSILON.sqrt();
    let mut combination = Matrix::from_fn(rows, rows, |i, j| f64::from(u8::from(i == j)));
    let mut pivots: Vec<(usize, usize)> = Vec::new();
    for i in 0..rows {
        let scale = max_norm(matrix.row(i));
        if scale == 0.0 {
            return Some(vec![i]);
        }
        matrix.row_mut(i).iter_mut().for_each(|x| *x /= scale);
        for &(k, col) in &pivots {
            let factor = -matrix[(i, col)] / matrix[(k, col)];
            for eliminated in [&mut matrix, &mut combination] {
                let above = eliminated.row(k).to_vec();
                add_scaled(eliminated.row_mut(i), factor, &above);
            }
        }
        let row = matrix.row(i);
        let largest = (0..cols).max_by(|a, b| row[*a].abs().total_cmp(&row[*b].abs()));
        match largest {
            Some(col) if row[col].abs() > tiny => pivots.push((i, col)),
            _ => {
                let needed = |k: &usize| combination[(i, *k)].abs() > tiny;
                return Some((0..=i).filter(needed).collect());
            }
        }
    }
    None
}

/// [`dependent_rows`] of a sparse matrix; where it is large, the rows named may be of several dependencies.
///
/// Large, it is the null vector of [[1, Aᵀ], [A, 0]] that names them.
pub fn dependencies(pattern: &Pattern, values: &[f64]) -> Option<Vec<usize>> {
    let (rows, cols) = pattern.shape();
    if rows * cols <= LARGEST_DENSE_RANK {
        let mut dense = Matrix::zeros(rows, cols);
        pattern.add_to(values, 1.0, &mut dense, 0, 0);
        return dependent_rows(dense);
    }
    let mut scale = vec![0.0_f64; rows];
    for (&(row, _), value) in pattern.entries().iter().zip(values) {
        scale[row] = scale[row].max(value.abs());
    }
    if let Some(row) = scale.iter().position(|scale| *scale == 0.0) {
        return Some(vec![row]);
    }
    let each = || pattern.entries().iter().zip(values);
    let below = each().map(|(&(i, j), value)| ((cols + i, j), value / scale[i]));
    let right = each().map(|(&(i, j), value)| ((j, cols + i), value / scale[i]));
    let one = (0..cols).map(|k| ((k, k), 1.0));
    let (entries, values): (Vec<_>, Vec<_>) = one.chain(below).chain(right).unzip();
    let augmented = Pattern {
        rows: rows + cols,
        cols: rows + cols,
        entries,
    };
    let mut factor = Sparse::new(&augmented);
    factor.factor(&values).err()?;
    let parts = factor.null_vector().skip(cols);
    Some(
        parts
            .enumerate()
            .filter_map(|(row, part)| part.then_some(row))
            .collect(),
    )
}
