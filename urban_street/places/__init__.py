"""Kinds of places beside the street, each a module with a `Pack`: crossing, rural road, car park, bus stop, motorway exit."""
