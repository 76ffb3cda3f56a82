"""Before the take-off check: deploy the structure, see it locked, and say go or no-go. Exit status 0 is go.

python examples/ground_station/preflight_deploy.py udpout:127.0.0.1:14560
"""

import sys

from ori_deploy.mav.ground import GroundStation, NoAnswer, Structure


def objections(told: Structure) -> list[str]:
    """What speaks against a take-off."""
    checks = {
        f"state is {told.state.name.lower()}, not deployed": told.locked,
        f"{told.latches_confirmed} of {told.latches} latches confirmed": told.latches_confirmed == told.latches,
        f"fault {told.fault}": not told.fault,
        f"cells stand from {told.fold_lowest:.3f} to {told.fold_highest:.3f}": told.fold_lowest > 0.98,
    }
    return [words for words, fine in checks.items() if not fine]


def main(link: str) -> int:
    try:
        with GroundStation(link) as station:
            verdict = station.deploy(progress=lambda percent: print(f"{percent:3d} %"))
            against = objections(station.status()) if verdict.accepted else [f"deploy {verdict}"]
    except NoAnswer as nobody:
        against = [str(nobody)]
    for words in against:
        print(f"NO-GO: {words}")
    if not against:
        print("GO: deployed and locked")
    return 1 if against else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1]))
