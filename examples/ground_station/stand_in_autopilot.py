"""Stands in for an autopilot on a bench that has none: says that it is disarmed and on the ground, until Ctrl-C.

    python examples/ground_station/stand_in_autopilot.py udpout:127.0.0.1:14560

Never on the network of a vehicle: its word would be taken for that of the autopilot, in the air, too.
"""

import contextlib
import sys
import time

from pymavlink import mavutil

m = mavutil.mavlink


def main(link: str) -> None:
    if "127.0.0.1" not in link:
        sys.exit("only on 127.0.0.1: this is for a bench")
    vehicle = mavutil.mavlink_connection(link, source_system=1, source_component=1)
    while True:
        vehicle.mav.heartbeat_send(m.MAV_TYPE_FIXED_WING, m.MAV_AUTOPILOT_GENERIC, 0, 0, m.MAV_STATE_STANDBY)
        vehicle.mav.extended_sys_state_send(m.MAV_VTOL_STATE_UNDEFINED, m.MAV_LANDED_STATE_ON_GROUND)
        time.sleep(0.5)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with contextlib.suppress(KeyboardInterrupt):  # as it is meant to end
        main(sys.argv[1])
