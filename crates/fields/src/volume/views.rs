//! The parts of flows that their kernels share: the state, memory and the operations on a view of it.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::code::{Code, Variables, evaluate};
use super::state::State;
use liouville_base::simd::{Number, SimdView};

/// Memory of flows beside the state.
#[derive(Clone, Debug)]
pub(super) struct FlowScratch<S> {
    /// The change of each variable.
    pub(super) change: Vec<S>,
    /// Z_r of each stage, and its K_r.
    pub(super) stages: Vec<[Vec<S>; 2]>,
}

/// The flow of one piece, of length `h`.
pub(super) struct FlowOf<'a, S, P> {
    pub(super) piece: P,
    pub(super) h: f64,
    pub(super) state: &'a mut State<S>,
    pub(super) scratch: &'a mut FlowScratch<S>,
}

/// Adds to the variable at a place, with its rounding error where that is kept.
#[inline(always)]
pub(super) fn add<W: SimdView>(
    view: W,
    (x, low): (&mut [W::Stored], &mut [W::Stored]),
    place: usize,
    change: W::Number,
) {
    let now = view.load(x, place);
    if low.is_empty() {
        view.store(x, place, now + change);
        return;
    }
    let change = change + view.load(low, place);
    let sum = now + change;
    let back = sum - now;
    let lost = (now - (sum - back)) + (change - back);
    view.store(x, place, sum);
    view.store(low, place, lost);
}

/// Multiplies the variable at a place by e^exponent.
#[inline(always)]
pub(super) fn multiply<W: SimdView>(
    view: W,
    (x, low): (&mut [W::Stored], &mut [W::Stored]),
    place: usize,
    exponent: W::Number,
) {
    let now = view.load(x, place);
    if low.is_empty() {
        view.store(x, place, now * exponent.exp());
    } else {
        add(view, (x, low), place, now * exponent.exp_m1());
    }
}

/// The variables of a state in a view.
pub(super) struct StateVariables<'a, W: SimdView> {
    pub(super) view: W,
    pub(super) x: &'a [W::Stored],
}

impl<W: SimdView> Variables for StateVariables<'_, W> {
    type Number = W::Number;

    #[inline(always)]
    fn load(&self, place: u32) -> W::Number {
        self.view.load(self.x, place as usize)
    }
}

/// The value of a row in a view.
#[inline(always)]
pub(super) fn value<W: SimdView>(view: W, program: &[Code], x: &[W::Stored]) -> W::Number {
    evaluate(program, view.constant(0.0), &StateVariables { view, x })
}
