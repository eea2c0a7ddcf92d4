"""What trimesh passes over in glTF files: fans and poses, which are read, and all else.

A pose is a file of its own: targets of morphs are added to the positions, and nodes stand where
an animation puts them.
"""

from __future__ import annotations

import json
import re
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterator
from contextlib import suppress
from copy import copy, deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.shell.io.gltf_old import converted

# modes of primitives that have no triangles, or none that could be read
_MODES = {0: "points", 1: "lines", 2: "lines", 3: "lines", 6: "triangle fans"}
_TRIANGLES, _FAN = 4, 6
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_HEAD = 20  # bytes of a binary file before its JSON
_MOVES = ("translation", "rotation", "scale", "weights")
BROKEN = (ValueError, LookupError, TypeError, AttributeError, OSError)

Resolved = Callable[[str], bytes] | None


class File:
    """A file as JSON, and the arrays that it describes.

    `resolved` gives the content of files that it names.
    """

    def __init__(self, data: bytes, resolved: Resolved) -> None:
        self.binary, self.resolved = data[:4] == b"glTF", resolved
        opened = _opened(data)
        self.json, self.rest = converted(*opened)
        self.is_old = self.json is not opened[0]

    def content(self) -> bytes:
        """The bytes of the file as it is now."""
        head = json.dumps(self.json).encode()
        if not self.binary:
            return head
        head += b" " * (-len(head) % 4)
        lengths = _HEAD + len(head) + len(self.rest), len(head)
        total, length = (n.to_bytes(4, "little") for n in lengths)
        return b"glTF\2\0\0\0" + total + length + b"JSON" + head + self.rest

    def _buffer(self, number: int) -> bytes:
        uri = self.json["buffers"][number].get("uri")
        if uri is None:
            return self.rest[8:]  # behind the head of the one chunk of bytes that there is
        if "base64," in uri:
            return b64decode(uri.partition("base64,")[2])
        if self.resolved is None:
            raise LookupError(uri)
        return self.resolved(uri)

    def _view(self, place: Any, count: int, width: int, kind: str) -> NDArray[Any]:
        """So many rows of numbers from where a ``bufferView`` and a ``byteOffset`` say."""
        view = self.json["bufferViews"][place["bufferView"]]
        content = self._buffer(view["buffer"])
        start = view.get("byteOffset", 0) + place.get("byteOffset", 0)
        each = np.dtype(kind).itemsize
        step = view.get("byteStride", each * width)
        need = start + max(count - 1, 0) * step + each * width * bool(count)
        if count < 0 or start < 0 or step < 1 or need > len(content):
            raise ValueError("an accessor is larger than its buffer")
        return np.ndarray((count, width), kind, content, start, (step, each))

    def array(self, number: int) -> NDArray[Any]:
        """The rows of an accessor: int64, or float64 where they are floats or normalized."""
        accessor = self.json["accessors"][number]
        kind, width = _KINDS[accessor["componentType"]], _WIDTHS[accessor["type"]]
        if "bufferView" in accessor:
            found = self._view(accessor, accessor["count"], width, kind)
        elif not 0 <= accessor["count"] < 1 << 28:
            raise ValueError("an accessor is too large")
        else:
            found = np.zeros((accessor["count"], width), kind)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            where, values = sparse["indices"], sparse["values"]
            rows = self._view(where, sparse["count"], 1, _KINDS[where["componentType"]])[:, 0]
            found = found.copy()
            found[rows] = self._view(values, sparse["count"], width, kind)
        if kind == "<f4":
            return found.astype(np.float64)
        if accessor.get("normalized"):
            return np.maximum(found / np.iinfo(kind).max, -1.0)
        return found.astype(np.int64)

    def add(self, rows: NDArray[Any]) -> int:
        """The number of a new accessor of rows (n, k), float32 or uint32."""
        content = np.ascontiguousarray(rows).tobytes()
        uri = "data:application/octet-stream;base64," + b64encode(content).decode()
        view = {"buffer": len(self.json.get("buffers", ())), "byteLength": len(content)}
        accessor = {
            "bufferView": len(self.json.get("bufferViews", ())),
            "componentType": 5126 if rows.dtype.kind == "f" else 5125,
            "count": len(rows),
            "type": {width: kind for kind, width in _WIDTHS.items()}[rows.shape[1]],
        }
        if rows.dtype.kind == "f" and len(rows):
            accessor |= {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        for name, value in (
            ("buffers", {"uri": uri, "byteLength": len(content)}),
            ("bufferViews", view),
            ("accessors", accessor),
        ):
            self.json.setdefault(name, []).append(value)
        return len(self.json["accessors"]) - 1


def _opened(data: bytes) -> tuple[Any, bytes]:
    """The JSON in a file, and what follows it in a binary one."""
    if data[:4] != b"glTF":
        return json.loads(data), b""
    end = _HEAD + int.from_bytes(data[12:16], "little")
    return json.loads(data[_HEAD:end]), data[end:]


def plain(data: bytes, resolved: Resolved, *, at_rest: bool = True) -> bytes:
    """A file of glTF 2 with triangles in place of fans, and morphs in their place `at_rest`.

    Fans that are broken stay fans.
    """
    try:
        file = File(data, resolved)
    except BROKEN:
        return data  # trimesh says what is wrong
    changed = file.is_old
    changed |= re.search(rb'"mode"\s*:\s*6', data) is not None
    if changed:
        _without_fans(file)
    if at_rest and re.search(rb'"targets"', data):
        with suppress(*BROKEN):
            changed |= _shaped(file, {})
    return file.content() if changed else data


def _without_fans(file: File) -> None:
    with suppress(*BROKEN):
        fans = [p for x in file.json["meshes"] for p in x["primitives"] if p.get("mode") == _FAN]
        for primitive in fans:
            with suppress(*BROKEN):
                corners = _corners(file, primitive)
                first = np.broadcast_to(corners[:1], max(len(corners) - 2, 0))
                a, b, c = first, corners[1:-1], corners[2:]
                faces = np.stack([a, b, c], axis=1)[(a != b) & (b != c) & (c != a)]
                number = file.add(faces.reshape(-1, 1).astype("<u4"))
                primitive |= {"mode": _TRIANGLES, "indices": number}


def _corners(file: File, primitive: Any) -> NDArray[np.int64]:
    """The vertices (n,) of a primitive, in their order."""
    if "indices" not in primitive:
        return np.arange(file.json["accessors"][primitive["attributes"]["POSITION"]]["count"])
    return file.array(primitive["indices"])[:, 0].astype(np.int64)


def animation(file: File) -> tuple[list[dict[str, Any]], list[float], list[str]]:
    """What the first animation moves, when, and the names of the animations after it.

    What it moves is, for each, the number of its ``node``, its ``path``, ``times`` (n,), ``values``
    (n, k), and how it goes from one to the next.
    """
    found = file.json.get("animations") or []
    moves = []
    for channel in found[0]["channels"] if found else ():
        target, sampler = channel["target"], found[0]["samplers"][channel["sampler"]]
        if target.get("path") not in _MOVES or "node" not in target:
            continue
        times = file.array(sampler["input"])[:, 0].astype(float)
        values = file.array(sampler["output"]).astype(float)
        how = sampler.get("interpolation", "LINEAR")
        parts = 3 if how == "CUBICSPLINE" else 1
        values = values.reshape(len(times), parts, -1)
        moves.append({**target, "times": times, "values": values, "how": how})
    every: set[float] = set().union(*(move["times"].tolist() for move in moves))
    names = [str(x.get("name", i)) for i, x in enumerate(found)]
    return moves, sorted(every), names[1:]


def posed(file: File, moves: list[dict[str, Any]], time: float) -> bytes:
    """The file as it is at a time of what moves."""
    pose = copy(file)
    pose.json = deepcopy(file.json)
    weights: dict[int, NDArray[np.float64]] = {}
    for move in moves:
        value, node = _between(move, time), move["node"]
        if move["path"] == "weights":
            weights[node] = value
        else:
            pose.json["nodes"][node][move["path"]] = value.tolist()
    _shaped(pose, weights)
    pose.json.pop("animations", None)
    return pose.content()


def _between(move: dict[str, Any], time: float) -> NDArray[np.float64]:
    """A value (k,) of what moves: the first before, the last after all of its times."""
    times, values, how = move["times"], move["values"], move["how"]
    i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1))
    point = values.shape[1] // 2  # between two tangents, of a cubic spline
    first = values[i, point]
    if i + 1 == len(times) or time <= times[i] or how == "STEP":
        return np.asarray(first)
    span = times[i + 1] - times[i]
    s, second = (time - times[i]) / span, values[i + 1, point]
    if how == "CUBICSPLINE":
        out, into = span * values[i, 2], span * values[i + 1, 0]
        found = (2 * s**3 - 3 * s**2 + 1) * first + (s**3 - 2 * s**2 + s) * out
        found += (3 * s**2 - 2 * s**3) * second + (s**3 - s**2) * into
    elif move["path"] == "rotation":
        cosine = float(first @ second)
        angle = np.arccos(min(abs(cosine), 1.0))
        turned = second if cosine >= 0 else -second
        if angle < 1e-6:
            found = first + s * (turned - first)
        else:
            found = np.sin((1 - s) * angle) * first + np.sin(s * angle) * turned
    else:
        found = first + s * (second - first)
    if move["path"] == "rotation":
        found = found / np.linalg.norm(found)
    return np.asarray(found)


def _shaped(file: File, weights: dict[int, NDArray[np.float64]]) -> bool:
    """Give nodes the shapes of their morphs by weights of nodes, or else those at rest.

    It tells whether any has changed.
    """
    changed, nodes = False, file.json.get("nodes", [])
    for number, node in enumerate(nodes):
        if "mesh" not in node:
            continue
        mesh = file.json["meshes"][node["mesh"]]
        given = weights.get(number, np.array(node.get("weights", mesh.get("weights", ())), float))
        if not np.any(given) or not any("targets" in p for p in mesh["primitives"]):
            continue
        shaped = {**mesh, "primitives": [deepcopy(p) for p in mesh["primitives"]]}
        for primitive in shaped["primitives"]:
            points = file.array(primitive["attributes"]["POSITION"])
            for weight, target in zip(given, primitive.get("targets", ()), strict=False):
                if weight and "POSITION" in target:
                    points = points + weight * file.array(target["POSITION"])
            primitive["attributes"]["POSITION"] = file.add(points.astype("<f4"))
        node["mesh"] = len(file.json["meshes"])
        file.json["meshes"].append(shaped)
        changed = True
    return changed


def others(data: bytes) -> tuple[list[str], list[str]]:
    """What a glTF file has besides triangles and texture coordinates, and what is wrong there."""
    try:
        found = File(data, None).json
        primitives = [p for mesh in found["meshes"] for p in mesh["primitives"]]
        names = {name for p in primitives for name in p["attributes"]}
        others = sorted(names - {"POSITION", "NORMAL", "TEXCOORD_0"})
        others += sorted({_MODES[m] for p in primitives if (m := p.get("mode", 4)) in _MODES})
        others += ["targets"] if any("targets" in p for p in primitives) else []
        others += [name for name in ("animations", "skins", "cameras") if found.get(name)]
        plain = [{"pbrMetallicRoughness": {}}, {}, {"name": "material_0"}]
        others += ["materials"] if any(x not in plain for x in found.get("materials", ())) else []
        return others, list(_damage(found, primitives))
    except BROKEN:
        return [], []  # trimesh has read it all the same


def _damage(found: Any, primitives: list[Any]) -> Iterator[str]:
    """What is wrong, once for each attribute."""
    damage = {}
    for p in primitives:
        count = {name: found["accessors"][i]["count"] for name, i in p["attributes"].items()}
        for name, number in count.items():
            if number != count["POSITION"]:
                damage[name] = f"got {number} of {name}, need {count['POSITION']}, one a point"
    yield from damage.values()
