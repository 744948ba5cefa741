"""Checks that find errors and oddities of a scene asset before a run."""

from valerie.scene.checks.asset import asset_findings, scene_findings
from valerie.scene.checks.doubts import Doubt, Severity

__all__ = ["Doubt", "Severity", "asset_findings", "scene_findings"]
