//! Cotangents of a potential: each of its places is a group whose matrix has a one there.

use super::powers::TransposedPowers;
use crate::method::blocks::{add_products, by_blocks};
use crate::method::driven::choice::Window;
use crate::method::driven::whole::Fit;

/// The part of a potential in cotangents of the state, and the cotangents of the potential.
#[derive(Default)]
pub(super) struct PotentialPull {
    /// Powers of r.
    powers: TransposedPowers,
    /// Whether there is a potential, or its cotangents are wanted.
    is_there: bool,
    /// Cotangents of its coefficients, empty where they are not wanted.
    pub(super) found: Vec<f64>,
    pub(super) places: usize,
}

impl PotentialPull {
    /// Begins with nothing, for vectors of a size of an H with so many rows.
    pub(super) fn begin(
        &mut self,
        (window, fit): (&Window, &Fit),
        (size, places): (usize, usize),
        is_wanted: bool,
    ) {
        self.is_there = is_wanted || !fit.potential.is_empty();
        if self.is_there {
            self.powers.begin(window, fit.degree, size);
        }
        self.places = places;
        self.found.clear();
        let count = if is_wanted { fit.degree + 1 } else { 0 };
        self.found.resize(count * places, 0.0);
    }

    /// Adds Σ_l V_l u^l of the next lower m to `now`, and to the cotangents of V_l what u^l has with the term c_m; r is
    /// made where it is to be kept.
    pub(super) fn add(
        &mut self,
        (fit, m): (&Fit, usize),
        make: impl FnOnce(&mut [f64]),
        now: &mut [f64],
        term: Option<&Vec<f64>>,
    ) {
        if !self.is_there {
            return;
        }
        make(self.powers.advance(m));
        let (places, size) = (self.places, now.len());
        let (powers, found) = (&mut self.powers, &mut self.found);
        by_blocks(
            places,
            #[inline(always)]
            |rows| {
                for part in (0..size).step_by(places) {
                    let here = part + rows.start..part + rows.end;
                    powers.make(here.clone());
                    for l in 0..=fit.degree {
                        let (u, place) = (powers.power(l, here.clone()), l * places);
                        let of_power = place + rows.start..place + rows.end;
                        if let Some(v) = fit.potential.get(of_power.clone()) {
                            add_products(&mut now[here.clone()], 1.0, v, u);
                        }
                        if let (Some(found), Some(term)) = (found.get_mut(of_power), term) {
                            add_products(found, 1.0, u, &term[here.clone()]);
                        }
                    }
                }
            },
        );
    }
}
