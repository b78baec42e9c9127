"""Error constants of the composition schemes: what they leave of order p + 1 in the free algebra.

With Phi_h = exp(h E_1 + h^2 E_2 + h^3 E_3 + ...) and Phi*_h the same with h^2 E_2, h^4 E_4, ...
negative, a composition of order p is exp(h E_1) + h^(p+1) (c_1 w_1 + c_2 w_2 + ...) + ..., where
the w are the words of degree p + 1 in the letters E_k of degree k. C is the Euclidean norm of the
c. With s stages, pairs of a Phi and a Phi*, the cost at equal error goes as s C^(1/p).

Run as ``python benchmarks/composition_errors.py``.
"""

from math import factorial

import numpy as np
from report import publish

from liouville.methods.composition import SCHEMES


def words(degree):
    """Tuples of positive integers with this sum."""
    if degree == 0:
        return [()]
    return [(k, *rest) for k in range(1, degree + 1) for rest in words(degree - k)]


class Algebra:
    """Series in the letters, up to a degree: one coefficient for each word."""

    def __init__(self, most):
        self.words = [word for degree in range(most + 1) for word in words(degree)]
        self.degrees = np.array([sum(word) for word in self.words])
        self.evens = np.array([sum(k % 2 == 0 for k in word) for word in self.words])
        self.exponential = np.array([1 / factorial(len(word)) for word in self.words])
        self.flow = np.where([set(word) <= {1} for word in self.words], self.exponential, 0.0)
        index = {word: k for k, word in enumerate(self.words)}
        cuts = [(k, word, at) for k, word in enumerate(self.words) for at in range(len(word) + 1)]
        self.products = np.array([(k, index[w[:at]], index[w[at:]]) for k, w, at in cuts]).T

    def step(self, is_adjoint, alpha):
        """Return the series of a step or its adjoint."""
        sign = (-1.0) ** self.evens if is_adjoint else 1.0
        return sign * alpha**self.degrees * self.exponential

    def product(self, left, right):
        """Return the series of one map followed by another."""
        target, first, second = self.products
        return np.bincount(target, left[first] * right[second])


def row(name, scheme):
    order, flows = scheme["order"], scheme["flows"]
    algebra = Algebra(order + 1)
    series = algebra.step(*flows[0])
    for flow in flows[1:]:
        series = algebra.product(series, algebra.step(*flow))
    left = (series - algebra.flow)[algebra.degrees == order + 1]
    constant, stages = float(np.linalg.norm(left)), len(flows) / 2
    return {
        "scheme": name,
        "order": order,
        "stages": f"{stages:g}",
        "largest step": round(max(abs(alpha) for _, alpha in flows), 3),
        "C": float(f"{constant:.2e}"),
        "s C^(1/p)": round(stages * constant ** (1 / order), 2),
    }


def main():
    publish("composition_errors", [row(name, scheme) for name, scheme in SCHEMES.items()])


if __name__ == "__main__":
    main()
