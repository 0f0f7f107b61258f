#!/usr/bin/env python3
"""pymavlink as the other end of a signed link.

    signing_peer.py verify --key HEX --stamp N < frames.hex     one JSON verdict a line
    signing_peer.py sign --key HEX --stamp N --seed N --count N one frame a line, in hex
    signing_peer.py forge --key HEX --stamp N < wishes.json     one frame a wish, in hex

`verify` judges each line with pymavlink's own check; an empty line starts a new receiver. `--stamp` is the
clock of either, in 10 us since 2015. A wish is an object on a line: `message` (heartbeat, radio_status or ack), and
where they differ from the vehicle's own: `system`, `component`, `link`, `stamp`, `key`.
"""
import argparse
import json
import os
import random
import sys

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import common as m  # noqa: E402


def end(options, system, component):
    mav = m.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.robust_parsing = False
    mav.signing.secret_key = bytes.fromhex(options.key)
    mav.signing.timestamp = options.stamp
    mav.signing.sign_outgoing = True
    return mav


def verify(options):
    receiver = end(options, 255, 1)
    for line in sys.stdin:
        line = line.strip()
        if not line:
            receiver = end(options, 255, 1)
            continue
        try:
            # bytearray: the CRC check of pymavlink slices and slices again.
            message = receiver.decode(bytearray.fromhex(line))
            verdict = {"accepted": True, "message": message.get_type(), "fields": plain(message.to_dict())}
        except m.MAVError as error:
            verdict = {"accepted": False, "reason": str(error)}
        print(json.dumps(verdict), flush=True)


def plain(fields):
    return {k: v for k, v in fields.items() if isinstance(v, (int, float, str))}


def sign(options):
    dice = random.Random(options.seed)
    sender = end(options, 1, 1)
    for _ in range(options.count):
        print(sample(dice).pack(sender).hex())


def forge(options):
    for line in sys.stdin:
        wish = json.loads(line)
        sender = end(options, wish.get("system", 1), wish.get("component", 1))
        sender.signing.link_id = wish.get("link", 0)
        sender.signing.timestamp = wish.get("stamp", options.stamp)
        sender.signing.secret_key = bytes.fromhex(wish.get("key", options.key))
        print(NAMED[wish["message"]].pack(sender).hex(), flush=True)


NAMED = {
    "heartbeat": m.MAVLink_heartbeat_message(2, 12, 0x1D, 0x04040000, 3, 3),
    "radio_status": m.MAVLink_radio_status_message(9, 9, 100, 1, 1, 0, 0),
    "ack": m.MAVLink_command_ack_message(400, 0, 0, 0, 245, 190),
}


def sample(dice):
    real = lambda: dice.uniform(-1e4, 1e4)  # noqa: E731
    kind = dice.randrange(7)
    if kind == 0:
        return m.MAVLink_heartbeat_message(2, 12, 0x1D, dice.choice([0x03040000, 0x04040000, 0x06040000]), 3, 3)
    if kind == 1:
        return m.MAVLink_global_position_int_message(
            dice.randrange(2**32), dice.randrange(-9 * 10**8, 9 * 10**8), dice.randrange(-18 * 10**8, 18 * 10**8),
            dice.randrange(-(2**31), 2**31), dice.randrange(-(2**31), 2**31),
            *(dice.randrange(-(2**15), 2**15) for _ in range(3)), dice.randrange(2**16))
    if kind == 2:
        return m.MAVLink_command_ack_message(400, dice.randrange(7), dice.randrange(101), dice.randrange(-100, 100), 245, 190)
    if kind == 3:
        return m.MAVLink_statustext_message(dice.randrange(8), bytes(dice.choices(b"abcxyz 0189", k=dice.randrange(1, 51))), 0, 0)
    if kind == 4:
        return m.MAVLink_mission_item_int_message(
            245, 190, dice.randrange(500), 6, 16, 0, 1, real(), real(), real(), real(),
            dice.randrange(-(2**31), 2**31), dice.randrange(-(2**31), 2**31), real(), 0)
    if kind == 5:
        return m.MAVLink_param_value_message(b"MIS_TAKEOFF_ALT", real(), 9, 947, dice.randrange(65536))
    return m.MAVLink_file_transfer_protocol_message(0, 245, 190, bytes(dice.randrange(256) for _ in range(251)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("verb", choices=["verify", "sign", "forge"])
    parser.add_argument("--key", required=True)
    parser.add_argument("--stamp", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=50)
    options = parser.parse_args()
    {"verify": verify, "sign": sign, "forge": forge}[options.verb](options)


if __name__ == "__main__":
    main()
