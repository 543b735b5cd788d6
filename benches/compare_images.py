#!/usr/bin/env python3
"""Images of two fingers on the paper's skin by NumPy and SciPy beside ours: error against time.

    $PYTHON benches/compare_images.py [--dry-run]

Plain NumPy and SciPy as a careful user would write them, one thread, wall time, double precision: products on contiguous
arrays; the primal-dual iteration minimises the objective of `st-tv` with the weights that ours chose, is over-relaxed, and
its step size is the best of eleven tried. Writes its table into docs/PERFORMANCE.md unless --dry-run is given.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = tempfile.mkdtemp(prefix="eit-images-")
ROWS = []


def load(name):
    return np.load(os.path.join(FOLDER, name + ".npy"))


def row(name, seconds, movie):
    """A row of the table: median time per frame, and the error relative to the norm of the truth."""
    truth = load("truth")
    error = np.linalg.norm(movie - truth) / np.linalg.norm(truth)
    ROWS.append((name, 1e3 * float(np.median(seconds)) / len(truth), error))


def times(run, count):
    """Returns the time of each run in seconds, and the result of the last one."""
    seconds, value = [], None
    for _ in range(count):
        start = time.perf_counter()
        value = run()
        seconds.append(time.perf_counter() - start)
    return seconds, value


def one_step():
    """Multiplies a reconstruction matrix by a frame, as every Python code does."""
    matrix, frames = load("matrix"), load("frames")

    def run():
        return np.stack([matrix @ frame for frame in frames])

    seconds, movie = times(run, 9)
    row("NumPy matrix", seconds, movie)


def total_variation():
    """Primal-dual iteration (Chambolle and Pock 2011) with the exact proximal map of the data."""
    jacobian, values = load("whitened_jacobian"), load("whitened_differences").T
    mask = load("mask") > 0.5
    space, in_time = load("weights")[0]
    basis, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    keep = singular > 1e-10 * singular[0]
    basis, singular, right = basis[:, keep], singular[keep], right[keep]
    wanted = basis.T @ values
    frames = values.shape[1]
    index = -np.ones(mask.shape, dtype=int)
    index[mask] = np.arange(mask.sum())
    import scipy.sparse as sp

    count = int(mask.sum())

    def differences(axis):
        """Forward differences inside the mask; no row for a pixel without a neighbour."""
        first = index[:, :-1] if axis else index[:-1]
        second = index[:, 1:] if axis else index[1:]
        both = (first >= 0) & (second >= 0)
        rows, after = first[both], second[both]
        ones = np.ones(len(rows))
        return sp.coo_matrix((np.concatenate([-ones, ones]),
                              (np.concatenate([rows, rows]), np.concatenate([rows, after]))),
                             shape=(count, count)).tocsr()

    dx, dy = differences(1), differences(0)
    dxt, dyt = dx.T.tocsr(), dy.T.tocsr()
    relaxed = 1.9

    def run(tau, iterations):
        sigma = 1.0 / (12.0 * tau)
        shrink = (tau * singular ** 2 / (1.0 + tau * singular ** 2))[:, None]
        goal = wanted / singular[:, None]
        x = np.zeros((count, frames))
        px, py = np.zeros_like(x), np.zeros_like(x)
        pt = np.zeros((count, max(frames - 1, 0)))
        for _ in range(iterations):
            step = x - tau * (dxt @ px + dyt @ py)
            if frames > 1:
                step[:, :-1] += tau * pt
                step[:, 1:] -= tau * pt
            new = step + right.T @ (shrink * (goal - right @ step))
            ahead = 2.0 * new - x
            gx, gy = px + sigma * (dx @ ahead), py + sigma * (dy @ ahead)
            norm = np.maximum(1.0, np.sqrt(gx * gx + gy * gy) / space)
            px += relaxed * (gx / norm - px)
            py += relaxed * (gy / norm - py)
            if frames > 1:
                gt = pt + sigma * (ahead[:, 1:] - ahead[:, :-1])
                pt += relaxed * (np.clip(gt, -in_time, in_time) - pt)
            x += relaxed * (new - x)
        return new

    def objective(x):
        data = 0.5 * np.sum((jacobian @ x - values) ** 2)
        flat = np.hypot(dx @ x, dy @ x).sum()
        return data + space * flat + in_time * np.abs(x[:, 1:] - x[:, :-1]).sum()

    # the peer's best step size for each number of iterations, found by trial: not timed
    unit = singular[len(singular) // 2] ** 2
    steps = [k / unit for k in 10.0 ** np.arange(-1.0, 4.1, 0.5)]
    for iterations in (10, 30, 100, 300, 1000):
        tried = min(iterations, 50)
        tau = min(steps, key=lambda step: objective(run(step, tried)))
        seconds, movie = times(lambda: run(tau, iterations), 3)
        row(f"NumPy primal-dual, {iterations} iterations", seconds, movie.T)
        if seconds[0] > 10.0:
            break


ours = subprocess.run(["cargo", "run", "--release", "--quiet", "-p", "benches", "--bin", "peer_images", "--", FOLDER],
                      cwd=ROOT, check=True, capture_output=True, text=True).stdout
for line in ours.splitlines():
    result = json.loads(line)
    ROWS.append((result["name"], result["ms_a_frame"], result["relative_error"]))
one_step()
total_variation()
table = "| solver | ms a frame | relative error |\n|---|---|---|\n"
table += "".join(f"| {name} | {ms:.3f} | {error:.3f} |\n" for name, ms, error in ROWS)
print(table)
if "--dry-run" not in sys.argv:
    page = ROOT / "docs/PERFORMANCE.md"
    before, rest = page.read_text().split("<!-- generated: report-peers -->\n")
    _, after = rest.split("<!-- end of generated: report-peers -->")
    page.write_text(f"{before}<!-- generated: report-peers -->\n{table}<!-- end of generated: report-peers -->{after}")
