//! The mass of a separable system: z with p(z) = p, and v(z), both linear with constant factors.

use liouville_base::error::StepError;
use liouville_base::linalg::Pattern;
use liouville_problem::{Mass, Model};

/// v = W (p − `p_0`) + `v_0` and z = `p_z`⁻¹ (p − `p_0`).
#[derive(Clone, Debug)]
pub(super) struct ConstantMass {
    matrices: MassFactors,
    /// p and v of z = 0.
    p_0: Vec<f64>,
    v_0: Vec<f64>,
}

#[derive(Clone, Debug)]
enum MassFactors {
    /// The diagonals of W and of `p_z`⁻¹.
    Diagonal {
        inverse_mass: Vec<f64>,
        inverse: Vec<f64>,
    },
    Sparse(Box<Mass>),
}

impl ConstantMass {
    /// The mass of a model whose `p_z` and `v_z` depend on parameters alone.
    pub(super) fn new(model: &mut Model) -> Result<Self, StepError> {
        let n = model.problem.n;
        let zeros = vec![0.0; n];
        let [p, _, v] = model.stage(0.0, &zeros, &zeros);
        let (p_0, mut v_0) = (p.to_vec(), v.to_vec());
        v_0.resize(n, 0.0);
        let mut mass = Mass::new(model);
        mass.update(model, 0.0, &zeros, &zeros)?;
        let at = &model.problem.patterns;
        let has_diagonal_velocity = at.v_z.as_ref().is_none_or(Pattern::is_diagonal);
        let matrices = if at.p_z.is_diagonal() && has_diagonal_velocity {
            let (mut inverse_mass, mut inverse) = (vec![1.0; n], vec![1.0; n]);
            mass.solve_velocity(&mut inverse_mass);
            mass.solve(&mut inverse);
            MassFactors::Diagonal {
                inverse_mass,
                inverse,
            }
        } else {
            MassFactors::Sparse(Box::new(mass))
        };
        Ok(Self { matrices, p_0, v_0 })
    }

    /// The diagonal of W, where W is diagonal.
    pub(super) fn inverse_mass(&self) -> Option<&[f64]> {
        match &self.matrices {
            MassFactors::Diagonal { inverse_mass, .. } => Some(inverse_mass),
            MassFactors::Sparse(_) => None,
        }
    }

    /// v of the momenta `p + low`.
    pub(super) fn velocity(&mut self, p: &[f64], low: &[f64], v: &mut [f64]) {
        self.subtract(p, low, v);
        self.apply_inverse(v);
        for (v, v_0) in v.iter_mut().zip(&self.v_0) {
            *v += v_0;
        }
    }

    /// z of the momenta `p + low`.
    pub(super) fn state(&mut self, p: &[f64], low: &[f64], z: &mut [f64]) {
        self.subtract(p, low, z);
        match &mut self.matrices {
            MassFactors::Diagonal { inverse, .. } => multiply(z, inverse),
            MassFactors::Sparse(mass) => mass.solve(z),
        }
    }

    /// `x = W x`
    pub(super) fn apply_inverse(&mut self, x: &mut [f64]) {
        match &mut self.matrices {
            MassFactors::Diagonal { inverse_mass, .. } => multiply(x, inverse_mass),
            MassFactors::Sparse(mass) => mass.solve_velocity(x),
        }
    }

    fn subtract(&self, p: &[f64], low: &[f64], out: &mut [f64]) {
        let momenta = p.iter().zip(low).zip(&self.p_0);
        for (out, ((p, low), p_0)) in out.iter_mut().zip(momenta) {
            *out = (p - p_0) + low;
        }
    }
}

fn multiply(x: &mut [f64], factors: &[f64]) {
    for (x, factor) in x.iter_mut().zip(factors) {
        *x *= factor;
    }
}
