"""glTF 2.0 in and out: z up here, y up in the file, nothing lost on the way.

What glTF has no word for (specular tint, the sun's angles, hidden nodes …) travels in ``extras`` under `EXTRAS_KEY`.
"""

from valerie.scene.gltf.common import EXTRAS_KEY, FilePart
from valerie.scene.gltf.reader import read_gltf
from valerie.scene.gltf.writer import save_gltf

__all__ = ["EXTRAS_KEY", "FilePart", "read_gltf", "save_gltf"]
