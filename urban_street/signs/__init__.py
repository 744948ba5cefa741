"""Faces of traffic signs as pictures, with a table of their sizes and outlines (``tools/sign_faces.py`` makes both)."""
