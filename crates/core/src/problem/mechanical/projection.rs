//! Start values moved onto their constraints by the least change in the mass metric.
//!
//! Gauss–Newton on c(x) = 0: each correction is the smallest in the metric W,
//!
//!     dx = W⁻¹ cᵀ_x μ,   (c_x W⁻¹ cᵀ_x) μ = −c

use crate::linalg::{Lu, Matrix, Pattern, dependent_rows, max_norm};
use crate::newton::{self, Equations};
use crate::tape::{Registers, Tape};
use crate::trouble::{Quantity, Trouble};

/// Equations to be met, by tapes (x, held, params) → c, `c_x` and the diagonal blocks of the metric.
#[derive(Clone, Debug)]
pub struct Projection {
    /// (x, held) → c
    pub residual: Tape,
    /// (x, held) → `c_x` on its pattern
    pub jacobian: Tape,
    /// Where `c_x` is not zero.
    pub pattern: Pattern,
    /// (x, held) → W, row by row
    pub metric: Tape,
}

struct Solve<'a> {
    projection: &'a Projection,
    registers: [Registers<f64>; 3],
    held: &'a [f64],
    x: Vec<f64>,
    metric: Lu,
    normal: Lu,
}

/// The point nearest to `x` where the projection's equations hold.
///
/// # Errors
/// The equations are not finite or dependent, or no such point is found near `x`.
///
/// # Panics
/// When an argument has not the size of the tapes' input.
pub fn project(
    projection: &Projection,
    x: &[f64],
    held: &[f64],
    params: &[f64],
) -> Result<Vec<f64>, Trouble> {
    let (c, n) = projection.pattern.shape();
    let mut solve = Solve {
        projection,
        registers: [
            &projection.residual,
            &projection.jacobian,
            &projection.metric,
        ]
        .map(|tape| tape.bind(params)),
        held,
        x: x.to_vec(),
        metric: Lu::new(n),
        normal: Lu::new(c),
    };
    newton::solve(&mut solve, 100)?;
    Ok(solve.x)
}

impl Equations for Solve<'_> {
    fn correct(&mut self) -> Result<f64, Trouble> {
        let (rows, n) = self.projection.pattern.shape();
        let args: [&[f64]; 2] = [&self.x, self.held];
        let [residual, jacobian, metric] = &mut self.registers;
        let c = self.projection.residual.eval(residual, args);
        let c_x = self.projection.jacobian.eval(jacobian, args);
        let metric = self.projection.metric.eval(metric, args);
        let not_finite = |quantity| {
            move |index| Trouble::NotFinite {
                quantity,
                index,
                t: f64::NAN,
            }
        };
        if let Some(index) = c.iter().position(|c| !c.is_finite()) {
            return Err(not_finite(Quantity::Constraint)(index));
        }
        if let Some(index) = c_x
            .iter()
            .chain(metric)
            .position(|value| !value.is_finite())
        {
            return Err(not_finite(Quantity::Derivative)(index));
        }
        self.metric.matrix_mut().flat_mut().copy_from_slice(metric);
        self.metric
            .factor()
            .map_err(|singular| Trouble::SingularMass {
                coordinate: singular.column,
            })?;
        let mut dense = Matrix::zeros(rows, n);
        self.projection.pattern.add_to(c_x, 1.0, &mut dense, 0, 0);
        let mut columns = dense.clone();
        for k in 0..rows {
            self.metric.solve(columns.row_mut(k));
        }
        let normal = self.normal.matrix_mut();
        for i in 0..rows {
            for j in 0..rows {
                normal[(i, j)] = dense
                    .row(i)
                    .iter()
                    .zip(columns.row(j))
                    .map(|(a, b)| a * b)
                    .sum();
            }
        }
        let mut mu: Vec<f64> = c.iter().map(|c| -c).collect();
        self.normal.factor().map_err(|_| {
            dependent_rows(dense).map_or(Trouble::SingularNewton, |constraints| {
                Trouble::Redundant { constraints }
            })
        })?;
        self.normal.solve(&mut mu);
        let mut dx = vec![0.0; n];
        for (k, mu) in mu.iter().enumerate() {
            crate::linalg::add_scaled(&mut dx, *mu, columns.row(k));
        }
        self.x.iter_mut().zip(&dx).for_each(|(x, dx)| *x += dx);
        let size = max_norm(&dx);
        Ok(if size == 0.0 {
            0.0
        } else {
            size / max_norm(&self.x).max(size)
        })
    }
}
