//! The spline functions of one axis, as polynomials on its cells.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::{Malformed, finite, size};

/// The most functions on a cell: splines have degree five at most.
pub(crate) const MOST: usize = 6;

/// The ends of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    /// The last edge is the first.
    Periodic,
    /// Walls: a coordinate on one of them, but for roundoff, is on it.
    Wall,
    /// A trajectory may leave.
    Open,
}

/// The functions of an axis of n cells: cell c touches numbers c to c + degree.
///
/// On each cell they are polynomials in s = (x − origin) / width. Functions that vanish at a wall have no constant there,
/// for the origin of its cell is the wall: what is on a wall stays on it exactly.
#[derive(Clone, Debug, PartialEq)]
pub struct Basis {
    edges: Vec<f64>,
    degree: usize,
    /// Coefficients of s^k, for each table and power those of all functions.
    tables: Vec<f64>,
    table_of: Vec<usize>,
    origin: Vec<f64>,
    inverse: Vec<f64>,
    bounds: Bounds,
    cells_per_unit: f64,
    /// 1 / length
    per_length: f64,
}

/// A coordinate within its cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) cell: usize,
    pub(crate) s: f64,
    /// Where coordinates of this cell begin and end, and its origin, as many periods further as they are.
    between: [f64; 2],
    origin: f64,
}

impl Place {
    /// A place that is not used.
    #[inline(always)]
    pub(crate) const fn none() -> Self {
        Self {
            cell: 0,
            s: 0.0,
            between: [0.0; 2],
            origin: 0.0,
        }
    }
}

/// Roundings by which a coordinate may be beyond a wall.
const ROUNDINGS: f64 = 4.0;
/// The part of a cell by which a frozen coordinate, such as the time, may be beyond its end.
const SLACK: f64 = 1e-6;

impl Basis {
    /// A basis of the cells between `edges`, with the tables that they take and their origins.
    ///
    /// # Errors
    /// Sizes that do not fit, or numbers that are not finite or in order.
    pub fn new(
        edges: Vec<f64>,
        degree: usize,
        tables: Vec<f64>,
        table_of: Vec<usize>,
        origin: Vec<f64>,
        bounds: Bounds,
    ) -> Result<Self, Malformed> {
        let cells = table_of.len();
        size("edges", edges.len(), cells + 1)?;
        size("origin", origin.len(), cells)?;
        finite("edge", &edges)?;
        finite("origin", &origin)?;
        finite("table entry", &tables)?;
        if degree >= MOST {
            let wanted = "0 to 5";
            return Err(Malformed::Degree { degree, wanted });
        }
        if cells < degree.min(3) {
            return Err(Malformed::Cells { cells });
        }
        if let Some(index) = (1..edges.len()).find(|k| edges[*k] <= edges[k - 1]) {
            return Err(Malformed::Edges { index });
        }
        let each = (degree + 1) * (degree + 1);
        let count = tables.len() / each;
        size("tables", tables.len(), count * each)?;
        if let Some(cell) = table_of.iter().position(|table| *table >= count) {
            return Err(Malformed::Table {
                cell,
                table: table_of[cell],
                tables: count,
            });
        }
        let inverse = edges.windows(2).map(|pair| 1.0 / (pair[1] - pair[0]));
        Ok(Self {
            inverse: inverse.collect(),
            cells_per_unit: cells as f64 / (edges[cells] - edges[0]),
            per_length: 1.0 / (edges[cells] - edges[0]),
            edges,
            degree,
            tables,
            table_of,
            origin,
            bounds,
        })
    }

    /// The degree of the functions.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// The number of cells.
    pub fn cells(&self) -> usize {
        self.table_of.len()
    }

    /// The number of functions; on a periodic axis the last ones are the first again.
    pub fn functions(&self) -> usize {
        self.cells() + self.degree
    }

    /// The width of a cell.
    #[inline(always)]
    pub(crate) fn width(&self, cell: usize) -> f64 {
        self.edges[cell + 1] - self.edges[cell]
    }

    /// 1 / width
    #[inline(always)]
    pub(crate) fn inverse(&self, cell: usize) -> f64 {
        self.inverse[cell]
    }

    /// The place of a coordinate; outside the axis that of the nearest cell, whose polynomials go on.
    #[inline(always)]
    pub(crate) fn find(&self, x: f64) -> Place {
        let (start, last) = (self.edges[0], self.cells() - 1);
        let mut shift = 0.0;
        if self.bounds == Bounds::Periodic {
            let turns = ((x - start) * self.per_length).floor();
            shift = turns * (self.edges[last + 1] - start);
        }
        let value = x - shift;
        let guess = (value - start) * self.cells_per_unit;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a cast saturates
        let mut cell = (guess as usize).min(last);
        while cell > 0 && value < self.edges[cell] {
            cell -= 1;
        }
        while cell < last && value >= self.edges[cell + 1] {
            cell += 1;
        }
        let origin = shift + self.origin[cell];
        Place {
            cell,
            s: (x - origin) * self.inverse[cell],
            between: [shift + self.edges[cell], shift + self.edges[cell + 1]],
            origin,
        }
    }

    /// The place of a coordinate near another: mostly in the same cell.
    #[inline(always)]
    pub(crate) fn go(&self, place: &mut Place, x: f64) {
        if place.between[0] <= x && x < place.between[1] {
            place.s = (x - place.origin) * self.inverse[place.cell];
        } else {
            *place = self.find(x);
        }
    }

    /// The place of a coordinate, if it is inside the axis. Beyond a wall by roundoff is on it.
    #[inline(always)]
    pub(crate) fn locate(&self, x: f64) -> Option<Place> {
        if !x.is_finite() {
            return None;
        }
        let mut place = self.find(x);
        let (start, end) = (self.edges[0], self.edges[self.cells()]);
        let beyond = (start - x).max(x - end);
        if beyond <= 0.0 || self.bounds == Bounds::Periodic {
            return Some(place);
        }
        if self.bounds == Bounds::Open {
            return (beyond <= SLACK * self.width(place.cell)).then_some(place);
        }
        if beyond > ROUNDINGS * f64::EPSILON * (start.abs() + end.abs()) {
            return None;
        }
        place.s = 0.0;
        Some(place)
    }

    /// The functions that are not zero at a place.
    #[inline(always)]
    pub(crate) fn values(&self, place: Place) -> [f64; MOST] {
        let width = self.degree + 1;
        let table = self.table(place.cell);
        let mut values = [0.0; MOST];
        for row in table.chunks_exact(width).rev() {
            for (value, c) in values.iter_mut().zip(row) {
                *value = *value * place.s + c;
            }
        }
        values
    }

    /// The functions at a place, and their derivatives by the coordinate; there are `N` of them.
    #[inline(always)]
    pub(crate) fn values_and_slopes<const N: usize>(&self, place: Place) -> ([f64; N], [f64; N]) {
        let table = &self.table(place.cell)[..N * N];
        let (mut values, mut slopes) = ([0.0; N], [0.0; N]);
        for i in 0..N {
            values[i] = table[N * (N - 1) + i];
        }
        for k in (0..N - 1).rev() {
            for i in 0..N {
                slopes[i] = slopes[i] * place.s + values[i];
                values[i] = values[i] * place.s + table[N * k + i];
            }
        }
        let inverse = self.inverse[place.cell];
        for slope in &mut slopes {
            *slope *= inverse;
        }
        (values, slopes)
    }

    /// The functions at a place, and their first and second derivatives by the coordinate.
    pub(crate) fn jet(&self, place: Place) -> [[f64; MOST]; 3] {
        let mut jet = [[0.0; MOST]; 3];
        for row in self.table(place.cell).chunks_exact(self.degree + 1).rev() {
            for (i, c) in row.iter().enumerate() {
                jet[2][i] = jet[2][i] * place.s + jet[1][i];
                jet[1][i] = jet[1][i] * place.s + jet[0][i];
                jet[0][i] = jet[0][i] * place.s + c;
            }
        }
        let inverse = self.inverse[place.cell];
        for i in 0..MOST {
            jet[1][i] *= inverse;
            jet[2][i] *= 2.0 * inverse * inverse;
        }
        jet
    }

    #[inline(always)]
    fn table(&self, cell: usize) -> &[f64] {
        let each = (self.degree + 1) * (self.degree + 1);
        let first = self.table_of[cell] * each;
        &self.tables[first..first + each]
    }
}
