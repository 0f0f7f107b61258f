#!/usr/bin/env python3
"""Reference of the DLI guard's trailer: an oracle, independent of the project's own code. Standard library only.

    reference_guard.py SEED COUNT      COUNT random datagrams, sealed, as JSON lines

HMAC and HKDF are written out over SHA-256 here, so that a mistake in a library of either side would show.
"""
import hashlib
import json
import random
import struct
import sys

DIRECTIONS = {"c2v": 1, "v2c": 2}
LENGTHS = [0, 1, 22, 51, 52, 53, 495, 496, 548]


def hmac(key, text):
    key = key.ljust(64, b"\0")
    inner = hashlib.sha256(bytes(b ^ 0x36 for b in key) + text).digest()
    return hashlib.sha256(bytes(b ^ 0x5C for b in key) + inner).digest()


def hkdf(key, info):
    return hmac(hmac(bytes(32), key), info + b"\x01")


def seal(key, direction, sender, receiver, stamp_us, datagram):
    key_id = hmac(key, b"vsm/1 key id")[:2]
    head = struct.pack(">2sBBI2sHQ", b"GD", 1, DIRECTIONS[direction], sender, key_id, 0, stamp_us)
    derived = hkdf(key, direction.encode())
    text = b"vsm-guard-1" + struct.pack(">I", receiver) + datagram + head
    return datagram + head + hmac(derived, text)


def main():
    source, count = random.Random(int(sys.argv[1])), int(sys.argv[2])
    for number in range(count):
        length = LENGTHS[number] if number < len(LENGTHS) else source.randrange(549)
        vector = {
            "key": source.randbytes(32).hex(),
            "direction": source.choice(sorted(DIRECTIONS)),
            "sender": source.randrange(1 << 32),
            "receiver": source.randrange(1 << 32),
            "stamp_us": source.randrange(1 << 64),
            "datagram": source.randbytes(length).hex(),
        }
        sealed = seal(
            bytes.fromhex(vector["key"]),
            vector["direction"],
            vector["sender"],
            vector["receiver"],
            vector["stamp_us"],
            bytes.fromhex(vector["datagram"]),
        )
        print(json.dumps(vector | {"sealed": sealed.hex()}))


if __name__ == "__main__":
    main()
