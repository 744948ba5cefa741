"""Template settings of all report pages."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.resources import files

import jinja2
from markupsafe import Markup


def own_file(name: str) -> str:
    """Return the text of a file beside the templates of this package."""
    return (files("valerie.analysis.report") / "templates" / name).read_text("utf-8")


@cache
def page_environment(package: str, finalize: Callable[[object], object] | None = None) -> jinja2.Environment:
    """Return an environment for the templates in a package's folder ``templates``.

    Text is escaped, unknown names fail, and ``style`` is the style sheet of all reports.

    Args:
        package: name of the package, such as ``valerie.studies``.
        finalize: function that converts each value before it is written.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(package),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=finalize,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["style"] = Markup(own_file("report.css"))  # noqa: S704  # the package's own file
    return environment
