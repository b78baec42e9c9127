//! The sign of a determinant, which tells the branch of a solution.

/// The meaning of a determinant's sign in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signs {
    /// A solution with the other sign than that of a small step is on another branch; none was found.
    Regarded,
    /// The same, and one was found.
    Reversed,
    /// Nothing: the branch turns, as that of a stretched spring does that ends compressed, or passes a singular position.
    Disregarded,
}

impl Signs {
    /// Whether a sign means something.
    pub fn are_regarded(self) -> bool {
        self != Self::Disregarded
    }

    /// Whether signs tell branches: without constraints always, with constraints, where they are rarely looked at, once one
    /// is reversed.
    pub fn tell(self, has_constraints: bool) -> bool {
        self == Self::Reversed || !has_constraints && self.are_regarded()
    }

    /// Disregards signs from here on; returns whether one was against a solution.
    pub fn disregard(&mut self) -> bool {
        std::mem::replace(self, Self::Disregarded) == Self::Reversed
    }
}
