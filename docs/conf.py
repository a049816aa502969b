"""The site: `python -m sphinx -W --keep-going docs build/docs` from the top of the checkout, with the extra `docs`.

Pages are plain Markdown that reads well without the site. Notebooks are shown as they were run: nothing is executed.
"""

from __future__ import annotations

import sys
from pathlib import Path

TOP = Path(__file__).parents[1]
sys.path[:0] = [str(TOP / folder) for folder in ("docs", ".", "kernels", "catalogs")]

import field_tables  # noqa: E402
import site_pages  # noqa: E402
import tidy_docstrings  # noqa: E402

tidy_docstrings.name_array_types()  # before anything of warpsim is imported

import warpsim  # noqa: E402

project = "warpsim"
author = copyright = "The warpsim developers"
release = version = warpsim.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["**/.ipynb_checkpoints"]
default_role = "py:obj"  # names in docstrings become links where there is something to lead to

nb_execution_mode = "off"
myst_heading_anchors = 4  # those of GitHub, so that a link is good there and here

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
napoleon_numpy_docstring = False
python_maximum_signature_line_length = 100

html_theme = "furo"
html_title = f"warpsim {release}"
html_copy_source = False


def setup(app):  # noqa: D103
    site_pages.copy_pages()
    app.connect("source-read", site_pages.add_names)
    app.connect("source-read", site_pages.fit_links)
    tidy_docstrings.connect(app)
    field_tables.connect(app)
