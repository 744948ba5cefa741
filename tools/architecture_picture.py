"""Draw ``docs/images/architecture.svg``: the packages as `.importlinter` layers them, and the processes.

``python -m tools.architecture_picture`` writes the picture. Run it when a contract changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from configparser import ConfigParser
from html import escape
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
PICTURE: Final = ROOT / "docs" / "images" / "architecture.svg"

INK, QUIET, AMBER = "#1f2933", "#52606d", "#b7791f"
#: Stroke and fill of the kinds of boxes.
GREEN, BLUE, VIOLET = ("#3b7d4f", "#eaf5ec"), ("#2f6f9f", "#e8f1f8"), ("#6b5b95", "#f1eef7")
YELLOW, GREY = (AMBER, "#fdf6e7"), ("#9aa5b1", "#f5f7fa")
INFRASTRUCTURE: Final = frozenset({"broker", "db", "logs", "storage"})

LEFT, WIDTH, TOP, GAP = 52.0, 528.0, 66.0, 8.0
#: Upper bounds of a letter's mean width in pixels: bold names of packages, and small names of their parts.
BOLD, SMALL = 8.0, 6.2
#: Packages whose inner layers are drawn, by the name of their contract.
DETAILED: Final = ("pipeline", "scene")

_LAYERS = tuple[tuple[str, ...], ...]


def layers(contract: str = "layers") -> _LAYERS:
    """Return the rows of a layers contract from top to bottom, as names without ``valerie.``."""
    text = _contracts()[f"importlinter:contract:{contract}"]["layers"]
    return tuple(
        tuple(name.strip().removeprefix("valerie.") for name in row.split("|")) for row in text.split("\n") if row
    )


def picture() -> str:
    """Return the picture as SVG."""
    packages, bottom = _packages()
    height = bottom + 50
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1210 {height:g}" width="1210" height="{height:g}" '
        f'role="img" aria-labelledby="t d" font-family="Helvetica, Arial, sans-serif" font-size="13.5" fill="{INK}">'
    )
    title = '<title id="t">Packages and processes of VALERIE</title>'
    description = (
        '<desc id="d">Left: the packages in layers; each imports only what lies below it. Right: people talk to the '
        "API. The API and its control loop write rows to the database and ring for work through the broker. Workers "
        "claim products in the database, compute them, store objects in the artifact store and publish them in the "
        "database.</desc>"
    )
    headings = [
        f'<text x="{x:g}" y="44" font-size="17" font-weight="bold">{text}</text>'
        for x, text in ((LEFT, "Packages"), (640, "Processes"))
    ]
    lines = [head, title, description, "<defs>", _marker("a", QUIET), _marker("b", AMBER), "</defs>"]
    lines += [f'<rect width="1210" height="{height:g}" fill="#ffffff"/>', *headings, *packages, *_legend(bottom)]
    return "\n".join([*lines, *_processes(), "</svg>\n"])


def _contracts() -> ConfigParser:
    parser = ConfigParser()
    parser.read(ROOT / ".importlinter", "utf-8")
    return parser


def _marker(name: str, colour: str) -> str:
    return (
        f'<marker id="{name}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
        f'orient="auto-start-reverse"><path d="M0 0L10 5L0 10z" fill="{colour}"/></marker>'
    )


def _rectangle(x: float, y: float, width: float, height: float, colours: tuple[str, str], more: str = "") -> str:
    stroke, fill = colours
    place = f'x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"'
    return f'<rect {place} rx="6" stroke="{stroke}" fill="{fill}"{more}/>'


def _text(x: float, y: float, text: str, more: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}" text-anchor="middle"{more}>{escape(text)}</text>'


def _line(path: str, *, ring: bool = False, both: bool = False) -> str:
    colour, marker = (AMBER, "b") if ring else (QUIET, "a")
    style = ' stroke-dasharray="5 4"' if ring else ""
    start = f' marker-start="url(#{marker})"' if both else ""
    return (
        f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.6"{style}{start} marker-end="url(#{marker})"/>'
    )


def _packages() -> tuple[list[str], float]:
    """Return the rows of packages, and the y coordinate of their lower end."""
    modules = _contracts()["importlinter:contract:science"]["source_modules"].split()
    science = {name.removeprefix("valerie.") for name in modules}
    parts: list[str] = []
    y = TOP
    for number, row in enumerate(layers()):
        room = WIDTH if number else 300.0  # The asset pack stands beside the first row.
        for line in _wrapped(row, [BOLD * len(name) + 12 for name in row], GAP, room):
            chains = {name: _wrapped_chain(layers(name), room - 16) for name in line if name in DETAILED}
            height = 32.0 + 28 * max(map(len, chains.values()), default=0)
            # The room that the names leave is shared.
            spare = (room - GAP * (len(line) - 1) - sum(BOLD * len(name) for name in line)) / len(line)
            x = LEFT
            for name in line:
                width = BOLD * len(name) + spare
                colours = GREEN if name in science else VIOLET if name in INFRASTRUCTURE else BLUE
                parts.append(_rectangle(x, y, width, height, colours))
                parts.append(_text(x + width / 2, y + 21, name, ' font-weight="bold"'))
                for place, labels in enumerate(chains.get(name, ())):
                    parts += _chain(labels, x + width / 2, y + 29 + 28 * place, colours[0], goes_on=place > 0)
                x += width + GAP
            y += height + GAP
    parts.append(_rectangle(LEFT + 316, TOP, WIDTH - 316, 32, (GREY[0], "#ffffff"), ' stroke-dasharray="4 3"'))
    parts.append(_text(LEFT + 316 + (WIDTH - 316) / 2, TOP + 21, "urban_street: loaded by name"))
    return parts, y - GAP


def _wrapped(names: Sequence[str], widths: Sequence[float], gap: float, room: float) -> list[list[str]]:
    """Return the names in lines that fit into the room."""
    lines: list[list[str]] = [[]]
    used = -gap
    for name, width in zip(names, widths, strict=True):
        if lines[-1] and used + gap + width > room:
            lines.append([])
            used = -gap
        lines[-1].append(name)
        used += gap + width
    return lines


def _wrapped_chain(rows: _LAYERS, room: float) -> list[list[str]]:
    labels = [" · ".join(row) for row in rows]
    return _wrapped(labels, [SMALL * len(label) + 12 for label in labels], 16, room - 16)


def _chain(labels: Sequence[str], centre: float, y: float, stroke: str, *, goes_on: bool) -> Iterator[str]:
    """Yield small boxes, from the importing to the imported rows; a line that goes on has an arrow before its first."""
    widths = [SMALL * len(label) + 12 for label in labels]
    x = centre - (sum(widths) + 16 * (len(widths) - 1)) / 2
    for place, (label, width) in enumerate(zip(labels, widths, strict=True)):
        if place or goes_on:
            yield _line(f"M{x - 15:g} {y + 11:g}H{x - 1:g}")
        yield _rectangle(x, y, width, 22, (stroke, "#ffffff"))
        yield _text(x + width / 2, y + 15, label, ' font-size="11.5"')
        x += width + 16


def _legend(bottom: float) -> Iterator[str]:
    yield _line(f"M28 {TOP:g}V{bottom:g}")
    yield (
        f'<text transform="translate(22 {(TOP + bottom) / 2:g}) rotate(-90)" text-anchor="middle" fill="{QUIET}" '
        'font-size="12">imports</text>'
    )
    entries = (
        (0, GREEN, "science: no database, queue or web"),
        (232, VIOLET, "infrastructure"),
        (352, BLUE, "entry, use cases, base"),
    )
    for offset, colours, label in entries:
        yield _rectangle(LEFT + offset, bottom + 17, 14, 14, colours)
        yield f'<text x="{LEFT + offset + 20:g}" y="{bottom + 29:g}" fill="{QUIET}" font-size="12">{label}</text>'


def _box(x: float, y: float, width: float, colours: tuple[str, str], title: str, lines: Sequence[str]) -> Iterator[str]:
    yield _rectangle(x, y, width, 36 + 18 * len(lines), colours)
    yield _text(x + width / 2, y + 22, title, ' font-weight="bold"')
    for number, line in enumerate(lines):
        yield _text(x + width / 2, y + 41 + 17 * number, line, f' font-size="12" fill="{QUIET}"')


def _processes() -> Iterator[str]:
    yield from _box(640, 66, 170, GREY, "People and scripts", ("valerie, dashboard,", "REST"))
    yield from _box(
        890,
        66,
        290,
        BLUE,
        "API with control loop",
        ("answers, plans, serves pictures;", "writes rows in blocks, rings, sweeps"),
    )
    yield from _box(690, 206, 490, YELLOW, "Broker (Redis)", ("the doorbell: may lose or duplicate a message",))
    yield from _box(690, 328, 150, GREEN, "Render workers", ("background, layer,", "truth, annotations"))
    yield from _box(860, 328, 150, GREEN, "Inference workers", ("picture from the sensor", "stage → prediction"))
    yield from _box(1030, 328, 150, GREEN, "Evaluation workers", ("counts; tables,", "summary, report"))
    yield _rectangle(640, 484, 540, 104, ("#cbd2d9", "#fbfcfd"), ' stroke-dasharray="3 4"')
    yield from _box(
        656, 500, 248, VIOLET, "Database", ("the queue of record: runs, frames,", "products with state and lease")
    )
    yield from _box(
        916, 500, 248, VIOLET, "Artifact store", ("one object per product,", "named by its digest; reports")
    )
    yield _line("M812 102H888", both=True)
    yield _line("M910 140V172H664V482", both=True)
    yield _line("M1035 140V204", ring=True)
    for x in (765, 935, 1105):
        yield _line(f"M{x} 262V326", ring=True)
        yield _line(f"M{x} 402V482", both=True)
        yield f'<text x="{x + 9}" y="298" font-size="12" fill="#8a5a12">ring</text>'
    for x, y, label in (
        (819, 86, "specs,"),
        (819, 120, "results"),
        (672, 192, "rows"),
        (774, 447, "claim, store, publish"),
    ):
        yield f'<text x="{x}" y="{y}" font-size="12" fill="{QUIET}">{label}</text>'
    yield '<text x="1044" y="176" font-size="12" fill="#8a5a12">ring</text>'


if __name__ == "__main__":
    PICTURE.write_text(picture(), "utf-8")
