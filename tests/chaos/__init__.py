"""Seeded schedules of faults on real processes: the run still ends, with the rows of a calm one.

`tests.simulation` tries far more schedules, in one process with a simulated broker, store and clock. Here everything is real.
"""
