"""Vehicles: cars, van, truck, bus, motorcycle, bicycle and their riders, generated from numbers (see `build`)."""

from valerie.scene.procedural.vehicles.build import KINDS, build_vehicle, dimensions, size_of
from valerie.scene.procedural.vehicles.content import VehicleContent, VehiclePart
from valerie.scene.procedural.vehicles.rider import MOUNTS, build_rider

__all__ = [
    "KINDS",
    "MOUNTS",
    "VehicleContent",
    "VehiclePart",
    "build_rider",
    "build_vehicle",
    "dimensions",
    "size_of",
]
