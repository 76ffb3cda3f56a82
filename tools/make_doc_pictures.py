"""Pictures of the documents, in docs/generated: `python tools/make_doc_pictures.py`.

The tutorial's are drawn from what its own commands leave behind, those of the mathematics by our own code. `--keep`
makes the one moving picture that is kept instead, docs/pictures/fold.gif, which the README shows.
"""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from ori_deploy.design import Structure
from ori_deploy.files import build_from_file, load_design, load_plan
from ori_deploy.telemetry.read import read_run
from ori_deploy.view import draw_plan, draw_section, draw_tracking, to_png
from ori_deploy.view.ink import FAINT, INK, SLIT, house_style
from ori_deploy.view.strip import Frame, draw_frame, fold_frames

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script, this is tools/
from tools.doc_blocks import blocks, run_shell  # noqa: E402
from tools.doc_figures import FIGURES  # noqa: E402

DOCS = ROOT / "docs"
GENERATED = DOCS / "generated"
KEPT = DOCS / "pictures" / "fold.gif"
TUTORIAL = ("tutorial-section.png", "tutorial-fold.gif", "tutorial-plan.png", "tutorial-run.png")
NAMES = frozenset({*TUTORIAL, *FIGURES})
"""All that pages may show from docs/generated."""

_POSES, _HOLD, _FRAME_MS = 40, 14, 50
_COLOURS = 48
_DPI = 80.0
_WIDTH_IN = 8.0
_HEAD_IN, _PAD_IN = 0.35, 0.1


def moving_picture(structure: Structure) -> bytes:
    """A GIF that unfolds the structure, rests, and folds it again."""
    at = np.linspace(0.0, 1.0, _POSES)
    folds = 0.5 - 0.5 * np.cos(np.pi * at)
    folds[-1] = 1.0
    frames = fold_frames(structure, folds)
    pictures = [_picture(structure, frame, frames) for frame in frames]
    sample = pictures[_POSES // 2].copy()
    # Slits and letters are thin: too few dots to be given a colour of their own.
    for k, colour in enumerate((SLIT, INK)):
        sample.paste(colour, (k * sample.width // 8, 0, (k + 1) * sample.width // 8, sample.height // 8))
    colours = sample.quantize(_COLOURS)
    flat = [picture.quantize(palette=colours, dither=Image.Dither.NONE) for picture in pictures]
    order = [*range(_POSES), *range(_POSES - 2, 0, -1)]
    rests = {0: _HOLD * _FRAME_MS, _POSES - 1: 2 * _HOLD * _FRAME_MS}
    out = io.BytesIO()
    flat[0].save(
        out,
        format="GIF",
        save_all=True,
        append_images=[flat[k] for k in order[1:]],
        duration=[rests.get(k, _FRAME_MS) for k in order],
        loop=0,
        optimize=True,
    )
    return out.getvalue()


def _picture(structure: Structure, frame: Frame, frames: tuple[Frame, ...]) -> Image.Image:
    """One pose in the middle of a page that has room for all of them."""
    widest, tallest = np.max([f.size for f in frames], axis=0)
    scale = (_WIDTH_IN - 2.0 * _PAD_IN) / widest
    height = scale * tallest + _HEAD_IN + 2.0 * _PAD_IN
    with house_style():
        figure = Figure(figsize=(_WIDTH_IN, height))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0.0, _WIDTH_IN)
        axes.set_ylim(0.0, height)
        corner = 0.5 * (np.array([_WIDTH_IN, height - _HEAD_IN]) - scale * frame.size)
        draw_frame(axes, structure.layout, frame, complex(*corner), scale, "frame")
        axes.text(_PAD_IN, height - 0.25, f"fold {frame.fold:.2f}", fontsize=11.0, fontweight="bold", color=INK)
        axes.plot([_PAD_IN, _PAD_IN + 2.0], [height - 0.33] * 2, color=FAINT, linewidth=0.8)
        axes.plot([_PAD_IN, _PAD_IN + 2.0 * frame.fold], [height - 0.33] * 2, color=INK, linewidth=2.5)
    return Image.open(io.BytesIO(to_png(figure, _DPI))).convert("RGB")


def tutorial_pictures() -> Mapping[str, bytes]:
    """Run the tutorial, and draw what came of it."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for block in blocks(DOCS / "tutorial.md", "sh"):
            run_shell(block, folder)
        structure = load_design(folder / "wing.design.json").structure
        plan, run = load_plan(folder / "wing.plan.json"), read_run(folder / "deploy.mcap")
    assert isinstance(structure, Structure)
    drawn = (
        to_png(draw_section(structure), 120.0),
        moving_picture(structure),
        to_png(draw_plan(plan), 110.0),
        to_png(draw_tracking(run, plan), 110.0),
    )
    return dict(zip(TUTORIAL, drawn, strict=True))


def main() -> None:
    """Make all of them."""
    GENERATED.mkdir(exist_ok=True)
    if "--keep" in sys.argv[1:]:
        _, wing = build_from_file(ROOT / "examples" / "wing_naca2412.toml")
        assert isinstance(wing, Structure)
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_bytes(moving_picture(wing))
        return
    for name, data in tutorial_pictures().items():
        (GENERATED / name).write_bytes(data)
    for name, draw in FIGURES.items():
        (GENERATED / name).write_bytes(to_png(draw(), 130.0))


if __name__ == "__main__":
    main()
