"""Deploy and fold again and again; times, and the worst tracking so far, as CSV.

python examples/ground_station/bench_cycles.py udpout:127.0.0.1:14560 20 > cycles.csv
"""

import csv
import math
import sys
import time

from ori_deploy.mav.ground import GroundStation, NoAnswer


def main(link: str, cycles: int) -> int:
    table = csv.writer(sys.stdout)
    table.writerow(["cycle", "deploy_s", "fold_s", "worst_tracking_deg", "latches_confirmed"])
    with GroundStation(link) as station:
        station.fold()  # every cycle begins folded
        for cycle in range(1, cycles + 1):
            times, told = [], []
            for move in (station.deploy, station.fold):
                began = time.monotonic()
                verdict = move()
                times.append(f"{time.monotonic() - began:.2f}")
                told.append(station.status())
                if not verdict.accepted:
                    print(f"cycle {cycle}: {move.__name__} {verdict}; {told[-1].fault}", file=sys.stderr)
                    return 1
            worst = math.degrees(told[-1].worst_tracking_rad)  # since the component was started
            table.writerow([cycle, *times, f"{worst:.2f}", told[0].latches_confirmed])
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1], int(sys.argv[2])) if len(sys.argv) == 3 else __doc__)
    except NoAnswer as nobody:
        sys.exit(str(nobody))
