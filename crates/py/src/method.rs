//! Methods of mechanical and semi-explicit systems, by their dataclasses.

use crate::errors::refused;
use crate::tableau::{lobatto_named, scheme_named, spark_named};
use liouville_alpha::Reactions;
use liouville_base::tableau;
use liouville_mechanics::run::{Method, SparkMethod};
use liouville_spark::Solver;
use pyo3::prelude::*;

/// A method, by the attributes of its dataclass; those that most runs take come first.
#[derive(FromPyObject)]
pub(crate) enum MechanicalMethod {
    #[pyo3(transparent)]
    Spark(SparkOf),
    Composed {
        base: SparkOf,
        scheme: String,
    },
    Alpha {
        coefficients: (f64, f64, f64, f64),
        reaction: String,
        #[pyo3(default)]
        b: f64,
        newton_tol: Option<f64>,
    },
}

/// A SPARK method on points, or a Lobatto pair.
#[derive(FromPyObject)]
pub(crate) enum SparkOf {
    OnPoints {
        stages: usize,
        points: String,
        solver: String,
        newton_tol: Option<f64>,
    },
    Pair {
        stages: usize,
        force: String,
        solver: String,
        newton_tol: Option<f64>,
    },
}

impl SparkOf {
    fn read(self, scheme: Option<&str>) -> PyResult<Method> {
        let (tableau, solver, newton_tol) = match self {
            Self::OnPoints {
                stages,
                points,
                solver,
                newton_tol,
            } => (spark_named(stages, &points)?, solver, newton_tol),
            Self::Pair {
                stages,
                force,
                solver,
                newton_tol,
            } => (lobatto_named(stages, &force)?, solver, newton_tol),
        };
        let solver = match solver.as_str() {
            "auto" => Solver::Auto,
            "node-schur" => Solver::NodeSchur,
            "newton" => Solver::Newton,
            other => return Err(refused(format!("there is no solver {other:?}"))),
        };
        Ok(Method::Spark(Box::new(SparkMethod {
            tableau,
            solver,
            newton_tol,
            scheme: scheme.map(scheme_named).transpose()?,
        })))
    }
}

impl MechanicalMethod {
    pub(crate) fn read(self) -> PyResult<Method> {
        match self {
            Self::Composed { base, scheme } => base.read(Some(&scheme)),
            Self::Spark(spark) => spark.read(None),
            Self::Alpha {
                coefficients: (alpha_m, alpha_f, gamma, beta),
                reaction,
                b,
                newton_tol,
            } => {
                let weights = tableau::Alpha {
                    alpha_m,
                    alpha_f,
                    gamma,
                    beta,
                };
                let reactions = match reaction.as_str() {
                    "position" => Reactions::Position,
                    "extended" | "predicted" => Reactions::Extended {
                        b,
                        predicted: reaction == "predicted",
                    },
                    other => return Err(refused(format!("there is no reaction {other:?}"))),
                };
                Ok(Method::Alpha(weights, reactions, newton_tol))
            }
        }
    }
}
