"""Fit the numbers of `valerie.sensing.blender_filmic` to Blender's Filmic view transform.

Run it with the Python of a Blender environment (`bpy`); it needs nothing else from this project and prints the numbers::

    python tools/fit_blender_filmic.py

Blender's colour management transforms images of known linear values, saved as 16-bit PNG without dither: colours with one
bright channel (view "Filmic Log"), which show how far highlights lose saturation, and a grey ramp (views "Filmic Log"
and "Filmic"), which gives the contrast curve between the two.
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np

LOWEST_STOP, STOPS, SIZE, SHOWN, NODES = -12.473931188, 25.0, 33, 0.66, 65


def shown(linear, view, folder):
    """Return linear Rec. 709 colours, (H, W, 3), as ``view`` displays them: float64 in [0, 1]."""
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


def linear_of(scale):
    """Return the linear value at a position on the logarithmic scale, 0 to 1."""
    return 2.0 ** (LOWEST_STOP + STOPS * scale)


def fitted_shares(folder):
    """Return, by step of the brightest channel, the share by which a darker one moves towards it (median over darker steps)."""
    steps = linear_of(np.arange(SIZE) / (SIZE - 1))
    bright, dark = np.meshgrid(steps, steps, indexing="ij")
    after = shown(np.stack([bright, dark, dark], axis=-1), "Filmic Log", folder)[..., 1]
    shares = {}
    for step in range(21, SIZE):
        # Clipping at white and black hides the shares there.
        usable = (np.arange(SIZE) < step) & (after[step] < 0.9995) & (np.arange(SIZE) > 0)
        if usable.any():
            moved = linear_of(after[step, usable] * SHOWN) - dark[step, usable]
            shares[step] = float(np.median(moved / (bright[step, usable] - dark[step, usable])))
    return shares


def fitted_nodes(folder):
    """Return the contrast curve at evenly spaced positions."""
    grey = 2.0 ** np.linspace(LOWEST_STOP - 0.5, LOWEST_STOP + 17.0, 1 << 14)
    ramp = np.repeat(grey.reshape(64, 256, 1), 3, axis=2)
    log, display = (shown(ramp, view, folder)[..., 1].ravel() for view in ("Filmic Log", "Filmic"))
    log, first = np.unique(log, return_index=True)
    return np.interp(np.linspace(0.0, 1.0, NODES), log, display[first])


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        shares, nodes = fitted_shares(temporary), fitted_nodes(temporary)
    print(f"bpy {bpy.app.version_string}")
    print("shares", {step: round(share, 6) for step, share in shares.items()})
    print("nodes", ", ".join(f"{node:.5f}" for node in nodes))
