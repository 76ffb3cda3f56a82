"""`python -m benchmarks`: everything."""

from __future__ import annotations

from benchmarks import control, geometry

geometry.main()
control.main()
