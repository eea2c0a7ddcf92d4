"""The files that a file names, which a library would open without a look: only regular ones.

A pipe that nobody writes to never ends, a device may have no end, and how much memory is in
proportion to a file depends on those that it names.
"""

from __future__ import annotations

import os
import re
import stat
from contextlib import suppress
from typing import Any

from limitsurf.cage.checks import MeshError
from limitsurf.shell.io.apart import allow

_TEXT = 1 << 22  # bytes of a file in which names of others are sought


class Named:
    """The files that a file names, each counted once."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.seen: set[str] = set()

    def add(self, path: str) -> None:
        """Let this process read a file, if there is one; MeshError if it is no regular one."""
        path = os.path.realpath(path)
        if path in self.seen:
            return
        self.seen.add(path)
        try:
            found = os.stat(path)
        except (OSError, ValueError):  # whoever opens it says more
            return
        if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
            raise MeshError(
                f"{self.name}: it refers to {path}, a pipe or a device: need a regular file"
            )
        allow(found.st_size)


def resolver(name: str, folder: str) -> Any:
    """What opens the files that one of trimesh names, in its folder."""
    from trimesh.resolvers import FilePathResolver

    named = Named(name)

    class Checked(FilePathResolver):  # type: ignore[misc]
        def get(self, name: str) -> Any:
            for place in {name.strip(), name.strip().lstrip("/"), os.path.basename(name)}:
                named.add(os.path.join(folder, place))
            return super().get(name)

    return Checked(folder)


def add_mentioned(name: str, path: str) -> None:
    """Let this process read all files that a file mentions by their path from its folder."""
    named, folder = Named(name), os.path.dirname(path)
    with open(path, "rb") as file:
        text = file.read(_TEXT)
    for word in set(re.findall(rb"""[^\s"'<>=\0]{1,255}""", text)):
        place = os.path.join(folder, os.fsdecode(word))
        if os.path.exists(place):
            named.add(place)


def read_usd(
    name: str, suffix: str, path: str, folder: str | None, *, call: str = "read", **options: Any
) -> Any:
    """What a function of `usd` returns, the layers of the stage being looked at one by one."""
    from limitsurf.shell.io import usd

    layers = _layers(name, path)  # kept, so that none is read twice
    try:
        return getattr(usd, call)(name, path, **options)
    finally:
        del layers


def _layers(name: str, path: str) -> list[Any]:
    """The layers that a stage is made of; what cannot be opened is left to who says more of it."""
    from pxr import Ar, Sdf, Tf, UsdUtils

    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    named, found, waiting = Named(name), [], [os.path.abspath(path)]
    asked = set(waiting)
    while waiting:
        layer = None
        with suppress(Tf.ErrorException):
            layer = Sdf.Layer.FindOrOpen(waiting.pop())
        if layer is None:
            continue
        found.append(layer)
        for asset in layer.GetCompositionAssetDependencies():
            with suppress(Tf.ErrorException):
                whole = Sdf.ComputeAssetPathRelativeToLayer(layer, asset)
                place = Ar.GetResolver().Resolve(whole).GetPathString()
                if place and whole not in asked:
                    named.add(Ar.SplitPackageRelativePathOuter(place)[0])
                    asked.add(whole)
                    waiting.append(whole)
    diagnostics.TakeUncoalescedDiagnostics()
    return found
