"""glTF 2.0 in and out: z up here, y up in the file, nothing lost on the way.

What glTF has no word for (specular tint, the sun's angles, hidden nodes …) travels in ``extras`` under `EXTRAS_KEY`.
"""
