//! The adjoint of the values that are recorded at a point of a run.

use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;
use liouville_index2::semi_explicit::{SemiExplicitModel, SemiExplicitPoint};
use liouville_problem::{Carried, Cotangents, Dynamics, KnotCotangents, Model, PointAdjoint};

/// Takes cotangents of the values at a point to y, z and τ there.
pub trait ObservePoint: Clone + Send + Sync + 'static {
    /// The model of the motion.
    type Model: Dynamics;

    /// Adds cotangents of (y, z, λ) of a state.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn observe(
        &mut self,
        at: (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError>;

    /// The same between steps, where y and z are those of polynomials.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn observe_between(
        &mut self,
        at: (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.observe(at, row, of)
    }

    /// Adds cotangents of the values at a knot.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn observe_knot(
        &mut self,
        at: (f64, &impl Carried),
        knot: &KnotCotangents,
        of: &mut Cotangents,
    ) -> Result<(), StepError>;

    /// The derivative along the motion of a function with these cotangents at a state.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    fn rate(&mut self, at: (f64, &impl Carried), of: &Cotangents) -> Result<f64, StepError>;
}

impl ObservePoint for PointAdjoint {
    type Model = Model;

    fn observe(
        &mut self,
        at: (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.observe(at, row, of)
    }

    fn observe_knot(
        &mut self,
        at: (f64, &impl Carried),
        knot: &KnotCotangents,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.observe_knot(at, knot, of)
    }

    fn rate(&mut self, at: (f64, &impl Carried), of: &Cotangents) -> Result<f64, StepError> {
        self.rate(at, of)
    }
}

impl ObservePoint for SemiExplicitPoint {
    type Model = SemiExplicitModel;

    fn observe(
        &mut self,
        at: (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.observe(at, row, of)
    }

    fn observe_between(
        &mut self,
        _: (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (of_y, of_z) = row.split_at(of.y.len());
        add_scaled(&mut of.y, 1.0, of_y);
        add_scaled(&mut of.z, 1.0, of_z);
        Ok(())
    }

    fn observe_knot(
        &mut self,
        at: (f64, &impl Carried),
        knot: &KnotCotangents,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.observe_knot(at, knot, of)
    }

    fn rate(&mut self, at: (f64, &impl Carried), of: &Cotangents) -> Result<f64, StepError> {
        Ok(self.rate(at, of))
    }
}
