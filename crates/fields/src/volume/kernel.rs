//! The flows of pieces as one kernel.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::affine::AffineChange;
use super::changes::Changes;
use super::code::Code;
use super::flow::{Change, Levels, PieceFlow, Shear};
use super::functions::{FunctionScratch, Functions, SetFunctions};
use super::rows::RowRun;
use super::stages::{RungeKutta, Substitution};
use super::state::State;
use super::views::{FlowOf, FlowScratch, add, multiply, value};
use liouville_base::composition::Flow;
use liouville_base::error::StepError;
use liouville_base::simd::{ForEach, Kernel, Number, SimdView, SimdViews, Stored};

/// Flows to be made one after another.
pub(super) struct FlowKernel<'a, S> {
    pub(super) piece_flows: &'a [PieceFlow],
    pub(super) functions: &'a Functions,
    pub(super) function_scratch: &'a mut FunctionScratch,
    /// The place of a variable that is the same in all trajectories.
    pub(super) clock: Option<u32>,
    pub(super) changes: &'a Changes,
    pub(super) flows: &'a [Flow],
    /// An addition to the length of the first.
    pub(super) before: f64,
    pub(super) t: f64,
    pub(super) h: f64,
    pub(super) state: &'a mut State<S>,
    pub(super) scratch: &'a mut FlowScratch<S>,
}

impl<S: Stored> Kernel<S> for FlowKernel<'_, S> {
    type Output = Result<(), StepError>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) -> Result<(), StepError> {
        let Self {
            state,
            scratch,
            function_scratch,
            ..
        } = self;
        function_scratch.forget();
        let mut before = self.before;
        for flow in self.flows {
            let h = before + flow.weight * self.h;
            before = 0.0;
            let piece = &self.piece_flows[flow.part];
            if self.functions.wants(flow.part, function_scratch) {
                let done = views.call(SetFunctions {
                    functions: self.functions,
                    piece: flow.part,
                    clock: self.clock,
                    x: &mut state.x,
                    scratch: &mut *function_scratch,
                });
                done.map_err(|(function, member)| StepError::Function {
                    piece: flow.part,
                    function,
                    member,
                    t: self.t + flow.offset * self.h,
                })?;
            }
            self.functions.outdate(flow.part, function_scratch);
            if let Some(levels) = piece.levels(flow.is_adjoint) {
                views.call(flow_of(levels, h, state, scratch));
                continue;
            }
            match piece {
                PieceFlow::Natural { .. } | PieceFlow::Scaling { .. } => {
                    unreachable!("flows of levels are made above")
                }
                PieceFlow::Shear(piece) => views.call(flow_of(piece, h, state, scratch)),
                PieceFlow::Exponential(piece) => {
                    let done = views.call(flow_of(piece, h, state, scratch));
                    done.map_err(|member| StepError::Singular {
                        piece: flow.part,
                        member,
                        t: self.t + flow.offset * self.h,
                    })?;
                }
                PieceFlow::Triangular(piece) if flow.is_adjoint => {
                    views.call(flow_of(Substitution(piece), h, state, scratch));
                }
                PieceFlow::Triangular(piece) => {
                    views.call(flow_of(RungeKutta(piece), h, state, scratch));
                }
                PieceFlow::Turn(piece) => views.call(flow_of(piece, h, state, scratch)),
                PieceFlow::Plane(_) => unreachable!("made a group of members after another"),
                PieceFlow::Affine(_) => {
                    let change = AffineChange(self.changes.find(flow.part, h));
                    views.call(flow_of(change, h, state, scratch));
                }
            }
        }
        Ok(())
    }
}

#[inline(always)]
fn flow_of<'a, S, P>(
    piece: P,
    h: f64,
    state: &'a mut State<S>,
    scratch: &'a mut FlowScratch<S>,
) -> FlowOf<'a, S, P> {
    FlowOf {
        piece,
        h,
        state,
        scratch,
    }
}

impl<S> Kernel<S> for FlowOf<'_, S, Levels<'_>> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let Self {
            piece, h, state, ..
        } = self;
        for rows in piece.iter() {
            for run in rows.iter() {
                change_run(views, piece.change, run, h, state);
            }
        }
    }
}

struct ChangeRow<'a, S> {
    program: &'a [Code],
    place: usize,
    h: f64,
    state: &'a mut State<S>,
}

impl<S> ForEach<S> for ChangeRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let value = value(view, self.program, &self.state.x).scaled(self.h);
        add(view, self.state.parts(), self.place, value);
        true
    }
}

struct ScaleRow<'a, S>(ChangeRow<'a, S>);

impl<S> ForEach<S> for ScaleRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let row = &mut self.0;
        let value = value(view, row.program, &row.state.x).scaled(row.h);
        let x = view.load(&row.state.x, row.place);
        view.store(&mut row.state.x, row.place, x * value.exp());
        true
    }
}

/// The same with compensated sums, whose formula is long.
struct ScaleLowRow<'a, S>(ChangeRow<'a, S>);

impl<S> ForEach<S> for ScaleLowRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let row = &mut self.0;
        let value = value(view, row.program, &row.state.x).scaled(row.h);
        multiply(view, row.state.parts(), row.place, value);
        true
    }
}

/// Changes a run of rows.
#[inline(always)]
fn change_run<W: SimdViews>(
    views: W,
    change: Change,
    (run, program): (&RowRun, &[Code]),
    h: f64,
    state: &mut State<W::Stored>,
) {
    let place = run.place;
    let is_plain = state.low.is_empty();
    if let (Change::Add, true, Some(short)) = (change, is_plain, &run.short) {
        return short.change(views, (place, run.count), h, state);
    }
    let mut row = ChangeRow {
        program,
        place,
        h,
        state,
    };
    match change {
        Change::Add => views.each(run.count, &mut row),
        Change::Scale if is_plain => views.each(run.count, &mut ScaleRow(row)),
        Change::Scale => views.each_narrow(run.count, &mut ScaleLowRow(row)),
    };
}

struct ShearBy<'a, S> {
    program: &'a [Code],
    places: &'a [(u32, f64)],
    h: f64,
    state: &'a mut State<S>,
}

impl<S> ForEach<S> for ShearBy<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let change = value(view, self.program, &self.state.x).scaled(self.h);
        for &(place, direction) in self.places {
            let change = change.scaled(direction);
            add(view, self.state.parts(), place as usize, change);
        }
        true
    }
}

impl<S> Kernel<S> for FlowOf<'_, S, &Shear> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let Self {
            piece, h, state, ..
        } = self;
        for (_, program) in piece.change.iter() {
            let mut shear = ShearBy {
                program,
                places: &piece.places,
                h,
                state: &mut *state,
            };
            views.one(&mut shear);
        }
    }
}
