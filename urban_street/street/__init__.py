"""The generated urban street: houses, trees, parked cars and street furniture from one seed.

`layout_street` decides what stands where (cheap, no shapes); `build_street` gives it shape, materials and textures.
"""
