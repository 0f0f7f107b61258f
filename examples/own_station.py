"""A ground station of the standard library alone: discovers, takes control, launches to 30 m, lands and releases.

    python3 examples/own_station.py [HOST:PORT]    # its bytes are explained in docs/guide/tasks.md, task 3
"""
import socket
import struct
import sys
import time

CUCS, VSM, VEHICLE, EVERYBODY = 0x1B0000C0, 0x1B000001, 0x1B000101, 0xFFFFFFFF
# Of what is read here: the bytes of the presence vector, and of each field up to the last that is read.
LAYOUTS = {
    2: (3, (5, 4, 4, 1, 1, 1, 1)),
    3002: (3, (5, 3, 1, 2, 2, 2, 2, 2, 1, 1, 2, 2, 2, 2, 1, 1, 1)),
    16000: (3, (5, 4, 1, 4, 1, 1, 2, 2, 2, 1, 4, 80)),
    16002: (1, (5,)),
    17000: (1, (5, 5, 2, 1)),
}
host, port = (sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:4586").rsplit(":", 1)
udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
udp.connect((host, int(port)))
udp.settimeout(0.2)
last_stamp = 0


def send(kind, to, presence, values="", ask=0):
    """Sends 16 bytes of wrapper, the presence vector, the Time Stamp (field 1) and the other fields."""
    global last_stamp
    last_stamp = max(last_stamp + 1, int((time.time() - 946_684_800) * 1000))  # ms since 2000 UTC; none is used twice
    stamp = last_stamp.to_bytes(5, "big")
    data = bytes.fromhex(presence) + stamp + bytes.fromhex(values)
    udp.send(struct.pack(">HHIIHH", 0, len(data), CUCS, to, kind, ask << 15 | 0x2000) + data)
    return stamp


def fields(kind, data):
    """The fields that are there, by number: the lowest bit of the presence vector is field 1."""
    width, sizes = LAYOUTS.get(kind, (0, ()))
    presence, at, found = int.from_bytes(data[:width], "big"), width, {}
    for number, size in enumerate(sizes, start=1):
        if presence >> number - 1 & 1:
            found[number], at = data[at:at + size], at + size
    return found


def wait(what, accept, seconds=60):
    """The first message that is accepted. A heartbeat each second keeps control."""
    end, beat = time.monotonic() + seconds, 0.0
    while time.monotonic() < end:
        if time.monotonic() >= beat:
            beat = time.monotonic() + 1
            send(16002, VSM, "01")
        try:
            message = udp.recv(65536)
        except (TimeoutError, ConnectionRefusedError):
            continue
        _, length, source, _, kind, properties = struct.unpack(">HHIIHH", message[:16])
        found = fields(kind, message[16:16 + length])
        # What asks for it is acknowledged: by that the VSM knows that this CUCS is at this address.
        if properties & 0x8000:
            send(17000, source, "0f", f"{found[1].hex()}{kind:04x}01")
        if kind == 16000:
            print("alert:", found.get(12, b"").rstrip(b"\0").decode("ascii", "replace"))
        if accept(kind, found):
            return found
    sys.exit(f"not seen within {seconds} s: {what}")


def command(what, presence, values):
    """Sends a 2016 and waits until the vehicle has carried it out (17000 type 2) or refused it (3)."""
    stamp = send(2016, VEHICLE, presence, values, ask=1)
    answer = wait(what, lambda kind, f: kind == 17000 and f.get(2) == stamp and f.get(4) in (b"\2", b"\3"))
    if answer[4] == b"\3":
        sys.exit(f"{what} was refused")
    print(what, "- done")


send(1, EVERYBODY, "000001")
wait("a vehicle", lambda kind, f: kind == 2)
send(1, VEHICLE, "000061", "0d01")                  # LOI 2, 4 and 5; request control
wait("control", lambda kind, f: kind == 2 and f.get(7) == b"\x0d")
command("launch", "01000f", "15010005dc02")         # mode 21; an altitude, of 30 m in steps of 2 cm, above home
wait("30 m", lambda kind, f: kind == 3002 and f.get(17) == b"\x0a")                 # UA State: in the air
command("landing begun", "000003", "13")            # mode 19
wait("the ground", lambda kind, f: kind == 3002 and f.get(17) == b"\x02", 120)      # UA State: on the ground, disarmed
send(1, VEHICLE, "000061", "0d00")                  # release
wait("the release", lambda kind, f: kind == 2 and f.get(7) == b"\0")
print("landed and released")
