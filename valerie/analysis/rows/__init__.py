"""The long table of a run as columns, and the groups of its rows."""
