"""Compares the ball finder with OpenCV's Hough transform for circles on the same images: accuracy and speed.

    pip install numpy opencv-python-headless mcap-protobuf-support
    taskset -c 0 python3 examples/hough_circle.py [target/release/ricochet]

The images are simulated, so that the truth is known: a speckled ball of 114 px in front of a textured background, in
uneven light, with 2 grey levels of noise. The ball is brighter than the background, then darker. OpenCV gets the radius
within 7 px, an image smoothed as its manual recommends, and the best of several settings.
"""

import csv
import io
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import cv2
import numpy as np
from mcap_protobuf.reader import read_protobuf_messages

SEEDS = range(6)

SCENARIO = """
name = "circle"
seed = {seed}
camera = {{ width_px = 512, height_px = 512, frame_rate_hz = 10000, frames = 8, noise_dn = 2.0 }}
scale = {{ mm_per_px = 0.5 }}
body = {{ diameter_mm = 57.0, pattern = {{ area_min_px2 = 9.0, area_max_px2 = 40.0, coverage = 0.3 }} }}
shade = {{ ball = {ball}, speckle = {speckle}, ground = {ground}, ground_texture = 0.04 }}
light = {{ gradient_x = 0.1, gradient_y = -0.05, side = 0.1, limb = 0.1 }}
motion = {{ kind = "constant", vx_px_frame = 1.37, vy_px_frame = 0.71, omega_deg_frame = 0.4, start_px = [{x}, {y}] }}
"""

RIG = """
[rig]
name = "circle"
[camera]
source = "simulated"
[scale]
mm_per_px = 0.5
[[body]]
name = "ball"
kind = "ball"
min_radius_px = 50
max_radius_px = 64
"""


def table(program: str, recording: pathlib.Path, topic: str) -> list[dict[str, str]]:
    line = [program, "export", str(recording), "--topic", topic]
    return list(csv.DictReader(io.StringIO(subprocess.run(line, check=True, capture_output=True, text=True).stdout)))


def frames(recording: pathlib.Path):
    """The images of a recording."""
    with recording.open("rb") as file:
        for message in read_protobuf_messages(file, topics=["/camera/image"]):
            image = message.proto_msg
            yield np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, : image.width]


def hough(picture: np.ndarray, settings: tuple[int, float, float, float]) -> np.ndarray | None:
    """Returns centre and radius of the first circle, px."""
    method, step, edge, votes = settings
    smooth = cv2.GaussianBlur(picture, (9, 9), 2)
    found = cv2.HoughCircles(smooth, method, step, 60, param1=edge, param2=votes, minRadius=50, maxRadius=64)
    return None if found is None else found[0][0]


SETTINGS = [
    (cv2.HOUGH_GRADIENT, step, edge, votes) for step in (1, 2) for edge in (50, 100, 200) for votes in (15, 30)
] + [(cv2.HOUGH_GRADIENT_ALT, 1.5, edge, votes) for edge in (150, 300) for votes in (0.3, 0.6, 0.8)]


def films(program: str, folder: pathlib.Path, shades: tuple[float, float, float]):
    """Simulates films and returns their images, true centres and measured centres."""
    rig = folder / "rig.toml"
    rig.write_text(RIG)
    for seed in SEEDS:
        scenario, film, out = folder / "film.toml", folder / f"{seed}.mcap", folder / f"{seed}-out.mcap"
        x, y = 200.3 + 11.7 * seed, 260.9 - 7.3 * seed
        ball, speckle, ground = shades
        scenario.write_text(SCENARIO.format(seed=seed + 1, ball=ball, speckle=speckle, ground=ground, x=x, y=y))
        for line in (
            ["simulate", scenario, "-o", film],
            ["analyze", film, "--config", rig, "-o", out],
        ):
            subprocess.run([program, *map(str, line)], check=True, capture_output=True)
        pictures = list(frames(film))
        places = [(row["center_x_px"], row["center_y_px"]) for row in table(program, out, "track")]
        truth = [(float(row["center_x_px"]), float(row["center_y_px"])) for row in table(program, film, "truth")]
        yield from zip(pictures, truth, places, strict=True)
        for path in (film, out):
            path.unlink()


def summary(errors: list[float], frames: int) -> str:
    if not errors:
        return f"found in 0 of {frames}"
    return f"mean |error| {statistics.mean(errors):.4f} px, largest {max(errors):.3f} px, found in {len(errors) // 2} of {frames}"


def errors_of(found, truth) -> list[float]:
    return [] if found is None else [abs(float(a) - b) for a, b in zip(found, truth)]


def main() -> None:
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/ricochet"
    cv2.setNumThreads(1)
    for name, shades in (("brighter", (0.7, 0.25, 0.2)), ("darker", (0.2, 0.45, 0.7))):
        with tempfile.TemporaryDirectory() as folder:
            rows = list(films(program, pathlib.Path(folder), shades))
        ours = [e for _, truth, place, in rows if all(place) for e in errors_of(place, truth)]
        best: list[float] = []
        for settings in SETTINGS:
            found = [errors_of(None if c is None else c[:2], truth) for c, truth in ((hough(p, settings), t) for p, t, _ in rows)]
            errors = [e for pair in found for e in pair]
            if len(errors) == 2 * len(rows) and (not best or statistics.mean(errors) < statistics.mean(best)):
                best, chosen = errors, settings
        print(f"ball {name} than the background, {len(rows)} frames")
        print(f"  ricochet               {summary(ours, len(rows))}")
        print(f"  OpenCV {cv2.__version__} HoughCircles {summary(best, len(rows))}")
        if best:
            print(f"  ratio of the mean errors {statistics.mean(best) / statistics.mean(ours):.0f}")
            start, count = time.perf_counter(), 0
            while time.perf_counter() - start < 1:
                hough(rows[count % len(rows)][0], chosen)
                count += 1
            print(f"  HoughCircles {1e6 * (time.perf_counter() - start) / count:.0f} us per frame")
    report = json.loads(subprocess.run([program, "bench", "live", "--json"], check=True, capture_output=True).stdout)
    for row in report["live"]:
        if "circle" in row["part"]:
            print(f"ricochet, {row['part']}: {row['us']:.0f} us per frame")


if __name__ == "__main__":
    main()
