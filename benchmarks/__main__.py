"""`python -m benchmarks`: everything."""

from __future__ import annotations

from benchmarks import control, dynamixel, geometry, layouts, mavlink, mcu, page, realtime, recording, search

geometry.main()
control.main()
realtime.main()
recording.main()
mavlink.main()
dynamixel.main()
mcu.main()
layouts.main()
search.main()
page.main()
