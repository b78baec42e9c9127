//! The inverse of P⁻¹ S, by Gauss and Jordan: at most sixteen rows, in registers as the nodes are.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::layout::Layout;
use super::tables::Tables;
use liouville_base::real::Scalar;

/// g_y and M⁻¹ r_λ at the nodes, and (P⁻¹ S)⁻¹: a column for each node 0..k−1 and constraint.
#[derive(Clone, Debug)]
pub(super) struct SchurInverse<L: Layout, const N: usize, const M: usize> {
    pub(super) g_y: [[L::Points; N]; M],
    pub(super) mass_r: [[L::Points; N]; M],
    columns: Vec<[L::Points; M]>,
    sides: [L::Points; M],
}

impl<L: Layout, const N: usize, const M: usize> SchurInverse<L, N, M> {
    pub(super) fn new(order: usize) -> Self {
        let zeros = [[L::zeros(); N]; M];
        Self {
            g_y: zeros,
            mass_r: zeros,
            columns: vec![[L::zeros(); M]; order],
            sides: [L::zeros(); M],
        }
    }

    /// Makes the inverse for the blocks there are, of m constraints.
    #[inline(always)]
    pub(super) fn invert(&mut self, tables: &Tables, (n, m): (usize, usize)) {
        let k = tables.intervals;
        let nodes = L::rows(k + 1);
        for l in 0..k {
            for d in 0..m {
                for c in 0..m {
                    for row in 0..nodes {
                        let mut sum = L::Row::splat(0.0);
                        for q in 0..n.min(N) {
                            let impulse = L::at(&self.mass_r[d][q], l).every();
                            sum += self.g_y[c][q].as_ref()[row] * impulse;
                        }
                        self.sides[c].as_mut()[row] = sum * L::factor(&tables.product[l], row);
                    }
                    let column = &mut self.columns[d * k + l][c];
                    let out = &mut column.as_mut()[..L::rows(k)];
                    L::sums(out, &tables.inverse_product, &self.sides[c]);
                }
            }
        }
        self.eliminate(k, m);
    }

    #[inline(always)]
    fn eliminate(&mut self, k: usize, m: usize) {
        let rows = L::rows(k);
        for c in 0..m {
            for l in 0..k {
                let p = c * k + l;
                let pivot = self.columns[p];
                let inverse = L::splat(1.0) / L::at(&pivot[c], l);
                for (j, column) in self.columns.iter_mut().enumerate() {
                    if j == p {
                        continue;
                    }
                    let factor = L::at(&column[c], l) * inverse;
                    let every = factor.every();
                    for d in 0..m {
                        let of = pivot[d].as_ref();
                        replace::<L>(
                            &mut column[d],
                            rows,
                            (d == c).then_some((l, factor)),
                            #[inline(always)]
                            |row, x| x - every * of[row],
                        );
                    }
                }
                let every = (-inverse).every();
                for d in 0..m {
                    replace::<L>(
                        &mut self.columns[p][d],
                        rows,
                        (d == c).then_some((l, inverse)),
                        #[inline(always)]
                        |_, x| x * every,
                    );
                }
            }
        }
    }

    /// Writes dΛ for these right-hand sides at the nodes 1..k.
    #[inline(always)]
    pub(super) fn solve(
        &mut self,
        tables: &Tables,
        sides: &[L::Points; M],
        d_lam: &mut [L::Points; M],
        m: usize,
    ) {
        let (k, rows) = (tables.intervals, L::rows(tables.intervals));
        for c in 0..m {
            L::sums(
                &mut self.sides[c].as_mut()[..rows],
                &tables.inverse_product,
                &sides[c],
            );
        }
        for c in 0..m {
            for row in 0..rows {
                let mut sum = L::Row::splat(0.0);
                for d in 0..m {
                    let [mut even, mut odd] = [L::Row::splat(0.0); 2];
                    for (l, column) in self.columns[d * k..][..k].iter().enumerate() {
                        let x = L::at(&self.sides[d], l).every();
                        let term = column[c].as_ref()[row] * x;
                        if l % 2 == 0 {
                            even += term;
                        } else {
                            odd += term;
                        }
                    }
                    sum += even + odd;
                }
                d_lam[c].as_mut()[row] = sum;
            }
        }
    }
}

/// Sets the value at one point, if any, and makes those at the others of what they were.
#[inline(always)]
fn replace<L: Layout>(
    points: &mut L::Points,
    rows: usize,
    value: Option<(usize, L)>,
    others: impl Fn(usize, L::Row) -> L::Row,
) {
    if let Some(value) = value {
        return L::replace(points, rows, value, others);
    }
    for (row, x) in points.as_mut()[..rows].iter_mut().enumerate() {
        *x = others(row, *x);
    }
}
