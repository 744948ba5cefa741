# SPDX-License-Identifier: Apache-2.0
"""The programs that run inside Blender's Python: ``inside`` renders with Cycles, ``inside.convert`` turns .blend into glTF.

Licence note. These programs import Blender (``bpy``, GPL-3.0-or-later). Their source is under Apache-2.0, which is compatible
with version 3 of the GPL. Together with Blender in one process, the whole is under GPL-3.0-or-later. They import nothing from
VALERIE, and VALERIE imports nothing from them: they are separate programs that exchange messages over pipes, or files. See
docs/cycles.md.
"""
