"""Derivations as documents: their form, their mathematics, and the index that leads to them.

That they hold is tested in ``test_project.py``.
"""

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jupytext
import pytest
from latex2mathml.converter import convert
from markdown_it.renderer import RendererHTML
from myst_parser.config.main import MdParserConfig
from myst_parser.parsers.mdit import create_md_parser

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "limitsurf"
FOLDER = ROOT / "derivations"
INDEX = FOLDER / "README.md"
DOCUMENTS = sorted(FOLDER.glob("*.py"))
PAGES = [
    ROOT / "README.md",
    *sorted(
        path
        for pattern in ("*.md", "*.py")
        for path in (ROOT / "notebooks").rglob(pattern)
        if "_copied" not in path.parts
    ),
]
CITED = re.compile(r"derivations/(\w+\.py)")
# as the site reads them
PARSER = create_md_parser(MdParserConfig(enable_extensions={"amsmath", "dollarmath"}), RendererHTML)
MATHEMATICS = {
    "math_inline": "inline",
    "math_inline_double": "block",
    "math_block": "block",
    "amsmath": "block",
}
CHILDREN = {
    "mfrac": 2,
    "mroot": 2,
    "msub": 2,
    "msup": 2,
    "munder": 2,
    "mover": 2,
    "msubsup": 3,
    "munderover": 3,
}


def text_of(path: Path) -> str:
    """Markdown of a page, or of all markdown cells of a document."""
    if path.suffix == ".md":
        return path.read_text(encoding="utf-8")
    cells = jupytext.read(path, fmt="py:percent").cells
    return "\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")


def tokens(text: str) -> Iterator[Any]:
    """All tokens, those inside of others too."""
    for token in PARSER.parse(text):
        yield token
        yield from token.children or []


def headings(path: Path) -> list[tuple[str, str]]:
    """Level and text of the headings."""
    found = PARSER.parse(text_of(path))
    return [
        (token.tag, after.content)
        for token, after in pairwise(found)
        if token.type == "heading_open"
    ]


def anchor(heading: str) -> str:
    """What GitHub and the site make of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def links(text: str) -> list[str]:
    return [str(token.attrs["href"]) for token in tokens(text) if token.type == "link_open"]


def table_rows(text: str) -> list[tuple[list[str], list[str]]]:
    """Names (in code, in the first cell) and links of each row of the tables of formulas."""
    rows = []
    for line in text.splitlines():
        names = re.findall(r"`([\w.]+)`", line.split("|")[1] if line.startswith("|") else "")
        if names:
            rows.append((names, links(line.strip("| "))))
    return rows


DERIVED, CHOSEN = map(table_rows, text_of(INDEX).split("### Chosen, not derived"))


def resolved(name: str) -> Any:
    """The object of that name in the package, attributes of classes included."""
    parts = ["limitsurf", *name.split(".")]
    for count in range(len(parts), 0, -1):
        try:
            found: Any = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            found = getattr(found, part)
        return found
    raise AssertionError(name)


def citations() -> Iterator[tuple[str, str]]:
    """Who cites a derivation in a docstring, and which: dotted names without the package."""
    for path in sorted(SOURCE.rglob("*.py")):
        module = ".".join(path.relative_to(SOURCE).with_suffix("").parts)
        stack: list[tuple[str, Any]] = [(module, ast.parse(path.read_text(encoding="utf-8")))]
        while stack:
            name, node = stack.pop()
            for document in CITED.findall(ast.get_docstring(node) or ""):
                yield name, document
            for child in ast.iter_child_nodes(node):
                if isinstance(child, (ast.ClassDef, ast.FunctionDef)):
                    stack.append((f"{name}.{child.name}", child))


def test_documents_were_found() -> None:
    assert len(DOCUMENTS) >= 7
    assert len(DERIVED) > 30
    assert CHOSEN


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_form(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    docstring = ast.get_docstring(ast.parse(text))
    assert docstring
    assert docstring.splitlines()[0].endswith(".")
    first, title, *cells = jupytext.read(path, fmt="py:percent").cells
    # the docstring is for readers of the file: pages begin with the title
    assert first.metadata.get("tags") == ["remove-cell"]
    assert ast.literal_eval(first.source).startswith(docstring.splitlines()[0])
    assert title.source.startswith("# ")
    for cell in cells:
        assert cell.cell_type in ("code", "markdown")
        assert cell.source.strip()
        assert cell.cell_type == "markdown" or ast.parse(cell.source).body, cell.source
    found = headings(path)
    assert [level for level, _ in found].count("h1") == 1
    sections = [heading for level, heading in found if level == "h2"]
    for number, heading in enumerate(sections, start=1):
        assert heading.startswith(f"{number}. ")
        assert "$" not in heading
    assert len(sections) >= 3
    # plain text that looks like mathematics
    for token in tokens(text_of(path)):
        if token.type == "text":
            assert "$" not in token.content, token.content


@pytest.mark.parametrize("path", [*DOCUMENTS, INDEX], ids=lambda path: path.name)
def test_mathematics_converts(path: Path) -> None:
    for token in tokens(text_of(path)):
        if token.type in MATHEMATICS:
            # not well-formed where the converter does not know an environment
            mathml = convert(token.content, display=MATHEMATICS[token.type])
            for element in ElementTree.fromstring(mathml).iter():
                tag = element.tag.rpartition("}")[2]
                assert len(element) == CHILDREN.get(tag, len(element)), token.content
                assert "\\" not in (element.text or ""), token.content


@pytest.mark.parametrize("path", [*DOCUMENTS, INDEX], ids=lambda path: path.name)
def test_links_lead_somewhere(path: Path) -> None:
    text = text_of(path)
    for link in links(text):
        target, _, section = link.partition("#")
        if "://" in target:
            continue
        assert (path.parent / target).exists(), link
        assert not section or section in [
            anchor(heading) for _, heading in headings(FOLDER / target)
        ], link
    for target, number in re.findall(r"\]\((\w+\.py)\), (?:section|part) (\d+)", text):
        assert any(heading.startswith(f"{number}. ") for _, heading in headings(FOLDER / target))
    for name in re.findall(r"`(?:derivations/)?(\w+\.py)`", text):
        assert (FOLDER / name).exists(), name


def test_every_document_is_in_the_index() -> None:
    listed = [link for link in links(text_of(INDEX)) if re.fullmatch(r"\w+\.py", link)]
    assert sorted(listed) == [path.name for path in DOCUMENTS]


@pytest.mark.parametrize("names", [names for names, _ in DERIVED + CHOSEN], ids=lambda x: x[0])
def test_row_names_what_there_is(names: list[str]) -> None:
    for name in names:
        resolved(name)


def test_rows_lead_to_sections() -> None:
    for names, found in DERIVED:
        assert found, names
        assert all("#" in link for link in found), names


@pytest.mark.parametrize(
    "path",
    [*PAGES, *sorted(SOURCE.rglob("*.py"))],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_cited_documents_exist(path: Path) -> None:
    for document in CITED.findall(path.read_text(encoding="utf-8")):
        assert (FOLDER / document).exists(), document


@pytest.mark.parametrize(("owner", "document"), sorted(set(citations())))
def test_citation_is_in_the_index(owner: str, document: str) -> None:
    found = [
        link.partition("#")[0]
        for names, row_links in DERIVED
        if any(name == owner or name.startswith(owner + ".") for name in names)
        for link in row_links
    ]
    assert document in found
