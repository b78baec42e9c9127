//! The flow of x_i' = c_i x_i m with m = x^j: with α = Σ c_i j_i is m' = α m², hence
//!
//!     x_i *= exp(c_i t*),   t* = −ln(1 − α h m)/α,   or h m where α = 0.
//!
//! Where α ≠ 0 this is (1 − α h m)^(−c_i/α); exponents that are multiples of 1, 1/2 or 1/3, as they are
//! for small integer rates, need a root and some products only.

#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::state::State;
use super::views::{FlowOf, multiply};
use liouville_base::real::Scalar;
use liouville_base::simd::{ForEach, Kernel, Number, SimdView, SimdViews};

/// A piece of one monomial.
#[derive(Clone, Debug)]
pub(super) struct Exponential {
    /// Places i and rates c_i.
    pub(super) rates: Vec<(u32, f64)>,
    /// The places in x^j, with repetition.
    pub(super) monomial: Vec<u32>,
    pub(super) alpha: f64,
    pub(super) roots: Option<Roots>,
    pair: Option<Pair>,
}

/// The places of a monomial of one variable, and of those that (1 - alpha h m)^2 multiplies and 1 - alpha h m divides.
#[derive(Clone, Copy, Debug)]
struct Pair {
    by: u32,
    squared: u32,
    divided: u32,
}

impl Pair {
    fn new(roots: &Roots, monomial: &[u32]) -> Option<Self> {
        let &[by] = monomial else {
            return None;
        };
        let (1, &[(squared, 2, 0), (divided, 0, 1)] | &[(divided, 0, 1), (squared, 2, 0)]) =
            (roots.q, &roots.powers[..])
        else {
            return None;
        };
        Some(Self {
            by,
            squared,
            divided,
        })
    }
}

/// Exponents −c_i/α = a − b/q.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Roots {
    pub(super) q: u32,
    /// Place, a and b of each variable.
    pub(super) powers: Vec<(u32, u32, u32)>,
}

/// Largest power that is computed by products.
const LARGEST_POWER: f64 = 12.0;

impl Roots {
    fn new(rates: &[(u32, f64)], alpha: f64) -> Option<Self> {
        (1..=3_u32).find_map(|q| {
            let powers = rates.iter().map(|(place, rate)| {
                let wanted = -rate / alpha * f64::from(q);
                let found = wanted.round();
                let is_near = (wanted - found).abs() <= 4.0 * f64::EPSILON * wanted.abs();
                let whole = (found / f64::from(q)).ceil().max(0.0);
                let rest = whole * f64::from(q) - found;
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 to 12
                (is_near && whole <= LARGEST_POWER && rest <= LARGEST_POWER).then_some((
                    *place,
                    whole as u32,
                    rest as u32,
                ))
            });
            let powers = powers.collect::<Option<Vec<_>>>()?;
            Some(Self { q, powers })
        })
    }
}

impl Exponential {
    pub(super) fn new(rates: Vec<(u32, f64)>, monomial: Vec<u32>) -> Self {
        let power = |at: u32| monomial.iter().filter(|place| **place == at).count() as f64;
        let parts = rates.iter().map(|(place, rate)| rate * power(*place));
        let (alpha, size) = parts.fold((0.0, 0.0), |(sum, size): (f64, f64), part| {
            (sum + part, size + part.abs())
        });
        // rates that cancel leave roundoff
        let alpha = if alpha.abs() <= 4.0 * f64::EPSILON * size {
            0.0
        } else {
            alpha
        };
        let roots = if alpha == 0.0 {
            None
        } else {
            Roots::new(&rates, alpha)
        };
        let pair = roots.as_ref();
        let pair = pair.and_then(|roots| Pair::new(roots, &monomial));
        Self {
            rates,
            monomial,
            alpha,
            roots,
            pair,
        }
    }

    /// The first trajectory, from `first` on, whose flow of length `h` reaches infinity.
    #[cold]
    pub(super) fn too_long<S: Scalar>(&self, h: f64, x: &[S], first: usize) -> Option<usize> {
        (first..S::MEMBERS).find(|member| {
            let factors = self.monomial.iter();
            let factors = factors.map(|place| x[*place as usize].member(*member));
            !(factors.product::<f64>() * (self.alpha * h)).is_below(1.0)
        })
    }
}

struct ExponentialFlow<'a, S> {
    piece: &'a Exponential,
    h: f64,
    state: &'a mut State<S>,
    /// The first trajectory of the part whose flow is too long.
    failed: usize,
}

impl<S> ExponentialFlow<'_, S> {
    /// m
    #[inline(always)]
    fn monomial<W: SimdView<Stored = S>>(&self, view: W) -> W::Number {
        let (piece, x) = (self.piece, &self.state.x);
        let mut m = match piece.monomial.first() {
            Some(&place) => view.load(x, place as usize),
            None => view.constant(1.0),
        };
        for &place in piece.monomial.iter().skip(1) {
            m = m * view.load(x, place as usize);
        }
        m
    }
}

impl<S> ForEach<S> for ExponentialFlow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let (piece, m) = (self.piece, self.monomial(view));
        let mut time = m.scaled(self.h);
        if piece.alpha != 0.0 {
            let z = m.scaled(piece.alpha * self.h);
            if !z.is_below(1.0) {
                self.failed = view.first();
                return false;
            }
            time = (view.constant(0.0) - z).ln_1p().scaled(-1.0 / piece.alpha);
        }
        // x *= exp(c t*)
        for &(place, rate) in &piece.rates {
            let exponent = time.scaled(rate);
            multiply(view, self.state.parts(), place as usize, exponent);
        }
        true
    }
}

/// The flow of a pair by a variable: a division and three products.
struct PairFlow<'a, S>(ExponentialFlow<'a, S>, Pair);

impl<S> ForEach<S> for PairFlow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let Self(
            flow,
            Pair {
                by,
                squared,
                divided,
            },
        ) = self;
        let x = &mut flow.state.x;
        let z = view.load(x, *by as usize).scaled(flow.piece.alpha * flow.h);
        if !z.is_below(1.0) {
            flow.failed = view.first();
            return false;
        }
        let base = view.constant(1.0) - z;
        let root = base.inverse_root(1);
        for (place, factor) in [(*squared, base * base), (*divided, root)] {
            let value = view.load(x, place as usize) * factor;
            view.store(x, place as usize, value);
        }
        true
    }
}

/// The flow by roots of degree Q: a chain of few operations, whose latency more registers in lock-step hide.
struct RootFlow<'a, S, const Q: u32>(ExponentialFlow<'a, S>, &'a [(u32, u32, u32)]);

impl<S, const Q: u32> ForEach<S> for RootFlow<'_, S, Q> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let Self(flow, powers) = self;
        let z = flow.monomial(view).scaled(flow.piece.alpha * flow.h);
        if !z.is_below(1.0) {
            flow.failed = view.first();
            return false;
        }
        let base = view.constant(1.0) - z;
        let root = base.inverse_root(Q);
        for &(place, a, b) in *powers {
            let x = view.load(&flow.state.x, place as usize);
            let x = times_power(times_power(x, base, a), root, b);
            view.store(&mut flow.state.x, place as usize, x);
        }
        true
    }
}

impl<'a, S> ExponentialFlow<'a, S> {
    /// Makes the flow by roots.
    #[inline(always)]
    fn by_roots<const Q: u32>(
        self,
        views: impl SimdViews<Stored = S>,
        roots: &'a Roots,
    ) -> (bool, usize) {
        let mut flow = RootFlow::<S, Q>(self, &roots.powers);
        (views.one_quarter(&mut flow), flow.0.failed)
    }
}

/// x y^power
#[inline(always)]
fn times_power<N: Number>(x: N, y: N, power: u32) -> N {
    match power {
        0 => x,
        1 => x * y,
        2 => x * (y * y),
        _ => times_large_power(x, y, power),
    }
}

#[inline(always)]
fn times_large_power<N: Number>(mut x: N, mut y: N, mut power: u32) -> N {
    while power > 0 {
        if power & 1 == 1 {
            x = x * y;
        }
        power >>= 1;
        if power > 0 {
            y = y * y;
        }
    }
    x
}

impl<S: Scalar> Kernel<S> for FlowOf<'_, S, &Exponential> {
    /// On failure the first trajectory whose flow is too long.
    type Output = Result<(), usize>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) -> Result<(), usize> {
        let Self { piece, h, .. } = self;
        let state = &mut *self.state;
        let failed = 0;
        let mut flow = ExponentialFlow {
            piece,
            h,
            state,
            failed,
        };
        let is_plain = flow.state.low.is_empty();
        let (is_made, first) = match (&piece.roots, piece.pair) {
            (_, Some(pair)) if is_plain => {
                let mut flow = PairFlow(flow, pair);
                (views.one_quarter(&mut flow), flow.0.failed)
            }
            (Some(roots), _) if is_plain => match roots.q {
                1 => flow.by_roots::<1>(views, roots),
                2 => flow.by_roots::<2>(views, roots),
                _ => flow.by_roots::<3>(views, roots),
            },
            _ => (views.one_narrow(&mut flow), flow.failed),
        };
        if is_made {
            Ok(())
        } else {
            Err(piece.too_long(h, &self.state.x, first).unwrap_or(first))
        }
    }
}
