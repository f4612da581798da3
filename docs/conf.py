"""Way from the pages to a site: `scripts/site`, which treats every warning as an error and needs no network."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "armid"
version = release = version_of("armid")
copyright = "the armid authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "from_code"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["extensions", "style"]
nitpicky = False

# Pages are read on GitHub as well, so they use little beyond plain Markdown.
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
suppress_warnings = [
    "myst.xref_missing",  # links out of docs/, as to CONTRIBUTING.md; a test looks at every one of them
    "ref.python",  # short names that several modules have
]

default_role = "code"  # docstrings write names in single backticks
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {"Array": "Array", "ArrayLike": "ArrayLike"}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
add_module_names = False
python_use_unqualified_type_names = True

# Equations are drawn by the browser itself where there is no network: MathJax is a script from elsewhere.
html_math_renderer = "mathml"
html_theme = "furo"
html_static_path = ["style"]
html_css_files = ["site.css"]
html_title = "armid"
html_copy_source = False
html_show_sphinx = False
highlight_language = "text"
