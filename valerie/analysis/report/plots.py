"""Drawings of a `Panel`: a plotly figure as a plain dict, and a static PNG or SVG from the same numbers."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Final, Literal

from valerie.analysis.report.panels import COMBINED_COLOR, Line, Mark, Panel, Points
from valerie.analysis.rows.frame_counts import ALL
from valerie.errors import MissingDependency
from valerie.plain import JsonObject

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK: Final = "#26303a"
RULE: Final = "#e3e6ea"
_FONT: Final = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', 'Liberation Sans', Arial, sans-serif"
_MATPLOTLIB_MARKERS: Final = {
    "circle": "o", "diamond": "D", "square": "s", "triangle-up": "^", "cross": "P", "star": "*",
}  # fmt: skip


def plotly_figure(panel: Panel) -> JsonObject:
    """Return the panel as a plotly figure: ``data`` and ``layout`` as JSON values."""
    data = [_plotly_points(points) for points in panel.points]
    for line in panel.lines:
        data.extend(_plotly_line(line))
    if panel.marks:
        data.append(_plotly_marks(panel.marks))
    axis: JsonObject = {
        "showline": True,
        "linecolor": "#9aa3ad",
        "gridcolor": RULE,
        "zeroline": False,
        "ticks": "outside",
        "ticklen": 4,
    }
    layout: JsonObject = {
        "height": 380,
        "margin": {"l": 52, "r": 12, "t": 8, "b": 46},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": _FONT, "size": 13, "color": INK},
        "hovermode": "closest",
        "hoverlabel": {
            "bgcolor": "#ffffff",
            "bordercolor": "#9aa3ad",
            "font": {"family": _FONT, "size": 12, "color": INK},
        },
        "showlegend": False,
        "xaxis": {**axis, "title": {"text": f"{panel.axis.title} ({panel.axis.unit})", "standoff": 8}},
        "yaxis": {**axis, "title": {"text": "pACC (%)", "standoff": 6}, "range": [-3, 103], "dtick": 20},
    }
    return {"data": data, "layout": layout}


def static_figure(panel: Panel, *, image_format: Literal["png", "svg"] = "png") -> bytes:
    """Return the panel as a picture file for readers without JavaScript; points are rasterised in SVG.

    Raises:
        MissingDependency: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependency("plots need matplotlib: install valerie[report]") from error
    figure = Figure(figsize=(6.0, 3.9), dpi=150)
    axes = figure.add_axes((0.1, 0.13, 0.88, 0.85))
    for points in panel.points:
        marker = _MATPLOTLIB_MARKERS[points.style.symbol]
        axes.scatter(
            points.x, points.y, s=9, marker=marker, color=points.style.color, alpha=0.3, linewidths=0, rasterized=True
        )
    for line in panel.lines:
        width, color = 2.4 if line.character == ALL else 1.5, line.style.color
        if line.low:
            axes.fill_between(line.x, line.low, line.high, color=color, alpha=0.14, linewidth=0)
        axes.plot(line.x, line.y, color=color, linewidth=width, linestyle="dashed" if line.dashed else "solid")
    axes.plot(
        [m.x for m in panel.marks], [m.y for m in panel.marks], "s", color=COMBINED_COLOR,
        markersize=4.5, markerfacecolor="white", markeredgewidth=1.4, zorder=5,
    )  # fmt: skip
    _matplotlib_axes(axes, panel)
    sink = BytesIO()
    metadata = {"Software": None} if image_format == "png" else {"Date": None, "Creator": None}
    figure.savefig(sink, format=image_format, metadata=metadata)
    return sink.getvalue()


def _matplotlib_axes(axes: Axes, panel: Panel) -> None:
    axes.set_xlabel(f"{panel.axis.title} ({panel.axis.unit})", color=INK)
    axes.set_ylabel("pACC (%)", color=INK)
    axes.set_ylim(-3, 103)
    axes.grid(color=RULE, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#9aa3ad")


def _plotly_points(points: Points) -> JsonObject:
    name = _plotly_text(points.character)
    return {
        "type": "scatter",
        "mode": "markers",
        "name": points.character,
        "x": list(points.x),
        "y": list(points.y),
        "text": list(points.frames),
        "marker": {
            "color": points.style.color,
            "symbol": points.style.symbol,
            "size": 5,
            "opacity": 0.32,
            "line": {"width": 0},
        },
        "hovertemplate": f"{name}<br>pACC %{{y:.1f}} % at %{{x:.4g}}<br>frame %{{text}}<extra></extra>",
    }


def _plotly_line(line: Line) -> list[JsonObject]:
    curve: JsonObject = {
        "type": "scatter",
        "mode": "lines",
        "name": line.character,
        "x": list(line.x),
        "y": list(line.y),
        "line": {
            "color": line.style.color,
            "width": 3 if line.character == ALL else 2,
            "dash": "dash" if line.dashed else "solid",
        },
        "hoverinfo": "skip",
    }
    if not line.low:
        return [curve]
    band: JsonObject = {
        "type": "scatter",
        "mode": "lines",
        "x": [*line.x, *reversed(line.x)],
        "y": [*line.high, *reversed(line.low)],
        "fill": "toself",
        "fillcolor": _transparent(line.style.color, 0.14),
        "line": {"width": 0},
        "hoverinfo": "skip",
    }
    return [band, curve]


def _plotly_marks(marks: tuple[Mark, ...]) -> JsonObject:
    return {
        "type": "scatter",
        "mode": "markers",
        "name": "binned mean",
        "x": [m.x for m in marks],
        "y": [m.y for m in marks],
        "text": [m.label for m in marks],
        "marker": {"color": "#ffffff", "size": 7, "symbol": "square", "line": {"color": COMBINED_COLOR, "width": 1.8}},
        "hovertemplate": "mean pACC %{y:.1f} %<br>%{text}<extra></extra>",
    }


def _transparent(color: str, opacity: float) -> str:
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"


def _plotly_text(text: str) -> str:
    """Return a name for a hover template, without markup and placeholders."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("%{", "% {")
