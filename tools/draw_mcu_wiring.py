"""Draws docs/mcu-wiring.png: `python tools/draw_mcu_wiring.py`. The same bytes every time."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import matplotlib

matplotlib.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

OUTPUT = Path(__file__).parents[1] / "docs" / "mcu-wiring.png"
WIDTH, HEIGHT = 180.0, 141.0
"""Of the drawing; it comes out 12 inches wide."""

GROUND, SUPPLY, LOGIC, SIGNAL, FEEDBACK = "#222222", "#c8201e", "#e0862a", "#1f5fbf", "#2a8a4a"
EDGE, FILL, BOARD, SERVO, WARNING = "#444444", "#f4f4f2", "#e3eef9", "#e9e9e6", "#fbe9e7"
SMALL, NORMAL, LARGE = 11.5, 13.0, 15.0
WIRE, RAIL = 2.2, 3.4

SERVO_X, SERVO_Y, SERVO_WIDTH, SERVO_HEIGHT = (98.0, 118.5, 139.0, 159.5), 108.0, 17.5, 21.0
SERVOS = (
    ("servo_1", "D11, A0", "1.4 : 1"),
    ("servo_2", "D12, A1", "3.5 : 1"),
    ("servo_3", "D13, A2", "1.4 : 1"),
    ("servo_4", "D5, A3", "12 : 1"),
)
SIGNAL_Y, FEEDBACK_Y, PLUS_Y, MINUS_Y = 133.5, 101.5, 91.0, 80.5


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
    axes.text(x, y, words, fontsize=size, ha=at, va="center", weight=weight, color=colour, linespacing=1.25, zorder=6)


def box(axes: Axes, x: float, y: float, width: float, height: float, colour: str, layer: float = 3) -> None:
    """A device."""
    shape = "round,pad=0,rounding_size=1.6"
    axes.add_patch(
        FancyBboxPatch(
            (x, y), width, height, boxstyle=shape, facecolor=colour, edgecolor=EDGE, linewidth=1.4, zorder=layer
        )
    )


def wire(axes: Axes, points: list[tuple[float, float]], colour: str, width: float = WIRE) -> None:
    """A conductor along corners."""
    xs, ys = zip(*points, strict=True)
    axes.plot(xs, ys, color=colour, linewidth=width, solid_joinstyle="round", solid_capstyle="butt", zorder=2)


def joint(axes: Axes, x: float, y: float, colour: str) -> None:
    """Where wires meet; without one they cross."""
    axes.add_patch(Circle((x, y), 0.75, facecolor=colour, edgecolor=colour, zorder=4))


def resistor(axes: Axes, x: float, y: float, *, upright: bool) -> None:
    """A resistor centred on a wire."""
    width, height = (2.6, 5.6) if upright else (5.6, 2.6)
    axes.add_patch(
        Rectangle(
            (x - width / 2, y - height / 2), width, height, facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=4
        )
    )


def capacitor(axes: Axes, x: float, y: float) -> None:
    """An upright capacitor, centred on a wire, which it interrupts."""
    axes.add_patch(Rectangle((x - 2.4, y - 0.6), 4.8, 1.2, facecolor="white", edgecolor="white", zorder=3))
    for level in (y - 0.6, y + 0.6):
        axes.plot([x - 2.2, x + 2.2], [level, level], color=EDGE, linewidth=2.4, zorder=4)


def ground(axes: Axes, x: float, y: float) -> None:
    """Ground, below a wire that ends here."""
    for k, half in enumerate((2.2, 1.4, 0.6)):
        axes.plot([x - half, x + half], [y - 0.9 * k, y - 0.9 * k], color=GROUND, linewidth=2.0, zorder=3)


def terminal(axes: Axes, x: float, y: float) -> None:
    """An open end."""
    axes.add_patch(Circle((x, y), 0.9, facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=4))


def pin(axes: Axes, x: float, y: float, name: str) -> None:
    """A pin of the board, at the end of a wire that comes from the left."""
    axes.add_patch(Rectangle((x, y - 2.1), 8.4, 4.2, facecolor=BOARD, edgecolor=EDGE, linewidth=1.2, zorder=3))
    text(axes, x + 4.2, y - 0.1, name, SMALL, bold=True)


def draw_board(axes: Axes) -> None:
    """Host, the board, and what feeds it."""
    box(axes, 3, 119, 22, 17, FILL)
    text(axes, 14, 130.5, "host PC", LARGE, bold=True)
    text(axes, 14, 124.0, "ori-deploy\nLinux", SMALL)
    box(axes, 3, 100, 22, 14, FILL)
    text(axes, 14, 110.2, "9 V adapter", NORMAL, bold=True)
    text(axes, 14, 104.2, "0.5 A, to the\nround jack", SMALL)
    wire(axes, [(25, 127), (42, 127)], "#777777", 4.5)
    text(axes, 33.5, 130.2, "USB", NORMAL)
    wire(axes, [(25, 107), (42, 107)], LOGIC, RAIL)
    box(axes, 42, 98, 29, 39, BOARD)
    text(axes, 56.5, 131.5, "Arduino\nMega 2560", NORMAL, bold=True)
    text(axes, 56.5, 120.2, "10 µF from RESET\nto GND, put in\nafter flashing", SMALL)
    text(axes, 56.5, 109.3, "servos get\nnothing from\nthe 5 V pin", SMALL)
    text(axes, 56.5, 101.3, "GND", SMALL, bold=True)


def draw_servos(axes: Axes) -> None:
    """Servos, each with signal, feedback, supply and ground."""
    last = SERVO_X[-1]
    wire(axes, [(71, SIGNAL_Y), (last + 8.75, SIGNAL_Y)], SIGNAL, RAIL)
    text(axes, 84, SIGNAL_Y + 2.8, "signals, one each", SMALL, colour=SIGNAL)
    wire(axes, [(71, FEEDBACK_Y), (last + 3.5, FEEDBACK_Y)], FEEDBACK, RAIL)
    text(axes, 84.2, FEEDBACK_Y + 5.4, "feedback, one\neach, see (a)", SMALL, colour=FEEDBACK)
    for x, (name, pins, gear) in zip(SERVO_X, SERVOS, strict=True):
        centre, top = x + SERVO_WIDTH / 2, SERVO_Y + SERVO_HEIGHT
        box(axes, x, SERVO_Y, SERVO_WIDTH, SERVO_HEIGHT, SERVO)
        text(axes, centre, SERVO_Y + 16.5, name, NORMAL, bold=True)
        text(axes, centre, SERVO_Y + 10.5, pins, NORMAL)
        text(axes, centre, SERVO_Y + 4.5, f"gear {gear}", SMALL)
        wire(axes, [(centre, SIGNAL_Y), (centre, top)], SIGNAL)
        wire(axes, [(x + 3.5, FEEDBACK_Y), (x + 3.5, SERVO_Y)], FEEDBACK)
        wire(axes, [(x + 8.75, PLUS_Y), (x + 8.75, SERVO_Y)], SUPPLY)
        wire(axes, [(x + 14.0, MINUS_Y), (x + 14.0, SERVO_Y)], GROUND)
        joint(axes, x + 8.75, PLUS_Y, SUPPLY)
        joint(axes, x + 14.0, MINUS_Y, GROUND)


def draw_supply(axes: Axes) -> None:
    """Supply, fuse and switch; the rails that servos hang on."""
    end = SERVO_X[-1] + SERVO_WIDTH
    box(axes, 3, 75, 22, 21, FILL)
    text(axes, 14, 90.5, "6 V supply", NORMAL, bold=True)
    text(axes, 14, 82.5, "10 A,\ncurrent limit", SMALL)
    text(axes, 27, PLUS_Y + 2.4, "+", LARGE, colour=SUPPLY)
    text(axes, 27, MINUS_Y - 2.8, "−", LARGE)
    wire(axes, [(25, PLUS_Y), (47.4, PLUS_Y)], SUPPLY, RAIL)
    axes.add_patch(Rectangle((31, PLUS_Y - 2), 9, 4, facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=3))
    axes.plot([31, 40], [PLUS_Y, PLUS_Y], color=SUPPLY, linewidth=1.6, zorder=4)
    text(axes, 35.5, PLUS_Y - 4.6, "fuse 10 A", SMALL)
    axes.plot([47.4, 53.4], [PLUS_Y, PLUS_Y + 3.0], color=SUPPLY, linewidth=3.0, zorder=3)
    for x in (47.4, 54.4):
        terminal(axes, x, PLUS_Y)
    text(axes, 50.6, PLUS_Y - 4.6, "switch", SMALL, bold=True)
    wire(axes, [(54.4, PLUS_Y), (end, PLUS_Y)], SUPPLY, RAIL)
    wire(axes, [(25, MINUS_Y), (end, MINUS_Y)], GROUND, RAIL)
    wire(axes, [(64, 98), (64, MINUS_Y)], GROUND, RAIL)
    joint(axes, 64, MINUS_Y, GROUND)
    text(axes, 31, MINUS_Y - 3.4, "one ground for all: no switch, no fuse", SMALL, at="left")
    wire(axes, [(82, PLUS_Y), (82, MINUS_Y)], EDGE)
    joint(axes, 82, PLUS_Y, SUPPLY)
    joint(axes, 82, MINUS_Y, GROUND)
    capacitor(axes, 82, (PLUS_Y + MINUS_Y) / 2)
    text(axes, 79, (PLUS_Y + MINUS_Y) / 2, "2200 µF\n16 V", SMALL, at="right")
    text(axes, 95, MINUS_Y - 3.4, "switched + also goes to (b); leads part at the capacitor", SMALL, at="left")


def panel(axes: Axes, x: float, width: float, title: str) -> None:
    """Frame of a detail."""
    box(axes, x, 19.5, width, 51.5, "white", 1)
    text(axes, x + width / 2, 67.3, title, NORMAL, bold=True)


def draw_feedback(axes: Axes) -> None:
    """(a): one feedback input."""
    panel(axes, 3, 34, "(a) feedback, × 4")
    wire(axes, [(7, 55), (26.5, 55)], FEEDBACK)
    terminal(axes, 7, 55)
    text(axes, 8.2, 59.2, "servo", SMALL)
    resistor(axes, 13.6, 55, upright=False)
    text(axes, 15.2, 50.9, "1 kΩ", SMALL, at="right")
    pin(axes, 26.5, 55, "A0")
    text(axes, 30.7, 60.4, "A1, A2,\nA3 alike", SMALL)
    wire(axes, [(18.6, 55), (18.6, 31)], EDGE)
    joint(axes, 18.6, 55, FEEDBACK)
    resistor(axes, 18.6, 42, upright=True)
    text(axes, 16.4, 42, "100 kΩ", SMALL, at="right")
    wire(axes, [(23.6, 55), (23.6, 31)], EDGE)
    joint(axes, 23.6, 55, FEEDBACK)
    capacitor(axes, 23.6, 42)
    text(axes, 26.6, 42, "100 nF", SMALL, at="left")
    ground(axes, 18.6, 31)
    ground(axes, 23.6, 31)
    text(axes, 20, 23.4, "an open wire reads 0", SMALL)


def draw_dividers(axes: Axes) -> None:
    """(b): supply and temperature."""
    panel(axes, 40, 41, "(b) supply, temperature")
    for x, top, colour, upper, name, lower in (
        (47.5, "servos' +", SUPPLY, "20 kΩ", "A12", "10 kΩ"),
        (67.5, "5 V pin", LOGIC, "10 kΩ", "A13", "NTC\n10 kΩ"),
    ):
        text(axes, x, 61.9, top, SMALL, colour=colour)
        wire(axes, [(x, 59.4), (x, 45)], colour)
        wire(axes, [(x, 45), (x, 31)], EDGE)
        resistor(axes, x, 52.6, upright=True)
        text(axes, x + 2.2, 53.2, upper, SMALL, at="left")
        joint(axes, x, 45, EDGE)
        wire(axes, [(x, 45), (x + 4, 45)], EDGE)
        pin(axes, x + 4, 45, name)
        resistor(axes, x, 37.4, upright=True)
        text(axes, x + 2.2, 37.0, lower, SMALL, at="left")
        ground(axes, x, 31)
    text(axes, 60.5, 23.4, "the NTC sits on a servo", SMALL)


def draw_stop(axes: Axes) -> None:
    """(c): emergency stop."""
    panel(axes, 84, 22, "(c) e-stop")
    pin(axes, 90.8, 59.5, "D38")
    wire(axes, [(95, 57.4), (95, 49.6)], EDGE)
    wire(axes, [(95, 40), (95, 31)], EDGE)
    terminal(axes, 95, 48.8)
    terminal(axes, 95, 40.8)
    axes.plot([96.4, 96.4], [39.6, 50], color=SUPPLY, linewidth=3.0, zorder=3)
    axes.plot([96.4, 99.6], [44.8, 44.8], color=EDGE, linewidth=1.6, zorder=3)
    axes.add_patch(Rectangle((99.6, 41.8), 2.0, 6.0, facecolor=SUPPLY, edgecolor=EDGE, linewidth=1.2, zorder=4))
    ground(axes, 95, 31)
    text(axes, 95, 24.6, "opens when\npressed", SMALL)


def draw_sensor(axes: Axes) -> None:
    """(d): Hall switch."""
    panel(axes, 109, 27, "(d) Hall switch")
    text(axes, 116, 61.9, "5 V pin", SMALL, colour=LOGIC)
    wire(axes, [(116, 59.4), (116, 50)], LOGIC)
    box(axes, 111.5, 41, 9.5, 9, SERVO)
    text(axes, 116.2, 45.5, "A3144", SMALL)
    wire(axes, [(121, 45.5), (125.5, 45.5)], SIGNAL)
    pin(axes, 125.5, 45.5, "D37")
    wire(axes, [(116, 41), (116, 31)], EDGE)
    ground(axes, 116, 31)
    text(axes, 127, 37.5, "pull-up\nis inside", SMALL)
    text(axes, 122.5, 23.4, "low when closed", SMALL)


def draw_magnet(axes: Axes) -> None:
    """(e): one electromagnet."""
    panel(axes, 139, 38, "(e) electromagnet")
    pin(axes, 140.6, 43, "D22")
    wire(axes, [(149, 43), (160.6, 43)], SIGNAL)
    resistor(axes, 153.2, 43, upright=False)
    text(axes, 153.0, 46.6, "220 Ω", SMALL)
    wire(axes, [(158, 43), (158, 31)], EDGE)
    joint(axes, 158, 43, SIGNAL)
    resistor(axes, 158, 36.6, upright=True)
    text(axes, 156, 35.6, "10 kΩ", SMALL, at="right")
    ground(axes, 158, 31)
    box(axes, 160.6, 38.6, 8.8, 8.6, SERVO)
    text(axes, 161.6, 43, "G", SMALL, at="left")
    text(axes, 167.0, 45.1, "D", SMALL)
    text(axes, 167.0, 40.7, "S", SMALL)
    text(axes, 175.8, 43.0, "MOS\nFET", SMALL, at="right")
    wire(axes, [(165.4, 38.6), (165.4, 31)], EDGE)
    ground(axes, 165.4, 31)
    wire(axes, [(165.4, 47.2), (165.4, 60.4)], EDGE)
    text(axes, 161.0, 61.9, "+, fused", SMALL, colour=SUPPLY, at="right")
    wire(axes, [(161.6, 61.2), (172.4, 61.2)], SUPPLY)
    wire(axes, [(172.4, 61.2), (172.4, 49.2), (165.4, 49.2)], EDGE)
    joint(axes, 165.4, 49.2, EDGE)
    joint(axes, 165.4, 61.2, SUPPLY)
    axes.add_patch(Rectangle((162.2, 51.6), 6.4, 6.6, facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=4))
    text(axes, 165.4, 54.9, "coil", SMALL)
    axes.add_patch(
        Polygon(
            [(170.6, 53.2), (174.2, 53.2), (172.4, 56.6)], facecolor="white", edgecolor=EDGE, linewidth=1.4, zorder=4
        )
    )
    axes.plot([170.4, 174.4], [56.7, 56.7], color=EDGE, linewidth=2.4, zorder=4)
    text(axes, 158, 23.4, "diode: its bar is on the + side", SMALL)


def draw_note(axes: Axes) -> None:
    """What the two switches do."""
    box(axes, 3, 2, 174, 14, WARNING)
    text(
        axes,
        6,
        11.8,
        "The e-stop on D38 brings the motion to rest, and the servos hold.",
        NORMAL,
        at="left",
        bold=True,
    )
    text(axes, 6, 6.2, "The supply's switch takes the servos' power: all go limp, and the structure falls "
         "unless something holds it.", NORMAL, at="left", bold=True)  # fmt: skip


def draw() -> Figure:
    """The whole sheet."""
    figure = Figure(figsize=(12.0, 12.0 * HEIGHT / WIDTH), dpi=150, facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, WIDTH)
    axes.set_ylim(0.0, HEIGHT)
    axes.set_axis_off()
    for part in (
        draw_board,
        draw_servos,
        draw_supply,
        draw_feedback,
        draw_dividers,
        draw_stop,
        draw_sensor,
        draw_magnet,
        draw_note,
    ):
        part(axes)
    return figure


def main() -> None:
    """Write the picture."""
    with matplotlib.rc_context({"font.family": "DejaVu Sans", "path.simplify": False}):
        draw().savefig(OUTPUT, metadata={"Software": None})


if __name__ == "__main__":
    main()
