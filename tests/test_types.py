"""Programs as users write them, those of the documentation, pass the checks of types."""

import re

import pytest
from pages import ROOT

PAGES = (
    "README.md",
    *(f"docs/{name}.md" for name in ("start", "copy", "choose", "coming_from")),
    *(f"docs/fields/{name}.md" for name in ("astronomy", "fluids", "machines", "molecules")),
    *(f"docs/guide/{name}.md" for name in ("analysis", "mechanical", "structures")),
)
# A user's functions of a model have no types, and some libraries beside ours have none.
STRICT = (
    "--strict",
    "--allow-untyped-defs",
    "--allow-untyped-calls",
    "--allow-redefinition",
    "--disable-error-code=import-untyped",
    "--disable-error-code=no-redef",
    "--no-error-summary",
)


def test_programs_of_the_documentation_pass_mypy(tmp_path, monkeypatch):
    api = pytest.importorskip("mypy.api")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MYPYPATH", str(ROOT / "python"))
    scripts = []
    for page in PAGES:
        programs = re.findall(
            r"^```python\n(.*?)^```", (ROOT / page).read_text("utf-8"), re.M | re.S
        )
        scripts.append(tmp_path / f"{page.removesuffix('.md').replace('/', '_')}.py")
        scripts[-1].write_text("\n".join(programs), encoding="utf-8")
    wrong = tmp_path / "wrong.py"
    wrong.write_text("import liouville as lv\n\nlv.Spark(stags=3)\n", encoding="utf-8")
    found, problems, _ = api.run([*STRICT, *map(str, (*scripts, wrong))])
    assert not problems
    reported = [
        line for line in found.splitlines() if ": error:" in line and "no-redef" not in line
    ]
    assert [line for line in reported if "wrong.py" not in line] == []
    assert len(reported) == 1  # a wrong argument is seen: the types are those of liouville


def test_types_say_what_a_ground_state_is(tmp_path, monkeypatch):
    api = pytest.importorskip("mypy.api")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MYPYPATH", str(ROOT / "python"))
    script = tmp_path / "ground.py"
    script.write_text(
        "import liouville as lv\n"
        "grid = lv.Grid(-5, 5, 64, potential=lambda t, x, params: x**2 / 2)\n"
        "reveal_type(lv.analysis.ground_state(lv.Schrodinger(grid, hbar=1.0)))\n"
        "own = lv.Schrodinger(grid, nonlinearity=lambda t, rho, params: rho, params={'g': 1.0})\n"
        "reveal_type(lv.analysis.ground_state(own))\n"
        "def plain(system: lv.Schrodinger) -> float:\n"
        "    return system.hbar\n",
        encoding="utf-8",
    )
    found, problems, _ = api.run([*STRICT, str(script)])
    assert not problems
    notes = [line for line in found.splitlines() if "Revealed type" in line]
    assert "GroundState" in notes[0]
    assert "Condensate" in notes[1]
    assert "error:" not in found
