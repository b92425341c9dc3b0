"""Writes one small film of a moving speckled disc in every imported format: write_films.py DIRECTORY."""

import math
import random
import struct
import sys
import zlib
from pathlib import Path

WIDTH, HEIGHT, FRAMES, RADIUS = 160, 128, 24, 36.3
GROUND = 40


def lattice(seed):
    """A lattice of random levels, 4 px apart in the disc's own coordinates."""
    source = random.Random(seed)
    return [[source.uniform(90, 230) for _ in range(40)] for _ in range(40)]


def level(speckles, x, y):
    """The level at a point of the disc, interpolated with a cosine ramp."""
    u, v = x / 4 + 20, y / 4 + 20
    column, row = int(u), int(v)
    a, b = (0.5 - 0.5 * math.cos(math.pi * (c - int(c))) for c in (u, v))
    above = speckles[row][column] * (1 - a) + speckles[row][column + 1] * a
    below = speckles[row + 1][column] * (1 - a) + speckles[row + 1][column + 1] * a
    return above * (1 - b) + below * b


def center(k):
    """The disc's centre in frame k: down, then up after frame 12, and to the right."""
    down = 1.83 * k if k < 12 else 1.83 * 12 - 1.41 * (k - 12)
    return 62.4 + 0.77 * k, 48.2 + down


def frame(speckles, noise, k):
    cx, cy = center(k)
    turn = math.radians(0.63 * k)
    cosine, sine = math.cos(turn), math.sin(turn)
    rows = []
    for y in range(HEIGHT):
        row = bytearray()
        for x in range(WIDTH):
            dx, dy = x - cx, y - cy
            inside = min(max(RADIUS + 0.5 - math.hypot(dx, dy), 0.0), 1.0)
            value = GROUND
            if inside > 0:
                # Counter-clockwise as seen on the screen, y down.
                value += inside * (level(speckles, dx * cosine - dy * sine, dx * sine + dy * cosine) - GROUND)
            row.append(min(max(round(value + noise.gauss(0, 1.2)), 0), 255))
        rows.append(bytes(row))
    return rows


def png(rows):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 0, 0, 0, 0)
    body = zlib.compress(b"".join(b"\0" + row for row in rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def npy(frames):
    text = f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({FRAMES}, {HEIGHT}, {WIDTH}), }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(text)) + text.encode() + b"".join(frames)


def cine(frames):
    """A Phantom CINE file, 8 bits, rows from the top down."""
    setup = bytearray(1000)
    setup[140:144] = b"ST" + struct.pack("<H", 1000)
    setup[768:772] = struct.pack("<I", 2000)
    setup[896:900] = struct.pack("<I", 8)
    table_at = 84 + len(setup)
    head = b"CI" + struct.pack("<HHHiIiI", 44, 0, 1, 0, FRAMES, 0, FRAMES)
    head += struct.pack("<III", 44, 84, table_at) + struct.pack("<II", 0, 1000)
    bitmap = struct.pack("<IiiHHIIiiII", 40, WIDTH, -HEIGHT, 1, 8, 0, WIDTH * HEIGHT, 0, 0, 0, 0)
    first = table_at + 8 * FRAMES
    images = [struct.pack("<I4sI", 12, b"\0" * 4, len(pixels)) + pixels for pixels in frames]
    places = [first + k * len(images[0]) for k in range(FRAMES)]
    return head + bitmap + bytes(setup) + struct.pack(f"<{FRAMES}Q", *places) + b"".join(images)


def cihx():
    return (
        f"<cih><imageDataInfo><resolution><width>{WIDTH}</width><height>{HEIGHT}</height></resolution>"
        "<colorInfo><type>Mono</type><bit>8</bit></colorInfo><effectiveBit><depth>8</depth><side>Lower</side>"
        f"</effectiveBit></imageDataInfo><frameInfo><totalFrame>{FRAMES}</totalFrame></frameInfo>"
        "<recordInfo><recordRate>2000</recordRate></recordInfo></cih>"
    )


def tiff(frames):
    """Uncompressed pages, one strip each."""
    size, tags = WIDTH * HEIGHT, 9
    page_bytes = 2 + 12 * tags + 4
    file = b"II*\0" + struct.pack("<I", 8)
    for k, pixels in enumerate(frames):
        at = 8 + k * (page_bytes + size)
        following = at + page_bytes + size if k + 1 < FRAMES else 0
        entries = [(256, 4, WIDTH), (257, 4, HEIGHT), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, at + page_bytes)]
        entries += [(277, 3, 1), (278, 4, HEIGHT), (279, 4, size)]
        file += struct.pack("<H", tags) + b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in entries)
        file += struct.pack("<I", following) + pixels
    return file


def main():
    folder = Path(sys.argv[1])
    speckles, noise = lattice(7), random.Random(11)
    films = [frame(speckles, noise, k) for k in range(FRAMES)]
    frames = [b"".join(rows) for rows in films]
    for k, rows in enumerate(films):
        (folder / f"still_{k:03}.png").write_bytes(png(rows))
    (folder / "film.npy").write_bytes(npy(frames))
    (folder / "film.cine").write_bytes(cine(frames))
    (folder / "film.cihx").write_text(cihx())
    (folder / "film.mraw").write_bytes(b"".join(frames))
    (folder / "film.tif").write_bytes(tiff(frames))


main()
