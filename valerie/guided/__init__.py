"""Strategies that choose the next variants from the outcomes of earlier ones: numpy objects, no database, no queue."""
