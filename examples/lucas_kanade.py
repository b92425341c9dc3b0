"""Compares the time per subset with OpenCV's pyramidal Lucas-Kanade, on one core.

    pip install numpy opencv-python-headless
    taskset -c 0 python3 examples/lucas_kanade.py [target/release/ricochet]

Both correlate 31 x 31 pixels at 900 points of a 512 x 512 image, all preparation included. They run in turns, so that a
drift of the machine's speed affects both. The medians of the ratios are printed.
"""

import json
import statistics
import subprocess
import sys
import time

import cv2
import numpy as np

ROUNDS = 7


def pattern(shift: float) -> np.ndarray:
    """Draws speckle discs of 3 to 6 px with soft rims on 512 x 512 px, with 2 grey levels of noise."""
    random = np.random.default_rng(7)
    clear = np.ones((512, 512))
    rows, columns = np.mgrid[-6:7, -6:7]
    for x, y, radius in zip(*(random.uniform(0, 512, (2, 10_000))), random.uniform(1.5, 2.9, 10_000)):
        column, row = int(x), int(y)
        if 6 <= column < 505 and 6 <= row < 505:
            distance = np.hypot(columns + column - x - shift, rows + row - y) - radius
            clear[row - 6 : row + 7, column - 6 : column + 7] *= 1 - 1 / (1 + np.exp(2.7 * distance))
    noise = np.random.default_rng(int(1000 * shift)).normal(0, 2, clear.shape)
    return np.clip(np.rint(18 + 200 * clear + noise), 0, 255).astype(np.uint8)


def lucas_kanade(first: np.ndarray, second: np.ndarray, places: np.ndarray) -> float:
    """Returns microseconds per point, pyramids included."""
    count, start = 0, time.perf_counter()
    while time.perf_counter() - start < 0.5:
        cv2.calcOpticalFlowPyrLK(first, second, places, None, winSize=(31, 31), maxLevel=3)
        count += len(places)
    return 1e6 * (time.perf_counter() - start) / count


def windows(program: str) -> dict[str, float]:
    """Returns microseconds per subset for each method, and for the parts of a match, on one thread."""
    line = [program, "bench", "windows", "--json", "--threads", "1", "--seconds", "0.4"]
    report = json.loads(subprocess.run(line, check=True, capture_output=True, text=True).stdout)
    parts = {row["part"]: row["us"] for row in report["parts"]}
    return {row["method"]: 1e6 / row["points_per_s"] for row in report["windows"]} | parts


def main() -> None:
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/ricochet"
    cv2.setNumThreads(1)
    first, second = pattern(0.0), pattern(0.37)
    grid = np.arange(24, 24 + 16 * 30, 16, dtype=np.float32)
    places = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 1, 2)
    peer, ours = [], []
    for _ in range(ROUNDS):
        peer.append(lucas_kanade(first, second, places))
        ours.append(windows(program))
    print(f"Lucas-Kanade of OpenCV {cv2.__version__}, 31 x 31, 4 levels: {statistics.median(peer):.1f} us")
    for method in ours[0]:
        times = [row[method] for row in ours]
        ratio = statistics.median(time / other for time, other in zip(times, peer))
        print(f"{method:36} {statistics.median(times):9.2f} us  {ratio:7.3f} x")


if __name__ == "__main__":
    main()
