"""`python -m benchmarks`: everything."""

from __future__ import annotations

from benchmarks import control, geometry, layouts, search

geometry.main()
control.main()
layouts.main()
search.main()
