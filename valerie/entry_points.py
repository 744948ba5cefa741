"""Plugins: objects that installed distributions offer by name, imported only when needed.

A distribution offers them as entry points of the groups ``valerie.*``. An entry point is code, and being installed (perhaps as
a dependency) does not permit it to run in every worker. Offers of another distribution therefore count only if the operator
names it in ``VALERIE_PLUGINS``. Those of this distribution always count.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, Final, NamedTuple

from valerie.errors import InvalidInput, MissingDependency, UnknownName
from valerie.settings import PREFIX, load_settings
from valerie.spelling import package_name

#: This distribution.
OWN: Final = "valerie"


class EntryPoint(NamedTuple):
    """One entry point.

    Attributes:
        name: its name in specs.
        target: ``module`` or ``module:attribute``.
        package: normalized name of the distribution that offers it.
    """

    name: str
    target: str
    package: str


def installed(group: str) -> tuple[EntryPoint, ...]:
    """Return the offers of a group."""
    return _installed(group, tuple(sys.path))


@lru_cache
def _installed(group: str, _path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the offers of a group on a path. Cached, since reading them opens a file of every installed distribution."""
    return tuple(
        EntryPoint(point.name, point.value, package_name(point.dist.name) if point.dist is not None else "")
        for point in entry_points(group=group)
    )


def named_packages() -> frozenset[str]:
    """Return the distributions that the operator names in ``VALERIE_PLUGINS``.

    The environment of this process provides them, since the code that looks up names has no settings.
    """
    return _named(os.environ.get(f"{PREFIX}PLUGINS", ""))


@lru_cache
def _named(_plugins: str) -> frozenset[str]:
    return frozenset(load_settings().plugin_packages)


@dataclass(frozen=True, slots=True)
class PluginKind:
    """One kind of plugin.

    Attributes:
        word: noun for such a plugin in messages.
        built_in: name to ``module:attribute``. Distributions cannot replace these.
    """

    word: str
    group: str
    built_in: Mapping[str, str] = field(default_factory=dict)

    def declared(self) -> dict[str, str]:
        """Return name to target of the allowed plugins that are not built in: this distribution's first, then by name."""
        packages = {OWN, *named_packages()}
        allowed = [offer for offer in self._offers() if offer.package in packages]
        ordered = sorted(allowed, key=lambda offer: (offer.package != OWN, offer.name))
        targets: dict[str, str] = {}
        for offer in ordered:
            targets.setdefault(offer.name, offer.target)
        return targets

    def left_out(self) -> dict[str, str]:
        """Return name to package for the plugins that are installed but not allowed."""
        names = self.names()
        return {offer.name: offer.package for offer in self._offers() if offer.name not in names}

    def _offers(self) -> list[EntryPoint]:
        return [offer for offer in installed(self.group) if offer.name not in self.built_in]

    def names(self) -> tuple[str, ...]:
        """Return all names: the built-in ones, then the declared ones."""
        return (*self.built_in, *self.declared())

    def load(self, name: str) -> Any:
        """Import a plugin and return it.

        Raises:
            UnknownName: no plugin has this name.
            InvalidInput: the plugin is installed, but the operator does not allow its package.
            MissingDependency: a library that it needs is not installed.
        """
        table = {**self.declared(), **self.built_in}
        if name not in table:
            raise self.unknown(name, table, field=self.word)
        module, _, attribute = table[name].partition(":")
        try:
            plugin = import_module(module)
            return getattr(plugin, attribute) if attribute else plugin
        except ImportError as error:
            raise MissingDependency(f"a dependency of the {self.word} {name!r} is not installed: {error}") from error

    def unknown(self, name: str, known: Iterable[str], *, field: str) -> InvalidInput:
        """Return the error for a name that is not in ``known``, with the setting that allows it or similar names."""
        package = self.left_out().get(name)
        if package is None:
            return UnknownName(self.word, name, known, field=field)
        return InvalidInput(
            f"{self.word} {name}: offered by the package {package}, which VALERIE_PLUGINS does not name",
            field=field,
            limit="the operator can allow it: packages in VALERIE_PLUGINS run as part of VALERIE",
        )
