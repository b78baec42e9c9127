//! A linear map of a vector, as a list of elementary ones: forwards for tangents, transposed for cotangents.

/// y[to] += factor y[from]; where both are the same, y[to] *= factor.
#[derive(Clone, Copy, Debug)]
struct Operation {
    to: u32,
    from: u32,
    factor: f64,
}

/// A product of elementary maps, the first one applied first.
#[derive(Clone, Debug, Default)]
pub(super) struct LinearMap(Vec<Operation>);

impl LinearMap {
    /// How many elementary maps there are.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// Becomes the identity.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// y[to] += factor y[from]
    #[inline]
    pub(super) fn add(&mut self, to: usize, from: usize, factor: f64) {
        debug_assert_ne!(to, from, "an addition is of another number");
        if factor != 0.0 {
            self.push(to, from, factor);
        }
    }

    /// y[at] *= factor
    #[inline]
    pub(super) fn scale(&mut self, at: usize, factor: f64) {
        self.push(at, at, factor);
    }

    #[inline]
    #[allow(clippy::cast_possible_truncation)] // a split has fewer than 2^31 variables
    fn push(&mut self, to: usize, from: usize, factor: f64) {
        self.0.push(Operation {
            to: to as u32,
            from: from as u32,
            factor,
        });
    }

    /// y ← L y, of `width` vectors whose numbers are side by side.
    pub(super) fn apply(&self, width: usize, y: &mut [f64]) {
        for &Operation { to, from, factor } in &self.0 {
            let (to, from) = (to as usize * width, from as usize * width);
            if to == from {
                for y in &mut y[to..to + width] {
                    *y *= factor;
                }
                continue;
            }
            let (low, high) = y.split_at_mut(to.max(from));
            let (to, from) = if to < from {
                (&mut low[to..to + width], &high[..width])
            } else {
                (&mut high[..width], &low[from..from + width])
            };
            for (to, from) in to.iter_mut().zip(from) {
                *to += factor * from;
            }
        }
    }

    /// y ← Lᵀ y
    pub(super) fn apply_transposed(&self, y: &mut [f64]) {
        for &Operation { to, from, factor } in self.0.iter().rev() {
            let (to, from) = (to as usize, from as usize);
            if to == from {
                y[to] *= factor;
            } else {
                y[from] += factor * y[to];
            }
        }
    }
}
