//! Rows of one or two short groups of terms, each in a loop of its own over the trajectories.
//!
//! A program decides on its next instruction in each part of the trajectories, which takes longer than the few operations
//! of such a row. The operations and their order are those of its program, and so are the bits.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::code::{RowTerm, Variables, in_groups};
use super::state::State;
use super::views::StateVariables;
use liouville_base::simd::{ForEach, Number, SimdView, SimdViews};

/// A row with few terms.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ShortRow {
    constant: f64,
    groups: Groups,
}

/// The groups of a row: linear terms come first, then brackets, then products.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Groups {
    L(Linear),
    LL(Linear, Linear),
    LB(Linear, Bracket),
    LP(Linear, Product),
    B(Bracket),
    BB(Bracket, Bracket),
    BP(Bracket, Product),
    P(Product),
    PP(Product, Product),
}

/// c x
#[derive(Clone, Copy, Debug, PartialEq)]
struct Linear(f64, u32);

/// c x y
#[derive(Clone, Copy, Debug, PartialEq)]
struct Product(f64, u32, u32);

/// (c_1 x_1 + c_2 x_2) y
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bracket([f64; 2], [u32; 2], u32);

/// No second group.
#[derive(Clone, Copy)]
struct Nothing;

/// A group of terms.
trait Addend: Copy {
    /// Adds its value to a sum.
    fn added<X: Variables>(self, sum: X::Number, from: &X) -> X::Number;
}

impl Addend for Nothing {
    #[inline(always)]
    fn added<X: Variables>(self, sum: X::Number, _: &X) -> X::Number {
        sum
    }
}

impl Addend for Linear {
    #[inline(always)]
    fn added<X: Variables>(self, sum: X::Number, from: &X) -> X::Number {
        let Self(c, x) = self;
        sum + from.load(x).scaled(c)
    }
}

impl Addend for Product {
    #[inline(always)]
    fn added<X: Variables>(self, sum: X::Number, from: &X) -> X::Number {
        let Self(c, x, y) = self;
        sum + from.load(x).scaled(c) * from.load(y)
    }
}

impl Addend for Bracket {
    #[inline(always)]
    fn added<X: Variables>(self, sum: X::Number, from: &X) -> X::Number {
        let Self([c, d], [x, z], y) = self;
        sum + (from.load(x).scaled(c) + from.load(z).scaled(d)) * from.load(y)
    }
}

/// The two kinds of groups that are not linear.
enum Other {
    Bracket(Bracket),
    Product(Product),
}

impl ShortRow {
    /// The row of these terms, if it is short enough.
    pub(super) fn of(terms: &[RowTerm]) -> Option<Self> {
        let (constant, linear, others) = in_groups(terms);
        let linear: Vec<Linear> = linear.iter().map(|(x, c)| Linear(*c, *x)).collect();
        let others = others.iter().map(|(common, bracket)| {
            let [y] = common[..] else {
                return None;
            };
            match bracket[..] {
                [(c, x)] => Some(Other::Product(Product(c, x, y))),
                [(c, x), (d, z)] => Some(Other::Bracket(Bracket([c, d], [x, z], y))),
                _ => None,
            }
        });
        let others = others.collect::<Option<Vec<_>>>()?;
        let groups = match (&linear[..], &others[..]) {
            (&[a], &[]) => Groups::L(a),
            (&[a, b], &[]) => Groups::LL(a, b),
            (&[a], &[Other::Bracket(b)]) => Groups::LB(a, b),
            (&[a], &[Other::Product(b)]) => Groups::LP(a, b),
            (&[], &[Other::Bracket(a)]) => Groups::B(a),
            (&[], &[Other::Bracket(a), Other::Bracket(b)]) => Groups::BB(a, b),
            (&[], &[Other::Bracket(a), Other::Product(b)]) => Groups::BP(a, b),
            (&[], &[Other::Product(a)]) => Groups::P(a),
            (&[], &[Other::Product(a), Other::Product(b)]) => Groups::PP(a, b),
            _ => return None,
        };
        // a program begins with its first linear term itself, where the sign of a zero stays, and else with 0
        let start = if linear.is_empty() { 0.0 } else { -0.0 };
        Some(Self {
            constant: if constant == 0.0 { start } else { constant },
            groups,
        })
    }

    /// Adds h times its value to `count` variables from a place on, of which no rounding errors are kept.
    #[inline(always)]
    pub(super) fn change<W: SimdViews>(
        &self,
        views: W,
        (place, count): (usize, usize),
        h: f64,
        state: &mut State<W::Stored>,
    ) {
        let row = Row {
            constant: self.constant,
            place,
            count,
            h,
            state,
        };
        match self.groups {
            Groups::L(a) => row.change(views, a, Nothing),
            Groups::LL(a, b) => row.change(views, a, b),
            Groups::LB(a, b) => row.change(views, a, b),
            Groups::LP(a, b) => row.change(views, a, b),
            Groups::B(a) => row.change(views, a, Nothing),
            Groups::BB(a, b) => row.change(views, a, b),
            Groups::BP(a, b) => row.change(views, a, b),
            Groups::P(a) => row.change(views, a, Nothing),
            Groups::PP(a, b) => row.change(views, a, b),
        }
    }
}

/// A row about to change its variable.
struct Row<'a, S> {
    constant: f64,
    place: usize,
    count: usize,
    h: f64,
    state: &'a mut State<S>,
}

impl<S> Row<'_, S> {
    #[inline(always)]
    fn change<W: SimdViews<Stored = S>>(self, views: W, first: impl Addend, second: impl Addend) {
        let count = self.count;
        views.each(count, &mut ChangeShortRow(self, first, second));
    }
}

struct ChangeShortRow<'a, S, A, B>(Row<'a, S>, A, B);

impl<S, A: Addend, B: Addend> ForEach<S> for ChangeShortRow<'_, S, A, B> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let Self(row, first, second) = self;
        let x = &mut row.state.x;
        let from = StateVariables { view, x };
        let sum = first.added(view.constant(row.constant), &from);
        let change = second.added(sum, &from).scaled(row.h);
        let now = view.load(x, row.place);
        view.store(x, row.place, now + change);
        true
    }
}
