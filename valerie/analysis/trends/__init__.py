"""Scores over one measure: bins, polynomials and curves."""
