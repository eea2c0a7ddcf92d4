"""The option --scheme: names of schemes, and schemes that stand in modules and files of Python.

Nothing is imported but what the user names with a colon: neither cages nor folders can cause it.
"""

from __future__ import annotations

import importlib
import sys
import traceback
from collections.abc import Callable
from contextlib import redirect_stdout
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import click

import limitsurf as ls


class SchemeName(click.ParamType):  # type: ignore[type-arg]
    """The name of a scheme, MODULE:NAME or FILE.py:NAME; which is a `Scheme` then, or refused."""

    name = "scheme"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | ls.Scheme:
        """A `Scheme` if the text has a colon; else the text, which the library knows, or not."""
        if not isinstance(value, str):
            return value  # type: ignore[no-any-return]
        home, colon, name = value.rpartition(":")
        if not colon:
            if value.endswith(".py"):
                self.fail(f"{value}: say which scheme of it, as in {value}:NAME", param, ctx)
            return value
        if not home or not name:
            self.fail(f"{value!r}: need a name, MODULE:NAME or FILE.py:NAME", param, ctx)
        module = self._run(home, value, param, ctx)
        found: Any = module
        for part in name.split("."):
            found = getattr(found, part, None)
        if isinstance(found, ls.Scheme):
            return found
        others = sorted(k for k, x in vars(module).items() if isinstance(x, ls.Scheme))
        there = f"; of schemes it has: {', '.join(others) or 'none'}"
        if found is None:
            self.fail(f"{home} has no {name!r}{there}", param, ctx)
        self.fail(
            f"{value} is of type {type(found).__name__}, need an ls.Scheme or ls.DualScheme{there}",
            param,
            ctx,
        )

    def _run(
        self, home: str, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> ModuleType:
        """The module; what it prints goes to the standard error, where it spoils no JSON."""
        load: Callable[[str], ModuleType] = importlib.import_module
        if home.endswith(".py"):
            load = _of_file
            if not Path(home).is_file():
                self.fail(f"{value}: there is no file {home}", param, ctx)
        elif not all(part.isidentifier() for part in home.split(".")):
            self.fail(f"{value}: {home!r} is neither a module nor a file *.py", param, ctx)
        try:
            with redirect_stdout(sys.stderr):
                return load(home)
        except (Exception, SystemExit) as error:
            if isinstance(error, ModuleNotFoundError) and home.startswith(error.name or "\0"):
                near = f"{home.replace('.', '/')}.py"
                advice = "; modules are found where Python finds them, not in this folder"
                advice += f": for the file say {near}:NAME" if Path(near).is_file() else ""
                self.fail(f"there is no module {error.name!r}{advice}", param, ctx)
            lines = [
                line.lineno
                for line in traceback.extract_tb(error.__traceback__)
                if line.filename == str(Path(home).resolve())
            ]
            where = f", line {lines[-1]}," if lines else ""
            self.fail(f"{home}{where} raised {type(error).__name__}: {error}", param, ctx)


def _of_file(path: str) -> ModuleType:
    """Run a file as a module that is gone afterwards: its functions are not found by its name.

    So they travel to other processes as their values. As for scripts, modules beside it are found.
    """
    file = Path(path).resolve()
    spec = spec_from_file_location(f"limitsurf_scheme_of_{file.stem}", file)
    assert spec is not None  # as of all that ends in .py
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # as dataclasses need
    sys.path.insert(0, str(file.parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(file.parent))
        del sys.modules[spec.name]
    return module


SCHEME = SchemeName()
OF_SCHEME = "Of subdivision: a name, or your own as MODULE:NAME or FILE.py:NAME, which is run."
