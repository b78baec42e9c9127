//! Rows of a matrix that depend on one another, to name in an error.

use super::choice::LARGEST_DENSE_RANK;
use super::{Matrix, Pattern, Sparse, add_scaled, max_norm};

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

/// [`dependent_rows`] of a sparse matrix; where it is large, more than one dependency may be in what is named.
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
