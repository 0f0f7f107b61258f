#!/usr/bin/env python3
"""pymavlink as a ground station beside the bridge: it receives the vehicle, and commands it signed.

    forward_client.py --listen HOST:PORT --key HEX --refused-key HEX
    forward_client.py --unsigned HOST:PORT

The bridge sends to `--listen`, by a [[forward]] with `commands = true`; or waits at `--unsigned`, by one with `unsigned = true` that
lists the command 400. Ends with 0 where every check held. THE AIRCRAFT WILL ARM.
"""
import argparse
import os
import sys
import time

os.environ["MAVLINK20"] = "1"
os.environ["MAVLINK_DIALECT"] = "common"
from pymavlink import mavutil  # noqa: E402

from checks import Checks  # noqa: E402

ARM, REBOOT = 400, 246
ACCEPTED, DENIED = 0, 2


class Client:
    def __init__(self, connection):
        # With `udpin` it binds, and answers where the bridge sends from.
        self.link = mavutil.mavlink_connection(connection, source_system=255, source_component=190)

    def sign(self, key):
        self.link.setup_signing(bytes.fromhex(key), sign_outgoing=True, allow_unsigned_callback=None)

    def receive(self, seconds, *kinds):
        """The first message of vehicle 1 of these kinds; a heartbeat a second shows that we are here."""
        end, beat = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            if time.monotonic() - beat > 1:
                beat = time.monotonic()
                self.link.mav.heartbeat_send(6, 8, 0, 0, 4)
            message = self.link.recv_match(blocking=True, timeout=0.2)
            if message and message.get_srcSystem() == 1 and message.get_type() in kinds:
                return message
        return None

    def command(self, number, *parameters):
        values = (parameters + (0,) * 7)[:7]
        self.link.mav.command_long_send(1, 1, number, 0, *values)
        end = time.monotonic() + 3
        while time.monotonic() < end:
            answer = self.receive(end - time.monotonic(), "COMMAND_ACK")
            if answer and answer.command == number:
                return answer.result
        return None


def run(options, checks):
    client = Client(f"udpin:{options.listen}")
    client.sign(options.key)
    position = client.receive(30, "GLOBAL_POSITION_INT")
    checks.check("the position comes, signed with the key of this ground station", position and position.get_signed(), position)
    checks.check("and is the vehicle's", position and abs(position.lat - 473977434) < 1000, position)

    checks.check("a reboot is on no list", client.command(REBOOT, 1) == DENIED)
    client.sign(options.refused_key)
    client.link.mav.signing.timestamp += 100_000
    client.link.mav.command_long_send(1, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0)
    time.sleep(1)
    client.sign(options.key)
    beat = client.receive(10, "HEARTBEAT")
    checks.check("another key arms nothing", beat and not beat.base_mode & 128, beat)

    arm(client, checks, "its own key arms")


def run_unsigned(options, checks):
    """Beside [[forward]] unsigned = true, commands = { commands = [400] }."""
    client = Client(f"udpout:{options.unsigned}")
    position = client.receive(30, "GLOBAL_POSITION_INT")
    checks.check("the position comes, unsigned", position and not position.get_signed(), position)
    checks.check("a reboot is not listed", client.command(REBOOT, 1) == DENIED)
    client.link.mav.param_set_send(1, 1, b"MPC_XY_CRUISE", 3.0, 9)
    end, taken = time.monotonic() + 3, False
    while time.monotonic() < end and not taken:
        answer = client.receive(end - time.monotonic(), "PARAM_VALUE")
        taken = bool(answer and answer.param_id == "MPC_XY_CRUISE" and answer.param_value == 3.0)
    checks.check("a parameter is not listed", not taken)
    client.link.mav.setup_signing_send(1, 1, b"\0" * 32, 0)
    client.link.mav.serial_control_send(10, 2, 0, 0, 7, list(b"reboot\n" + b"\0" * 63))
    arm(client, checks, "what is listed arms")
    position = client.receive(5, "GLOBAL_POSITION_INT")
    checks.check("the vehicle still signs for the bridge", position is not None, position)


def arm(client, checks, name):
    # A vehicle refuses to arm in the first seconds after its start.
    end, result = time.monotonic() + 30, client.command(ARM, 1)
    while result != ACCEPTED and time.monotonic() < end:
        client.receive(1, "SYS_STATUS")
        result = client.command(ARM, 1)
    checks.check(name, result == ACCEPTED, result)
    deadline, armed = time.monotonic() + 5, False
    while not armed and time.monotonic() < deadline:
        beat = client.receive(2, "HEARTBEAT")
        armed = bool(beat and beat.base_mode & 128)
    checks.check("the vehicle shows it", armed)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--listen", metavar="HOST:PORT")
    parser.add_argument("--key")
    parser.add_argument("--refused-key")
    parser.add_argument("--unsigned", metavar="HOST:PORT")
    options, checks = parser.parse_args(), Checks()
    (run_unsigned if options.unsigned else run)(options, checks)
    checks.close()
    return 0 if checks.passed() else 1


if __name__ == "__main__":
    sys.exit(main())
