"""The long table of a run as columns, and the ways in which its rows are grouped."""
