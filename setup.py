"""The part of the build that pyproject.toml cannot say: the MAVLink codecs are generated."""

import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT / "tools"))


class GenerateAndBuild(build_py):
    """Generates the codecs in the source tree, then builds as ever."""

    def run(self) -> None:
        from generate_codecs import generate_python

        generate_python(ROOT / "ori_deploy" / "wire" / "generated")
        super().run()


setup(cmdclass={"build_py": GenerateAndBuild})
