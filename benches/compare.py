#!/usr/bin/env python3
"""Compares the times of forward problem and Jacobian with SciPy and CHOLMOD, run alternately, and
writes the generated parts of docs/PERFORMANCE.md. One file because it is a standalone program.

Run it with an interpreter that has numpy, scipy and scikit-sparse (the peers' run.sh makes one):

    $PYTHON benches/compare.py [--peers ../shared/peers] [--rounds 5] [--no-stages] [--dry-run]

In every round and for every size, the peers' bench_scipy.py and our `peers` run one after the other
on one core with one thread each. Only ratios within a round are compared, because the machine's
speed drifts. Then the stages are compared with their floors (`floors`), and criterion's medians of
all stages are collected (`cargo bench`). Before timing, the voltages and Jacobians of both sides are
checked against each other on every mesh.
"""

import argparse
import contextlib
import json
import os
import pathlib
import platform
import statistics
import subprocess
import sys
import tempfile
import time

THREADS = {
    name: "1"
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")
}
os.environ.update(THREADS)  # before numpy reads them
import numpy as np  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parent.parent
SIZES = (500, 2000, 5000, 20000)
# Largest accepted difference of voltages and Jacobian, relative to the largest value. Measured: 3e-13
# at 20 368 nodes; the rest is a margin for other processors and libraries.
AGREE = 1e-11
PARTS = (
    ("forward", "fwd", "forward_cpu_s"),
    ("Jacobian", "jac", "jacobian_cpu_s"),
    ("both", None, "both_cpu_s"),
)


def main():
    options = arguments()
    peers = options.peers.resolve()
    if not (peers / "bench_scipy.py").is_file():
        sys.exit(f"no bench_scipy.py in {options.peers}: give the peers' folder with --peers")
    programs = build()
    pin(options.core)
    if options.only_st_tv:
        quiet(options)
        deliver({"sttv": sttv_table(programs["sttv"], peers, options)}, options)
        return
    with tempfile.TemporaryDirectory() as folder:
        agreement = check(programs["peers"], peers, folder)
        quiet(options)
        load = [os.getloadavg()[0]]
        rounds = [
            one_round(programs["peers"], peers, folder, number + 1, options.rounds)
            for number in range(options.rounds)
        ]
        load.append(os.getloadavg()[0])
    floors = json_lines(run([programs["floors"], "2000", "20000"]))
    parts = {"peers": peers_table(agreement, rounds, load), "floors": floors_table(floors)}
    deliver(parts, options)
    deliver({"sttv": sttv_table(programs["sttv"], peers, options)}, options)
    if not options.no_stages:
        quiet(options)
        deliver({"stages": stages_table()}, options)


def deliver(parts, options):
    """Writes parts as soon as they are available, because later ones may fail."""
    if options.dry_run:
        print("\n\n".join(parts.values()))
    else:
        write(ROOT / "docs" / "PERFORMANCE.md", parts)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--peers",
        type=pathlib.Path,
        default=ROOT / ".." / "shared" / "peers",
        help="folder of bench_scipy.py and eitlib.py",
    )
    parser.add_argument("--rounds", type=int, default=5, help="rounds, at least 3 (default 5)")
    parser.add_argument("--core", type=int, default=0, help="core to run on (default 0)")
    parser.add_argument(
        "--quiet", type=float, default=None, help="wait until the load average is below this"
    )
    parser.add_argument(
        "--patience",
        type=float,
        default=900,
        help="maximum time to wait for a quiet machine, in seconds (default 900)",
    )
    parser.add_argument(
        "--no-stages", action="store_true", help="skip cargo bench and its table"
    )
    parser.add_argument(
        "--only-st-tv", action="store_true", help="only spatio-temporal total variation"
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="print the tables instead of writing them"
    )
    options = parser.parse_args()
    if options.rounds < 3:
        parser.error(f"--rounds {options.rounds}: fewer than 3 rounds show no spread")
    return options


def run(command, **more):
    done = subprocess.run(
        command, stdout=subprocess.PIPE, text=True, cwd=more.pop("cwd", ROOT), **more
    )
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))} ended with status {done.returncode}")
    return done.stdout


def json_lines(text):
    return [json.loads(line) for line in text.splitlines() if line.startswith("{")]


def build():
    """Paths of our two programs, built once before the rounds."""
    print("building", file=sys.stderr)
    command = [
        "cargo",
        "build",
        "--release",
        "-p",
        "benches",
        "--bins",
        "--message-format",
        "json-render-diagnostics",
    ]
    messages = json_lines(run(command))
    return {m["target"]["name"]: m["executable"] for m in messages if m.get("executable")}


def pin(core):
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})


def quiet(options):
    if options.quiet is None:
        return
    end = time.monotonic() + options.patience
    while os.getloadavg()[0] > options.quiet and time.monotonic() < end:
        time.sleep(5)
    print(f"load average {os.getloadavg()[0]:.2f}", file=sys.stderr)


def check(program, peers, folder):
    """Relative differences (voltages, Jacobian) between ours and the peer's on each mesh."""
    sys.path.insert(0, str(peers))
    sys.dont_write_bytecode = True
    import eitlib

    if len(json_lines(run([program, "--values", folder, *map(str, SIZES)]))) < len(SIZES):
        sys.exit("our program skipped a mesh: the peers' must lie in ../shared/peers/problems")
    agreement = {}
    for size in SIZES:
        try:
            model = eitlib.CEM(*eitlib.disc(size), backend="cholmod")
        except ImportError as error:
            sys.exit(f"{error}: install scikit-sparse 0.4 for {sys.executable}")
        # the conductivity of benches/src/problem.rs, bit for bit
        sigma = 1 + 0.1 * (
            (np.arange(model.ne, dtype=np.uint64) * np.uint64(2654435761))
            % np.uint64(2**32)
            / 2.0**32
        )
        voltages, jacobian = model.forward(sigma), model.jacobian()
        ours = [
            np.fromfile(f"{folder}/{name}_{size}.f64", "<f8").reshape(wanted.shape)
            for name, wanted in (("voltages", voltages), ("jacobian", jacobian))
        ]
        difference = [
            np.abs(a - b).max() / np.abs(b).max() for a, b in zip(ours, (voltages, jacobian))
        ]
        print(
            f"{model.N} nodes: voltages differ by {difference[0]:.1e} and the Jacobian by "
            f"{difference[1]:.1e} of the largest value",
            file=sys.stderr,
        )
        if not max(difference) < AGREE:
            sys.exit(
                f"on {model.N} nodes the two sides do not compute the same thing: they differ by "
                f"{max(difference):.1e} of the largest value, wanted below {AGREE}"
            )
        agreement[size] = difference
    return agreement


def one_round(program, peers, folder, number, count):
    """For each size, the peer's times and ours, measured one after the other."""
    rows = []
    for size in SIZES:
        environment = {**os.environ, "PEERS_OUT": folder, "PYTHONDONTWRITEBYTECODE": "1"}
        lines = json_lines(
            run([sys.executable, "bench_scipy.py", str(size)], cwd=peers, env=environment)
        )
        theirs = [line for line in lines if line["peer"].endswith("cholmod")]
        ours = json_lines(run([program, str(size)]))
        theirs, ours = theirs[0], ours[0]
        pairs = {}
        for part, their_key, our_key in PARTS:
            their_s = theirs[their_key] if their_key else theirs["fwd"] + theirs["jac"]
            pairs[part] = (their_s, ours[our_key])
        print(
            f"round {number} of {count}, {ours['nodes']} nodes: "
            + ", ".join(
                f"{part} {1e3 * a:.3g} / {1e3 * b:.3g} ms" for part, (a, b) in pairs.items()
            ),
            file=sys.stderr,
        )
        rows.append(
            {
                "size": size,
                "nodes": ours["nodes"],
                "repeats": ours["repeats"],
                "flop": (theirs["factor_flop"], ours["factor_flop"]),
                "pairs": pairs,
            }
        )
    return rows


def peers_table(agreement, rounds, load):
    """Times, ratios per round and agreement as a Markdown table."""
    lines = [
        f"{cpu()}; {versions()}. One core, one thread, f64, 208 values. CPU time: the median of 7 "
        f"runs (SciPy) and of {rounds[0][0]['repeats']} (ours) in each of {len(rounds)} rounds, in "
        "the table the median of the rounds. Ratio: ours / SciPy inside a round; `least`: the "
        "least of ours over all rounds / the least of SciPy's. Load average before and after: "
        f"{load[0]:.1f}, {load[1]:.1f} (1.0 is this run alone). Difference: the largest, relative "
        "to the largest value.",
        "",
        "| nodes | part | SciPy + CHOLMOD, ms | ours, ms | ratio, min | median | max | least "
        "| difference |",
        "|---" * 9 + "|",
    ]
    for index, row in enumerate(rounds[0]):
        differences = dict(zip(("forward", "Jacobian"), agreement[row["size"]]))
        for part, _, _ in PARTS:
            theirs, ours = zip(*(r[index]["pairs"][part] for r in rounds))
            ratios = [b / a for a, b in zip(theirs, ours)]
            figures = (min(ratios), statistics.median(ratios), max(ratios), min(ours) / min(theirs))
            cells = [
                spaced(row["nodes"]),
                "**forward + Jacobian**" if part == "both" else part,
                *(digits(1e3 * statistics.median(times)) for times in (theirs, ours)),
                *(f"{figure:.2f}" for figure in figures),
                f"{differences[part]:.0e}" if part in differences else "",
            ]
            lines.append(f"| {' | '.join(cells)} |")
    flops = (
        f"{spaced(row['nodes'])} nodes: {digits(row['flop'][0] / 1e6)} and "
        f"{digits(row['flop'][1] / 1e6)}"
        for row in rounds[0]
    )
    lines += ["", f"MFLOP of one factorisation, CHOLMOD's and ours: {'; '.join(flops)}."]
    return "\n".join(lines)


# The peers' solvers that are fastest on at least one problem and gap.
STTV_PEERS = ("svdprox tau=1000", "rho=30lam")
STTV_PROBLEMS = ((32, "sttv_problem_small", 2), (64, "sttv_problem", 9))
STTV_GAPS = ("1e-2", "1e-3", "1e-4")


def sttv_table(program, peers, options):
    """Compares spatio-temporal total variation with the best peer, for each problem in several rounds."""
    rounds = min(options.rounds, 3)
    found = {pixels: [] for pixels, _, _ in STTV_PROBLEMS}
    for number in range(rounds):
        for pixels, name, budget in STTV_PROBLEMS:
            with tempfile.TemporaryDirectory() as folder:
                environment = {**os.environ, "PEERS_OUT": folder, "PYTHONDONTWRITEBYTECODE": "1"}
                command = [sys.executable, "sttv_bench.py", name, str(budget), *STTV_PEERS]
                run(command, cwd=peers, env=environment)
                lines = (pathlib.Path(folder) / "results_sttv.jsonl").read_text()
            theirs = [row["t_to_gap"] for row in json_lines(lines)]
            best = {}
            for gap in STTV_GAPS:
                key = f"{float(gap):g}"
                best[gap] = min((t[key] for t in theirs if key in t), default=None)
            ours = json_lines(run([program, str(pixels)]))[0]
            found[pixels].append((best, ours))
            print(f"st-tv round {number + 1} of {rounds}, {pixels} pixels", file=sys.stderr)
    lines = [
        f"{cpu()}; {versions()}. One core, one thread, cold start, 20 frames, median of {rounds} "
        "rounds. Peer: CPU seconds of the best of "
        "primal-dual with SVD prox and ADMM until the objective is within the gap of the certified "
        "optimum. Ours: CPU seconds until the same is true, and until our own certificate proves "
        "the gap.",
        "",
        "| pixels | gap | best peer, s | ours, s | peer / ours | ours certified, s "
        "| peer / certified |",
        "|---" * 7 + "|",
    ]
    for pixels, results in found.items():
        for gap in STTV_GAPS:
            known = [(b[gap], o["primal_s"][gap], o["certified_s"][gap]) for b, o in results if b[gap]]
            if not known:
                continue
            theirs, ours, certified = (statistics.median(column) for column in zip(*known))
            ratios = [statistics.median(k[0] / k[i] for k in known) for i in (1, 2)]
            cells = [
                f"{pixels} x {pixels}", gap, digits(theirs), digits(ours), f"{ratios[0]:.1f}",
                digits(certified), f"{ratios[1]:.1f}",
            ]
            lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "| pixels | iteration, ms | its floor, ms | ratio | set-up, ms |", "|---" * 5 + "|"]
    for pixels, results in found.items():
        ours = results[-1][1]
        stride = -(-ours["frames"] // 8) * 8
        flop = 4 * ours["unknowns"] * ours["rank"] * ours["frames"]
        byte = 4 * ours["unknowns"] * (ours["rank"] + 9 * stride)
        floor_s = flop / ours["flop_per_s"] + byte / ours["byte_per_s"]
        took = statistics.median(o["iteration_s"] for _, o in results)
        cells = [
            f"{pixels} x {pixels}", digits(1e3 * took), digits(1e3 * floor_s),
            f"{took / floor_s:.1f}", digits(1e3 * ours["set_up_s"]),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    lines += [
        "",
        f"The floor: 4 n r T flops at {ours['flop_per_s'] / 1e9:.0f} GFLOP/s (a product of square "
        "matrices in f32), and the basis and 9 arrays of n T values read or written at "
        f"{ours['byte_per_s'] / 1e9:.0f} GB/s, both measured in the same run. The part of the spectrum "
        "that is left to an explicit step (docs/DESIGN_IMAGES.md) is counted as if it were not. "
        "An iteration's time includes its share of looks at the objective.",
        "",
        "A stream, certified gap of 1e-2 on every frame, each linked to the image before:",
        "",
        "| pixels | frames/s | p50, ms | p95 | p99 | worst | iterations a frame | worst gap |",
        "|---" * 8 + "|",
    ]
    for pixels, results in found.items():
        stream = results[-1][1]["causal"]
        times = (digits(1e3 * stream[key]) for key in ("p50_s", "p95_s", "p99_s", "worst_s"))
        cells = [
            f"{pixels} x {pixels}", digits(stream["frames_per_s"]), *times,
            f"{stream['iterations']:.0f}", f"{stream['worst_gap']:.1e}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def floors_table(rows):
    """Stages, their work and their floors as a Markdown table."""
    lines = [
        f"Matrix product, f64, one thread: {rows[0]['flop_per_s'] / 1e9:.0f} GFLOP/s. CPU time, "
        "medians.",
        "",
        "| nodes | stage | MFLOP | stored, MB at GB/s | read, MB at GB/s | floor, ms | bound by "
        "| measured, ms | measured / floor |",
        "|---" * 9 + "|",
    ]
    for row in rows:
        floor_ms, took_ms = 1e3 * row["floor_s"], 1e3 * row["cpu_s"]
        cells = [
            spaced(row["nodes"]),
            row["stage"],
            digits(row["flop"] / 1e6),
            moved(row["stored_bytes"], row["store_byte_per_s"]),
            moved(row["read_bytes"], row["read_byte_per_s"]),
            digits(floor_ms),
            row["bound"],
            digits(took_ms),
            f"{took_ms / floor_ms:.1f}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def moved(count, rate):
    """Bytes and their rate; empty if none are moved."""
    return f"{digits(count / 1e6)} at {rate / 1e9:.0f}" if count else ""


def stages_table():
    """Criterion's medians, in the order in which they ran."""
    metadata = json.loads(run(["cargo", "metadata", "--format-version", "1", "--no-deps"]))
    load, started = os.getloadavg()[0], time.time()
    run(["cargo", "bench", "-p", "benches", "--bench", "stages"])
    results = pathlib.Path(metadata["target_directory"]).glob("criterion/*/*/*/new/estimates.json")
    fresh = [path for path in results if path.stat().st_mtime >= started]
    found = {}
    for path in sorted(fresh, key=lambda path: path.stat().st_mtime):
        name = json.loads((path.parent / "benchmark.json").read_text())
        median = json.loads(path.read_text())["median"]
        interval = median["confidence_interval"]
        low, high = interval["lower_bound"], interval["upper_bound"]
        middle, low, high = (digits(ns / 1e6) for ns in (median["point_estimate"], low, high))
        stage = f"{name['group_id']}: {name['function_id']}"
        found.setdefault(stage, {})[name["value_str"]] = f"{middle} ({low} to {high})"
    lines = [
        "Wall time in milliseconds, median (95 % interval). One core, one thread; load average "
        f"before: {load:.1f}.",
        "",
        "| stage | 2 000 nodes | 20 000 nodes |",
        "|---|---|---|",
    ]
    lines += [f"| {stage} | {t['2000']} | {t['20000']} |" for stage, t in found.items()]
    return "\n".join(lines)


def versions():
    """Describes what was compared."""
    import scipy
    import sksparse

    return (
        f"{run(['rustc', '--version']).split(' (')[0]}; Python {platform.python_version()}, NumPy "
        f"{np.__version__}, SciPy {scipy.__version__}, scikit-sparse {sksparse.__version__}"
    )


def cpu():
    """The processor's name and the number of cores visible to the system."""
    name = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        for line in open("/proc/cpuinfo", encoding="utf-8"):
            if line.startswith("model name"):
                name = line.split(":", 1)[1].strip()
                break
    return f"{name}, {os.cpu_count()} cores"


def digits(number):
    """Three significant digits, without an exponent."""
    return f"{number:.0f}" if number >= 100 else f"{number:#.3g}"


def spaced(number):
    """Separates thousands by a space."""
    return f"{number:,}".replace(",", " ")


def write(path, parts):
    text = path.read_text(encoding="utf-8")
    for name, body in parts.items():
        begin, end = f"<!-- generated: {name} -->", f"<!-- end of generated: {name} -->"
        if text.count(begin) != 1 or text.count(end) != 1:
            sys.exit(f"{path} needs the two lines '{begin}' and '{end}', once each")
        before, rest = text.split(begin)
        text = before + begin + "\n" + body + "\n" + end + rest.split(end)[1]
    path.write_text(text, encoding="utf-8")
    print(f"wrote {path}", file=sys.stderr)


if __name__ == "__main__":
    main()
