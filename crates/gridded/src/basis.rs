//! The spline functions of one axis, as polynomials on its cells.

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
    /// The same, for each table and function those of all powers.
    by_function: Vec<f64>,
    table_of: Vec<usize>,
    origin: Vec<f64>,
    inverse: Vec<f64>,
    bounds: Bounds,
    cells_per_unit: f64,
    /// 1 / length
    per_length: f64,
}

/// The cell of a coordinate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) cell: usize,
    /// The coordinate, which is a wall's where it is beyond that by roundoff.
    pub(crate) x: f64,
    /// Coordinates from the first bound on and below the second one have this place.
    pub(crate) between: [f64; 2],
    /// The origin of the cell, as many periods further as the coordinate is, and 1 / width.
    pub(crate) origin: f64,
    pub(crate) inverse: f64,
}

impl Place {
    /// The coordinate within the cell.
    pub(crate) fn s(&self) -> f64 {
        (self.x - self.origin) * self.inverse
    }
}

/// Roundings by which a coordinate may be beyond a wall.
const ROUNDINGS: f64 = 4.0;
/// Roundings of the number of periods, by which the last cell of a period and its first one are apart.
const TURN_ROUNDINGS: f64 = 16.0;
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
        let mut by_function = tables.clone();
        for (table, turned) in tables
            .chunks_exact(each)
            .zip(by_function.chunks_exact_mut(each))
        {
            for (k, row) in table.chunks_exact(degree + 1).enumerate() {
                for (function, c) in row.iter().enumerate() {
                    turned[function * (degree + 1) + k] = *c;
                }
            }
        }
        let inverse = edges.windows(2).map(|pair| 1.0 / (pair[1] - pair[0]));
        Ok(Self {
            inverse: inverse.collect(),
            cells_per_unit: cells as f64 / (edges[cells] - edges[0]),
            per_length: 1.0 / (edges[cells] - edges[0]),
            edges,
            degree,
            tables,
            by_function,
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

    /// The place of a coordinate; outside the axis that of the nearest cell, whose polynomials go on.
    pub(crate) fn find(&self, x: f64) -> Place {
        let (start, last) = (self.edges[0], self.cells() - 1);
        let end = self.edges[last + 1];
        let is_periodic = self.bounds == Bounds::Periodic;
        let shift = if is_periodic {
            ((x - start) * self.per_length).floor() * (end - start)
        } else {
            0.0
        };
        let guess = (x - shift - start) * self.cells_per_unit;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a cast saturates
        let mut cell = (guess as usize).min(last);
        while cell > 0 && x < shift + self.edges[cell] {
            cell -= 1;
        }
        while cell < last && x >= shift + self.edges[cell + 1] {
            cell += 1;
        }
        let mut between = [shift + self.edges[cell], shift + self.edges[cell + 1]];
        let apart = TURN_ROUNDINGS * f64::EPSILON * (x.abs() + (end - start));
        if is_periodic && cell == 0 {
            between[0] += apart;
        }
        if cell == last {
            between[1] = if is_periodic {
                between[1] - apart
            } else {
                end.next_up()
            };
        }
        Place {
            cell,
            x,
            between,
            origin: shift + self.origin[cell],
            inverse: self.inverse[cell],
        }
    }

    /// The place of a coordinate, if it is inside the axis. Beyond a wall by roundoff is on it.
    pub(crate) fn locate(&self, x: f64) -> Option<Place> {
        if !x.is_finite() {
            return None;
        }
        let (start, end) = (self.edges[0], self.edges[self.cells()]);
        let beyond = (start - x).max(x - end);
        if beyond <= 0.0 || self.bounds == Bounds::Periodic {
            return Some(self.find(x));
        }
        if self.bounds == Bounds::Open {
            let place = self.find(x);
            return (beyond * place.inverse <= SLACK).then_some(place);
        }
        let is_roundoff = beyond <= ROUNDINGS * f64::EPSILON * (start.abs() + end.abs());
        is_roundoff.then(|| self.find(x.clamp(start, end)))
    }

    /// The functions of a cell as polynomials: for each function its coefficients of s^k, in the order of k.
    pub(crate) fn polynomials(&self, cell: usize) -> &[f64] {
        let each = (self.degree + 1) * (self.degree + 1);
        let first = self.table_of[cell] * each;
        &self.by_function[first..first + each]
    }

    /// The functions at a place, and their first and second derivatives by the coordinate.
    pub(crate) fn jet(&self, place: Place) -> [[f64; MOST]; 3] {
        let (mut jet, s) = ([[0.0; MOST]; 3], place.s());
        for row in self.table(place.cell).chunks_exact(self.degree + 1).rev() {
            for (i, c) in row.iter().enumerate() {
                jet[2][i] = jet[2][i] * s + jet[1][i];
                jet[1][i] = jet[1][i] * s + jet[0][i];
                jet[0][i] = jet[0][i] * s + c;
            }
        }
        let inverse = place.inverse;
        for i in 0..MOST {
            jet[1][i] *= inverse;
            jet[2][i] *= 2.0 * inverse * inverse;
        }
        jet
    }

    fn table(&self, cell: usize) -> &[f64] {
        let each = (self.degree + 1) * (self.degree + 1);
        let first = self.table_of[cell] * each;
        &self.tables[first..first + each]
    }
}
