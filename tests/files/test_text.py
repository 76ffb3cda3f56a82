"""Files are read once and whole, and written with all that can be written of them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ori_deploy.errors import FileError
from ori_deploy.files import write_atomically
from ori_deploy.files.text import HeldFile, read_bytes, read_text, read_toml


def test_a_name_that_is_not_utf_8_can_be_told_on_a_page(tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    write_atomically(page, f"recorded with {os.fsdecode(bytes([0xFF]))}.toml, 20 °C")
    assert page.read_text(encoding="utf-8") == "recorded with \\udcff.toml, 20 °C"


def test_a_file_that_is_held_is_read_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b'schema = "a/1"\r\nb = 1\r\n')
    held = HeldFile.of(path, read_bytes(path))
    path.unlink()
    assert (str(held), held.read_bytes()) == (str(path), b'schema = "a/1"\r\nb = 1\r\n')
    assert read_text(held) == 'schema = "a/1"\nb = 1\n'
    assert read_toml(held, "a/1") == {"schema": "a/1", "b": 1}
    with pytest.raises(FileError, match="cannot be read"):
        read_text(path)
    with pytest.raises(FileError, match="its rig: not a text file"):
        read_text(HeldFile.of("its rig", b"\xff"))
