"""Command a motion, `deploy` or `fold`, record what the structure tells meanwhile, and draw it: fold over time.

python examples/ground_station/plot_telemetry.py udpout:127.0.0.1:14560 deploy deploy.png
"""

import sys
import threading
import time

from matplotlib.figure import Figure

from ori_deploy.mav.ground import GroundStation, NoAnswer, Structure
from ori_deploy.wire.vehicle import Party


def main(link: str, command: str, picture: str) -> None:
    told = []
    with GroundStation(link) as pilot, GroundStation(link, party=Party(254, 190)) as watcher:
        watcher.status()  # says so where nobody is there
        moving = threading.Thread(target=lambda: print(getattr(pilot, command)()))
        moving.start()
        for one in watcher.monitor():
            told += [(time.monotonic(), one)] if isinstance(one, Structure) else []
            if told and told[-1][1].at_rest and not moving.is_alive():
                break
    seconds, fold = [at - told[0][0] for at, _ in told], [one.fold for _, one in told]
    off = [(one.fold_lowest - one.fold, one.fold_highest - one.fold) for _, one in told]
    upper, lower = (figure := Figure(layout="constrained")).subplots(2, sharex=True)
    upper.plot(seconds, fold)
    lower.fill_between(seconds, *zip(*off, strict=True), alpha=0.5)
    lower.set(xlabel="time, s", ylabel="measured − commanded")
    figure.savefig(picture, dpi=150)


if __name__ == "__main__":
    try:
        sys.exit(main(*sys.argv[1:]) if len(sys.argv) == 4 else __doc__)
    except NoAnswer as nobody:
        sys.exit(str(nobody))
