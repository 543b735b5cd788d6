#!/usr/bin/env python3
"""Compares the times of the U-net's training step and inference with PyTorch, run alternately, and
writes a generated part of docs/PERFORMANCE.md.

Run it with an interpreter that has numpy and torch (pip install torch):

    $PYTHON benches/compare_unet.py [--rounds 5] [--dry-run]

The program is the example `step_time` of eit-denoise with the feature train: images by our own network
and by burn's, training steps by burn. In every round and for every network, PyTorch and the program run
one after the other on one core with one thread each. Before timing, images and derivatives of all sides
from the same weights are checked against each other. PyTorch runs eagerly, in its default and in
channels-last memory order; the faster one counts.
"""

import argparse
import os
import pathlib
import platform
import statistics
import sys
import tempfile
import time

# one thread, set before numpy is loaded
from compare import ROOT, cpu, deliver, digits, json_lines, pin, quiet, run, spaced

import numpy as np
import torch
import torch.nn.functional as F

# width and depth: the default network, and one with 487 thousand weights
NETS = ((6, 3), (16, 3))
PIXELS, BATCH = 64, 16
# Largest accepted relative difference of images (f32 rounding through fifteen layers) and of derivatives
# (the same, plus pixels whose sign before a ReLU it flips: one in some hundred thousand).
AGREE = {"made": 1e-5, "gradient": 1e-3}


def main():
    options = arguments()
    torch.set_num_threads(1)
    program = build()
    pin(options.core)
    with tempfile.TemporaryDirectory() as folder:
        agreement = {net: check(net, program, folder) for net in NETS}
    quiet(options)
    load = [os.getloadavg()[0]]
    rounds = [one_round(program, number + 1, options) for number in range(options.rounds)]
    load.append(os.getloadavg()[0])
    deliver({"unet": table(rounds, agreement, load)}, options)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="rounds, at least 3 (default 5)")
    parser.add_argument("--core", type=int, default=0, help="core to run on (default 0)")
    parser.add_argument("--budget", type=float, default=1.0, help="seconds per figure (default 1)")
    parser.add_argument(
        "--quiet", type=float, default=None, help="wait until the load average is below this"
    )
    parser.add_argument(
        "--patience", type=float, default=900, help="maximum time to wait for a quiet machine, in seconds (default 900)"
    )
    parser.add_argument("--dry-run", action="store_true", help="only print the table")
    options = parser.parse_args()
    if options.rounds < 3:
        parser.error(f"--rounds {options.rounds}: fewer than 3 rounds show no spread")
    return options


def build():
    """Path of our program, built once before the rounds."""
    print("building", file=sys.stderr)
    command = "cargo build --release -p eit-denoise --features train --example step_time"
    messages = json_lines(run([*command.split(), "--message-format", "json-render-diagnostics"]))
    return next(m["executable"] for m in messages if m.get("target", {}).get("name") == "step_time")


class Net(torch.nn.Module):
    """The network of `UnetShape`, from its parameters in file order."""

    def __init__(self, width, depth, parameters):
        super().__init__()
        self.depth = depth
        channels = [width << level for level in range(depth + 1)]
        sizes, inputs = [], 2
        for own in channels:
            sizes += [(own, inputs, 3), (own, own, 3)]
            inputs = own
        for level in reversed(range(depth)):
            own = channels[level]
            sizes += [(own, own + channels[level + 1], 3), (own, own, 3)]
        sizes.append((1, width, 1))
        self.weights, self.biases = torch.nn.ParameterList(), torch.nn.ParameterList()
        rest = torch.from_numpy(parameters)
        for outputs, inputs, side in sizes:
            own, rest = rest.tensor_split([outputs * inputs * side * side])
            biases, rest = rest.tensor_split([outputs])
            self.weights.append(own.reshape(outputs, inputs, side, side).clone())
            self.biases.append(biases.clone())
        assert len(rest) == 0, f"{len(rest)} parameters are left over"

    def forward(self, now):
        layers = iter(zip(self.weights, self.biases))

        def pair(now):
            for _ in range(2):
                weights, biases = next(layers)
                now = F.relu(F.conv2d(now, weights, biases, padding=1))
            return now

        skips = []
        for _ in range(self.depth):
            skips.append(pair(now))
            now = F.max_pool2d(skips[-1], 2)
        now = pair(now)
        while skips:
            now = pair(torch.cat([skips.pop(), F.interpolate(now, scale_factor=2)], 1))
        weights, biases = next(layers)
        return F.conv2d(now, weights, biases)

    def step(self, inputs, wanted, weights):
        """Error and derivative of a batch, with the example weights of `Examples`."""
        self.zero_grad()
        error = (weights * (self(inputs) - wanted).square().mean((1, 2, 3))).mean()
        error.backward()
        return error.item()

    def gradient(self):
        both = (p for pair in zip(self.weights, self.biases) for p in pair)
        return torch.cat([p.grad.flatten() for p in both]).numpy()


def data(images):
    """Images, and the mask of a skin that fills them."""
    images = torch.from_numpy(images).reshape(BATCH, 1, PIXELS, PIXELS)
    return torch.cat([images, torch.ones_like(images)], 1)


def check(net, program, folder):
    """Largest relative differences from PyTorch: images of both networks, burn's derivatives."""
    off = {}
    run([program, *map(str, net), "0", folder])
    read = lambda name: np.fromfile(f"{folder}/{name}.f32", "<f4")  # noqa: E731
    model, inputs = Net(*net, read("parameters")), data(read("raw"))
    made = model(inputs).detach().numpy().ravel()
    wanted = torch.from_numpy(read("wanted")).reshape(BATCH, 1, PIXELS, PIXELS)
    raw_errors = (inputs[:, :1] - wanted).square().mean((1, 2, 3))
    references = torch.minimum(raw_errors, wanted.square().mean((1, 2, 3)))
    model.step(inputs, wanted, 1 / (references + 0.05 * references.mean()))
    for name, theirs in (("made", made), ("made_burn", made), ("gradient", model.gradient())):
        difference = np.abs(read(name) - theirs).max() / np.abs(theirs).max()
        print(f"{net}: {name} differs by {difference:.1e}", file=sys.stderr)
        if not difference < AGREE[name.split("_")[0]]:
            sys.exit(
                f"width and depth {net}: {name} differs from PyTorch's by {difference:.1e} of the "
                "largest value: not the same net"
            )
        off[name] = difference
    return off


def least_s(budget_s, work):
    """Minimum of as many runs as fit the budget, at least five, after a warm-up run."""
    work()
    times, first = [], time.perf_counter()
    while len(times) < 5 or time.perf_counter() < first + budget_s:
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def torch_times(net, parameters, budget_s):
    """Seconds per step and per image, in the faster of two memory orders."""
    generator = np.random.default_rng(1)
    images = generator.uniform(-1, 1, BATCH * PIXELS**2).astype("f4")
    wanted = torch.from_numpy(images).reshape(BATCH, 1, PIXELS, PIXELS) * 0.5
    weights = torch.ones(BATCH)
    found = []
    for memory in (torch.contiguous_format, torch.channels_last):
        model = Net(*net, parameters).to(memory_format=memory)
        inputs = data(images).to(memory_format=memory)
        one = inputs[:1].clone(memory_format=memory)
        step = least_s(budget_s, lambda: model.step(inputs, wanted, weights))
        with torch.inference_mode():
            found.append((step, least_s(budget_s, lambda: model(one))))
    return [min(times) for times in zip(*found)]


def one_round(program, number, options):
    """For each network: {side: (step, image)} in seconds; our own network has no training step."""
    rows = []
    for net in NETS:
        size = json_lines(run([program, *map(str, net), str(options.budget)]))[0]
        random = np.random.default_rng(2).normal(0, 0.05, size["parameters"]).astype("f4")
        found = {
            "ours": (None, size["image_s"]),
            "burn flex": (size["step_s"], size["burn_image_s"]),
            "PyTorch": torch_times(net, random, options.budget),
        }
        said = ", ".join(
            f"{side} {' and '.join(f'{1e3 * t:.3g}' for t in times if t)} ms"
            for side, times in found.items()
        )
        print(f"round {number} of {options.rounds}, {net}: {said}", file=sys.stderr)
        rows.append({"net": net, "size": size, "times": found})
    return rows


def table(rounds, agreement, load):
    sides = list(rounds[0][0]["times"])
    worst = {k: max(off[k] for off in agreement.values()) for k in next(iter(agreement.values()))}
    lines = [
        f"{cpu()}; {run(['rustc', '--version']).split(' (')[0]}; Python "
        f"{platform.python_version()}, PyTorch {torch.__version__} (the faster of two orders of "
        f"memory, eager), burn 0.22.1. One core, one thread, f32, {PIXELS} x {PIXELS} pixels. CPU time, the least "
        f"of the runs in each of {len(rounds)} rounds, in the table the median of the rounds. Step: error "
        "and derivative of "
        f"{BATCH} images, without the optimiser. Load average before and after: {load[0]:.1f}, "
        f"{load[1]:.1f} (1.0 is this run alone). From the same weights the images differ from "
        f"PyTorch's by at most {max(worst['made'], worst['made_burn']):.0e} of the largest value, burn's "
        "derivatives by "
        f"{worst['gradient']:.0e}.",
        "",
        "| weights | what | "
        + " | ".join(f"{side}, ms" for side in sides)
        + " |",
        "|---" * (len(sides) + 2) + "|",
    ]
    for index, row in enumerate(rounds[0]):
        for part, what in enumerate(("training step", "one image")):
            cells = [spaced(row["size"]["parameters"]), what]
            for side in sides:
                times = [r[index]["times"][side][part] for r in rounds]
                cells.append("" if None in times else digits(1e3 * statistics.median(times)))
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
