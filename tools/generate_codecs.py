"""Generate the codecs of both wires from their dialects, with pymavlink's mavgen.

Usage: generate_codecs.py python FOLDER   both dialects for Python
       generate_codecs.py c FOLDER        the microcontroller's for C
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import pymavlink
from pymavlink.generator import mavgen

ROOT = Path(__file__).resolve().parent.parent
MICROCONTROLLER = ROOT / "ori_deploy" / "wire" / "ori_deploy.xml"
VEHICLE = ROOT / "ori_deploy" / "wire" / "ori_vehicle.xml"
INCLUDED = ("minimal.xml", "standard.xml", "common.xml")


def generate(dialect: Path, language: str, target: Path) -> None:
    """Write the codec of `dialect` in `language` (as mavgen names it) to `target`."""
    with tempfile.TemporaryDirectory() as folder:
        # mavgen looks for included dialects beside the one that includes them.
        source = Path(shutil.copy(dialect, folder))
        for name in INCLUDED:
            shutil.copy(Path(pymavlink.__file__).parent / "dialects" / "v20" / name, folder)
        made = Path(folder) / "made.py" if language == "Python3" else Path(folder) / "made"
        options = mavgen.Opts(str(made), wire_protocol="2.0", language=language, validate=True)
        if not mavgen.mavgen(options, [str(source)]):
            raise SystemExit(f"error: mavgen could not read {dialect}")
        target.parent.mkdir(parents=True, exist_ok=True)
        if made.is_dir():
            shutil.copytree(made, target, dirs_exist_ok=True)
        else:
            shutil.copy(made, target)


def generate_python(folder: Path) -> None:
    """Write the Python codecs of both dialects into `folder`, each named after its dialect."""
    for dialect in (MICROCONTROLLER, VEHICLE):
        generate(dialect, "Python3", folder / f"{dialect.stem}.py")


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in ("python", "c"):
        raise SystemExit(__doc__)
    if sys.argv[1] == "python":
        generate_python(Path(sys.argv[2]))
    else:
        generate(MICROCONTROLLER, "C", Path(sys.argv[2]))
