"""The names of what the tapes of a system take and give, for people to read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from liouville._systems.program import elements

if TYPE_CHECKING:
    from liouville._systems.mechanics.general import Mechanics
    from liouville._systems.mechanics.semi_explicit import SemiExplicit

#: The parts of a tape's outputs by name, with the names of their elements.
Parts = dict[str, list[str]]

#: Each tape by its name: the vectors that it takes, and its parts.
Layout = dict[str, tuple[tuple[str, ...], Parts]]

#: Time and state.
POINT = ("t", "y", "z")


def of_mechanics(system: Mechanics) -> Layout:
    """Lay out the tapes of `problem::mechanical` in the core, in the order of their outputs."""
    n, m, own = len(system.coordinates), len(system.holonomic), len(system.nonholonomic)
    names = dict(zip("yz", system.states, strict=True))
    has_velocity = "v_z" in system.patterns

    def vectors(**sizes: int) -> Parts:
        if has_velocity and "momentum" in sizes:
            sizes["velocity"] = n
        return {name: elements(name, size) for name, size in sizes.items() if size}

    def slopes(*keys: str) -> Parts:
        found = {}
        for key in keys:
            if key in system.patterns:
                of, _, by = key.partition("_")
                label = f"{of}_{names.get(by, by)}"
                _, _, row, column = system.patterns[key]
                found[label] = [f"{label}[{i},{j}]" for i, j in zip(row, column, strict=True)]
        return found

    node, rolling = ("t", "y", "lam"), (*POINT, "nu")
    rates = vectors(motion=n, hidden_rate=m, nonholonomic_rate=own)
    rates |= vectors(velocity_rate=n) if has_velocity else {}
    found: Layout = {
        "stage": (POINT, vectors(momentum=n, force=n)),
        "stage_blocks": (POINT, slopes("p_z", "v_z")),
        "stage_jacobian": (POINT, slopes("p_y", "f_y", "f_z", "v_y")),
        "node": (node, vectors(constraint=m, reaction=n)),
        "node_blocks": (node, slopes("g_y", "r_lam")),
        "node_jacobian": (node, slopes("r_y")),
        "end": (POINT, vectors(momentum=n, hidden=m)),
        "acceleration": (POINT, rates),
        "nonholonomic": (rolling, vectors(nonholonomic=own, nonholonomic_reaction=n)),
        "nonholonomic_blocks": (rolling, slopes("k_y", "k_z", "rn_y", "rn_z", "rn_nu")),
        "nonholonomic_hidden": (POINT, slopes("w_y")),
        "reactions": (POINT, slopes("reactions")),
    }
    return {name: found[name] for name in found if name in system.tapes}


def of_semi_explicit(system: SemiExplicit) -> Layout:
    """Lay out the tapes of `semi_explicit` in the core."""
    n, count = len(system.coordinates), len(system.unknowns)

    def slopes(*keys: str) -> Parts:
        places = {key: system.patterns[key][2:] for key in keys}
        return {
            key: [f"{key}[{i},{j}]" for i, j in zip(*place, strict=True)]
            for key, place in places.items()
        }

    place, rates = ("t", "y"), {"hidden_rate": count, "rate": n}
    return {
        "field": (POINT, {"field": elements("field", n)}),
        "field_jacobian": (POINT, slopes("f_y", "f_z")),
        "constraint": (place, {"constraint": elements("constraint", count)}),
        "constraint_jacobian": (place, slopes("k_y")),
        "hidden": (POINT, {"hidden": elements("hidden", count), "field": elements("field", n)}),
        "hidden_jacobian": (POINT, slopes("w_z", "f_z")),
        "rates": (POINT, {x: elements(x, size) for x, size in rates.items()}),
    }
