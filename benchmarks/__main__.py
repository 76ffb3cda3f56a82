"""`python -m benchmarks`: everything."""

from __future__ import annotations

from benchmarks import control, geometry, layouts

geometry.main()
control.main()
layouts.main()
