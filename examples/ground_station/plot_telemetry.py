"""Command a motion, `deploy` or `fold`, record what the structure tells meanwhile, and draw it.

python examples/ground_station/plot_telemetry.py udpout:127.0.0.1:14560 deploy deploy.png
"""

import math
import sys
import threading
import time

from matplotlib.figure import Figure

from ori_deploy.mav.ground import GroundStation, NoAnswer, Structure
from ori_deploy.wire.vehicle import Party


def main(link: str, command: str, picture: str) -> None:
    times, told = [], []
    with GroundStation(link) as pilot, GroundStation(link, party=Party(254, 190)) as watcher:
        watcher.status()  # nobody there: says so, instead of waiting for telemetry
        moving = threading.Thread(target=lambda: print(getattr(pilot, command)()))
        moving.start()
        for one in watcher.monitor():
            if isinstance(one, Structure):
                times.append(time.monotonic())
                told.append(one)
                if one.at_rest and not moving.is_alive():
                    break
    seconds = [at - times[0] for at in times]
    fold, low, high = zip(*((s.fold, s.fold_lowest - s.fold, s.fold_highest - s.fold) for s in told), strict=True)
    upper, lower = (figure := Figure(layout="constrained")).subplots(2, sharex=True)
    upper.plot(seconds, fold)
    upper.set(ylabel="fold commanded", title=f"worst tracking {math.degrees(told[-1].worst_tracking_rad):.2f} deg")
    lower.fill_between(seconds, low, high, alpha=0.5)
    lower.set(ylabel="measured − commanded, all cells", xlabel="time, s")
    figure.savefig(picture, dpi=150)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:4])
    except NoAnswer as nobody:
        sys.exit(str(nobody))
