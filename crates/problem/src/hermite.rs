//! Polynomials through values and derivatives at several points; see [`super::dense`] for their use.

/// A polynomial through values and derivatives at several knots: Newton's form, on divided differences.
#[derive(Clone, Debug, Default)]
pub(super) struct Newton {
    nodes: Vec<f64>,
    coefficients: Vec<f64>,
}

impl Newton {
    /// The polynomial in τ that at each knot has this value and these derivatives with respect to t = h τ.
    pub(super) fn fit<'a, const K: usize>(
        &mut self,
        h: f64,
        knots: &(impl Iterator<Item = (f64, &'a [Vec<f64>; K])> + Clone),
    ) {
        self.nodes.clear();
        self.coefficients.clear();
        for (x, known) in knots.clone() {
            for _ in 0..K {
                self.nodes.push(x);
                self.coefficients.extend_from_slice(&known[0]);
            }
        }
        let m = self.nodes.len();
        let n = self.coefficients.len() / m;
        for level in 1..m {
            for i in (level..m).rev() {
                let (head, row) = self.coefficients.split_at_mut(i * n);
                if i % K >= level {
                    let (_, known) = knots.clone().nth(i / K).unwrap_or_else(|| unreachable!());
                    let scale = if level == 1 { h } else { h * h / 2.0 };
                    row.iter_mut()
                        .zip(&known[level])
                        .for_each(|(c, x)| *c = scale * x);
                } else {
                    let distance = self.nodes[i] - self.nodes[i - level];
                    let before = &head[(i - 1) * n..];
                    row[..n]
                        .iter_mut()
                        .zip(before)
                        .for_each(|(c, x)| *c = (*c - x) / distance);
                }
            }
        }
    }

    /// Value and derivative of component `k` at `x`.
    pub(super) fn at(&self, k: usize, x: f64) -> (f64, f64) {
        let n = self.coefficients.len() / self.nodes.len();
        let (mut value, mut slope) = (0.0, 0.0);
        for (i, node) in self.nodes.iter().enumerate().rev() {
            slope = slope * (x - node) + value;
            value = value * (x - node) + self.coefficients[i * n + k];
        }
        (value, slope)
    }
}
