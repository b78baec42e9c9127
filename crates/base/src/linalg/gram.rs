//! Matrices A W Bᵀ, of two sparse matrices with one pattern and a diagonal W between them.

use super::elimination::Elimination;
use super::{Factor, Pattern, Singular};

/// A W Bᵀ, factored; W is taken to be in B already.
///
/// It is symmetric where A and B are equal, and nearly so where they nearly are: then chains, trees and
/// rings of couplings are eliminated without pivoting, at a cost of a few operations each.
#[derive(Clone, Debug)]
pub struct Gram {
    /// Where each value's products start; one more than there are values.
    starts: Vec<u32>,
    /// Entries of A and B whose product it is.
    products: Vec<(u32, u32)>,
    solver: Solver,
}

/// Where a product goes, and which entries of A and B it is of.
type Product = ((usize, usize), (u32, u32));

#[derive(Clone, Debug)]
enum Solver {
    Eliminated(Elimination),
    Pivoted {
        pattern: Pattern,
        values: Vec<f64>,
        factor: Factor,
    },
}

impl Gram {
    /// Memory for A and B of this pattern, whose entries stand column by column.
    ///
    /// # Panics
    /// When they do not.
    pub fn new(pattern: &Pattern) -> Self {
        let entries = pattern.entries();
        assert!(
            entries.is_sorted_by_key(|(_, col)| *col),
            "order of entries"
        );
        let mut products: Vec<Product> = Vec::new();
        let mut first = 0;
        for column in entries.chunk_by(|a, b| a.1 == b.1) {
            for (i, (row, _)) in column.iter().enumerate() {
                for (j, (col, _)) in column.iter().enumerate() {
                    #[allow(clippy::cast_possible_truncation)]
                    // more entries would not fit in memory
                    products.push(((*row, *col), ((first + i) as u32, (first + j) as u32)));
                }
            }
            first += column.len();
        }
        products.sort_unstable();
        let rows = pattern.shape().0;
        let mut places: Vec<(usize, usize)> = products.iter().map(|(place, _)| *place).collect();
        places.dedup();
        let couplings = Pattern {
            rows,
            cols: rows,
            entries: places,
        };
        let count = couplings.len();
        let elimination = Elimination::new(&couplings);
        let slots = match &elimination {
            Some(elimination) => elimination.slots(&couplings),
            None => (0..count).collect(),
        };
        let solver = match elimination {
            Some(elimination) => Solver::Eliminated(elimination),
            None => Solver::Pivoted {
                factor: Factor::new(&couplings),
                values: vec![0.0; count],
                pattern: couplings,
            },
        };
        let mut gram = Self {
            starts: vec![0],
            products: Vec::with_capacity(products.len()),
            solver,
        };
        gram.lay_out(&products, &slots);
        gram
    }

    /// Puts products, in groups by their place, in the order of the values they make.
    fn lay_out(&mut self, products: &[Product], slots: &[usize]) {
        let mut of_slot = vec![&products[..0]; self.values_mut().len()];
        for (slot, group) in slots.iter().zip(products.chunk_by(|a, b| a.0 == b.0)) {
            of_slot[*slot] = group;
        }
        for group in of_slot {
            self.products.extend(group.iter().map(|(_, pair)| *pair));
            #[allow(clippy::cast_possible_truncation)]
            self.starts.push(self.products.len() as u32);
        }
    }

    fn values_mut(&mut self) -> &mut [f64] {
        match &mut self.solver {
            Solver::Eliminated(elimination) => elimination.values_mut(),
            Solver::Pivoted { values, .. } => values,
        }
    }

    /// Factors the product of A and B with these values.
    ///
    /// # Errors
    /// The first column without a pivot.
    pub fn factor(&mut self, a: &[f64], b: &[f64]) -> Result<(), Singular> {
        self.multiply(a, b, false);
        self.eliminate()
    }

    /// Factors the product of A and W A, with these values, which is symmetric.
    ///
    /// # Errors
    /// The first column without a pivot.
    pub fn factor_symmetric(&mut self, a: &[f64], w_a: &[f64]) -> Result<(), Singular> {
        self.multiply(a, w_a, true);
        self.eliminate()
    }

    fn multiply(&mut self, a: &[f64], b: &[f64], is_symmetric: bool) {
        let values = match &mut self.solver {
            Solver::Eliminated(elimination) if is_symmetric => elimination.lower_mut(),
            Solver::Eliminated(elimination) => elimination.values_mut(),
            Solver::Pivoted { values, .. } => values,
        };
        let mut start = 0;
        for (value, end) in values.iter_mut().zip(&self.starts[1..]) {
            let end = *end as usize;
            let products = self.products[start..end].iter();
            *value = products.fold(0.0, |sum, (i, j)| sum + a[*i as usize] * b[*j as usize]);
            start = end;
        }
        if let (Solver::Eliminated(elimination), true) = (&mut self.solver, is_symmetric) {
            elimination.mirror();
        }
    }

    fn eliminate(&mut self) -> Result<(), Singular> {
        match &mut self.solver {
            Solver::Eliminated(elimination) => elimination.factor(),
            Solver::Pivoted {
                pattern,
                values,
                factor,
            } => factor.factor(pattern, values),
        }
    }

    /// Solves `(A W Bᵀ) x = b` in place.
    #[inline]
    pub fn solve(&mut self, b: &mut [f64]) {
        match &mut self.solver {
            Solver::Eliminated(elimination) => elimination.solve(b),
            Solver::Pivoted { factor, .. } => factor.solve(b),
        }
    }
}
