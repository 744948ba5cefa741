"""Solids that street and vehicles are made from: surfaces, the primitives behind them, and their colours as bytes."""
