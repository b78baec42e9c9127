"""The pages as a reader finds them: addresses name files, the reference has public names only."""

import importlib
import inspect
import re

import pytest
from pages import PAGES, ROOT, name

import liouville

SITE = "https://liouville-integrators.github.io/liouville/"
HOST = "https://github.com/liouville-integrators/liouville"
RAW = "https://raw.githubusercontent.com/liouville-integrators/liouville/main/"
REFERENCE = [ROOT / "docs" / "api.md", *sorted((ROOT / "docs" / "api").glob("*.md"))]


def addresses(page):
    return re.findall(r"https?://[^\s)>\]\"`]+", page.read_text(encoding="utf-8"))


def of_the_tree(address):
    """Return the file of the repository that an address shows; None for an outside one."""
    if address.startswith(RAW):
        return address.removeprefix(RAW)
    if address.startswith(f"{HOST}/blob/main/"):
        return address.removeprefix(f"{HOST}/blob/main/").split("#")[0]
    inside = address.removeprefix(SITE).split("#")[0]
    if address.startswith(SITE) and inside:
        if inside.startswith("gallery/"):  # built from the examples
            script = inside.removeprefix("gallery/").replace(".html", ".py")
            return "examples/GALLERY_HEADER.rst" if script == "index.py" else f"examples/{script}"
        return f"docs/{inside.replace('.html', '.md')}"
    return None


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_addresses_of_our_own_name_files_of_the_tree(page):
    named = {address: of_the_tree(address) for address in addresses(page)}
    lost = [where for where, path in named.items() if path and not (ROOT / path).is_file()]
    assert not lost, f"{name(page)} points to {lost}"


def test_the_readme_points_nowhere_by_a_relative_path():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)]+)\)", text) + re.findall(r"^\[[^\]]+\]: (\S+)", text, re.M)
    assert targets
    assert [target for target in targets if not target.startswith("https://")] == []


def entries(page):
    """Return the names that the directives of a page document, with their members."""
    text = page.read_text(encoding="utf-8")
    for block in re.findall(
        r"^\.\. auto(?:class|function|data|exception|module):: .*\n(?:   .*\n)*", text, re.M
    ):
        found = re.match(r"\.\. auto(\w+):: (\S+)", block)
        members = re.search(r"^   :members:(.*(?:\n {6}.*)*)$", block, re.M)
        # systems inherit what only runners call
        assert page.stem != "systems" or ":inherited-members:" not in block, found[2]
        yield found[2], [] if members is None else re.findall(r"\w+", members[1])


def resolve(path):
    """Return the object of a dotted name, which is relative to the package or absolute."""
    parts = path.removeprefix("liouville.").split(".")
    found = liouville
    for part in parts:
        if not hasattr(found, part):
            importlib.import_module(f"{found.__name__}.{part}")
        found = getattr(found, part)
    return found


def test_the_reference_has_all_public_names_and_those_members_that_exist():
    listed = {}
    for page in REFERENCE:
        for path, members in entries(page):
            found = resolve(path)
            assert path not in listed, f"{path} is documented twice"
            listed[path] = found
            for member in members:
                assert hasattr(found, member), f"{path} has no {member}"
                assert inspect.getdoc(getattr(found, member)), f"{path}.{member} says nothing"
    # those that are imported when they are first used are not among its variables before
    given = {known: getattr(liouville, known) for known in dir(liouville) if known[0] != "_"}
    public = {known for known, found in given.items() if not inspect.ismodule(found)}
    assert {"GriddedField", "FieldPlan", "Store"} < public
    assert public - set(listed) - {"METHODS"} == set()
    assert "liouville._methods.METHODS" in listed


def test_public_names_are_few_and_have_one_door():
    assert len(liouville.__all__) == len(set(liouville.__all__)) <= 60
    assert set(dir(liouville)) == {*liouville.__all__, *liouville._ROOMS, "__version__"}
    for room in liouville._ROOMS:
        inside = getattr(liouville, room)
        shared = set(getattr(inside, "__all__", ())) & set(liouville.__all__)
        twice = {name for name in shared if getattr(inside, name) is getattr(liouville, name)}
        assert not twice, f"{room} has {twice} too"


# nobody calls these
MADE_BY_RUNS = {"IntegrationError", "OptimalControl", "OptimizationError", "Pullback", "WavePlan"}
CALLS = {
    known: found
    for known in liouville.__all__
    if known not in MADE_BY_RUNS and callable(found := getattr(liouville, known))
}


@pytest.mark.parametrize("known", CALLS)
def test_every_parameter_is_described(known):
    told = inspect.getdoc(CALLS[known]) or ""
    given = inspect.signature(CALLS[known]).parameters.values()
    wanted = [each.name for each in given if each.kind is not each.VAR_KEYWORD]
    lines = re.findall(r"^(\S[^\n:]*?) ?(?::[^\n]*)?$", told, re.M)
    words = {word.strip(" *") for line in lines for word in line.split(",")}
    missing = [word for word in wanted if word not in words]
    assert not missing, f"{known} does not describe {missing}"


def test_the_film_is_small():
    assert (ROOT / "docs" / "_static" / "film.gif").stat().st_size < 400_000
