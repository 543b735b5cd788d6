"""Python peers of `eit report --peers`: plain NumPy and SciPy, and pyEIT if installed.

Reads arrays from the folder given as its argument and writes results.json and arrays to it. One
thread; wall time; double precision. Plain NumPy and SciPy as a careful user would write them:
sparsity patterns and symbolic factors are prepared outside the clock, products are on contiguous
arrays, the primal-dual iteration is over-relaxed and its step size is the best of ten tried.
"""

import json
import os
import sys
import time

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np  # noqa: E402

FOLDER = sys.argv[1]
RESULTS = []


def load(name):
    return np.load(os.path.join(FOLDER, name + ".npy"))


def save(kind, name, value, seconds, frames=1):
    """One result: an array, and the times of its runs."""
    number = len(RESULTS)
    np.save(os.path.join(FOLDER, f"result_{number}.npy"), np.ascontiguousarray(value, dtype=float))
    RESULTS.append({"kind": kind, "name": name, "seconds": list(seconds), "frames": frames})


def times(run, count):
    """Returns the time of each run in seconds, and the result of the last one."""
    seconds, value = [], None
    for _ in range(count):
        start = time.perf_counter()
        value = run()
        seconds.append(time.perf_counter() - start)
    return seconds, value


def forward():
    """Complete electrode model, P1: assembly of values, factorisation, voltages, Jacobian."""
    import scipy.sparse as sp
    import scipy.sparse.linalg as spla

    nodes, triangles = load("nodes"), load("triangles").astype(int)
    edges, impedance, sigma = load("edges"), load("impedance"), load("sigma")
    stimulations, patterns, data = load("stimulations"), load("patterns"), load("data").astype(int)
    n, electrodes = len(nodes), len(impedance)
    corners = nodes[triangles]
    sides = np.stack([corners[:, 2] - corners[:, 1], corners[:, 0] - corners[:, 2],
                      corners[:, 1] - corners[:, 0]], axis=1)
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    local = np.einsum("eik,ejk->eij", sides, sides) / (4.0 * area)[:, None, None]
    rows = np.repeat(triangles, 3, axis=1).ravel()
    columns = np.tile(triangles, (1, 3)).ravel()
    a, b, owner = edges.T.astype(int)
    length = np.linalg.norm(nodes[a] - nodes[b], axis=1)
    weight = length / impedance[owner]
    e = n + owner
    fixed = sp.coo_matrix(
        (np.concatenate([weight / 3, weight / 3, weight / 6, weight / 6, -weight / 2, -weight / 2,
                         -weight / 2, -weight / 2, weight]),
         (np.concatenate([a, b, a, b, a, b, e, e, e]), np.concatenate([a, b, b, a, e, e, a, b, e]))),
        shape=(n + electrodes, n + electrodes)).tocsc()
    # the last electrode is grounded
    size = n + electrodes - 1
    fixed = fixed.tocoo()
    all_rows = np.concatenate([rows, fixed.row])
    all_columns = np.concatenate([columns, fixed.col])
    inside = (all_rows < size) & (all_columns < size)
    places, slot = np.unique(all_columns[inside].astype(np.int64) * size + all_rows[inside],
                             return_inverse=True)
    indices = (places % size).astype(np.int32)
    starts = np.searchsorted(places, np.arange(size + 1, dtype=np.int64) * size).astype(np.int32)
    right = np.zeros((size, electrodes - 1))
    right[n:, :] = np.eye(electrodes - 1)
    try:
        from sksparse.cholmod import analyze
        engine = "SciPy + CHOLMOD"
    except ImportError:
        analyze, engine = None, "SciPy (SuperLU)"

    def matrix():
        values = np.concatenate([(local * sigma[:, None, None]).ravel(), fixed.data])[inside]
        values = np.bincount(slot, weights=values, minlength=len(places))
        return sp.csc_matrix((values, indices, starts), shape=(size, size))

    symbolic = analyze(matrix()) if analyze else None
    jacobian = np.empty((len(data), len(triangles)))

    def solve():
        system = matrix()
        if symbolic is not None:
            symbolic.cholesky_inplace(system)
            potentials = symbolic(right)
        else:
            factor = spla.splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                               options={"SymmetricMode": True})
            potentials = factor.solve(right)
        full = np.zeros((n + electrodes, electrodes))
        full[:size, : electrodes - 1] = potentials
        of_stimulation, of_pattern = full @ stimulations.T, full @ patterns.T
        voltages = np.einsum("me,me->m", patterns[data[:, 1]], of_stimulation[n:].T[data[:, 0]])
        # [pattern, corner, element], contiguous along the elements
        s = np.ascontiguousarray(of_stimulation[triangles].transpose(2, 1, 0))
        p = np.ascontiguousarray(of_pattern[triangles].transpose(2, 1, 0))
        bent = np.einsum("ije,sje->sie", stiff, s)
        for row, (stimulation, pattern) in zip(jacobian, data):
            np.einsum("ie,ie->e", bent[stimulation], p[pattern], out=row)
            np.negative(row, out=row)
        return voltages, jacobian

    stiff = np.ascontiguousarray(local.transpose(1, 2, 0))
    seconds, (voltages, _) = times(solve, 5)
    save("forward", engine, voltages, seconds)


def pyeit_forward():
    """pyEIT's forward problem with its Jacobian: point electrodes, its own assembly."""
    try:
        import warnings
        warnings.filterwarnings("ignore")
        from pyeit.eit import protocol
        from pyeit.eit.fem import EITForward
        from pyeit.mesh import PyEITMesh
    except ImportError:
        return
    nodes, triangles, edges = load("nodes"), load("triangles").astype(int), load("edges")
    if np.ptp(nodes[:, 2]) > 0.0:
        return  # it reads x and y alone
    patterns = load("stimulations")
    electrodes = patterns.shape[1]
    pairs = [[int(np.argmax(row)), int(np.argmin(row))] for row in patterns]
    if any(pair != [k, (k + 1) % electrodes] for k, pair in enumerate(pairs)):
        return
    middle = []
    for electrode in range(electrodes):
        own = edges[edges[:, 2] == electrode]
        middle.append(int(own[len(own) // 2, 0]))
    mesh = PyEITMesh(node=nodes.copy(), element=triangles.copy(), perm=1.0,
                     el_pos=np.array(middle), ref_node=0)
    pattern = protocol.create(electrodes, dist_exc=1, step_meas=1, parser_meas="rotate_meas")
    model, sigma = EITForward(mesh, pattern), load("sigma")
    current = float(np.max(patterns))
    seconds, value = times(lambda: model.compute_jac(sigma), 2)
    voltages = np.asarray(value[1]).ravel() * current
    if len(voltages) == len(load("data")):
        save("forward", "pyEIT (point electrodes)", voltages, seconds)


def one_step():
    """Multiplies a reconstruction matrix by a frame, as every Python code does."""
    matrix, frames = load("matrix"), load("frames")

    def run():
        return np.stack([matrix @ frame for frame in frames])

    seconds, movie = times(run, 9)
    save("inverse", "NumPy matrix", movie, seconds, len(frames))


def total_variation():
    """Primal-dual iteration (Chambolle and Pock 2011) with the exact proximal map of the data."""
    jacobian, values = load("whitened_jacobian"), load("whitened_differences").T
    mask = load("mask") > 0.5
    space, in_time = load("weights")
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
        save("inverse", f"NumPy primal-dual, {iterations} iterations", movie.T, seconds, frames)
        if seconds[0] > 10.0:
            break


if os.path.exists(os.path.join(FOLDER, "nodes.npy")):
    forward()
    pyeit_forward()
if os.path.exists(os.path.join(FOLDER, "matrix.npy")):
    one_step()
if os.path.exists(os.path.join(FOLDER, "whitened_jacobian.npy")):
    total_variation()
with open(os.path.join(FOLDER, "results.json"), "w", encoding="utf-8") as out:
    json.dump(RESULTS, out)
