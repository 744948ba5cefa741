"""Vehicles: cars, vans, trucks, bus, motorcycle, bicycle and riders, all generated (see `build`)."""

from urban_street.vehicles.build import KINDS, build_vehicle, dimensions, outline_vehicle, size_of
from urban_street.vehicles.content import VehicleContent, VehiclePart
from urban_street.vehicles.rider import MOUNTS, build_rider

__all__ = [
    "KINDS",
    "MOUNTS",
    "VehicleContent",
    "VehiclePart",
    "build_rider",
    "build_vehicle",
    "dimensions",
    "outline_vehicle",
    "size_of",
]
