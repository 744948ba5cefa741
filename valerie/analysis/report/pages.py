"""Template settings of all report pages."""

from __future__ import annotations

from collections.abc import Callable

import jinja2


def page_environment(package: str, finalize: Callable[[object], object] | None = None) -> jinja2.Environment:
    """Return an environment for the templates in a package's folder ``templates``: text is escaped, unknown names fail.

    Args:
        package: name of the package, such as ``valerie.studies``.
        finalize: function that converts each value before it is written.
    """
    return jinja2.Environment(
        loader=jinja2.PackageLoader(package),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=finalize,
        trim_blocks=True,
        lstrip_blocks=True,
    )
