"""Generate the codecs of the microcontroller's wire from its dialect, with pymavlink's mavgen.

Usage: generate_codecs.py python FILE   or   generate_codecs.py c FOLDER
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import pymavlink
from pymavlink.generator import mavgen

ROOT = Path(__file__).resolve().parent.parent
DIALECT = ROOT / "ori_deploy" / "wire" / "ori_deploy.xml"


def generate(language: str, target: Path) -> None:
    """Write the codec of `language` (as mavgen names it) to `target`."""
    with tempfile.TemporaryDirectory() as folder:
        # mavgen looks for included dialects beside the one that includes them.
        source = Path(shutil.copy(DIALECT, folder))
        shutil.copy(Path(pymavlink.__file__).parent / "dialects" / "v20" / "minimal.xml", folder)
        made = Path(folder) / "made.py" if language == "Python3" else Path(folder) / "made"
        options = mavgen.Opts(str(made), wire_protocol="2.0", language=language, validate=True)
        if not mavgen.mavgen(options, [str(source)]):
            raise SystemExit(f"error: mavgen could not read {DIALECT}")
        target.parent.mkdir(parents=True, exist_ok=True)
        if made.is_dir():
            shutil.copytree(made, target, dirs_exist_ok=True)
        else:
            shutil.copy(made, target)


if __name__ == "__main__":
    languages = {"python": "Python3", "c": "C"}
    if len(sys.argv) != 3 or sys.argv[1] not in languages:
        raise SystemExit(__doc__)
    generate(languages[sys.argv[1]], Path(sys.argv[2]))
