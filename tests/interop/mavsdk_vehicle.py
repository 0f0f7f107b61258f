"""A vehicle whose autopilot is MAVSDK's servers: missions, actions, parameters and telemetry are its code.

MAVSDK does not sign. Its bytes go through pymavlink on their way: sent ones are signed there, received ones are
verified there, and only what verifies is passed on. The body is a few lines: it climbs when told to take off, and
sinks when told to land.
"""
import os
import socket
import threading
import time
from importlib import import_module

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import common as m  # noqa: E402
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk  # noqa: E402

actions = import_module("mavsdk.plugins.action_server.action_server")
missions = import_module("mavsdk.plugins.mission_raw_server.mission_raw_server")
parameters = import_module("mavsdk.plugins.param_server.param_server")
telemetry = import_module("mavsdk.plugins.telemetry_server.telemetry_server")

EPOCH_2015_S = 1_420_070_400
GEOID_M = 47.4
LOWEST_CLIMB_M = 20.0


class Signer:
    """Between MAVSDK and the wire; without a key it only passes on what is well formed."""

    def __init__(self, key):
        self.refused = 0
        # One end for both ways: what is verified lifts the clock that answers are stamped with.
        end = self._end = m.MAVLink(None, srcSystem=1, srcComponent=1)
        end.robust_parsing = True
        if key:
            end.signing.secret_key = key
            end.signing.timestamp = int((time.time() - EPOCH_2015_S) * 100_000)
            end.signing.sign_outgoing = True

    def sign(self, message):
        """The frame of a message as it goes out."""
        if message.get_srcComponent():
            self._end.srcComponent = message.get_srcComponent()
        return message.pack(self._end)

    def verify(self, datagram):
        """The messages of a datagram that MAVSDK may see, unsigned."""
        for message in self._end.parse_buffer(datagram) or []:
            if message.get_type() == "BAD_DATA":
                self.refused += 1
                continue
            plain = m.MAVLink(None, srcSystem=message.get_srcSystem(), srcComponent=message.get_srcComponent())
            plain.seq = message.get_seq()
            yield message, bytes(message.pack(plain))


class MavsdkVehicle:
    """System 1 at the other end of a bridge's link."""

    def __init__(self, bridge, key, home):
        self.home, self.height = home, 0.0
        self.armed, self.mode = False, actions.FlightMode.HOLD
        self.plans, self.asked, self.heard, self.told = [], [], {}, {}
        # MAVSDK 4.1.0 refuses DO_SET_MODE to AUTO.LOITER, whatever is allowed: the body can answer it instead.
        self.holds_itself = False
        self._climb_to = None
        self._running = True
        self._bridge = bridge
        self._signer = Signer(key)
        self._wire = threading.Lock()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        configuration = Configuration.create_with_component_type(ComponentType.AUTOPILOT)
        configuration.system_id, configuration.component_id = 1, 1
        self._mavsdk = Mavsdk(configuration)
        assert self._mavsdk.add_any_connection("raw://") == ConnectionResult.SUCCESS
        self._mavsdk.subscribe_raw_bytes_to_be_sent(self._send)
        component = self._mavsdk.server_component_by_type(ComponentType.AUTOPILOT, 0)
        self._telemetry = telemetry.TelemetryServer(component)
        self._serve_parameters(component)
        self._serve_actions(component)
        self._missions = missions.MissionRawServer(component)
        self._missions.subscribe_incoming_mission(self._take_plan)
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._receive, self._live)]
        for thread in self._threads:
            thread.start()

    def close(self):
        self._running = False
        for thread in self._threads:
            thread.join()
        self._mavsdk.destroy()
        self._socket.close()

    def refused(self):
        """Datagrams that did not verify."""
        return self._signer.refused

    def _serve_parameters(self, component):
        self._parameters = parameters.ParamServer(component)
        for name, value in PARAMETERS.items():
            if isinstance(value, int):
                self._parameters.provide_param_int(name, value)
            else:
                self._parameters.provide_param_float(name, value)

    def _serve_actions(self, component):
        server = self._actions = actions.ActionServer(component)
        server.set_armable(True, True)
        server.set_disarmable(True, True)
        server.set_allow_takeoff(True)
        server.set_allowable_flight_modes(actions.AllowableFlightModes(True, True, True, True, True, True, True))
        server.subscribe_arm_disarm(lambda result, asked, _: self._arm(result, asked))
        server.subscribe_takeoff(lambda result, _a, _b=None: self._take_off(result))
        server.subscribe_land(lambda result, _a, _b=None: self._land(result))
        server.subscribe_flight_mode_change(lambda result, mode, _: self._set_mode(result, mode))
        server.set_flight_mode(self.mode)

    # What MAVSDK's servers were asked for

    def _arm(self, result, asked):
        self.asked.append(("arm" if asked.arm else "disarm", result.name))
        self.armed = asked.arm

    def _take_off(self, result):
        self.asked.append(("take off", result.name))
        self._climb_to = LOWEST_CLIMB_M
        self._show(actions.FlightMode.TAKEOFF)

    def _land(self, result):
        self.asked.append(("land", result.name))
        self._climb_to = 0.0
        self._show(actions.FlightMode.LAND)

    def _set_mode(self, result, mode):
        self.asked.append((f"mode {mode.name}", result.name))
        if mode == actions.FlightMode.LAND:
            self._climb_to = 0.0
        self._show(mode)

    def _hold(self, asked):
        self._show(actions.FlightMode.HOLD)
        with self._wire:
            answer = m.MAVLink_command_ack_message(m.MAV_CMD_DO_SET_MODE, m.MAV_RESULT_ACCEPTED, 0, 0,
                                                   asked.get_srcSystem(), asked.get_srcComponent())
            self._transmit(answer)

    def _show(self, mode):
        self.mode = mode
        self._actions.set_flight_mode_internal(mode)

    def _take_plan(self, result, plan, _):
        self.plans.append((result.name, plan.mission_items))

    # The wire

    def _send(self, raw):
        with self._wire:
            for message in m.MAVLink(None).parse_buffer(raw) or []:
                self.told[message.get_type()] = self.told.get(message.get_type(), 0) + 1
                self._transmit(message)

    def _transmit(self, message):
        self._socket.sendto(self._signer.sign(message), self._bridge)

    def _receive(self):
        while self._running:
            try:
                datagram = self._socket.recv(2048)
            except (TimeoutError, ConnectionRefusedError):
                continue
            with self._wire:
                verified = list(self._signer.verify(datagram))
            for message, raw in verified:
                self.heard.setdefault(message.get_type(), []).append(message)
                if self.holds_itself and is_hold(message):
                    self._hold(message)
                    continue
                self._mavsdk.pass_received_raw_bytes(raw)

    # The body

    def _live(self):
        tick = 0
        while self._running:
            if self._climb_to is not None:
                step = max(-0.6, min(0.6, self._climb_to - self.height))
                self.height += step
            if self._climb_to == 0.0 and self.height <= 0.0:
                self.armed, self._climb_to = False, None
                self._actions.set_armed_state(False)
            self._tell(tick)
            tick += 1
            time.sleep(0.1)

    def _tell(self, tick):
        t, (latitude, longitude, altitude) = self._telemetry, self.home
        here = telemetry.Position(latitude, longitude, altitude + self.height, self.height)
        t.publish_position(here, telemetry.VelocityNed(0.0, 0.0, 0.0), telemetry.Heading(0.0))
        up = self.height > 0.0
        state = telemetry.LandedState.IN_AIR if up else telemetry.LandedState.ON_GROUND
        t.publish_extended_sys_state(telemetry.VtolState.MC, state)
        if tick % 10 == 0:
            # MAVSDK 4.1.0 divides by 1000 to make HOME_POSITION's millimetres, instead of multiplying.
            t.publish_home(telemetry.Position(latitude, longitude, altitude * 1e6, 0.0))
            fix = telemetry.RawGps(0, latitude, longitude, altitude + self.height, 1.0, 1.0, 0.0, 0.0,
                                   altitude + self.height + GEOID_M, 1.0, 1.0, 0.1, 1.0, 0.0)
            t.publish_raw_gps(fix, telemetry.GpsInfo(12, telemetry.FixType.FIX_3D))


def is_hold(message):
    return message.get_type() == "COMMAND_LONG" and message.command == m.MAV_CMD_DO_SET_MODE and (
        message.param2, message.param3) == (4, 3)


# Some of what the bridge asks a PX4 for, as PX4 has them by default.
PARAMETERS = {"BAT_CRIT_THR": 0.07, "BAT_LOW_THR": 0.15, "COM_DL_LOSS_T": 10, "MPC_XY_VEL_MAX": 12.0, "NAV_LOITER_RAD": 80.0}
