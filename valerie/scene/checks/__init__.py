"""Checks that find errors and oddities of a scene asset before a run."""

from valerie.scene.checks.asset import asset_findings, scene_findings
from valerie.scene.checks.findings import Finding, Severity

__all__ = ["Finding", "Severity", "asset_findings", "scene_findings"]
