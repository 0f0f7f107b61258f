"""Writes a file of pictures for the page's map: a chequered ground around a place, by the PMTiles writer of its authors.

    map_tiles.py FILE LATITUDE LONGITUDE
"""

import math
import struct
import sys
import zlib

from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer

ATTRIBUTION = "a map of <b>chequers</b>"
MAX_ZOOM = 14
SIDE = 256
GREENS = [(0xC9, 0xDD, 0xBE), (0xDD, 0xE8, 0xD2)]


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(colour):
    row = b"\0" + bytes(colour) * SIDE
    head = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(row * SIDE, 9)) + chunk(b"IEND", b"")


def tile_at(latitude, longitude, zoom):
    across = 1 << zoom
    y = (1 - math.asinh(math.tan(math.radians(latitude))) / math.pi) / 2
    return int((longitude + 180) / 360 * across), int(y * across)


def main():
    file, latitude, longitude = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    pictures = [png(colour) for colour in GREENS]
    tiles = {}
    for zoom in range(MAX_ZOOM + 1):
        x, y = tile_at(latitude, longitude, zoom)
        for right in (-1, 0, 1):
            for down in (-1, 0, 1):
                at = (x + right, y + down)
                if all(0 <= one < 1 << zoom for one in at):
                    tiles[zxy_to_tileid(zoom, *at)] = pictures[sum(at) % 2]
    with open(file, "wb") as out:
        writer = Writer(out)
        for tile, picture in sorted(tiles.items()):
            writer.write_tile(tile, picture)
        e7 = lambda degrees: int(degrees * 1e7)
        header = {
            "tile_type": TileType.PNG,
            "tile_compression": Compression.NONE,
            "min_lon_e7": e7(-180), "max_lon_e7": e7(180), "min_lat_e7": e7(-85), "max_lat_e7": e7(85),
            "center_zoom": MAX_ZOOM, "center_lon_e7": e7(longitude), "center_lat_e7": e7(latitude),
        }
        writer.finalize(header, {"attribution": ATTRIBUTION})


main()
