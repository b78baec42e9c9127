//! Planes of fields: spline coefficients or programs in, a Hamiltonian of two coordinates out.

use crate::convert::{self, Tape, Values};
use crate::errors::refused;
use liouville_gridded::{Basis, Bounds, Spline, Traced};
use numpy::{
    PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use std::sync::Arc;

/// The basis of an axis: edges, degree, tables, the table and the origin of each cell, and its bounds.
#[derive(FromPyObject)]
struct BasisOf<'py>(
    Values<'py>,
    usize,
    Values<'py>,
    PyReadonlyArray1<'py, i64>,
    Values<'py>,
    String,
);

impl BasisOf<'_> {
    fn read(&self) -> PyResult<Basis> {
        let bounds = match self.5.as_str() {
            "periodic" => Bounds::Periodic,
            "wall" => Bounds::Wall,
            "open" => Bounds::Open,
            other => return Err(refused(format!("there are no bounds {other:?}"))),
        };
        let vector = |values: &Values<'_>| values.as_slice().map(<[f64]>::to_vec);
        Basis::new(
            vector(&self.0)?,
            self.1,
            vector(&self.2)?,
            convert::indices(&self.3)?,
            vector(&self.4)?,
            bounds,
        )
        .map_err(refused)
    }
}

/// A spline, or programs, as the Hamiltonian of two coordinates, others frozen.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct Plane(pub(crate) Arc<liouville_gridded::Plane>);

#[pymethods]
impl Plane {
    /// Bases are tuples (edges, degree, tables, table_of, origin, bounds); coefficients those of the frozen axes first.
    #[new]
    fn new(
        frozen: Vec<BasisOf<'_>>,
        axes: [BasisOf<'_>; 2],
        coefficients: PyReadonlyArrayDyn<'_, f64>,
        mean: [Values<'_>; 2],
    ) -> PyResult<Self> {
        let frozen = frozen.iter().map(BasisOf::read);
        let axes = [axes[0].read()?, axes[1].read()?];
        let [u, v] = &mean;
        let mean = [u.as_slice()?.to_vec(), v.as_slice()?.to_vec()];
        let coefficients = coefficients.as_slice()?.to_vec();
        let frozen = frozen.collect::<PyResult<_>>()?;
        let spline = Spline::new(frozen, axes, coefficients, mean).map_err(refused)?;
        Ok(Self(Arc::new(liouville_gridded::Plane::Spline(Box::new(
            spline,
        )))))
    }

    /// Tapes of the coordinates, `frozen` ones first, and parameters: F; F_v, F_w and F_vw; and these, F_vv and F_ww among
    /// them in the order of rows, then F_v and F_w by each frozen coordinate and by each parameter.
    #[staticmethod]
    fn traced(
        frozen: usize,
        tapes: [PyRef<'_, Tape>; 3],
        params: Values<'_>,
        is_separable: bool,
    ) -> PyResult<Self> {
        let [value, slopes, jet] = tapes.map(|tape| tape.0.clone());
        let params = params.as_slice()?.to_vec();
        let traced = Traced::new(frozen, value, slopes, jet, params, is_separable);
        let traced = traced.map_err(refused)?;
        Ok(Self(Arc::new(liouville_gridded::Plane::Traced(traced))))
    }

    /// The potential and the rates of the two coordinates at points, rows of the frozen coordinates and the two; NaN
    /// outside the grid, and where F is not finite.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let width = self.0.frozen() + 2;
        if points.shape()[1] != width {
            return Err(refused(format!("points are rows of {width} values")));
        }
        let mut rates = Vec::with_capacity(3 * points.shape()[0]);
        let mut memory = self.0.memory();
        for point in points.as_slice()?.chunks_exact(width) {
            let mut x = [0.0; 4];
            x[..width].copy_from_slice(point);
            rates.extend(self.0.sample(x, &mut memory).unwrap_or([f64::NAN; 3]));
        }
        Ok(PyArray1::from_vec(py, rates))
    }
}
