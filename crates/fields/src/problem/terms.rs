//! Sparse polynomials: the terms of each row one after another.

use super::Malformed;
use std::ops::Range;

/// Several polynomials in the same variables.
#[derive(Clone, Debug, PartialEq)]
pub struct Polynomials {
    variables: usize,
    /// Where the terms of each row begin, and where the last ones end.
    rows: Vec<usize>,
    coefficients: Vec<f64>,
    /// Where the factors of each term begin, and where the last ones end.
    terms: Vec<usize>,
    factors: Vec<u32>,
}

impl Polynomials {
    /// Polynomials from their terms in any order; those of a row keep theirs.
    ///
    /// term k belongs to row `term_rows[k]`, and is `coefficients[k]` times the variables
    /// `factors[k * width .. (k + 1) * width]`, of which negative ones are absent.
    ///
    /// # Errors
    /// The first row, factor or coefficient that cannot be one.
    pub fn new(
        rows: usize,
        variables: usize,
        term_rows: &[usize],
        coefficients: &[f64],
        factors: &[i64],
        width: usize,
    ) -> Result<Self, Malformed> {
        size("coefficients", coefficients.len(), term_rows.len())?;
        size("factors", factors.len(), width * term_rows.len())?;
        if variables > 1 << 31 {
            return Err(Malformed::TooLarge);
        }
        finite("coefficient", coefficients)?;
        let mut starts = vec![0; rows + 1];
        for (term, &row) in term_rows.iter().enumerate() {
            if row >= rows {
                return Err(Malformed::Row { term, row, rows });
            }
            starts[row + 1] += 1;
        }
        for row in 0..rows {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let mut sorted = vec![0; term_rows.len()];
        for (term, &row) in term_rows.iter().enumerate() {
            sorted[next[row]] = term;
            next[row] += 1;
        }
        let mut polynomials = Self {
            variables,
            rows: starts,
            coefficients: Vec::with_capacity(term_rows.len()),
            terms: Vec::with_capacity(term_rows.len() + 1),
            factors: Vec::new(),
        };
        polynomials.terms.push(0);
        for term in sorted {
            let factors = &factors[term * width..(term + 1) * width];
            polynomials.push(term, coefficients[term], factors)?;
        }
        Ok(polynomials)
    }

    fn push(&mut self, term: usize, coefficient: f64, factors: &[i64]) -> Result<(), Malformed> {
        for &factor in factors.iter().filter(|factor| **factor >= 0) {
            let index = u32::try_from(factor).ok();
            match index.filter(|index| (*index as usize) < self.variables) {
                Some(index) => self.factors.push(index),
                None => {
                    return Err(Malformed::Factor {
                        term,
                        factor,
                        variables: self.variables,
                    });
                }
            }
        }
        self.coefficients.push(coefficient);
        self.terms.push(self.factors.len());
        Ok(())
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows.len() - 1
    }

    /// Number of variables the factors are chosen from.
    pub fn variables(&self) -> usize {
        self.variables
    }

    /// Number of terms.
    pub fn terms(&self) -> usize {
        self.coefficients.len()
    }

    /// The terms of a row: coefficients and factors.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (f64, &[u32])> + Clone {
        let terms: Range<usize> = self.rows[row]..self.rows[row + 1];
        terms.map(|term| {
            let factors = self.terms[term]..self.terms[term + 1];
            (self.coefficients[term], &self.factors[factors])
        })
    }

    /// The number of the first term of a row.
    pub fn first(&self, row: usize) -> usize {
        self.rows[row]
    }

    /// All factors of a row, with repetitions.
    pub fn row_factors(&self, row: usize) -> &[u32] {
        let (first, last) = (self.rows[row], self.rows[row + 1]);
        &self.factors[self.terms[first]..self.terms[last]]
    }
}

/// Refuses a size that is not the one wanted.
pub(super) fn size(name: &'static str, found: usize, wanted: usize) -> Result<(), Malformed> {
    if found == wanted {
        Ok(())
    } else {
        Err(Malformed::Size {
            name,
            found,
            wanted,
        })
    }
}

/// Refuses values that are not finite.
pub(super) fn finite(name: &'static str, values: &[f64]) -> Result<(), Malformed> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(Malformed::NotFinite { name, index }),
        None => Ok(()),
    }
}
