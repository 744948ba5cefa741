"""What is wrong or suspicious with a scene asset, found before a run."""

from valerie.scene.checks.asset import asset_findings, scene_findings
from valerie.scene.checks.findings import Finding, Severity

__all__ = ["Finding", "Severity", "asset_findings", "scene_findings"]
