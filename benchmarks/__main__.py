"""`python -m benchmarks`: everything."""

from __future__ import annotations

from benchmarks import control, dynamixel, geometry, layouts, mcu, search

geometry.main()
control.main()
dynamixel.main()
mcu.main()
layouts.main()
search.main()
