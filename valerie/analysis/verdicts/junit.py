"""Result of a gate as JUnit XML, which CI systems show as tests.

Each requirement is a test case of the suite ``requirements``; each compared slice is one of the suite of its function, skipped
if it has too few places to show that it became worse. The format is that of the Ant task *junit*, which GitLab, Jenkins and
GitHub Actions read. They compare results of two pipelines by class and name of a case, so these hold neither the run nor the
version of a function.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from valerie.analysis.verdicts.gate import GateResult, VersionGate, slice_text
from valerie.analysis.verdicts.text import notes, sentence, title
from valerie.analysis.verdicts.verdicts import RequirementVerdict

#: Characters that XML 1.0 does not allow.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit_xml(result: GateResult) -> bytes:
    """Return the document, UTF-8; equal results give equal bytes."""
    root = ET.Element("testsuites", name=f"valerie gate {result.run_id}")
    if result.verdicts:
        suite = _suite(root, "requirements")
        for verdict in result.verdicts:
            _requirement(suite, verdict, result)
    for version in result.versions:
        _version(_suite(root, f"{version.version} against {version.baseline}"), version, result)
    for suite in root:
        suite.set("tests", str(len(suite)))
        suite.set("failures", str(len(suite.findall("testcase/failure"))))
        suite.set("skipped", str(len(suite.findall("testcase/skipped"))))
        suite.set("errors", "0")
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))


def _suite(root: ET.Element, name: str) -> ET.Element:
    return ET.SubElement(root, "testsuite", name=_clean(name))


def _case(suite: ET.Element, where: str, name: str, text: str) -> ET.Element:
    case = ET.SubElement(suite, "testcase", classname=_clean(where), name=_clean(name), time="0")
    ET.SubElement(case, "system-out").text = _clean(text)
    return case


def _requirement(suite: ET.Element, verdict: RequirementVerdict, result: GateResult) -> None:
    text = "\n".join([title(verdict), sentence(verdict), *notes(verdict)])
    case = _case(
        suite,
        f"requirements.{_stable(verdict.function, (other.function for other in result.verdicts))}",
        verdict.id,
        text,
    )
    if not result.passes(verdict):
        message = _clean(f"{verdict.outcome}: {sentence(verdict)}")
        ET.SubElement(case, "failure", message=message, type=verdict.outcome.replace(" ", "-"))
    elif verdict.outcome != "met":
        ET.SubElement(case, "skipped", message=_clean(f"{verdict.outcome}: {sentence(verdict)}"))


def _version(suite: ET.Element, version: VersionGate, result: GateResult) -> None:
    where = f"comparison.{_stable(version.version, (other.version for other in result.versions))}"
    if version.undecided and not result.allow_undecided:
        text = slice_text(version.gate.slices[0], version.gate.effect)
        case = _case(suite, where, "enough places", text)
        ET.SubElement(case, "failure", message=_clean(f"undecided: {text}"), type="undecided")
    for item in version.gate.slices:
        text = slice_text(item, version.gate.effect)
        case = _case(suite, where, item.name, text)
        if item.worse:
            ET.SubElement(case, "failure", message=_clean(f"worse than {version.baseline}: {text}"), type="worse")
        elif item.too_few:
            ET.SubElement(case, "skipped", message=_clean(text))


def _stable(function: str, others: Iterable[str]) -> str:
    """Return the name of a function without its version, unless there are several versions of it among the others."""
    name = function.partition("@")[0]
    return name if len({other for other in others if other.partition("@")[0] == name}) == 1 else function


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
