"""Artifacts: what products hold, how it is encoded, under which key it is kept, and where."""

from valerie.storage.store import ArtifactStore, ObjectInfo, Usage, open_store

__all__ = ["ArtifactStore", "ObjectInfo", "Usage", "open_store"]
