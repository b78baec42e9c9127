//! Bounds of the eigenvalues of Σ_k w_k B_k, by those of the parts B_k and closer ones where they are known.
//!
//! λ_max is convex in the weights, and λ_min concave. So bounds at the corners of a cell of B_0 + Σ f_k B_k hold inside
//! it, as does what is linear in each f_k between them.

/// An interval of energies.
pub(super) type Interval = (f64, f64);

/// The parts of a Hamiltonian H(t) = Σ f_k(t) B_k, the first of which has the weight 1, and their bounds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TermBounds {
    /// How many terms each part has: terms of a part have their weight in common.
    pub groups: Vec<usize>,
    /// Bounds of the eigenvalues of each part.
    pub parts: Vec<(f64, f64)>,
    /// Bounds of H at any time, where they are known.
    pub given: Option<(f64, f64)>,
    /// Values of each f_k, in order, that make the corners of a grid; empty without one.
    pub axes: Vec<Vec<f64>>,
    /// Bounds of B_0 + Σ f_k B_k at these, the last f_k first.
    pub corners: Vec<(f64, f64)>,
    /// Start and end of a run, over which the f_k are looked at; equal where they are not.
    pub span: (f64, f64),
    /// Times of samples, at which splines bend and are looked at besides, in order.
    pub knots: Vec<f64>,
    /// Other times at which the f_k are looked at, as those of outputs, in order.
    pub outputs: Vec<f64>,
    /// Densities at which a potential of the density is looked at.
    pub densities: Vec<f64>,
    /// Whether flows of all parts are exact, so that no period of H counts.
    pub is_split: bool,
}

fn sum(a: Interval, b: Interval) -> Interval {
    (a.0 + b.0, a.1 + b.1)
}

/// Half the width of a spectrum, where it has one.
pub(super) fn half((low, high): Interval) -> f64 {
    (0.5 * (high - low))
        .max(8.0 * f64::EPSILON * low.abs().max(high.abs()))
        .max(1e-290)
}

/// An interval times a number.
pub(super) fn scaled(factor: f64, (low, high): Interval) -> Interval {
    let (a, b) = (factor * low, factor * high);
    (a.min(b), a.max(b))
}

/// The numbers that are in both of two intervals; the first one where there are none, as the other is wrong.
pub(super) fn both(a: Interval, b: Interval) -> Interval {
    let found = (a.0.max(b.0), a.1.min(b.1));
    if found.0 <= found.1 { found } else { a }
}

impl TermBounds {
    /// Whether these are parts of so many terms, each with its bounds.
    pub fn is_fitting(&self, terms: usize) -> bool {
        let corners = self.axes.iter().map(Vec::len).product::<usize>();
        let has_corners = self.axes.len() + 1 == self.parts.len() && corners == self.corners.len();
        self.groups.iter().sum::<usize>() == terms
            && !self.groups.contains(&0)
            && self.parts.len() == self.groups.len()
            && (self.axes.is_empty() && self.corners.is_empty() || has_corners && corners > 0)
    }

    /// Norms of the parts at most: those of differences of corners, where these are smaller.
    pub(super) fn norms(&self) -> Vec<f64> {
        let of_part = |(low, high): &Interval| low.abs().max(high.abs());
        let mut found: Vec<f64> = self.parts.iter().map(of_part).collect();
        let mut stride = self.corners.len();
        for (axis, norm) in self.axes.iter().zip(found.iter_mut().skip(1)) {
            stride /= axis.len();
            let (last, width) = (axis.len() - 1, axis[axis.len() - 1] - axis[0]);
            if width > 0.0 {
                let (a, b) = (self.corners[0], self.corners[last * stride]);
                *norm = norm.min(of_part(&(b.0 - a.1, b.1 - a.0)) / width);
            }
        }
        found
    }

    /// The weights of the parts, by those of all terms.
    pub(super) fn weights<'a>(&'a self, terms: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let mut next = 0;
        self.groups.iter().map(move |count| {
            next += count;
            terms[next - count]
        })
    }

    /// Bounds of a sum of the parts with these weights.
    pub(super) fn of(&self, weights: &[f64]) -> Interval {
        let added = self.of_parts(weights, &[]);
        match self.by_corners(weights) {
            Some(closer) => both(added, closer),
            None => added,
        }
    }

    /// The same with a potential, by the parts alone.
    pub(super) fn of_parts(&self, weights: &[f64], potential: &[f64]) -> Interval {
        let parts = weights.iter().zip(&self.parts);
        parts.fold(range(potential), |all, (w, part)| {
            sum(all, scaled(*w, *part))
        })
    }

    /// Bounds by the corners of the cell that f_k = w_k / w_0 are in, and by the parts for what they are outside of all.
    fn by_corners(&self, weights: &[f64]) -> Option<Interval> {
        let (first, others) = weights.split_first()?;
        if self.axes.is_empty() || *first == 0.0 {
            return None;
        }
        let mut beyond = (0.0, 0.0);
        for ((weight, axis), part) in others.iter().zip(&self.axes).zip(&self.parts[1..]) {
            let inside = (weight / first).clamp(axis[0], axis[axis.len() - 1]);
            beyond = sum(beyond, scaled(weight - first * inside, *part));
        }
        let mut inside = (0.0, 0.0);
        for corner in 0..1_usize << others.len() {
            let (mut part, mut place) = (1.0, 0);
            for (k, (weight, axis)) in others.iter().zip(&self.axes).enumerate() {
                let value = (weight / first).clamp(axis[0], axis[axis.len() - 1]);
                let after = axis
                    .partition_point(|x| *x < value)
                    .clamp(1, axis.len().max(2) - 1);
                let (low, high) = (axis[after - 1], axis[after.min(axis.len() - 1)]);
                let upper = if high > low {
                    (value - low) / (high - low)
                } else {
                    0.0
                };
                let is_upper = corner >> k & 1 == 1;
                part *= if is_upper { upper } else { 1.0 - upper };
                let index = (after - usize::from(!is_upper)).min(axis.len() - 1);
                place = place * axis.len() + index;
            }
            if part > 0.0 {
                inside = sum(inside, scaled(part, self.corners[place]));
            }
        }
        Some(sum(scaled(*first, inside), beyond))
    }

    /// The same with a potential, for H at one time: a row of the weights and of the potential.
    pub(super) fn at(&self, row: &[f64]) -> Interval {
        let (weights, potential) = row.split_at(self.groups.len());
        self.of_sum(weights, potential, &[1.0])
    }

    /// The norm of a row of changes of these, in energies.
    pub(super) fn size(&self, row: &[f64]) -> f64 {
        let (weights, potential) = row.split_at(self.groups.len());
        let of_groups = weights.iter().zip(&self.parts);
        let sum: f64 = of_groups
            .map(|(weight, (low, high))| weight.abs() * low.abs().max(high.abs()))
            .sum();
        sum + potential.iter().fold(0.0, |most: f64, v| most.max(v.abs()))
    }

    /// The same for a sum of H at several times, each times its number of a row.
    pub(super) fn of_sum(&self, weights: &[f64], potential: &[f64], row: &[f64]) -> Interval {
        let found = sum(self.of(weights), range(potential));
        let Some(given) = self.given else {
            return found;
        };
        let sums = row.iter().map(|a| scaled(*a, given));
        both(found, sums.fold((0.0, 0.0), sum))
    }
}

/// The least and the largest value of a potential, which may be empty.
pub(super) fn range(potential: &[f64]) -> Interval {
    let least = potential.iter().copied().reduce(f64::min);
    let largest = potential.iter().copied().reduce(f64::max);
    (least.unwrap_or(0.0), largest.unwrap_or(0.0))
}
