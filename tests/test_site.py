"""What the site adds to plain Markdown: links that fit copied pages, tables of contents, plain signatures."""

import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture
def site_pages(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    import site_pages

    yield site_pages
    sys.modules.pop("site_pages")


@pytest.fixture
def tidy_docstrings(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    import tidy_docstrings

    yield tidy_docstrings
    sys.modules.pop("tidy_docstrings")


def fitted(site_pages, docname, text):
    source = [text]
    site_pages.fit_links(None, docname, source)
    return source[0]


@pytest.mark.parametrize(
    ("docname", "text", "expected"),
    [
        ("api", "[c](../CHANGELOG.md#added)", "[c](copied/changelog.md#added)"),
        ("howto/labels", "[c](../../CONTRIBUTING.md)", "[c](../copied/contributing.md)"),
        ("api", "see [results](../benchmarks/results), there", "see results, there"),
        ("api", "see [its page](../README.md)", "see its page"),
        (
            "api",
            "[s](scene.md#shape) and [web](https://example.org)",
            "[s](scene.md#shape) and [web](https://example.org)",
        ),
        ("api", "[data](../benchmarks/results/fps.json)", "[data](../benchmarks/results/fps.json)"),
        ("api", "`x[0](y)`", "`x[0](y)`"),
    ],
)
def test_links_fit_the_site(site_pages, docname, text, expected):
    assert fitted(site_pages, docname, text) == expected


def test_links_of_copies_fit_their_new_place(site_pages, monkeypatch):
    """A copy's links count from where the page was."""
    exists = Path.exists
    monkeypatch.setattr(Path, "exists", lambda path: path == DOCS / "copied" / "contributing.md" or exists(path))
    assert fitted(site_pages, "copied/contributing", "[a](docs/architecture.md)") == "[a](../architecture.md)"


def test_contents_are_the_lists_of_the_index(site_pages):
    text = (
        "# T\n\n[x](api.md)\n\n## First steps\n\n- [Q](quickstart.md): words\n- [C](../CHANGELOG.md)\n\n"
        "## How to\n\n- [G](howto/gpu.md)\n"
    )
    trees = fitted(site_pages, "index", text).split("```{toctree}\n")[1:]
    assert [tree.split("```")[0].split() for tree in trees] == [
        [":caption:", "First", "steps", ":hidden:", "quickstart.md", "copied/changelog.md"],
        [":caption:", "How", "to", ":hidden:", "howto/gpu.md"],
    ]
    assert fitted(site_pages, "api", text).count("toctree") == 0


def test_notebooks_are_listed_where_there_are_any(site_pages, monkeypatch, tmp_path):
    monkeypatch.setattr(site_pages, "NOTEBOOKS", tmp_path)
    assert "toctree" not in fitted(site_pages, "notebooks", "# Notebooks\n")
    (tmp_path / "01_first.ipynb").write_text("{}")
    assert "notebooks/01_first.ipynb" in fitted(site_pages, "notebooks", "# Notebooks\n")


def test_signatures_are_plain(tidy_docstrings):
    signature = (
        "(bits: Annotated[Integer, closed_interval(1, 16)] = 14, place: tuple[Annotated[float, at(f(1), 2)], ...] = ()"
        ", *, kind: Literal['a'] = 'a')"
    )
    plain = tidy_docstrings.plain_signature
    shown, returned = plain(None, "class", "", None, None, signature, "npt.NDArray[np.float64]")
    assert shown == "(bits: Integer = 14, place: tuple[float, ...] = ())"
    assert returned == "NDArray[float64]"
    hidden = plain(None, "class", "", None, None, "(scene: Scene, _world: World)", None)
    assert hidden == ("", None)


def test_words_before_a_colon_are_no_types(tidy_docstrings):
    lines = [
        "Where it falls: (x, y) [px].",
        "",
        "Returns:",
        "    start, shape (n,): those of cone i.",
        "    More: as it is.",
    ]
    changed = list(lines)
    tidy_docstrings.hide_colons(None, "property", "", None, None, changed)
    assert ":" not in changed[0] + changed[3] and changed[4] == lines[4]
    tidy_docstrings.show_colons(None, "property", "", None, None, changed)
    assert changed == lines
