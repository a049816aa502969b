"""The words agree with the code: snippets run, fields, columns and options are all there, links lead somewhere."""

import importlib
import inspect
import re
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest
from pydantic import TypeAdapter

import warpsim as ws
from docs import field_tables, site_pages
from warpsim.config.distributions import KINDS
from warpsim.dataset.layout import check_extremes
from warpsim.orbit.constellations import Constellation, Orbit
from warpsim.scene.scene import Scene

TOP = Path(__file__).parents[1]
DOCS = TOP / "docs"
MODELS = field_tables.models_within(Scene)
# Without the pages that the site copies in.
PAGES = [TOP / "README.md", *sorted(p for p in DOCS.rglob("*.md") if p.parent.name not in ("copied", "notebooks"))]
MORE_PAGES = [TOP / "CONTRIBUTING.md", TOP / "CHANGELOG.md"]


def name_of(page):
    """Of a page, for the names of tests."""
    return str(page.relative_to(TOP))


def blocks(page, language):
    """Fenced code blocks of one language."""
    return re.findall(rf"^```{re.escape(language)}\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


def recipes(page):
    """Blocks that are recipes of data sets: they name their scene."""
    return [text for text in blocks(page, "toml") if text.startswith("scene = ")]


def sections(page):
    """Text under each heading, by heading."""
    pieces = re.split(r"^#+ (.*)\n", page.read_text(), flags=re.MULTILINE)
    return dict(zip(pieces[1::2], pieces[2::2], strict=True))


def first_column(text):
    """What stands in backquotes in the first column of the tables of a text."""
    cells = re.findall(r"^\|([^|]*)\|", text, re.MULTILINE)
    return [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=name_of)
@pytest.mark.ci
def test_python_blocks_run(page, tmp_path, monkeypatch):
    """Top to bottom, in one namespace, as a reader would."""
    monkeypatch.chdir(tmp_path)
    names = {"__name__": page.stem}
    for recipe in recipes(page):
        (tmp_path / "recipe.toml").write_text(recipe)
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), names)


def test_toml_blocks_are_scenes():
    texts = [text for page in PAGES for text in blocks(page, "toml") if text not in recipes(page)]
    assert texts
    for text in texts:
        assert Scene.from_dict(tomllib.loads(text)).target_names


def test_recipes_are_recipes_and_their_page_lists_all_fields(tmp_path):
    page = TOP / "docs" / "datasets.md"
    (text,) = recipes(page)
    (tmp_path / "recipe.toml").write_text(text)
    recipe = ws.Recipe.load(tmp_path / "recipe.toml")
    check_extremes(recipe)
    assert len(recipe.distributions) == 4
    assert first_column(sections(page)["Fields"]) == [field.name for field in fields(ws.Recipe)]
    kinds = [re.match(r"{ (\w+) =", cell)[1] for cell in first_column(sections(page)["Distributions"])]
    assert kinds == list(KINDS)


STATIONS = """\
ISS (ZARYA)
1 25544U 98067A   25152.00000000  .00001764  00000-0  38792-4 0  9996
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
COSMOS 1
1 25545U 98067A   25152.00000000  .00001764  00000-0  38792-4 0  9997
2 25545  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202483
TIANHE
1 48274U 98067A   25152.00000000  .00001764  00000-0  38792-4 0  9991
2 48274  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202487
"""


def test_toml_parts_are_parts_of_scenes(tmp_path, monkeypatch):
    """Blocks marked "toml part" hold one table of a scene; their files are beside them."""
    monkeypatch.chdir(tmp_path)
    Path("stations.tle").write_text(STATIONS)
    known = {"constellation": TypeAdapter(Constellation), "trajectory": TypeAdapter(Orbit)}
    texts = [text for page in PAGES for text in blocks(page, "toml part")]
    assert len(texts) >= 10
    for text in texts:
        ((name, data),) = tomllib.loads(text).items()
        if name == "targets":
            assert [TypeAdapter(ws.TargetSpec).validate_python(item) for item in data]
            continue
        if name not in known:
            stss = Scene.load("stss")
            assert stss.replace(**{name: data}) != stss
            continue
        states = known[name].validate_python(data).states(Scene.load("stss").epoch, [0.0])
        assert states[0].shape[::2] == (1, 3)


def test_tables_of_the_scene_page_are_those_of_all_config_models():
    shown = [name for text in blocks(DOCS / "scene.md", "{config-fields}") for name in text.split()]
    distributions = field_tables.models_within(ws.Recipe.__pydantic_fields__["sample"].annotation)
    assert len(distributions) == len(KINDS)
    assert sorted(shown) == sorted(set(MODELS) - set(distributions))


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_every_field_says_what_it_is(model):
    rows = field_tables.field_rows([model])
    assert [row.name for row in rows if not (row.meaning or row.name == "kind")] == []


def test_fields_say_their_unit_rule_and_default():
    fov, psf, seed = (
        next(row for row in field_tables.field_rows([MODELS[model]]) if row.name == name)
        for model, name in (("Camera", "fov_deg"), ("Optics", "psf"), ("Scene", "seed"))
    )
    assert (fov.unit, fov.rule, fov.default) == ("deg", "in (0, 120)", "-")
    assert (psf.unit, psf.rule, psf.default) == ("", '"airy", "gaussian", "table"', '"airy"')
    assert (seed.rule, seed.default) == (f"in [0, {2**63 - 1}]", "0")
    assert field_tables.field_table([ws.Jitter])[2].startswith("| `rms_urad` | urad | in [0, 100000] | required | ")


@pytest.mark.parametrize("kind", ["truth", "stars"])
@pytest.mark.ci
def test_output_page_lists_every_column(kind):
    scene = Scene.load("stss").replace(background__zodiacal=True, detector__line_time_s=1e-5)
    frames = ws.Renderer(scene, device="cpu").render([60], ["sat11"], ["A"], keep_stars=True)
    listed = first_column(sections(TOP / "docs" / "output.md")["Truth"])
    columns = [*frames.truth.colnames, *frames.stars.colnames]
    assert set(listed) == set(columns)
    assert [name for name in listed if name in getattr(frames, kind).colnames]


def test_output_page_lists_every_column_of_frames_and_every_key(tmp_path):
    import json

    from astropy.io import fits

    ws.render_to_folder(Scene.load("stss"), tmp_path, frames=[60], sensors=["sat11"], bands=["A"], device="cpu")
    text = sections(TOP / "docs" / "output.md")
    with fits.open(tmp_path / "sat11_A.fits") as file:
        assert set(file["FRAMES"].columns.names) <= set(first_column(text["FITS cubes"]))
        own = set(file[0].header) - {"SIMPLE", "BITPIX", "NAXIS", "NAXIS1", "NAXIS2", "NAXIS3", "EXTEND"}
        assert own - {"BSCALE", "BZERO", "BUNIT"} <= set(first_column(text["FITS cubes"]))
    for key in json.loads((tmp_path / "manifest.json").read_text()):
        assert f"`{key}`" in text["Manifest"] or key in ("warpsim", "python", "packages")


def test_api_page_names_everything_public():
    text = (TOP / "docs" / "api.md").read_text()
    assert [name for name in ws.__all__ if not re.search(rf"\b{name}\b", text)] == []


def reference():
    """Names on the pages of the reference, as directives of autodoc or Python's own: full name to kind."""
    names = []
    for page in sorted((DOCS / "reference").glob("*.md")):
        module = ""
        text = page.read_text().replace(".. public-names::", site_pages.directives(page.stem))
        for kind, name in re.findall(r"^\.\. (?:py:|auto)?(\w+):: (\S+)", text, re.MULTILINE):
            if kind == "currentmodule":
                module = f"{name}."
            elif kind == "module":
                names.append((name, kind))
            else:
                names.append((name if name.startswith("warpsim.") else module + name, kind))
    assert len(dict(names)) == len(names)  # none twice
    return dict(names)


def test_reference_has_every_public_name_and_no_other():
    public = {f"warpsim.{name}" for name in ws.__all__}
    own = {name for name in reference() if name.count(".") == 1}
    assert own == public


def test_every_page_of_the_stub_asks_for_its_names():
    pages = re.findall(r"^# (\w+)$", (TOP / "warpsim" / "__init__.pyi").read_text(), re.MULTILINE)
    asking = {page.stem for page in (DOCS / "reference").glob("*.md") if ".. public-names::" in page.read_text()}
    assert set(pages) == asking
    assert [name for page in pages for name in site_pages.names_of(page)] == ws.__all__[8:]


def test_reference_names_what_there_is():
    for name, kind in reference().items():
        if kind == "module":
            assert importlib.import_module(name).__doc__
            continue
        home, _, last = name.rpartition(".")
        thing = getattr(importlib.import_module(home), last)
        assert kind == "data" or thing.__doc__, name
        assert inspect.isclass(thing) == (kind in ("class", "exception"))


def test_command_line_page_has_every_command():
    shown = [name for text in blocks(DOCS / "command_line.md", "{command-options}") for name in text.split()]
    assert shown == list(field_tables.commands())
    assert "| `--step` S | time between positions [s]; chosen by their error if left out |" in "\n".join(
        field_tables.command_table("czml")
    )
    assert all("None" not in line for name in shown for line in field_tables.command_table(name))


def test_first_screen_has_the_two_commands():
    first = blocks(TOP / "README.md", "console")[0]
    assert first.splitlines() == [
        "python -m pip install . && warpsim render stss -o out",
        "python -m pip install '.[test]' && python -m pytest -n auto",
    ]


def test_every_notebook_is_named():
    notebooks = sorted(path.name for path in (TOP / "examples" / "notebooks").glob("*.ipynb"))
    named = re.findall(r"\(\.\./examples/notebooks/(\S+\.ipynb)\)", (DOCS / "notebooks.md").read_text())
    assert named == notebooks != []


def anchors(page):
    """What a link may lead to within a page: its headings, as GitHub and the site name them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^#+ (.*)", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", [*PAGES, *MORE_PAGES], ids=name_of)
def test_links_lead_to_files_and_headings(page):
    links = re.findall(r"\]\(([^)#]*)#?([^)]*)\)|src=\"([^\"]+)\"", page.read_text())
    for link, anchor, picture in links:
        if "://" not in link:
            target = (page.parent / (picture or link)).resolve() if picture or link else page
            assert target.exists(), link
            assert not anchor or anchor in anchors(target), f"{link}#{anchor}"


def test_every_page_is_in_the_contents():
    """The lists of docs/index.md, of which the site makes its tables of contents, name each page once."""
    index = DOCS / "index.md"
    lists = index.read_text().split("\n## ", 1)[1]
    listed = [(DOCS / link).resolve() for link in re.findall(r"^- \[[^\]]+\]\(([^)]+)\)", lists, re.MULTILINE)]
    inside = [page for page in listed if DOCS in page.parents]
    assert sorted(inside) == sorted(page for page in PAGES if DOCS in page.parents and page != index)
    assert [page for page in listed if page not in inside] == [TOP / "catalogs" / "README.md", *MORE_PAGES]
