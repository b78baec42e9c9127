//! The velocities that reactions give, v_z p_z⁻¹ r_λ, sparse where the mass falls into small blocks.

use super::Mass;
use liouville_base::at_size;
use liouville_base::linalg::{Pattern, Product};
use liouville_base::real::Real;

/// v_z p_z⁻¹ r_λ of one mass and the reactions at several nodes.
#[derive(Clone, Debug)]
pub struct Compliance<R = f64> {
    /// v_z p_z⁻¹, where v is not z.
    mobility: Option<(Product, Vec<R>)>,
    product: Product,
    values: Vec<R>,
    nodes: usize,
}

impl<R: Real> Compliance<R> {
    /// Memory for reactions of pattern `r_lam` at some number of nodes; `None` where a block of the mass
    /// is large.
    pub fn new(mass: &Mass<R>, r_lam: &Pattern, nodes: usize) -> Option<Self> {
        let inverse = mass.inverse_pattern()?;
        let mobility = mass.v_z().map(|(v_z, _)| {
            let product = Product::new(v_z, &inverse);
            let values = vec![R::splat(0.0); product.pattern().len()];
            (product, values)
        });
        let of = mobility.as_ref().map_or(&inverse, |(of, _)| of.pattern());
        let product = Product::new(of, r_lam);
        Some(Self {
            values: vec![R::splat(0.0); nodes * product.pattern().len()],
            mobility,
            product,
            nodes,
        })
    }

    /// Where it is not zero.
    pub fn pattern(&self) -> &Pattern {
        self.product.pattern()
    }

    /// The values for the mass as it is factored now; those of `r_lam` stand node by node within an entry,
    /// and so do these.
    pub fn update(&mut self, mass: &Mass<R>, r_lam: &[R]) -> &[R] {
        let mut inverse = mass.inverse_values();
        if let (Some((product, values)), Some((_, v_z))) = (&mut self.mobility, mass.v_z()) {
            product.multiply::<R, 1>(v_z, inverse, values);
            inverse = values;
        }
        let (nodes, values) = (self.nodes, &mut self.values);
        at_size!(nodes, K => self.product.multiply::<R, K>(inverse, r_lam, values));
        values
    }
}
