"""Samples Blender's Filmic view transform into the table of `valerie.sensing.blender_filmic`.

Run it with the Python of a Blender environment (`bpy`); it needs nothing of this project::

    python tools/sample_blender_filmic.py valerie/sensing/blender_filmic.npz

Blender's colour management transforms two images of known linear values, saved as 16-bit PNG without dither: the corners of
the cube that Filmic's desaturation is defined on (view "Filmic Log"), and a grey ramp (views "Filmic Log" and "Filmic"), which
gives the contrast curve between the two.
"""

import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

LOWEST_STOP, STOPS, SIZE, CURVE = -12.473931188, 25.0, 33, 4096


def shown(linear, view, folder):
    """(H, W, 3) linear Rec. 709 as ``view`` shows it: float64 in [0, 1]."""
    height, width, _ = linear.shape
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = linear
    image = bpy.data.images.new("samples", width, height, float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    image.pixels.foreach_set(pixels.ravel())
    scene = bpy.context.scene
    scene.display_settings.display_device = "sRGB"
    settings = scene.view_settings
    settings.view_transform, settings.look, settings.exposure, settings.gamma = view, "None", 0.0, 1.0
    target = scene.render.image_settings
    target.file_format, target.color_depth, target.color_mode = "PNG", "16", "RGB"
    scene.render.dither_intensity = 0.0
    path = Path(folder) / "shown.png"
    image.save_render(str(path), scene=scene)
    bpy.data.images.remove(image)
    read = bpy.data.images.load(str(path))
    read.colorspace_settings.name = "Non-Color"
    read.pixels.foreach_get(values := np.empty(height * width * 4, np.float32))
    bpy.data.images.remove(read)
    return values.reshape(height, width, 4)[..., :3].astype(np.float64)


def main(out):
    corners = 2.0 ** (LOWEST_STOP + STOPS * np.arange(SIZE) / (SIZE - 1))
    cube = np.stack(np.meshgrid(corners, corners, corners, indexing="ij"), axis=-1)
    grey = 2.0 ** np.linspace(LOWEST_STOP - 0.5, LOWEST_STOP + 17.0, 1 << 14)
    ramp = np.repeat(grey.reshape(64, 256, 1), 3, axis=2)
    with tempfile.TemporaryDirectory() as folder:
        desaturated = shown(cube.reshape(SIZE, SIZE * SIZE, 3), "Filmic Log", folder).reshape(SIZE, SIZE, SIZE, 3)
        log = shown(ramp, "Filmic Log", folder)[..., 1].ravel()
        display = shown(ramp, "Filmic", folder)[..., 1].ravel()
    log, first = np.unique(log, return_index=True)
    curve = np.interp(np.arange(CURVE) / (CURVE - 1), log, display[first])
    np.savez_compressed(
        out,
        desaturated=np.rint(desaturated * 65535).astype(np.uint16),
        curve=np.rint(curve * 65535).astype(np.uint16),
        made_with=np.array(f"bpy {bpy.app.version_string}"),
    )


if __name__ == "__main__":
    main(sys.argv[1])
