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


#: A ground state of each kind, whose types are told, and an argument that there is none of.
GROUND = """import liouville as lv
grid = lv.Grid(-5, 5, 64, potential=lambda t, x, params: x**2 / 2)
reveal_type(lv.analysis.ground_state(lv.Schrodinger(grid, hbar=1.0)))
own = lv.Schrodinger(grid, nonlinearity=lambda t, rho, params: rho, params={"g": 1.0})
reveal_type(lv.analysis.ground_state(own))
def plain(system: lv.Schrodinger) -> float:
    return system.hbar
"""
WRONG = "import liouville as lv\n\nlv.Spark(stags=3)\n"


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """Run mypy once on all programs, and return its messages by the name of the program."""
    api = pytest.importorskip("mypy.api")
    folder = tmp_path_factory.mktemp("programs")
    texts = {"ground": GROUND, "wrong": WRONG}
    for page in PAGES:
        text = (ROOT / page).read_text("utf-8")
        programs = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
        texts[page.removesuffix(".md").replace("/", "_")] = "\n".join(programs)
    for name, text in texts.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("MYPYPATH", str(ROOT / "python"))
        found, problems, _ = api.run([*STRICT, *(f"{name}.py" for name in texts)])
    assert not problems
    lines = [line.partition(".py:") for line in found.splitlines()]
    return {name: [text for file, _, text in lines if file == name] for name in texts}


def test_programs_of_the_documentation_pass_mypy(said):
    errors = {
        name: [text for text in lines if " error:" in text and "no-redef" not in text]
        for name, lines in said.items()
    }
    assert len(errors.pop("wrong")) == 1  # a wrong argument is seen: the types are liouville's
    assert not any(errors.values()), errors


def test_types_say_what_a_ground_state_is(said):
    first, second = (text for text in said["ground"] if "Revealed type" in text)
    assert "GroundState" in first
    assert "Condensate" in second
