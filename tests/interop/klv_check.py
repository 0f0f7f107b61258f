"""Reads what `vsm klv` has written, by a decoder of its own and by klvdata, and prints it as JSON.

    klv_check.py FILE.klv
    klv_check.py FILE.ts VIDEO.h264

A list of local sets is compared, item by item, with klvdata's. A transport stream is taken apart first: tables and their checksums,
continuity, clock, presentation times; its video must be that of VIDEO, but for access unit delimiters.
"""

import io
import json
import sys

import klvdata

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
# Tag: name, signed, low end, high end.
NUMBERS = {
    5: ("heading", False, 0, 360),
    6: ("pitch", True, -20, 20),
    7: ("roll", True, -50, 50),
    13: ("latitude", True, -90, 90),
    14: ("longitude", True, -180, 180),
    15: ("altitude", False, -900, 19000),
    16: ("hfov", False, 0, 180),
    17: ("vfov", False, 0, 180),
    18: ("azimuth", False, 0, 360),
    19: ("elevation", True, -180, 180),
    20: ("rotation", False, 0, 360),
    21: ("range", False, 0, 5000000),
    23: ("centre_latitude", True, -90, 90),
    24: ("centre_longitude", True, -180, 180),
    56: ("ground_speed", False, 0, 255),
    75: ("ellipsoid_height", False, -900, 19000),
    78: ("centre_ellipsoid_height", False, -900, 19000),
    79: ("north_velocity", True, -327, 327),
    80: ("east_velocity", True, -327, 327),
    90: ("pitch_full", True, -90, 90),
    91: ("roll_full", True, -90, 90),
}
TEXTS = {3: "mission", 4: "tail_number", 10: "platform", 11: "sensor", 12: "coordinates", 59: "call_sign"}


def ber(data, at):
    first = data[at]
    if first < 0x80:
        return first, at + 1
    count = first & 0x7F
    return int.from_bytes(data[at + 1 : at + 1 + count], "big"), at + 1 + count


def decode_set(data):
    """The set at the beginning of the data, as a dictionary, and what is behind it."""
    assert data[:16] == KEY, data[:16].hex()
    length, at = ber(data, 16)
    end = at + length
    words = data[: end - 2] + b"\0" * (end % 2)
    total = sum(words[i] << 8 | words[i + 1] for i in range(0, len(words), 2)) & 0xFFFF
    assert total == int.from_bytes(data[end - 2 : end], "big"), "checksum"
    found, tags = {}, []
    while at < end:
        tag = data[at]
        size, at = ber(data, at + 1)
        value, at = data[at : at + size], at + size
        tags.append(tag)
        if tag == 2:
            found["time_us"] = int.from_bytes(value, "big")
        elif tag == 65:
            found["version"] = value[0]
        elif tag in TEXTS:
            found[TEXTS[tag]] = value.decode()
        elif tag in NUMBERS:
            name, signed, low, high = NUMBERS[tag]
            raw = int.from_bytes(value, "big", signed=signed)
            codes = 2 ** (8 * size)
            found[name] = raw * high / (codes // 2 - 1) if signed else low + raw * (high - low) / (codes - 1)
        else:
            assert tag == 1, f"item {tag}"
    assert tags[0] == 2 and tags[-1] == 1 and len(set(tags)) == len(tags), tags
    return found, data[end:]


def decode_sets(data):
    whole, sets = data, []
    while data:
        found, data = decode_set(data)
        sets.append(found)
    theirs = [packet.MetadataList() for packet in klvdata.StreamParser(io.BytesIO(whole))]
    assert len(theirs) == len(sets), (len(theirs), len(sets))
    for ours, their in zip(sets, theirs):
        compared = 0
        for tag, (_, _, _, value) in their.items():
            if tag in NUMBERS:
                name, _, low, high = NUMBERS[tag]
                assert abs(float(value) - ours[name]) <= 1e-4 * (high - low), (tag, value, ours)
            elif tag in TEXTS:
                assert value == ours[TEXTS[tag]], (tag, value, ours)
            else:
                continue
            compared += 1
        ours["agrees_with_klvdata"] = compared
    return sets


def crc32(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc & 0x80000000 else 0)) & 0xFFFFFFFF
    return crc


def section(payload):
    section = payload[1 + payload[0] :]
    length = 3 + ((section[1] & 0x0F) << 8 | section[2])
    assert crc32(section[:length]) == 0, "checksum of a table"
    return section[8 : length - 4]


def time_stamp(five):
    assert five[0] & 1 and five[2] & 1 and five[4] & 1, "marker bits"
    return (five[0] >> 1 & 7) << 30 | five[1] << 22 | (five[2] >> 1) << 15 | five[3] << 7 | five[4] >> 1


def packets(data):
    assert len(data) % 188 == 0, len(data)
    for at in range(0, len(data), 188):
        packet = data[at : at + 188]
        assert packet[0] == 0x47, "lost the synchronisation"
        pid, control = (packet[1] & 0x1F) << 8 | packet[2], packet[3] >> 4 & 3
        clock, begin = None, 4
        if control & 2:
            begin = 5 + packet[4]
            if packet[4] and packet[5] & 0x10:
                base = int.from_bytes(packet[6:12], "big")
                clock = (base >> 15) * 300 + (base & 0x1FF)
        yield pid, bool(packet[1] & 0x40), packet[3] & 15, clock, packet[begin:] if control & 1 else b""


def demultiplex(data):
    counters, units, clocks, streams, order = {}, {}, [], {}, []
    table_pid = clock_pid = None
    for pid, begins, counter, clock, payload in packets(data):
        assert pid not in counters or counter == counters[pid] + 1 & 15, f"continuity of {pid}"
        counters[pid] = counter
        if pid == 0:
            programs = section(payload)
            table_pid = int.from_bytes(programs[2:4], "big") & 0x1FFF
        elif pid == table_pid:
            table = section(payload)
            clock_pid, at = int.from_bytes(table[0:2], "big") & 0x1FFF, 4
            while at < len(table):
                length = int.from_bytes(table[at + 3 : at + 5], "big") & 0xFFF
                stream = int.from_bytes(table[at + 1 : at + 3], "big") & 0x1FFF
                streams[stream] = (table[at], table[at + 5 : at + 5 + length])
                at += 5 + length
        else:
            assert streams, "data before the tables"
            if clock is not None:
                assert pid == clock_pid
                clocks.append(clock)
            if begins:
                units.setdefault(pid, []).append(b"")
                order.append(pid)
            units[pid][-1] += payload
    video = next(pid for pid, (kind, _) in streams.items() if kind == 0x1B)
    metadata = next(pid for pid, (kind, more) in streams.items() if kind == 6 and more == b"\x05\x04KLVA")
    assert clocks == sorted(clocks) and clock_pid == video

    def elementary(pid, stream_id):
        for unit in units[pid]:
            assert unit[:4] == bytes([0, 0, 1, stream_id]) and unit[7] & 0xC0 == 0x80, unit[:9].hex()
            length, begin = int.from_bytes(unit[4:6], "big"), 9 + unit[8]
            assert length in (len(unit) - 6, 0 if stream_id == 0xE0 else -1), (length, len(unit))
            yield time_stamp(unit[9:14]), unit[begin:]

    return list(elementary(video, 0xE0)), list(elementary(metadata, 0xBD)), clocks


def main():
    data = open(sys.argv[1], "rb").read()
    if len(sys.argv) == 2:
        print(json.dumps({"sets": decode_sets(data)}))
        return
    pictures, metadata, clocks = demultiplex(data)
    delimiter = bytes([0, 0, 0, 1, 9, 0xF0])
    assert all(picture.startswith(delimiter) for _, picture in pictures)
    video = b"".join(picture[len(delimiter) :] for _, picture in pictures)
    original = open(sys.argv[2], "rb").read()
    assert original.startswith(video), "the video is another"
    sets = decode_sets(b"".join(unit for _, unit in metadata))
    for (presented, _), one in zip(metadata, sets):
        one["presented_90khz"] = presented
    print(
        json.dumps(
            {
                "sets": sets,
                "pictures": len(pictures),
                "video_bytes": len(video),
                "presented_90khz": [presented for presented, _ in pictures],
                "clock_27mhz": clocks,
            }
        )
    )


main()
