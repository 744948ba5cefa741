"""Read and write glTF 2.0 without loss: z up here, y up in the file.

Properties that glTF lacks (specular tint, the sun's angles, hidden nodes …) are stored in ``extras`` under `EXTRAS_KEY`.
"""
