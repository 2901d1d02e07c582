"""Settings of the documentation site; `scripts/docs` builds it."""

import sys
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "Jointstiff"
author = "The Jointstiff authors"
copyright = author  # noqa: A001 - Sphinx's name
release = metadata.version("jointstiff")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "generated_pages",
    "external_code",
    "llms",
]
exclude_patterns = ["extensions"]
templates_path = ["templates"]

# Every reference between pages must be found. Types in signatures are not links: most are of other libraries.
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]
suppress_warnings = [
    "misc.highlighting_failure",  # examples with … in place of numbers
    "ref.python",  # a letter of the formulas that several classes carry
]
myst_enable_extensions = ["attrs_block", "deflist"]
myst_heading_anchors = 3

default_role = "code"  # docstrings write `name`
autodoc_default_options = {"members": True}
autodoc_type_aliases = {name: name for name in ("FloatArray", "IndexArray", "BoolArray")}
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
toc_object_entries = False

html_theme = "furo"
html_title = f"{project} {release}"
html_sidebars = {
    "**": [
        "sidebar/scroll-start.html",
        "sidebar/brand.html",
        "sidebar/search.html",
        "page_link.html",
        "sidebar/navigation.html",
        "sidebar/scroll-end.html",
    ]
}
html_favicon = "../dashboard/public/favicon.svg"
html_copy_source = False
html_show_sphinx = False
