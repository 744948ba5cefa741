# SPDX-License-Identifier: Apache-2.0
"""The programs that run inside Blender's Python: ``inside`` renders with Cycles, ``inside.convert`` turns .blend into glTF.

Licence note. They import Blender (``bpy``, GPL-3.0-or-later). Their text is under Apache-2.0, which is compatible with version
3 of the GPL; running together with Blender in one process, the whole is under GPL-3.0-or-later. They import nothing of
VALERIE, and VALERIE imports nothing of them: they are separate programs that exchange messages over pipes, or files.
See docs/cycles.md.
"""
