"""Cost of a step and memory on chains of 10 to 10 000 links, and the same motion by other codes.

Three chains: the hanging chain of point masses in the plane, and rigid rods in space, in unit
quaternions, with spherical and with revolute joints. The step is h = 0.2/N, that of the links'
own oscillations. A step's time is the difference of a long and a short run, the minimum of repeats,
in seconds of the processor; each size runs in a process of its own, whose peak memory is counted
less what the imports took, building the system included and shown apart. Slopes are of the
logarithms, fitted over all sizes.

With ``pip install exudyn scikit-sundae numba`` the plane chain of 10 and 100 links is also stepped
by Exudyn's generalised alpha and by SUNDIALS' IDA on the stabilised index-2 form, sparse, to t = 1:
time and the error of the tip, beside those of Spark(2) at several steps. Run as
``python benchmarks/chain_scaling.py``; takes some minutes.
"""

import importlib.util
import json
import resource
import subprocess
import sys
import time

import numpy as np
from report import publish, show

import liouville as lv
from liouville.problems import chain, rigid_chain

LINKS = {
    "plane": (10, 100, 1000, 10_000),
    "spherical": (10, 100, 1000),
    "revolute": (10, 100, 1000),
}
METHODS = {
    "Spark(2)": lv.Spark(2),
    "Spark(4)": lv.Spark(4),
    "Spark(2) newton": lv.Spark(2, solver="newton"),
    "LobattoPair(2)": lv.LobattoPair(2),
    "HHT": lv.HHT(-0.1),
}
REPEATS = 3
MORE = 200_000  # steps times links in the long run, but at least 20 steps
COMPARED = (10, 100)


def model(kind, links):
    """Return a chain, its start and a step."""
    if kind == "plane":
        return chain.build(links), chain.start_for(links), 0.2 / links
    revolute = kind == "revolute"
    system, start = rigid_chain.build(links, revolute), rigid_chain.start_for(links, revolute)
    return system, start, 0.1 / links


def peak():
    """Peak memory of this process so far, in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def one(kind, links, name):
    """Return the row of one size; runs in its own process."""
    imports = peak()
    begin = time.process_time()
    system, start, h = model(kind, links)

    def run(steps):
        begin = time.process_time()
        options = {"t": (0.0, steps * h), "steps": steps, "every": steps, "states": False}
        stats = lv.integrate(system, METHODS[name], **options, **start).stats
        return time.process_time() - begin, stats["iterations"]

    few, more = 3, max(20, MORE // links)
    run(1)
    building, built = time.process_time() - begin, peak()
    short, long = (min(run(count) for _ in range(REPEATS)) for count in (few, few + more))
    seconds, corrections = ((long[k] - short[k]) / more for k in (0, 1))
    return {
        "chain": kind,
        "method": name,
        "links": links,
        "µs a step": 1e6 * seconds,
        "µs a link": 1e6 * seconds / links,
        "corrections": corrections,
        "building s": building,
        "MiB": built - imports,
    }


def scaling():
    """Return the rows of all sizes, and the slopes."""
    rows, slopes = [], []
    for kind, sizes in LINKS.items():
        for name in METHODS:
            own = []
            for links in sizes:
                command = [sys.executable, __file__, kind, str(links), name]
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                if done.returncode:
                    print(kind, name, links, done.stderr.strip().splitlines()[-1])
                else:
                    own.append(json.loads(done.stdout))
            rows += own
            if len(own) > 1:
                logs = np.log([row["links"] for row in own])
                powers = {
                    key: float(np.polyfit(logs, np.log([row[key] for row in own]), 1)[0])
                    for key in ("µs a step", "MiB")
                }
                slopes.append({"chain": kind, "method": name, **powers})
    return rows, slopes


def in_the_plane(rows):
    """Yield a row for each size: microseconds a step by each method, with its corrections."""
    for links in LINKS["plane"]:
        own = {x["method"]: x for x in rows if (x["chain"], x["links"]) == ("plane", links)}
        costs = {name: f"{x['µs a step']:.3g} ({x['corrections']:.2g})" for name, x in own.items()}
        first = own["Spark(2)"]
        yield {"links": links, **costs, "building s": first["building s"], "MiB": first["MiB"]}


def tip(q):
    return np.asarray(q)[-2:]


def beside_peers():
    """Return rows of the plane chain to t = 1 by other codes and by Spark(2)."""
    from peers import sundials
    from peers.implicit import implicit
    from peers.mechanisms import Exudyn
    from peers.mechanisms import chain as bodies

    rows = []
    for links in COMPARED:
        system, start, _ = model("plane", links)
        fine = lv.integrate(
            system, lv.Spark(5), t=(0.0, 1.0), steps=40 * links, every=40 * links, **start
        )
        exact = tip(fine.q[-1])

        def row(code, setting, seconds, q, links=links, exact=exact):
            error = float(abs(tip(q) - exact).max())
            return {
                "links": links,
                "code": code,
                "setting": setting,
                "ms": 1e3 * seconds,
                "error": error,
            }

        for a_link in (1, 2, 4, 8):
            steps = a_link * links
            options = {"t": (0.0, 1.0), "steps": steps, "every": steps}
            lv.integrate(system, lv.Spark(2), **options, **start)
            begin = time.perf_counter()
            solution = lv.integrate(system, lv.Spark(2), **options, **start)
            rows.append(
                row("Spark(2)", f"{steps} steps", time.perf_counter() - begin, solution.q[-1])
            )
        for a_link in (4, 16):
            steps = a_link * links
            peer = Exudyn(bodies, system, start, (0.0, 1.0), "sparse")
            seconds, q, _ = peer.run(steps)
            rows.append(row("Exudyn", f"{steps} steps", seconds, q))
        equation = implicit(system, "ggl", start, 0.0)
        for code, kind in (("IDA in C", sundials.InC), ("scikit-sundae", sundials.ScikitSundae)):
            peer = kind(equation, (0.0, 1.0), (1.0, 1.0), sparse=True)
            peer.run(1e-2)
            for tolerance in (1e-4, 1e-6):
                seconds, q, _ = peer.run(tolerance)
                rows.append(row(code, f"rtol {tolerance:g}", seconds, q))
    return rows


def main():
    """Publish the tables, or print the row of one size."""
    if len(sys.argv) == 4:
        kind, links, name = sys.argv[1:]
        print(json.dumps(one(kind, int(links), name)))
        return
    rows, slopes = scaling()
    show(rows)
    print()
    show(slopes)
    print()
    publish("chain_scaling", list(in_the_plane(rows)))
    if importlib.util.find_spec("exudyn") and importlib.util.find_spec("sksundae"):
        print()
        show(beside_peers())


if __name__ == "__main__":
    main()
