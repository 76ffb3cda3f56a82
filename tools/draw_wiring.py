"""Draws docs/dynamixel-wiring.png: `python tools/draw_wiring.py`. The same bytes every time."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import matplotlib

matplotlib.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

OUTPUT = Path(__file__).parents[1] / "docs" / "dynamixel-wiring.png"
WIDTH, HEIGHT = 180.0, 103.0
"""Of the drawing; it comes out 12 inches wide."""

GROUND, SUPPLY, DATA = "#222222", "#c8201e", "#1f5fbf"
EDGE, FILL, BOARD, SERVO, WARNING = "#444444", "#f4f4f2", "#e3eef9", "#e9e9e6", "#fbe9e7"
SMALL, NORMAL, LARGE = 12.0, 13.5, 15.0
WIRE = 2.6
GAP = 3.0
"""Between the wires of one cable."""

SERVO_X, SERVO_Y, SERVO_WIDTH, SERVO_HEIGHT = (92.0, 114.5, 137.0, 159.5), 64.0, 16.5, 24.0
CHAIN_Y = 72.0
GEARS = ("2 : 1", "4 : 1", "2 : 1", "12 : 1")


def text(
    axes: Axes,
    x: float,
    y: float,
    words: str,
    size: float = NORMAL,
    *,
    at: Literal["left", "center", "right"] = "center",
    bold: bool = False,
    colour: str = "black",
) -> None:
    """Words at a place, centred on it unless `at` says otherwise."""
    weight = "bold" if bold else "normal"
    axes.text(x, y, words, fontsize=size, ha=at, va="center", weight=weight, color=colour, linespacing=1.25, zorder=5)


def box(axes: Axes, x: float, y: float, width: float, height: float, colour: str) -> None:
    """A device."""
    shape = "round,pad=0,rounding_size=1.6"
    axes.add_patch(
        FancyBboxPatch(
            (x, y), width, height, boxstyle=shape, facecolor=colour, edgecolor=EDGE, linewidth=1.4, zorder=3
        )
    )


def wire(axes: Axes, points: list[tuple[float, float]], colour: str, width: float = WIRE) -> None:
    """A conductor along corners."""
    xs, ys = zip(*points, strict=True)
    axes.plot(xs, ys, color=colour, linewidth=width, solid_joinstyle="round", solid_capstyle="butt", zorder=2)


def cable(axes: Axes, left: float, right: float) -> None:
    """One cable of the chain: data on top, supply, ground."""
    for row, colour in enumerate((GROUND, SUPPLY, DATA)):
        wire(axes, [(left, CHAIN_Y + row * GAP), (right, CHAIN_Y + row * GAP)], colour)


def draw_data_side(axes: Axes) -> None:
    """Host and adapter."""
    box(axes, 3, 66, 22, 20, FILL)
    text(axes, 14, 79, "host PC", LARGE, bold=True)
    text(axes, 14, 72, "ori-deploy\nLinux", SMALL)
    wire(axes, [(25, CHAIN_Y + GAP), (34, CHAIN_Y + GAP)], "#777777", 4.5)
    text(axes, 29.5, 79, "USB", NORMAL)
    box(axes, 34, 65, 20, 22, BOARD)
    text(axes, 44, 82, "U2D2", LARGE, bold=True)
    text(axes, 44, 73, "signals only,\ngives no\npower", SMALL)


def draw_hub(axes: Axes) -> None:
    """Power hub, where supply and signals meet."""
    cable(axes, 54, 62)
    box(axes, 62, 60, 21, 27, BOARD)
    text(axes, 72.5, 81, "U2D2\nPower Hub", NORMAL, bold=True)
    text(axes, 72.5, 69, "at most 10 A,\none supply\nonly", SMALL)


def draw_chain(axes: Axes) -> None:
    """Servos, one after the other."""
    for i, x in enumerate(SERVO_X):
        cable(axes, 83.0 if i == 0 else SERVO_X[i - 1] + SERVO_WIDTH, x)
        box(axes, x, SERVO_Y, SERVO_WIDTH, SERVO_HEIGHT, SERVO)
        centre = x + SERVO_WIDTH / 2
        axes.add_patch(
            Circle((centre, SERVO_Y + 18.5), 3.4, facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=4)
        )
        axes.add_patch(Circle((centre, SERVO_Y + 18.5), 0.7, facecolor=EDGE, edgecolor=EDGE, zorder=5))
        text(axes, centre, SERVO_Y + 10.5, f"servo_{i + 1}", NORMAL, bold=True)
        text(axes, centre, SERVO_Y + 4.5, f"id {i + 1}", NORMAL)
        text(axes, centre, SERVO_Y + SERVO_HEIGHT + 3.2, f"gear {GEARS[i]}", SMALL)
    text(axes, 134, 98, "4 x XM430-W350 in one chain, 12 V (XL330: 5 V!)", LARGE, bold=True)


def draw_supply(axes: Axes) -> None:
    """Supply, fuse and switch, up into the hub, whose left terminal is ground."""
    left, right = 67.5, 77.5
    plus, minus = 36.5, 51.0
    box(axes, 3, 32, 22, 23, FILL)
    text(axes, 14, 47.5, "12 V supply", NORMAL, bold=True)
    text(axes, 14, 39.5, "5 A,\ncurrent limit", SMALL)
    text(axes, 27, plus + 2.2, "+", LARGE, colour=SUPPLY)
    text(axes, 27, minus - 2.6, "−", LARGE)
    wire(axes, [(25, plus), (33, plus)], SUPPLY, 3.4)
    axes.add_patch(Rectangle((33, plus - 2.2), 10, 4.4, facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=3))
    axes.plot([33, 43], [plus, plus], color=SUPPLY, linewidth=1.6, zorder=4)
    text(axes, 38, plus + 5.2, "fuse 5 A", NORMAL)
    wire(axes, [(43, plus), (50.4, plus)], SUPPLY, 3.4)
    axes.plot([49.2, 59.6], [plus + 1.5, plus + 1.5], color=SUPPLY, linewidth=3.0, zorder=3)
    axes.plot([54.4, 54.4], [plus + 1.5, plus + 5.2], color=EDGE, linewidth=1.6, zorder=3)
    axes.add_patch(Rectangle((51.2, plus + 5.2), 6.4, 2.0, facecolor=SUPPLY, edgecolor=EDGE, linewidth=1.2, zorder=4))
    for x in (50.4, 58.4):
        axes.add_patch(Circle((x, plus), 1.0, facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=4))
    text(axes, 54.4, plus + 9.6, "e-stop", NORMAL, bold=True)
    wire(axes, [(58.4, plus), (right, plus), (right, 60)], SUPPLY, 3.4)
    wire(axes, [(25, minus), (left, minus), (left, 60)], GROUND, 3.4)
    text(axes, right + 1.6, 56.6, "+", LARGE, colour=SUPPLY, at="left")
    text(axes, left - 1.6, 57.0, "−", LARGE, at="right")
    text(axes, 44, minus + 3.0, "ground: no switch, no fuse", SMALL)


def draw_note(axes: Axes) -> None:
    """What the switch does."""
    box(axes, 92, 34, 84, 21, WARNING)
    text(axes, 95, 51, "The e-stop cuts VDD: every servo goes limp,", NORMAL, at="left", bold=True)
    text(axes, 95, 46.7, "and the structure falls unless something holds it.", NORMAL, at="left", bold=True)
    text(axes, 95, 41.8, "Plug and unplug with the supply off. Never power servos from", SMALL, at="left")
    text(axes, 95, 37.8, "USB, never join two supplies, never 12 V on an XL330.", SMALL, at="left")


def draw_connector(axes: Axes, x: float, title: str, pins: tuple[tuple[str, str], ...]) -> None:
    """Pins of a plug, named."""
    pitch = 15.0
    y = 11.0
    width = pitch * len(pins)
    text(axes, x, 25.0, title, NORMAL, at="left", bold=True)
    axes.add_patch(Rectangle((x, y), width, 9.5, facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=3))
    for k, (name, colour) in enumerate(pins):
        centre = x + (k + 0.5) * pitch
        axes.add_patch(Rectangle((centre - 1.9, y + 2.0), 3.8, 5.5, facecolor=colour, edgecolor=EDGE, zorder=4))
        text(axes, centre, y + 4.75, str(k + 1), SMALL, bold=True, colour="white")
        text(axes, centre, y - 3.6, name, NORMAL, colour=colour, bold=True)


def draw() -> Figure:
    """The whole sheet."""
    figure = Figure(figsize=(12.0, 12.0 * HEIGHT / WIDTH), dpi=150, facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, WIDTH)
    axes.set_ylim(0.0, HEIGHT)
    axes.set_axis_off()
    for part in (draw_data_side, draw_hub, draw_chain, draw_supply, draw_note):
        part(axes)
    draw_connector(axes, 4.0, "TTL, models -T: JST EHR-03", (("GND", GROUND), ("VDD", SUPPLY), ("DATA", DATA)))
    draw_connector(
        axes,
        62.0,
        "RS-485, models -R: JST EHR-04",
        (("GND", GROUND), ("VDD", SUPPLY), ("D+", DATA), ("D−", DATA)),
    )
    text(axes, 132, 19.5, "Pin 1 to pin 1, from the hub to", SMALL, at="left")
    text(axes, 132, 15, "the last servo: one ground for all.", SMALL, at="left")
    text(axes, 132, 9.5, "All servos -T, or all -R.", SMALL, at="left")
    return figure


def main() -> None:
    """Write the picture."""
    with matplotlib.rc_context({"font.family": "DejaVu Sans", "path.simplify": False}):
        draw().savefig(OUTPUT, metadata={"Software": None})


if __name__ == "__main__":
    main()
