"""Assemblies from MJCF and URDF files, which MuJoCo's own compiler reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville.bodies import expansion, unmodelled
from liouville.bodies.assembly import Assembly
from liouville.bodies.body import numbers
from liouville.bodies.geoms import pairs_of, refused
from liouville.bodies.reading import Reader

#: The prefix of the sites that are links.
LINK = "link "

#: A loop of :func:`from_urdf`.
Loop = Sequence[Any]


def from_mjcf(
    source: str | Path,
    *,
    without: Sequence[str] = (),
    controls: Mapping[str, float | Callable[..., Any]] | None = None,
    restitution: float | Mapping[str, float] = 0.0,
) -> Assembly:
    r"""Read an assembly from a file in MuJoCo's format.

    Bodies and joints keep their names, bodies without joints are parts of those that carry them.
    The file is drawn at its reference pose, so a value of a joint is that of MuJoCo less its
    ``ref``. Armature, damping and springs of joints, equality constraints (connect, weld and joint,
    here exact), actuators, and limits and friction loss of hinges and slides come along; friction
    sticks, as :class:`~liouville.bodies.Dry`. So do contacts of spheres, capsules and boxes with
    planes, of spheres with all of these, and in a plane of capsules; limits and contacts are rigid,
    without softness and margins. Friction of contacts is that of mechanisms whose hinges are
    parallel, which move in a plane, and in space of spheres and capsules on planes. What an
    assembly has not is refused by name. Other files that it names are read too; one of more than
    100,000 elements is refused, those counted that it repeats.

    Parameters
    ----------
    source : str or Path
        A path, or the text of the file, which begins with "<".
    without : sequence of str
        What to leave out: "contact", of it "contact shapes" that are not modelled or "friction of
        contacts", "limits", "friction loss", "tendons", "muscles", "activation",
        "transmissions", "actuator models", "nonlinear springs", "nonlinear damping", "springs of
        free bodies", "equality constraints", "fluid", "gravity compensation", "flex", "mocap",
        "plugins".
    controls : mapping, optional
        Signals by actuator: a number, or a function ``f(t, angle, rate, params)`` of the joint that
        it acts on. Others are parameters with the name of the actuator, zero by default.
    restitution : float or mapping, default 0
        That of contacts, of all or by their names, which are those of both shapes, ``"foot.floor"``
        with a plane last.

    Returns
    -------
    Assembly
        With parameters for the actuators in ``params``. A body with several joints has one compound
        joint with their names for its coordinates, called after the body, ``"thigh.joints"``.

    Raises
    ------
    ImportError
        MuJoCo is not installed.
    TypeError, ValueError
        MuJoCo does not read the file; it has what is not modelled; a body has no mass.

    Examples
    --------
    >>> import liouville as lv
    >>> m = lv.bodies.from_mjcf('''<mujoco><worldbody><body name="bob"><joint name="pin"/>
    ...     <geom size="0.1" pos="0 0 -1"/></body></worldbody></mujoco>''')
    >>> m
    <Assembly of 1 body and 1 joint>
    >>> start = m.start(values={"pin": 0.3})
    """
    model, data = _compiled(source)
    return _read(model, data, without, controls, restitution).assembly


def from_urdf(
    source: str | Path,
    *,
    loops: Mapping[str, Loop] | None = None,
    without: Sequence[str] = (),
    controls: Mapping[str, float | Callable[..., Any]] | None = None,
    restitution: float | Mapping[str, float] = 0.0,
) -> Assembly:
    """Read an assembly from a URDF file; its root is fixed to the ground.

    Parameters
    ----------
    source : str or Path
        A path, or the text of the file, which begins with "<".
    loops : mapping, optional
        Joints that the format has no place for, by name: two links and a point of both,
        ``(link, other, point)`` of a ball joint, ``(link, other, point, axis)`` of a hinge, in the
        axes of the first link. Two points, one in the axes of each link, close a loop that is drawn
        open.
    without, controls, restitution : optional
        As for :func:`from_mjcf`.

    Returns
    -------
    Assembly
        As of :func:`from_mjcf`; mimic joints are couplings.

    Raises
    ------
    ImportError, TypeError, ValueError
        As for :func:`from_mjcf`, or a loop names no link.
    """
    model, data = _compiled(source, is_urdf=True)
    reader = _read(model, data, without, controls, restitution)
    for name, loop in (loops or {}).items():
        _close(reader, name, loop)
    return reader.assembly


def _compiled(source: str | Path, *, is_urdf: bool = False) -> tuple[Any, Any]:
    """Return the model that MuJoCo makes of a file, and its state at the reference pose.

    Links of URDF are sites too, as those that stand still lose their names when they are fused: a
    root that is not fused with the world has no floating joint.
    """
    try:
        import mujoco
    except ImportError as error:
        sentence = "MJCF and URDF files are read by MuJoCo, which is not installed"
        raise ImportError(hinted(sentence, "pip install 'liouville[robots]'")) from error
    if not isinstance(source, str | Path):
        raise TypeError(f"a file must be a path or its text, not {source!r}")
    if not str(source).strip():
        raise ValueError(f"a file must be a path or its text, not {source!r}")
    is_text = isinstance(source, str) and source.lstrip().startswith("<")
    what = "the text" if is_text else f"'{source}'"
    _check_size(source, is_text, what)
    try:
        read = mujoco.MjSpec.from_string if is_text else mujoco.MjSpec.from_file
        spec = read(str(source))
        if is_urdf:
            spec.compiler.fusestatic = True
            for body in spec.bodies:
                body.add_site(name=LINK + body.name)
        model = spec.compile()
    except ValueError as error:
        raise ValueError(f"MuJoCo does not read {what}: {error}") from error
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def _check_size(source: str | Path, is_text: bool, what: str) -> None:
    """Refuse what MuJoCo cannot be given, and what would keep it busy for longer than minutes."""
    try:
        str(source).encode()
    except UnicodeEncodeError as error:
        odd = source[error.start : error.end] if isinstance(source, str) else str(source)
        raise ValueError(f"MuJoCo does not read {what!a}: {odd!a} is no character") from error
    folder, text = Path(), str(source)
    if not is_text:
        folder = Path(source).parent
        try:
            text = Path(source).read_text(encoding="utf-8", errors="replace")
        except OSError:  # MuJoCo says why
            return
    count = expansion.elements(text, folder)
    if count > expansion.MOST:
        raise ValueError(
            hinted(
                f"{what} stands for {count} elements or more, of which {expansion.MOST} are read",
                "lower the counts in it, as those of replicate",
            )
        )


def _read(model: Any, data: Any, without: Sequence[str], controls: Any, restitution: Any) -> Reader:
    unmodelled.check_names(without)
    pairs = pairs_of(model, data, without)
    unmodelled.check(model, without, refused(pairs))
    reader = Reader(model, data, controls, without)
    reader.read_contacts(pairs, restitution)
    return reader


def _close(reader: Reader, name: str, loop: Loop) -> None:
    """Add a joint between two links."""
    of = f"loop '{name}'"
    if isinstance(loop, str) or not isinstance(loop, Sequence) or len(loop) not in (3, 4):
        hint = "write (link, other, point), and an axis of a hinge"
        raise ValueError(hinted(f"{of} must be two links and a point, not {loop!r}", hint))
    links = [reader.link(of, LINK, link) for link in loop[:2]]
    shape = np.shape(loop[2])
    points = numbers(f"point of {of}", loop[2], (2, 3) if shape == (2, 3) else (3,))
    if points.ndim == 2:
        at: Any = tuple(own.placed(x) for own, x in zip(links, points, strict=True))
    else:
        at = links[0].placed(points)
    first, second = (link.body for link in links)
    if len(loop) == 3:
        reader.assembly.spherical(name, first, second, at=at)
        return
    axis = numbers(f"axis of {of}", loop[3], (3,))
    turned = [link.turned(axis) for link in links]
    own = turned[0] if points.ndim == 1 else turned
    reader.assembly.revolute(name, first, second, at=at, axis=own)
