"""Files are read once and whole, and written with all that can be written of them."""

from __future__ import annotations

import os
from pathlib import Path

from ori_deploy.files import write_atomically


def test_a_name_that_is_not_utf_8_can_be_told_on_a_page(tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    write_atomically(page, f"recorded with {os.fsdecode(bytes([0xFF]))}.toml, 20 °C")
    assert page.read_text(encoding="utf-8") == "recorded with \\udcff.toml, 20 °C"
