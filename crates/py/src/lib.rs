//! The border between Python and the core: conversions, and nothing else.
//!
//! Programs and patterns cross once a system, methods and jobs once a run; arrays come back. No Python runs inside a step; the loop runs detached from the interpreter.
#![allow(clippy::needless_pass_by_value)] // PyO3 hands arguments over by value

mod caught;
mod composition;
mod convert;
mod derivative;
mod errors;
mod field_pullback;
mod gridded;
mod job;
mod ladder;
mod listing;
mod mechanical;
mod members_pullback;
mod method;
mod multipliers;
mod operator;
mod program;
mod project;
mod pullback;
mod run;
mod schrodinger;
mod second_order;
mod semi_explicit;
mod split;
mod start;
mod tableau;
mod wave_method;

use pyo3::prelude::*;

/// The compiled core of liouville; its types stand in `_core.pyi`.
#[pymodule]
mod _core {
    use super::PyResult;
    use liouville_base::tape::Op;
    use pyo3::prelude::*;
    use pyo3::types::PyDict;

    #[pymodule_export]
    use super::composition::compositions;
    #[pymodule_export]
    use super::convert::{Column, Rows, Tape};
    #[pymodule_export]
    use super::derivative::{WaveDerivative, WaveRecord};
    #[pymodule_export]
    #[pymodule_export]
    use super::field_pullback::FieldPullback;
    #[pymodule_export]
    use super::gridded::Plane;
    #[pymodule_export]
    use super::ladder::{ladder, stability};
    #[pymodule_export]
    use super::listing::listing;
    #[pymodule_export]
    use super::mechanical::{Mechanical, Sensitivity};
    #[pymodule_export]
    use super::members_pullback::{MembersPullback, members_pullback};
    #[pymodule_export]
    use super::multipliers::{first_dependent, multipliers};
    #[pymodule_export]
    use super::operator::{Hamiltonian, Operator};
    #[pymodule_export]
    use super::project::{independent_rows, project, project_linear};
    #[pymodule_export]
    use super::pullback::{Pullback, pullback};
    #[pymodule_export]
    use super::run::{Run, run, run_each};
    #[pymodule_export]
    use super::schrodinger::{
        chebyshev_degree, driven_cost, magnus_cost, processor_degree, split_beginning,
        split_program,
    };
    #[pymodule_export]
    use super::second_order::{SecondOrder, Separable};
    #[pymodule_export]
    use super::semi_explicit::{SemiExplicit, SemiExplicitSensitivity};
    #[pymodule_export]
    use super::split::Split;
    #[pymodule_export]
    use super::start::violation;
    #[pymodule_export]
    use super::tableau::{lobatto_pair, spark_tableau};
    #[pymodule_export]
    use super::wave_method::SplitBeginning;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        let codes = PyDict::new(module.py());
        for (code, op) in Op::ALL.iter().enumerate() {
            codes.set_item(op.name(), code)?;
        }
        module.add("OPERATIONS", codes)?;
        module.add("VERSION", env!("CARGO_PKG_VERSION"))
    }
}
