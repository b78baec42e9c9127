//! The linear map of a step: from tangents before it to those after it, or from cotangents after it to those before.

use super::{Cotangents, Directions, TangentState};
use liouville_base::linalg::{add_scaled, copy};
use liouville_base::linear::{LinearMap, Operators, Segment, Segments};

/// The places of the parts of a state in the memory of a map; parts that a step does not use are empty.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct StateSegments {
    pub y: Segment,
    pub z: Segment,
    pub carried: Segment,
    pub t: Segment,
}

impl StateSegments {
    /// Segments for the numbers of y, z and the carried state.
    pub fn new(segments: &mut Segments, [y, z, carried]: [usize; 3]) -> Self {
        Self {
            y: segments.take(y),
            z: segments.take(z),
            carried: segments.take(carried),
            t: segments.take(1),
        }
    }
}

/// A list with the ends of its step.
#[derive(Clone, Debug)]
pub struct StepMap {
    /// The list.
    pub map: LinearMap,
    /// The state before the step, and after it.
    pub before: StateSegments,
    #[allow(missing_docs)]
    pub after: StateSegments,
    /// The relative stretch of the step, and parameters.
    pub stretch: Segment,
    #[allow(missing_docs)]
    pub params: Segment,
    memory: Vec<f64>,
}

impl StepMap {
    /// The map of a step between these states, and of all segments taken so far.
    pub fn new(mut segments: Segments, [before, after]: [StateSegments; 2], params: usize) -> Self {
        let (stretch, params) = (segments.take(1), segments.take(params));
        Self {
            map: LinearMap::default(),
            before,
            after,
            stretch,
            params,
            memory: segments.memory(),
        }
    }

    /// The numbers of a segment, as the map has last left them.
    pub fn read(&self, segment: Segment) -> &[f64] {
        &self.memory[segment.range()]
    }

    /// Writes the tangent after the step in one direction.
    ///
    /// # Errors
    /// Errors of the operators.
    pub fn push<S, O: Operators<f64>>(
        &mut self,
        by: &mut O,
        (directions, direction): (&Directions, usize),
        (before, state): (&TangentState<S>, &mut TangentState<S>),
    ) -> Result<(), O::Error> {
        let (from, to, memory) = (self.before, self.after, &mut self.memory);
        memory.fill(0.0);
        memory[self.stretch.range()][0] = directions.stretch[direction];
        copy(
            &mut memory[self.params.range()],
            &directions.tau.row(direction)[1..],
        );
        memory[from.t.range()][0] = before.t[direction];
        let rows = [&before.y, &before.z, &before.carried].map(|rows| rows.row(direction));
        for (segment, row) in [from.y, from.z, from.carried].into_iter().zip(rows) {
            let out = &mut memory[segment.range()];
            let len = out.len();
            copy(out, &row[..len]);
        }
        self.map.apply::<false, _>(memory, by)?;
        state.t[direction] = memory[to.t.range()][0];
        let rows = [&mut state.y, &mut state.z, &mut state.carried];
        for (segment, rows) in [to.y, to.z, to.carried].into_iter().zip(rows) {
            copy(rows.row_mut(direction), &memory[segment.range()]);
        }
        Ok(())
    }

    /// Takes cotangents from the end of the step to its start.
    ///
    /// # Errors
    /// Errors of the operators.
    pub fn pull<O: Operators<f64>>(
        &mut self,
        by: &mut O,
        of: &mut Cotangents,
    ) -> Result<(), O::Error> {
        let (from, to, memory) = (self.before, self.after, &mut self.memory);
        memory.fill(0.0);
        memory[to.t.range()][0] = of.tau[0];
        let rows = [&of.y, &of.z, &of.carried];
        for (segment, row) in [to.y, to.z, to.carried].into_iter().zip(rows) {
            // a pullback has no cotangents of z where a step does not read z
            copy(&mut memory[segment.range()][..row.len()], row);
        }
        self.map.apply::<true, _>(memory, by)?;
        of.tau[0] = memory[from.t.range()][0];
        of.stretch += memory[self.stretch.range()][0];
        add_scaled(&mut of.tau[1..], 1.0, &memory[self.params.range()]);
        let rows = [&mut of.y, &mut of.z, &mut of.carried];
        for (segment, row) in [from.y, from.z, from.carried].into_iter().zip(rows) {
            let found = &memory[segment.range()];
            copy(&mut row[..found.len()], found);
        }
        Ok(())
    }
}
