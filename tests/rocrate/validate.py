"""Validate an RO-Crate offline: ``python validate.py FOLDER``, in the environment of roc-validator (`make test-rocrate`).

Prints one line for each issue. The JSON-LD context is the one that the package rocrate carries (of 1.3, which extends 1.2),
since the validator would fetch it.
"""

from __future__ import annotations

import sys
from importlib import resources
from pathlib import Path

import requests
from rocrate_validator import services
from rocrate_validator.models import Severity
from rocrate_validator.utils.http import HttpRequester


def carried(_: HttpRequester, url: str, **__: object) -> requests.Response:
    """Answer the question for a context; nothing else is found."""
    answer = requests.Response()
    answer.url = url
    answer.status_code = 404
    if url.startswith("https://w3id.org/ro/crate/"):
        answer.status_code = 200
        answer.headers["Content-Type"] = "application/ld+json"
        answer.raw = resources.files("rocrate.data").joinpath("ro-crate.jsonld").open("rb")
    return answer


def main(folder: Path) -> int:
    """Print the issues of the severities required and recommended; return the number of required ones."""
    HttpRequester.get = carried
    settings = services.ValidationSettings(
        rocrate_uri=str(folder),
        profile_identifier="ro-crate-1.2",
        requirement_severity=Severity.RECOMMENDED,
        skip_availability_check=True,
        cache_max_age=-1,
    )
    result = services.validate(settings)
    for issue in result.get_issues(min_severity=Severity.RECOMMENDED):
        print(f"{issue.severity.name}: {issue.check.identifier}: {issue.message}")
    return len(result.get_issues(min_severity=Severity.REQUIRED))


if __name__ == "__main__":
    sys.exit(min(main(Path(sys.argv[1])), 100))
