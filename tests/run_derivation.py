"""Run a derivation: python run_derivation.py DOCUMENT. What it shows must convert to MathML."""

import ast
import sys
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert


def show(value: object) -> None:
    """As a notebook does with the value of an expression, and the site with its LaTeX."""
    latex: Any = getattr(value, "_repr_latex_", None)
    if latex is not None:
        convert(latex().strip("$"), display="block")


def main(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Expr) and not isinstance(node.value, ast.Constant):
            shown = ast.Call(ast.Name("_show", ast.Load()), [node.value], [])
            node.value = ast.copy_location(shown, node.value)
    names = {"__name__": "__main__", "__file__": str(path), "_show": show}
    exec(compile(ast.fix_missing_locations(tree), str(path), "exec"), names)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
