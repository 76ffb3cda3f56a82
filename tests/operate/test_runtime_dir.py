"""The folder for sockets and locks is this user's alone, or it is not used."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from ori_deploy import runtime_dir
from ori_deploy.errors import FileError
from ori_deploy.runtime_dir import runtime_dirs

pytestmark = pytest.mark.usefixtures("runtime_folder")


def test_it_is_made_for_this_user_alone_whatever_the_umask(runtime_folder: Path) -> None:
    before = os.umask(0)
    try:
        assert runtime_dir.runtime_dir() == runtime_folder
    finally:
        os.umask(before)
    assert stat.S_IMODE(runtime_folder.stat().st_mode) == 0o700
    assert runtime_dir.runtime_dir() == runtime_folder
    assert runtime_dirs(os.geteuid()) == (runtime_folder,)


@pytest.mark.parametrize("given", ["", "relative/folder", "/nonexistent/od"])
def test_without_a_runtime_folder_of_the_session_it_is_in_tmp(monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", given)
    runtime_dir.FALLBACK.mkdir()
    assert runtime_dir.runtime_dir() == runtime_dir.FALLBACK / f"ori-deploy-{os.geteuid()}"


def test_what_others_can_enter_is_refused_with_its_mode(runtime_folder: Path) -> None:
    runtime_folder.mkdir()
    runtime_folder.chmod(0o755)
    with pytest.raises(FileError, match=r"found mode 755.*remedy: .*chmod 700"):
        runtime_dir.runtime_dir()
    assert runtime_dirs(os.geteuid()) == ()


def test_no_symbolic_link_is_followed(runtime_folder: Path, tmp_path: Path) -> None:
    target = tmp_path / "elsewhere"
    target.mkdir(mode=0o700)
    runtime_folder.symlink_to(target)
    with pytest.raises(FileError, match="a symbolic link"):
        runtime_dir.runtime_dir()
    assert not list(target.iterdir())


def test_a_file_of_that_name_is_refused(runtime_folder: Path) -> None:
    runtime_folder.touch()
    with pytest.raises(FileError, match="not a folder"):
        runtime_dir.runtime_dir()


def test_another_user_s_folder_is_refused(runtime_folder: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("NOT TESTED: giving a folder to another user needs root")
    runtime_folder.mkdir(mode=0o700)
    os.chown(runtime_folder, 65534, 65534)
    with pytest.raises(FileError, match="owned by user 65534"):
        runtime_dir.runtime_dir()
    os.chown(runtime_folder.parent, 65534, 65534)  # as `sudo -E` leaves it: then it is not even looked at
    runtime_dir.FALLBACK.mkdir()
    assert runtime_dir.runtime_dir().parent == runtime_dir.FALLBACK
