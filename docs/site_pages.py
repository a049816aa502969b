"""What the site adds to plain Markdown: pages from outside of docs/, links that fit them, tables of contents."""

from __future__ import annotations

import inspect
import os
import re
import shutil
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
TOP = DOCS.parent

PAGES = {"CONTRIBUTING.md": "contributing", "CHANGELOG.md": "changelog", "catalogs/README.md": "embedded_catalog"}
"""Pages outside of docs/, and what they are called in docs/copied/."""

NOTEBOOKS = TOP / "examples" / "notebooks"
LINK = re.compile(r"\[([^\[\]]*)\]\(([^()#: ]+)((?:#[^()]*)?)\)")


def copies() -> dict[Path, Path]:
    """Files to copy: from where, to where."""
    pages = {TOP / page: DOCS / "copied" / f"{name}.md" for page, name in PAGES.items()}
    return pages | {path: DOCS / "notebooks" / path.name for path in sorted(NOTEBOOKS.glob("*.ipynb"))}


def copy_pages() -> None:
    """Bring the copies up to date; unchanged ones keep their time, so that they are not read again."""
    wanted = copies()
    for folder in ("copied", "notebooks"):
        for old in (DOCS / folder).glob("*.*"):
            if old not in wanted.values():
                old.unlink()
    for source, copy in wanted.items():
        copy.parent.mkdir(exist_ok=True)
        if not copy.exists() or copy.read_bytes() != source.read_bytes():
            shutil.copyfile(source, copy)


def names_of(page: str) -> list[str]:
    """Return the public names of a page of the reference, by the stub in which they are registered."""
    stub = (TOP / "warpsim" / "__init__.pyi").read_text()
    section = re.search(rf"^# {page}\n((?:from .*\n)*)", stub, re.MULTILINE)
    return re.findall(r"import (\w+) as", section[1]) if section else []


def directives(page: str) -> str:
    """Return the directives of autodoc for the public names of a page; data are written there, with their words."""
    import warpsim

    lines = []
    for name in names_of(page):
        thing = getattr(warpsim, name)
        if inspect.isclass(thing):
            kind = "exception" if issubclass(thing, Exception) else "class"
            lines += [f".. auto{kind}:: {name}", "   :members:"]
            if any(base.__module__.startswith("warpsim.") for base in thing.__mro__[1:]):
                lines.append("   :inherited-members:")
            lines.append("")
        elif callable(thing):
            lines += [f".. autofunction:: {name}", ""]
    return "\n".join(lines)


def add_names(app: Any, docname: str, source: list[str]) -> None:
    """Put the public names of a page of the reference where it asks for them."""
    if ".. public-names::" in source[0]:
        source[0] = source[0].replace(".. public-names::", directives(docname.rpartition("/")[2]))


def fit_links(app: Any, docname: str, source: list[str]) -> None:
    """Let links to copied pages lead to the copies, from wherever a page was.

    Links to folders, and to pages that the site does not have, become plain text.
    """
    moved = copies()
    page = next((DOCS / f"{docname}{end}" for end in (".md", ".ipynb") if (DOCS / f"{docname}{end}").exists()), DOCS)
    origin = next((path for path, copy in moved.items() if copy == page), page)

    def fitted(match: re.Match[str]) -> str:
        text, link, anchor = match.groups()
        target = Path(os.path.normpath(origin.parent / link))
        elsewhere = target.suffix == ".md" and DOCS not in target.parents and target not in moved
        if target.is_dir() or (elsewhere and target.exists()):
            return text
        if not target.exists() or (target not in moved and origin == page):
            return match[0]
        return f"[{text}]({os.path.relpath(moved.get(target, target), page.parent)}{anchor})"

    source[0] = LINK.sub(fitted, source[0])
    source[0] += contents(docname, source[0])


def contents(docname: str, text: str) -> str:
    """Tables of contents, which readers of plain Markdown need not see: the lists of index.md, and the notebooks."""
    if docname == "notebooks":
        names = [f"notebooks/{copy.name}" for copy in copies().values() if copy.parent.name == "notebooks"]
        return toctree("", names) if names else ""
    if docname != "index":
        return ""
    sections = re.split(r"^## (.*)\n", text, flags=re.MULTILINE)[1:]
    lists = zip(sections[::2], sections[1::2], strict=True)
    return "".join(toctree(title, [link[1] for link in LINK.findall(body)]) for title, body in lists)


def toctree(caption: str, pages: list[str]) -> str:
    """A hidden table of contents in MyST's words."""
    head = [f":caption: {caption}", ":hidden:"] if caption else [":hidden:"]
    return "\n".join(["", "```{toctree}", *head, "", *pages, "```", ""])
