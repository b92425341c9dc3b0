"""Measures the films of `render.py` with ricochet and compares every row with its truth.

    python3 tests/rendered/compare.py target/release/ricochet films/*

prints a line per film: the share of frames with a position and with a rotation, the values that are wrong, and the impact. A
value of a `valid` row is wrong if its error exceeds 5 standard uncertainties and 0.2 px (centre), 0.02 px (displacement) or
0.02 deg and 1 % (rotation); one of an impact, 4 standard uncertainties and 1 %, or 2 frames (moments). The exit code is 1 if
any value is wrong.
"""

import csv
import json
import pathlib
import subprocess
import sys

# Column of velocity, its uncertainty, the column of the truth whose difference it is, and the limit.
STEPS = (
    ("dx_px", "sigma_dx_px", "center_x_px", 0.02, 0.0),
    ("dy_px", "sigma_dy_px", "center_y_px", 0.02, 0.0),
    ("dtheta_deg", "sigma_dtheta_deg", "angle_deg", 0.02, 0.01),
)
MOMENTS = ("start_s", "deepest_s", "end_s", "contact_time_s")


def read(path):
    """Returns the rows of a table in a file."""
    return list(csv.DictReader(path.open()))


def measure(program, folder):
    """Measures a film; returns its rows by topic."""
    rate = json.loads((folder / "scene.json").read_text())["frame_rate_hz"]
    results = folder / "results.mcap"
    results.unlink(missing_ok=True)
    film, rig = folder / "film.npy", folder / "rig.toml"
    # An exit code other than 0 reports lost rows, which are counted here.
    subprocess.run([program, "analyze", film, "--fps", str(rate), "--config", rig, "-o", results], capture_output=True)
    topics = {}
    for topic in ("velocity", "track", "impact"):
        table = subprocess.run([program, "export", results, "--topic", topic], capture_output=True, text=True).stdout
        topics[topic] = list(csv.DictReader(table.splitlines()))
    return rate, topics


def is_wrong(row, name, sigma_name, truth, limit, sigmas):
    """Whether a value is more certain than right; one that is missing is not wrong."""
    if not row.get(name) or not row.get(sigma_name):
        return False
    error = abs(float(row[name]) - truth)
    return error > limit and error > sigmas * float(row[sigma_name])


def wrong_rows(topics, truth):
    """Returns the wrong values of the rows of all frames, each with its frame."""
    wrong = []
    for row, pose in zip(topics["velocity"], topics["track"]):
        if row["status"] != "valid":
            continue
        frame = int(row["frame"])
        for name in ("center_x_px", "center_y_px"):
            if is_wrong(pose, name, "sigma_center_px", float(truth[frame][name]), 0.2, 5):
                wrong.append(f"{name} of frame {frame}")
        if frame + 1 == len(truth):
            continue
        for name, sigma_name, column, limit, share in STEPS:
            moved = float(truth[frame + 1][column]) - float(truth[frame][column])
            if is_wrong(row, name, sigma_name, moved, max(limit, share * abs(moved)), 5):
                wrong.append(f"{name} of frame {frame}")
    return wrong


def wrong_impacts(impacts, truth, rate):
    """Returns the wrong values of valid impacts."""
    wrong = []
    for impact in (impact for impact in impacts if impact["status"] == "valid"):
        for name, value in truth.items():
            limit = 2 / rate if name in MOMENTS else 0.01 * abs(float(value))
            if is_wrong(impact, name, f"sigma_{name}", float(value), limit, 4):
                wrong.append(f"{name} {float(impact[name]):.4g} for {float(value):.4g}")
    return wrong


def main():
    if len(sys.argv) < 3:
        sys.exit("usage: compare.py PROGRAM FOLDER...")
    program, folders = sys.argv[1], [pathlib.Path(name) for name in sys.argv[2:]]
    frames = positions = rotations = errors = 0
    for folder in folders:
        rate, topics = measure(program, folder)
        truth, [impact_truth] = read(folder / "truth.csv"), read(folder / "truth_impact.csv")
        rows = topics["velocity"]
        placed = sum(row["status"] == "valid" for row in rows)
        turned = sum(bool(row["dtheta_deg"]) for row in rows)
        wrong = wrong_rows(topics, truth) + wrong_impacts(topics["impact"], impact_truth, rate)
        states = ", ".join(impact["status"] for impact in topics["impact"]) or "none"
        print(
            f"{folder.name:16} positions {placed / len(truth):4.0%} rotations {turned / len(truth):4.0%} impact {states}"
            + (f"; {len(wrong)} wrong: {', '.join(wrong[:4])}" if wrong else ""),
            flush=True,
        )
        frames, positions, rotations = frames + len(truth), positions + placed, rotations + turned
        errors += len(wrong)
    print(f"{len(folders)} films, {frames} frames: positions {positions / frames:.1%}, "
          f"rotations {rotations / frames:.1%}, {errors} wrong values")
    sys.exit(errors > 0)


if __name__ == "__main__":
    main()
