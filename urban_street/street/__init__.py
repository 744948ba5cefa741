"""The generated urban street: houses, trees, parked cars and street furniture from one seed.

`layout_street` places the objects at little cost. `build_street` adds shapes, materials and textures.
"""
