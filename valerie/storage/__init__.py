"""Stored objects of products and runs: their encoding, their keys, and the store."""

from valerie.storage.store import ArtifactStore, ObjectInfo, open_store

__all__ = ["ArtifactStore", "ObjectInfo", "open_store"]
