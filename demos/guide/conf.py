"""Configuration of the documentation; ``make docs`` builds this folder with Sphinx."""

import dataclasses
import inspect

import ann_dc

project, author, release = "ann_dc", "the authors of ann_dc", ann_dc.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # pages load nothing from other hosts
    "sphinxcontrib.typer",
    "numpydoc",
]
default_role = "py:obj"  # names in single backticks link to their entries

html_theme = "furo"
html_title = f"ann_dc {release}"
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["guide.css"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_preserve_defaults = True
autodoc_typehints = "none"  # the parameter sections give types and shapes
numpydoc_show_class_members = False

LONGEST = 16
"""Largest number of letters of a default that is shown; the parameter section describes others."""


def shorten_defaults(app, what, name, value, options, signature, annotation):
    """Return the signature of a dataclass without long defaults."""
    if not (what == "class" and dataclasses.is_dataclass(value)):
        return None
    signature = inspect.signature(value)
    words = [str(one.replace(annotation=one.empty)) for one in signature.parameters.values()]
    keyword_only = any(one.kind is one.KEYWORD_ONLY for one in signature.parameters.values())
    return f"({', '.join(['*'] * keyword_only + [_short(word) for word in words])})", None


def _short(word):
    name, is_optional, default = word.partition("=")
    return f"{name}=..." if is_optional and len(default) > LONGEST else word


def skip_fields(app, what, name, value, skip, options):
    """Skip the default of a dataclass field: its entry is in the section of parameters."""
    return True if name in ("progress",) else None


def setup(app):
    """Connect the functions above."""
    app.connect("autodoc-process-signature", shorten_defaults)
    app.connect("autodoc-skip-member", skip_fields)
