//! Runge-Kutta steps of triangular pieces, and their adjoints.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::code::Code;
use super::rows::PolynomialRows;
use super::state::State;
use super::triangular::Triangular;
use super::views::{FlowOf, add, value};
use liouville_base::simd::{ForEach, Kernel, Number, SimdView, SimdViews};

/// Z_r = x + h Σ_{q<r} A_rq K_q, for a run.
struct SetStage<'a, S> {
    weights: &'a [f64],
    place: usize,
    h: f64,
    x: &'a [S],
    earlier: &'a [[Vec<S>; 2]],
    out: &'a mut [S],
}

impl<S> ForEach<S> for SetStage<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let x = view.load(self.x, self.place);
        let change = combined(view, self.weights, self.earlier, self.place);
        view.store(self.out, self.place, x + change.scaled(self.h));
        true
    }
}

/// Σ weights_q K_q
#[inline(always)]
fn combined<W: SimdView>(
    view: W,
    weights: &[f64],
    stages: &[[Vec<W::Stored>; 2]],
    place: usize,
) -> W::Number {
    let mut sum = view.constant(0.0);
    for (weight, [_, k]) in weights.iter().zip(stages) {
        sum = sum + view.load(k, place).scaled(*weight);
    }
    sum
}

/// x += h Σ b_r K_r, for a run.
struct AddStages<'a, S> {
    weights: &'a [f64],
    place: usize,
    h: f64,
    state: &'a mut State<S>,
    stages: &'a [[Vec<S>; 2]],
}

impl<S> ForEach<S> for AddStages<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let change = combined(view, self.weights, self.stages, self.place);
        let change = change.scaled(self.h);
        add(view, self.state.parts(), self.place, change);
        true
    }
}

/// The step: Z_r and K_r stage after stage.
pub(super) struct RungeKutta<'a>(pub(super) &'a Triangular);

impl<S: Copy> Kernel<S> for FlowOf<'_, S, RungeKutta<'_>> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let Self {
            h, state, scratch, ..
        } = self;
        let piece = self.piece.0;
        let s = piece.stages;
        let runs = || piece.levels.iter().flat_map(PolynomialRows::iter);
        for r in 0..s {
            let (earlier, later) = scratch.stages.split_at_mut(r);
            let [z, k] = &mut later[0];
            z.copy_from_slice(&state.x);
            for (run, _) in runs() {
                let mut stage = SetStage {
                    weights: &piece.a[r * s..r * s + r],
                    place: run.place,
                    h,
                    x: &state.x,
                    earlier: &*earlier,
                    out: &mut *z,
                };
                views.each(run.count, &mut stage);
            }
            for level in &piece.levels {
                level.set(views, z, k);
            }
        }
        for (run, _) in runs() {
            let mut add_stages = AddStages {
                weights: &piece.b,
                place: run.place,
                h,
                state: &mut *state,
                stages: &scratch.stages[..s],
            };
            views.each(run.count, &mut add_stages);
        }
    }
}

/// All stages of a run after its earlier levels: K_r, z, Z_r.
struct Substitute<'a, S> {
    piece: &'a Triangular,
    program: &'a [Code],
    place: usize,
    h: f64,
    state: &'a mut State<S>,
    stages: &'a mut [[Vec<S>; 2]],
}

impl<S> ForEach<S> for Substitute<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let s = self.piece.stages;
        for [z, k] in &mut self.stages[..s] {
            let change = value(view, self.program, z);
            view.store(k, self.place, change);
        }
        let change = combined(view, &self.piece.b, self.stages, self.place);
        let change = change.scaled(self.h);
        add(view, self.state.parts(), self.place, change);
        let end = view.load(&self.state.x, self.place);
        for r in 0..s {
            let weights = &self.piece.a[r * s..r * s + r];
            let change = combined(view, weights, self.stages, self.place);
            let z = &mut self.stages[r][0];
            view.store(z, self.place, end - change.scaled(self.h));
        }
        true
    }
}

/// The adjoint step, level after level.
pub(super) struct Substitution<'a>(pub(super) &'a Triangular);

impl<S: Copy> Kernel<S> for FlowOf<'_, S, Substitution<'_>> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let Self {
            h, state, scratch, ..
        } = self;
        let piece = self.piece.0;
        for [z, _] in &mut scratch.stages[..piece.stages] {
            z.copy_from_slice(&state.x);
        }
        for level in &piece.levels {
            for (run, program) in level.iter() {
                let mut substitute = Substitute {
                    piece,
                    program,
                    place: run.place,
                    h,
                    state: &mut *state,
                    stages: &mut scratch.stages,
                };
                views.each(run.count, &mut substitute);
            }
        }
    }
}
