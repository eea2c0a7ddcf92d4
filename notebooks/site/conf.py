"""The documentation site, built without a network, from the root of the project, by

    python -m sphinx -W -q notebooks/site build/site

(``-j auto`` uses all processors). Notebooks and derivations are copied here as Jupyter notebooks,
into ``_copied``, which git ignores. Sphinx runs them, and the code cells of these pages. What was
built before is run again when its own text has changed, or with the option ``-E``.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jupytext
import latex2mathml.converter
import zmq
from docutils import nodes
from jupyter_client.manager import KernelManager
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell
from sphinx.addnodes import download_reference

import limitsurf
from limitsurf.shell.files import replacing

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
COPIED = HERE / "_copied"
DOCUMENTS = ("notebooks", "derivations")
# The first cell of each notebook, which its page does not show.
INSTALL = """\
# Where limitsurf is missing, as on a fresh machine, install it from a clone or a wheel.
import importlib.util

SOURCE = "."  # the folder of a clone, or a wheel
if importlib.util.find_spec("limitsurf") is None:
    %pip install -q "{SOURCE}[plot]\""""

if hasattr(KernelManager, "transport_encryption") and zmq.has("curve"):
    KernelManager.transport_encryption.default_value = "auto"  # kernels warn of sockets without it

project = "limitsurf"
author = "the limitsurf authors"
copyright = author
release = version = limitsurf.__version__

extensions = [
    *("myst_nb", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.autosummary"),
    "sphinx.ext.viewcode",  # the source of all that the reference names
]
exclude_patterns = ["_copied/pictures"]
default_role = "py:obj"
templates_path = ["_templates"]

myst_enable_extensions = ["amsmath", "attrs_block", "attrs_inline", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_show_tb = True  # with the warning that an error is; all pages are tried
nb_execution_timeout = 300
nb_ipywidgets_js: dict[str, Any] = {}  # nothing from the network
nb_merge_streams = True
nb_render_markdown_format = "gfm"

autosummary_generate = True
autosummary_filename_map = {"limitsurf.Eigenbasis": "limitsurf.Eigenbasis-class"}  # not by case
autodoc_typehints = "none"  # numpydoc sections name the types
numpydoc_show_class_members = False  # the template lists them

html_theme = "pydata_sphinx_theme"
html_title = "limitsurf"
html_static_path = ["_static"]
html_extra_path = ["_copied/pictures"]  # scenes that the gallery has written
html_css_files = ["site.css"]
html_favicon = "_static/favicon.svg"
html_logo = "_static/favicon.svg"
html_show_sourcelink = False
html_copy_source = False
html_math_renderer = "mathml"
html_context = {"default_mode": "auto"}
html_sidebars: dict[str, list[str]] = {
    page: [] for page in ("index", "tutorial", "concepts", "gallery")
}
html_theme_options = {
    "logo": {"text": f"limitsurf {version}"},
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "header_links_before_dropdown": 7,
    "show_toc_level": 2,
}


def documents() -> Iterator[tuple[Path, Path]]:
    """Each document of the project, and its copy."""
    for folder in DOCUMENTS:
        for path in sorted((ROOT / folder).glob("*.py")):
            yield path, (COPIED / folder / path.name).with_suffix(".ipynb")
    index = ROOT / "derivations" / "README.md"
    if index.exists():
        yield index, COPIED / "derivations" / "README.md"


def copy_documents() -> None:
    """Bring the copies up to date; whatever else is among them goes."""
    wanted = {copy: path for path, copy in documents()}
    for folder in DOCUMENTS:
        (COPIED / folder).mkdir(parents=True, exist_ok=True)
        for found in (COPIED / folder).iterdir():
            if found.is_dir():
                shutil.rmtree(found)
            elif found not in wanted:
                found.unlink()
    (COPIED / "pictures").mkdir(exist_ok=True)
    shutil.rmtree(COPIED / "api", ignore_errors=True)  # autosummary writes it anew
    for copy, path in wanted.items():
        if path.suffix == ".md":
            text = with_contents(linked(path.read_text("utf-8")))
        else:
            notebook = jupytext.read(path, fmt="py:percent")
            text = jupytext.writes(rendered(notebook), fmt="ipynb")
        # a copy that is not touched is not run again
        if not copy.exists() or copy.read_bytes() != text.encode():
            with replacing(copy) as file:
                file.write(text.encode())


def clear_pictures(app: Any, env: Any, page: str) -> None:
    """Forget the scenes that the gallery wrote, when it is about to be run."""
    if page == "gallery":
        shutil.rmtree(COPIED / "pictures")
        (COPIED / "pictures").mkdir()


def rendered(document: NotebookNode) -> NotebookNode:
    """A notebook for this interpreter, to be downloaded as well, with links to the copies."""
    document.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3"}
    document.metadata["mystnb"] = {"execution_in_temp": True}  # what it writes goes nowhere
    document.metadata["language_info"] = {"name": "python", "pygments_lexer": "ipython3"}
    document.cells.insert(0, new_code_cell(INSTALL, metadata={"tags": ["remove-cell"]}))
    for number, cell in enumerate(document.cells):
        cell["id"] = str(number)  # they are random, and equal text is to have equal copies
        if cell.cell_type == "markdown":
            cell.source = linked(cell.source)
    return document


def linked(text: str) -> str:
    """Links between documents lead to their copies."""
    return re.sub(r"\]\(([\w./]+)\.py(#[\w-]+)?\)", r"](\1.ipynb\2)", text)


def with_contents(index: str) -> str:
    """An index page with a table of contents: all documents that it links, in its order."""
    names = "\n".join(dict.fromkeys(re.findall(r"\]\((\w+)\.ipynb", index)))
    return f"{index}\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"


def _mathml(translator: Any, node: nodes.math | nodes.math_block) -> None:
    block = isinstance(node, nodes.math_block)
    try:
        math = latex2mathml.converter.convert(node.astext(), display="block" if block else "inline")
    except Exception as error:
        raise ValueError(f"no MathML for {node.astext()!r}: {error}") from error
    translator.body.append(f'<div class="math">{math}</div>' if block else math)
    raise nodes.SkipNode


def offer_notebook(app: Any, page: nodes.document) -> None:
    """Under the title of a notebook, a link to it as a file with all that it shows."""
    name = app.env.docname
    if not name.startswith("_copied/") or not (HERE / f"{name}.ipynb").exists():
        return
    file = Path(app.env.mystnb_config.output_folder, f"{name}.ipynb")
    link = download_reference("", reftarget="/" + os.path.relpath(file, app.srcdir))
    link += nodes.literal("", file.name)
    title = next(page.findall(nodes.title))
    title.parent.insert(1, nodes.paragraph("", "This page as a notebook, outputs included: ", link))


def setup(app: Any) -> None:
    copy_documents()
    app.connect("doctree-read", offer_notebook, priority=100)  # before files are collected
    app.connect("env-purge-doc", clear_pictures)
    app.add_html_math_renderer("mathml", (_mathml, None), (_mathml, None))
