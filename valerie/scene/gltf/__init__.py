"""Reading and writing of glTF 2.0: z up here, y up in the file, nothing lost on the way.

Properties that glTF lacks (specular tint, the sun's angles, hidden nodes …) are stored in ``extras`` under `EXTRAS_KEY`.
"""
