#!/usr/bin/env python3
"""MAVSDK as a ground station for `mavlink-check station`: parameters, a plan, arming and a take-off of the vehicle that is played.

    mavlink-check station --listen udpout:127.0.0.1:14571 --time 40 --command "python3 mavsdk_station.py 14571"

MAVSDK does not sign: run it without a key.
"""
import sys
import time
from importlib import import_module

from mavsdk import ComponentType, Configuration, Mavsdk

actions = import_module("mavsdk.plugins.action.action")
missions = import_module("mavsdk.plugins.mission_raw.mission_raw")
parameters = import_module("mavsdk.plugins.param.param")
NAV_WAYPOINT, RELATIVE_INT = 16, 6


def attempt(what, step):
    """A step whose failure is the vehicle's doing: it loses answers on purpose."""
    try:
        print(what, step())
    except Exception as error:
        print(what, error)


def main():
    station = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    station.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
    deadline = time.monotonic() + 10
    while not station.get_systems() and time.monotonic() < deadline:
        time.sleep(0.1)
    vehicle = station.get_systems()[0]
    items = [missions.MissionItem(seq, RELATIVE_INT, NAV_WAYPOINT, int(seq == 0), 1, 0.0, 0.0, 0.0, 0.0, 473_977_434 + 5_000 * seq, 85_455_939, 30.0, 0)
             for seq in range(3)]
    attempt("parameters", lambda: parameters.Param(vehicle).get_all_params())
    attempt("plan", lambda: missions.MissionRaw(vehicle).upload_mission(items))
    attempt("arm", lambda: actions.Action(vehicle).arm())
    attempt("take-off", lambda: actions.Action(vehicle).takeoff())
    while True:
        attempt("arm", lambda: actions.Action(vehicle).arm())
        time.sleep(2)


if __name__ == "__main__":
    main()
