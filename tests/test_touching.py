"""Shapes that touch and ropes, beside closed forms and MuJoCo's distances."""

import numpy as np
import pytest

import liouville as lv
from liouville.bodies import Assembly, Box, Capsule, Plane, Polygon, Sphere

G = 9.81
UP = (0, 1, 0)


def thrown(m, t, rates, h=0.01, method=None):
    start = m.start(rates=rates)
    return lv.integrate(m.system(), method or lv.Spark(3), t=(0, t), h=h, **start)


def flying(m, name, **more):
    """Add a body in space that flies freely."""
    body = m.body(name, mass=1.0, inertia=(0.1, 0.1, 0.1), **more)
    m.free(f"flight of {name}", body)
    return body


@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(3)], ids=repr)
def test_a_disc_that_slides_begins_to_roll_at_two_thirds_of_its_speed(method):
    m = Assembly(gravity=(0, -G, 0))
    disc = m.planar_body("disc", mass=2.0, inertia=2.0 * 0.1**2 / 2, at=(0, 0.1))
    m.free("flight", disc)
    m.contact("floor", Plane("ground", normal=UP), Sphere(disc, radius=0.1), friction=0.3)
    run = thrown(m, 1, {"flight": (1.5, 0, None, None, None, 0)}, method=method)
    floor = run.contacts["floor"]
    assert [c.kind for c in floor.changes] == ["close", "stick"]
    assert floor.changes[1].t == pytest.approx(1.5 / (3 * 0.3 * G), abs=1e-13)
    np.testing.assert_allclose(run.v[-1], [1.0, 0, -10.0], atol=1e-12)
    assert floor.slip[0] == pytest.approx(1.5)
    assert floor.friction[0] == pytest.approx(-0.3 * 2.0 * G, abs=1e-11)


def test_places_in_the_plane_have_two_numbers():
    runs = []
    for z in ((), (0.0,)):
        m = Assembly(gravity=(0, -G, 0))
        disc = m.planar_body("disc", mass=2.0, inertia=0.01, at=(0, 0.5))
        m.free("flight", disc)
        ball = Sphere(disc, 0.1, at=(0.02, 0.5, *z))
        m.contact("floor", Plane("ground", at=(0, 0, *z), normal=(0, 1, *z)), ball)
        m.contact("rail", Capsule("ground", [(1, 0, *z), (2, 0, *z)], 0.1), ball, restitution=0.5)
        runs.append(thrown(m, 1, {"flight": (1.5, 0, None, None, None, 0)}))
    assert np.array_equal(runs[0].q, runs[1].q)
    m = Assembly()
    with pytest.raises(ValueError, match="bodies in space, and a place of its shapes has two"):
        m.contact("floor", Plane("ground", normal=(0, 1)), Sphere(flying(m, "ball"), 0.1))


def test_balls_in_space_exchange_velocities_along_the_line_of_their_centres():
    m = Assembly()
    first = flying(m, "first")
    second = flying(m, "second", at=(1.0, 0.1, 0))
    m.contact("pair", Sphere(first, 0.1), Sphere(second, 0.1), restitution=1)
    run = thrown(m, 2, {"flight of first": (1, 0, 0, 0, 0, 0)})
    (hit,) = run.contacts["pair"].changes
    n = np.array([np.sqrt(0.03), 0.1, 0]) / 0.2
    assert hit.t == pytest.approx(1 - np.sqrt(0.03), abs=1e-13)
    v = [run.body(name).velocity[-1] for name in ("first", "second")]
    np.testing.assert_allclose(v[1], n[0] * n, atol=1e-13)
    np.testing.assert_allclose(v[0], [1, 0, 0] - n[0] * n, atol=1e-13)
    assert hit.normal == pytest.approx(n[0], abs=1e-13)


FIXED = {
    "edge of a box": (Box("ground", (2, 2, 2)), (1, 1), 0.0),
    "corner of a box": (Box("ground", (2, 2, 2)), (1, 1), 1.0),
    "capsule": (Capsule("ground", [(0, -5, 0), (0, 5, 0)], 1), (0, 0), 0.0),
    "end of a capsule": (Capsule("ground", [(0, -1, 0), (0, 1, 0)], 1), (0, 0), 1.0),
}


@pytest.mark.parametrize("what", FIXED)
def test_a_ball_that_falls_beside_is_thrown_off_along_the_normal(what):
    """It falls with 2 m/s and without gravity, from 3 m, a bit off what it hits."""
    shape, (x, z), y = FIXED[what]
    beside, radius = 0.2, 0.5
    reach = radius + (1 if isinstance(shape, Capsule) else 0)
    place = np.array([x + beside, y * 1.1, 3.0])
    off = np.array([beside, 0.1 * y, 0])
    off[2] = np.sqrt(reach**2 - off @ off)
    m = Assembly()
    ball = flying(m, "ball", at=place)
    m.contact("touch", shape, Sphere(ball, radius), restitution=0.5)
    run = thrown(m, 2, {"flight of ball": (0, 0, -2, 0, 0, 0)})
    hit = run.contacts["touch"].changes[0]
    assert hit.t == pytest.approx((3 - z - off[2]) / 2, abs=1e-12)
    n = off / reach
    after = run.body("ball").velocity[-1]
    np.testing.assert_allclose(after, [0, 0, -2] + 1.5 * 2 * n[2] * n, atol=1e-12)


def test_a_box_in_space_falls_flat_and_its_corners_bear_its_weight():
    m = Assembly(gravity=(0, 0, -G))
    box = flying(m, "box", at=(0, 0, 1))
    m.contact("floor", Box(box, (1, 0.6, 0.4)), Plane("ground"))
    run = thrown(m, 1, {})
    assert run.body("box").position[-1, 2] == pytest.approx(0.2, abs=1e-14)
    bears = sum(record.normal[-1] for record in run.contacts.values())
    assert bears == pytest.approx(G, abs=1e-10)
    low = [name for name, record in run.contacts.items() if record.mode[-1].name == "CLOSED"]
    assert low == [f"floor.{k}" for k in (0, 2, 4, 6)]


def test_a_brick_falls_on_another_and_both_stay():
    m = Assembly(gravity=(0, -G, 0))
    bricks = []
    for k, centre in enumerate([(0.0, 0.26), (0.1, 0.78)]):
        body = m.planar_body(f"brick {k}", mass=1.0, inertia=0.1, at=centre)
        m.free(f"flight {k}", body)
        corners = np.array([(-0.5, -0.25), (0.5, -0.25), (0.5, 0.25), (-0.5, 0.25)])
        bricks.append(Polygon(body, corners + np.array(centre), radius=0.0025))
        m.contact(f"floor {k}", bricks[-1], Plane("ground", normal=UP), friction=0.3)
    m.contact("pair", *bricks, friction=0.3)
    run = thrown(m, 0.2, {}, h=0.02)
    assert run.contacts["floor 0.0"].mode[-1].name == "STICK"
    bears = {name: record.normal[-1] for name, record in run.contacts.items()}
    of_pair = [x for name, x in bears.items() if name.startswith("pair")]
    of_floor = [x for name, x in bears.items() if name.startswith("floor 0")]
    assert sum(of_pair) == pytest.approx(G, abs=1e-9)
    assert sum(of_floor) == pytest.approx(2 * G, abs=1e-9)
    assert sum(x > 0 for x in of_pair) == 2
    tops = [run.body(f"brick {k}").position[-1, 1] for k in range(2)]
    np.testing.assert_allclose(tops, [0.2525, 0.7575], atol=1e-13)


def test_bricks_slide_from_beside_one_another_and_are_refused_corner_on_corner():
    for off in (0.0, 1e-6):
        m = Assembly(gravity=(G * np.sin(0.29), -G * np.cos(0.29), 0))
        brick = m.planar_body("brick", mass=1.0, inertia=0.01, at=(off, 0.05))
        m.free("flight", brick)
        corners = np.array([(-0.1, 0.001), (0.1, 0.001), (0.1, 0.099), (-0.1, 0.099)])
        own = Polygon(brick, corners + np.array([off, 0]), radius=0.001)
        bed = Polygon("ground", corners - np.array([0, 0.1]), radius=0.001)
        m.contact("pair", bed, own, friction=0.25)
        if not off:
            with pytest.raises(lv.IntegrationError, match=r"penetrates .*\n.*begin beside"):
                thrown(m, 0.2, {}, h=0.02)
    speed = 0.2 * G * (np.sin(0.29) - 0.25 * np.cos(0.29))
    run = thrown(m, 0.2, {}, h=0.02)
    np.testing.assert_allclose(run.body("brick").velocity[-1], [speed, 0, 0], atol=1e-12)


def test_bodies_that_touch_fall_freely_together():
    """Nothing presses them: forces are zero to roundoff, and no mode gives way for that."""
    m = Assembly(gravity=(0, -G, 0))
    discs = [m.planar_body(f"{k}", mass=1.0, inertia=0.01, at=(0.02 * k, k * 0.2)) for k in (0, 1)]
    for disc in discs:
        m.free(f"flight {disc.name}", disc)
    radius = np.hypot(0.02, 0.2) / 2
    m.contact("pair", *(Sphere(disc, radius) for disc in discs), friction=0.5)
    run = thrown(m, 1, {}, h=0.05)
    np.testing.assert_allclose(run.v[-1], [0, -G, 0, 0, -G, 0], atol=1e-12)
    assert len(run.contacts["pair"].changes) <= 3


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_rope_goes_taut_with_a_jerk(restitution):
    m = Assembly(gravity=(0, 0, -G))
    bob = m.point_mass("bob", mass=2.0, at=(0.6, 0, 0))
    m.free("flight", bob)
    m.rope("rope", "ground", bob, at=((0, 0, 0), (0.6, 0, 0)), length=1, restitution=restitution)
    run = thrown(m, 0.45, {})
    hit = run.contacts["rope"].changes[0]
    assert hit.t == pytest.approx(np.sqrt(2 * 0.8 / G), abs=1e-13)
    speed = np.sqrt(2 * 0.8 * G)
    assert hit.normal == pytest.approx(2 * (1 + restitution) * 0.8 * speed, abs=1e-12)
    if not restitution:
        at, v = run.body("bob").position, run.body("bob").velocity
        taut = run.t >= hit.t
        np.testing.assert_allclose(np.linalg.norm(at[taut], axis=1), 1, atol=1e-14)
        tension = 2 * ((v[taut] ** 2).sum(axis=1) - G * at[taut, 2])
        np.testing.assert_allclose(run.contacts["rope"].normal[taut], tension, atol=1e-10)
    assert run.contacts["rope"].gap[0] == pytest.approx(0.4)


def test_friction_of_bodies_in_space_that_move_in_a_plane():
    """A capsule slides on both its ends and comes to rest, as a block does."""
    m = Assembly(gravity=(0, 0, -G))
    rod = m.body("rod", mass=1.0, inertia=(0.01, 0.1, 0.1), at=(0, 0, 0.1))
    m.planar("P", m.ground, rod, at=(0, 0, 0.1), normal=UP)
    shape = Capsule(rod, [(-0.4, 0, 0.1), (0.4, 0, 0.1)], 0.1)
    m.contact("floor", shape, Plane("ground"), friction=0.2, across=(0, -1, 0))
    start = m.start()
    start["v"][:3] = 1.0, 0, 0
    run = lv.integrate(m.system(), lv.Spark(3), t=(0, 1), h=0.02, **start)
    assert run.contacts["floor.0"].slip[0] == pytest.approx(1.0)
    assert run.contacts["floor.1"].mode[-1].name == "STICK"
    rest = run.body("rod").position[-1]
    np.testing.assert_allclose(rest, [1 / (2 * 0.2 * G), 0, 0.1], atol=1e-12)


def test_a_capsule_in_space_that_falls_flat_bounces_on_both_ends_at_once():
    """They hit within a rounding of one another, the second one first."""
    m = Assembly(gravity=(0, 0, -G))
    log = m.body("log", mass=2.0, inertia=(0.01, 0.15, 0.15), at=(0, 0, 0.6))
    m.free("flight", log)
    shape = Capsule(log, [(-0.4, 0, 0.6), (0.4, 0, 0.6)], 0.1)
    m.contact("floor", shape, Plane("ground"), restitution=1.0)
    run = lv.integrate(m.system(), lv.Spark(3), t=(0, 3), h=0.02, **m.start())
    times = np.sqrt(2 * 0.5 / G) * np.arange(1, 10, 2)
    for record in run.contacts.values():
        np.testing.assert_allclose([x.t for x in record.changes], times, rtol=1e-13)
        impulses = [x.normal for x in record.changes]
        np.testing.assert_allclose(impulses, 2 * np.sqrt(2 * G * 0.5), rtol=1e-13)
    assert np.ptp(run.invariants["energy"]) < 1e-13 * G


def rod(m, at, half=1.0, radius=0.1):
    """Add a capsule that flies in the plane."""
    body = m.planar_body("rod", mass=3.0, inertia=0.9, at=at)
    m.free("flight", body)
    return Capsule(body, np.add(at, [(-half, 0), (half, 0)]), radius)


@pytest.mark.parametrize("is_first", [True, False])
def test_a_rod_that_falls_on_the_end_of_another_turns_about_it(is_first):
    """It falls with v and is hit d beside its centre: by (1 + e) m v / (1 + m d^2 / I)."""
    m = Assembly()
    own, post = rod(m, (0.4, 1)), Capsule("ground", [(0, -1), (0, 0)], 0.2)
    m.contact("pair", *((own, post) if is_first else (post, own)), restitution=0.5)
    run = thrown(m, 0.5, {"flight": (None, -2, None, None, None, None)})
    (hit,) = [x for record in run.contacts.values() for x in record.changes]
    assert hit.t == pytest.approx(0.7 / 2, abs=1e-14)
    impulse = 1.5 * 3 * 2 / (1 + 3 * 0.4**2 / 0.9)
    assert hit.normal == pytest.approx(impulse, rel=1e-13)
    np.testing.assert_allclose(run.v[-1], [0, impulse / 3 - 2, -0.4 * impulse / 0.9], atol=1e-12)


def test_a_rod_rests_on_a_table_and_on_its_edge_by_the_lever():
    """From x = -1 to 1 it bears on its left end and, at x = 0.5, on the corner of the table."""
    m = Assembly(gravity=(0, -G, 0))
    table = Polygon("ground", [(-2, -1), (0.5, -1), (0.5, 0), (-2, 0)])
    m.contact("table", rod(m, (0, 0.1)), table, friction=0.4)
    run = thrown(m, 0.5, {"flight": (-1.0, None, None, None, None, None)})
    bears = {name: record.normal[0] for name, record in run.contacts.items() if record.normal[0]}
    assert {*bears} == {"table.0 of a", "table.2 of b"}
    # slid by friction, too, which acts 0.1 below the centre
    left, corner = bears.values()
    assert left + corner == pytest.approx(3 * G, rel=1e-12)
    assert left - 0.5 * corner == pytest.approx(0.1 * 0.4 * 3 * G, rel=1e-11)
    assert run.body("rod").position[-1, 0] == pytest.approx(-1 / (2 * 0.4 * G), rel=1e-12)


def test_capsules_in_a_plane_are_as_far_apart_as_by_mujoco():
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(5)
    for _ in range(30):
        ends = np.zeros((2, 2, 3))
        ends[..., :2] = rng.normal(size=(2, 2, 2))
        ends[1, :, 0] += 5
        geoms = "".join(
            f'<body><joint/><geom type="capsule" size="0.1" fromto="{a} {b}"/></body>'
            for a, b in ends
        )
        text = f"<mujoco><worldbody>{geoms}</worldbody></mujoco>"
        text = text.replace("[", "").replace("]", "")
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        wanted = mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None)
        assert gap(lv.bodies.from_mjcf(text)).min() == pytest.approx(wanted, abs=1e-6)


def gap(m, params=None):
    system, start = m.system(params=params), m.start()
    at = system.contacts.at(0.0, start["q"], start["v"], system.values(None), 0.1)
    return at.gap


def test_distances_are_those_of_mujoco():
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(3)
    for _ in range(30):
        x, e = rng.normal(size=(2, 3)) * 0.7, rng.normal(size=(2, 4))
        e /= np.linalg.norm(e, axis=1)[:, None]
        size, ends = rng.uniform(0.3, 0.8, 3), rng.normal(size=(2, 3))
        text = f"""<mujoco><worldbody>
            <body pos="{x[0]} "><freejoint/><geom type="sphere" size="0.2"/></body>
            <body pos="{x[1]} " quat="{e[1]}"><freejoint/>
              <geom type="box" size="{size / 2}"/></body>
            <body><freejoint/><geom type="capsule" size="0.1"
              fromto="{ends[0]} {ends[1]}"/></body></worldbody></mujoco>"""
        model = mujoco.MjModel.from_xml_string(text.replace("[", "").replace("]", ""))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        wanted = [mujoco.mj_geomDistance(model, data, 0, k, 10.0, None) for k in (1, 2)]
        m = Assembly()
        ball = flying(m, "ball", at=x[0])
        box = flying(m, "box", at=x[1], rotation=e[1])
        m.contact("box's", Sphere(ball, 0.2), Box(box, size))
        m.contact("capsule's", Sphere(ball, 0.2), Capsule("ground", ends, 0.1))
        np.testing.assert_allclose(gap(m), wanted, atol=1e-6 if min(wanted) > 0 else 1e-5)


def test_the_distance_of_a_polygon_is_that_of_its_outline():
    """A square of edge 2, seen from its sides, its corners and within."""
    for place, wanted in {
        (2, 0.5): 1,
        (2, 2): np.sqrt(2),
        (0.5, -3): 2,
        (-4, -1): 3,
        (0.9, 0): -0.1,
        (0, 0): -1,
    }.items():
        m = Assembly()
        disc = m.planar_body("disc", mass=1.0, inertia=1.0, at=place)
        m.free("flight", disc)
        square = [(1, -1), (1, 1), (-1, 1), (-1, -1)]
        for corners in (square, square[::-1]):
            m.contact("pair", Sphere(disc, 0.1), Polygon("ground", corners, radius=0.2))
            assert gap(m)[0] == pytest.approx(wanted - 0.3, abs=1e-14)
            m.remove("pair")


def test_sizes_of_shapes_may_depend_on_parameters():
    m = Assembly()
    ball = m.planar_body("ball", mass=1.0, inertia=1.0, at=(0, 3))
    m.free("flight", ball)
    floor = Plane("ground", at=lambda params: (0, params.floor, 0), normal=UP)
    m.contact("floor", Sphere(ball, lambda params: params.r), floor)
    m.rope("rope", ball, "ground", at=((0, 3, 0), (0, 0, 0)), length=lambda params: 20 * params.r)
    system = m.system(params={"r": 0.5, "floor": 1.0})
    found = system.contacts.at(0.0, np.array([0, 3.0, 0]), np.zeros(3), system.values(None), 0.1)
    np.testing.assert_allclose(found.gap, [1.5, 7])
    with pytest.raises(ValueError, match="radius of contact 'floor' must be positive, not -1"):
        system.values({"r": -1.0})


def touching(a, b, space=True, **more):
    m = Assembly()
    for name in ("p", "q"):
        if space:
            flying(m, name)
        else:
            m.planar_body(name, mass=1.0, inertia=1.0)
            m.free(f"flight {name}", name)
    m.contact("touch", a, b, **more)


def roped(at):
    m = Assembly()
    m.rope("r", "ground", flying(m, "p"), at=at)


CORNERS = [(0, 0), (1, 0), (0, 1)]
REFUSED = {
    "contact 'touch' takes two shapes, not 'p'": lambda: touching("p", Plane("ground")),
    "contact 'touch' joins 'p' with itself": lambda: touching(Sphere("p", 1), Sphere("p", 1)),
    "contact 'touch' joins 'r', which is no body": lambda: touching(Sphere("r"), Plane("ground")),
    "of two planes, which meet in no point": lambda: touching(Plane("p"), Plane("ground")),
    "of two points, which do not meet": lambda: touching(Sphere("p"), Sphere("q")),
    "of a box and a box": lambda: touching(Box("p", (1, 1, 1)), Box("q", (1, 1, 1))),
    "of a box and a capsule, whose edges may touch along a line": lambda: touching(
        Box("p", (1, 1, 1)), Capsule("q", np.eye(3)[:2], 0.1)
    ),
    "of a capsule and a capsule, whose edges may touch along a line": lambda: touching(
        Capsule("p", np.eye(3)[:2], 0.1), Capsule("q", np.eye(3)[:2], 0.1), across=(0, 1, 0)
    ),
    "of a corner on a corner": lambda: touching(
        Polygon("p", CORNERS), Polygon("q", CORNERS), False
    ),
    "has a polygon, which planar bodies have": lambda: touching(
        Polygon("p", CORNERS), Plane("ground")
    ),
    "is none across theirs": lambda: touching(Sphere("p", 1), Plane("ground"), False),
    "in space that of spheres and capsules on planes is followed": lambda: touching(
        Sphere("p", 1), Sphere("q", 1), friction=0.1
    ),
    "friction must be zero or positive, not -1": lambda: touching(
        Sphere("p", 1), Plane("ground"), friction=-1
    ),
    "restitution must be from 0 to 1, not 3": lambda: touching(
        Sphere("p", 1), Plane("ground"), restitution=3
    ),
    "radius= of a sphere must be zero or positive, not -1": lambda: Sphere("p", -1),
    "an edge of a box must be positive, not 0": lambda: Box("p", (1, 0, 1)),
    "ends= of a capsule must be": lambda: Capsule("p", (1, 0, 1), 1),
    "normal= of a plane has length zero": lambda: Plane("p", normal=(0, 0, 0)),
    "no convex one": lambda: Polygon("p", [(0, 0), (1, 0), (0.2, 0.2), (0, 1)]),
    "those of no convex": lambda: Polygon("p", [(0, 0), (1, 0)]),
    "length= of rope 'r' must be positive, not 0": lambda: roped(((0, 0, 0), (0, 0, 0))),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_does_not_touch_is_said(words):
    with pytest.raises((TypeError, ValueError), match=words):
        REFUSED[words]()


def test_a_contact_is_taken_out_again():
    m = Assembly()
    ball = flying(m, "ball", at=(0, 0, 1))
    m.contact("floor", Sphere(ball, 0.1), Plane("ground"))
    with pytest.raises(ValueError, match="there is a contact called 'floor' already"):
        m.rope("floor", ball, "ground", at=((0, 0, 1), (0, 0, 0)))
    with pytest.raises(ValueError, match="'flight of ball' and 'floor' need 'ball'"):
        m.remove("ball")
    assert m.system().contacts is not None
    m.remove("floor")
    assert m.system().contacts is None


def test_a_woodpecker_toy_pecks_its_way_down_without_penetration():
    """Of 3 s with 160 stretches one begins with a flight of a ninth of a step."""
    toy = Assembly(gravity=(0, -G, 0))
    sleeve = toy.planar_body("sleeve", mass=0.3e-3, inertia=5e-9)
    bird = toy.planar_body("bird", mass=4.5e-3, inertia=0.7e-6, at=(0.025, 0))
    toy.guide("pole", "ground", sleeve, lambda position, params: [position[0]])
    toy.revolute("spring", sleeve, bird, at=(0.01, 0, 0), spring=0.0056)
    pole = Plane("ground", at=(0.0025, 0, 0), normal=(1, 0, 0))
    for name, y in (("top", 0.0058), ("bottom", -0.0058)):
        toy.contact(name, Sphere(sleeve, at=(0.0031, y, 0)), pole, friction=0.35)
    beak = Sphere(bird, at=(0.0049, 0.02, 0))
    toy.contact("beak", beak, pole, friction=0.35, restitution=0.5)
    start = toy.start(values={"spring": -0.4})
    run = lv.integrate(toy.system(), lv.Spark(3), t=(0, 3), h=1e-3, **start)
    for record in run.contacts.values():
        assert record.gap.min() > -1e-15
        assert record.normal.min() > -1e-12
    assert len(run.contacts["beak"].changes) == 21
    assert np.diff(run.invariants["energy"]).max() < 2e-9


@pytest.mark.parametrize(("speed", "hits"), [(55.0, 0), (70.0, 20), (90.0, 2)])
def test_a_follower_lifts_off_where_its_cam_slows_down_faster_than_spring_and_weight(speed, hits):
    """Its normal force is m a + k (s + s0) + m g, and first zero at 63.1 rad/s."""
    mass, stiffness, off, pressed = 0.2, 200.0, 0.01, 0.01
    m = Assembly(gravity=(0, -G, 0))
    cam = m.planar_body("cam", mass=0.5, inertia=2e-4, at=(0, -off))
    follower = m.planar_body("follower", mass=mass, inertia=1e-4, at=(0, 0.06))
    m.revolute("shaft", "ground", cam, at=(0, 0), motion=lambda t, params: speed * t)
    m.prismatic("guide", "ground", follower, axis=(0, 1, 0), spring=stiffness, rest=-pressed)
    face = Plane(follower, at=(0, 0.02), normal=(0, -1))
    m.contact("touch", Sphere(cam, 0.03), face, restitution=0.3)
    system = m.system()
    run = lv.integrate(system, lv.Spark(3), t=(0, 4 * np.pi / speed), steps=400, **m.start())
    touch = run.contacts["touch"]
    assert touch.gap.min() > -1e-15
    assert touch.normal.min() > -1e-11
    assert sum(x.kind == "hit" for x in touch.changes) == hits
    load = mass * G + stiffness * (off + pressed)
    wanted = -load / (off * (mass * speed**2 - stiffness))
    assert (wanted > -1) == (hits > 0) == (speed > 63.1)
    if hits:
        left = next(x.t for x in touch.changes if x.kind == "leave")
        assert left == pytest.approx(np.arccos(wanted) / speed, abs=1e-14)


def test_coefficients_of_shapes_may_be_functions_of_the_parameters():
    def falls(friction, restitution):
        yard = Assembly(gravity=(0, -9.81, 0))
        disc = yard.planar_body("disc", mass=1.0, inertia=0.005, at=(0, 0.6))
        yard.free("flight", disc)
        laws = {"friction": friction, "restitution": restitution}
        yard.contact("bounce", Sphere(disc, radius=0.1), Plane("ground", normal=(0, 1, 0)), **laws)
        system = yard.system({"mu": 0.1, "e": 0.6})
        start = yard.start(rates={"flight": (3, 0, None, None, None, 0)})
        return lv.integrate(system, lv.Spark(3), t=(0, 1.0), h=0.02, **start)

    free = falls(lambda params: params.mu, lambda params: params.e)
    assert free.q.tobytes() == falls(0.1, 0.6).q.tobytes()
