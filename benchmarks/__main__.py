"""`python -m benchmarks`: everything."""

from __future__ import annotations

from benchmarks import control, dynamixel, geometry, layouts, search

geometry.main()
control.main()
dynamixel.main()
layouts.main()
search.main()
