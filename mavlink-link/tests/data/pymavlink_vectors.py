"""Frames signed by pymavlink, for tests/vectors.rs.

Made with:  python3 -m venv venv && venv/bin/pip install pymavlink==2.4.50
            MAVLINK20=1 venv/bin/python pymavlink_vectors.py > pymavlink_vectors.txt
A line: key, link id, stamp, sequence, system, component, message id, the whole frame in hex.
"""

from pymavlink.dialects.v20 import common as m

KEYS = [bytes(range(1, 33)), b"\xa5" * 32, bytes(range(255, 223, -1))]
STAMPS = [0, 1, 0x0102030405, 37_517_586_000_000, (1 << 48) - 2]
MESSAGES = [
    m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
    m.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
    m.MAVLink_mission_item_int_message(1, 1, 7, 6, 16, 0, 1, 0, 0, 0, 0, 473977434, 85455939, 50.0, 0),
    m.MAVLink_statustext_message(6, b"a text of some length, with its end", 0, 0),
    m.MAVLink_param_value_message(b"MIS_TAKEOFF_ALT", 2.5, 9, 947, 65535),
    m.MAVLink_system_time_message(0, 0),
    m.MAVLink_file_transfer_protocol_message(0, 1, 1, bytes(i * 7 % 256 for i in range(250)) + b"\x01"),
]

for n, message in enumerate(MESSAGES):
    for k, key in enumerate(KEYS):
        mav = m.MAVLink(None, srcSystem=245 - k, srcComponent=190 + k)
        mav.signing.secret_key = key
        mav.signing.link_id = n * 37 + k
        mav.signing.timestamp = STAMPS[(n + k) % len(STAMPS)]
        mav.signing.sign_outgoing = True
        mav.seq = n * 3 + k
        stamp, seq = mav.signing.timestamp, mav.seq
        frame = message.pack(mav)
        print(key.hex(), mav.signing.link_id, stamp, seq, mav.srcSystem, mav.srcComponent,
              message.get_msgId(), bytes(frame).hex())
