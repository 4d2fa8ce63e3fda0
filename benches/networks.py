"""Training and sampling the paper's networks: ours beside PyTorch's, in one run.

    make bench            or   .venv/bin/python benches/networks.py [--only mlp|hybrid] [--patience SECONDS]

Prints a line for each measurement as it comes, and then Markdown tables of all: times, what products and memory account for of
ours, in float32 and, where that is faster, in bfloat16. PyTorch stands beside ours where it is installed
(tests/python/requirements-torch.txt): the modules of tdcr.torch, eager and compiled, in float32 and under bfloat16 autocast, with
fused AdamW, as many threads as ours, and a malloc that keeps what it frees. Its best float32 mode and its best bfloat16 mode are
shown, each with its ratio to our fastest that computes with such numbers or finer ones. Each mode runs in a process of its own,
ours before each of them, and of ours the median is shown. Our step also draws its batch and averages the weights; PyTorch's batch
is ready. Of the paper's sampling, 100 steps of Heun's method, 5 are timed by both and the time is multiplied by 20.
A mode of PyTorch that is not done after --patience seconds, its compilation included, is left out, and said to be.
"""

import argparse
import json
import os
import pathlib
import resource
import signal
import statistics
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).parent.parent
NETWORKS = ("mlp", "hybrid")
PRECISIONS = ("float32", "bfloat16")
MODES = [(how, precision) for precision in PRECISIONS for how in ("eager", "compiled")]
# glibc then neither returns memory to the system nor maps large blocks anew.
MALLOC = {
    "MALLOC_MMAP_THRESHOLD_": "8000000000",
    "MALLOC_TRIM_THRESHOLD_": "16000000000",
    "MALLOC_TOP_PAD_": "500000000",
}
# Seconds for one mode of PyTorch: a compiled Hybrid takes minutes to compile, or never comes to an end.
PATIENCE = 600
PAPER_STEPS = 100


def ours(network, precision):
    """What benches/networks.rs measures of a network."""
    command = ["cargo", "bench", "--quiet", "--locked", "--bench", "networks", "--", network, precision]
    run = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(run.stdout)


def theirs(work, how, precision, patience):
    """What PyTorch takes for the same work in a mode, measured in another process; a word on why not where that fails or takes
    more than `patience` seconds."""
    task = json.dumps({"work": work, "how": how, "precision": precision})
    command = [sys.executable, __file__, "--task", task]
    # A group of its own, as a compiler's processes outlive the one that started them.
    group = {"start_new_session": True}
    with subprocess.Popen(
        command, env=os.environ | MALLOC, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **group
    ) as run:
        try:
            output, error = run.communicate(timeout=patience)
        except BaseException as reason:
            os.killpg(run.pid, signal.SIGKILL)
            if isinstance(reason, subprocess.TimeoutExpired):
                return f"not done after {patience:g} s"
            raise
    if run.returncode != 0:
        return (error.strip().splitlines() or [f"exit status {run.returncode}"])[-1]
    return json.loads(output)


def median_seconds(runs, work):
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def peak_memory():
    """Largest resident memory of this process so far (bytes; macOS counts so, Linux in KiB)."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def peer(work, how, precision):
    """PyTorch's seconds of a step and of sampling, and the growth to its peak memory; runs in a process of its own."""
    import torch

    from tdcr.torch import loss, network

    torch.set_num_threads(work["threads"])
    torch.manual_seed(0)
    conditions = work["shape"].get("head", work["shape"])["condition_dim"]

    def autocast():
        return torch.autocast("cpu", dtype=torch.bfloat16, enabled=precision == "bfloat16")

    def batch(clouds, points):
        return torch.randn(clouds, points, 3), torch.rand(clouds), torch.rand(clouds, conditions)

    def adamw(module):
        return torch.optim.AdamW(module.parameters(), lr=3e-4, weight_decay=1e-4, fused=True)

    # What PyTorch loads with its first step is no memory of the training.
    tiny = torch.nn.Linear(1, 1)
    tiny(torch.ones(1, 1)).sum().backward()
    adamw(tiny).step()

    inputs = batch(work["clouds"], work["points"])
    targets = torch.randn_like(inputs[0])
    before = peak_memory()
    module = network(work["shape"])
    optimizer = adamw(module)
    forward = torch.compile(module) if how == "compiled" else module

    def step():
        optimizer.zero_grad(set_to_none=True)
        with autocast():
            velocities = forward(*inputs)
        loss(velocities.float(), targets).backward()
        torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0)
        optimizer.step()

    for _ in range(3):
        step()
    times = {"step": median_seconds(5, step), "peak": peak_memory() - before}
    if work["sampling"]:
        steps = work["sampling"]["steps"]
        start, _, condition = batch(1, work["sampling"]["points"])

        # Compiled modules do not run in inference mode.
        @torch.no_grad()
        def sample():
            x, h = start, 1 / steps
            with autocast():
                for k in range(steps):
                    u = forward(x, torch.full((1,), k * h), condition).float()
                    ahead = forward(x + h * u, torch.full((1,), (k + 1) * h), condition).float()
                    x = x + 0.5 * h * (u + ahead)
            return x

        sample()
        times["sampling"] = median_seconds(3, sample)
    return times


def measure(network, modes, patience):
    """What ours, by precision and in rounds, and PyTorch, by mode, take for a network; prints each as it comes."""
    rounds, peers = {precision: [] for precision in PRECISIONS}, {}
    for how, precision in modes or [(None, precision) for precision in PRECISIONS]:
        mine = ours(network, precision)
        # Where ours is faster in float32, that is what ran.
        rounds[mine["precision"]].append(mine)
        sampling = mine["sampling"]
        tell(
            network,
            "ours",
            mine["precision"],
            mine["step"]["seconds"],
            sampling and (sampling["steps"], sampling["work"]["seconds"]),
        )
        if how:
            found = theirs(mine, how, precision, patience)
            if isinstance(found, str):
                print(f"{network} | PyTorch {how} {precision} | left out: {found}", flush=True)
                continue
            peers[how, precision] = found
            tell(network, f"PyTorch {how}", precision, found["step"], sampling and (sampling["steps"], found["sampling"]))
    rounds = {precision: mine for precision, mine in rounds.items() if mine}
    return rounds, peers


def tell(network, who, precision, step, sampling):
    """Prints a measurement: seconds of a training step, and of so many of the sampler's steps."""
    line = f"{network} | {who} {precision} | training step {1e3 * step:,.1f} ms"
    if sampling:
        steps, seconds = sampling
        line += f" | {2 * PAPER_STEPS} evaluations {PAPER_STEPS / steps * seconds:,.1f} s"
    print(line, flush=True)


def works(network, rounds):
    """By the work's name: its key in PyTorch's results, all rounds of ours by precision, and the factor from seconds to
    what is shown."""
    first = rounds["float32"][0]
    name = network.upper() if network == "mlp" else network.capitalize()
    batch = f"{first['clouds']} x {first['points']:,} points"
    steps = {precision: [r["step"] for r in mine] for precision, mine in rounds.items()}
    yield f"{name}: training step, {batch} (ms)", "step", steps, 1e3
    if first["sampling"]:
        points, steps = first["sampling"]["points"], first["sampling"]["steps"]
        title = f"{name}: sampling {points:,} points, {2 * PAPER_STEPS} evaluations (s)"
        samplings = {precision: [r["sampling"]["work"] for r in mine] for precision, mine in rounds.items()}
        yield title, "sampling", samplings, PAPER_STEPS / steps


def beside(mine, peers, key, precision, factor):
    """A cell: PyTorch's best of a precision, which mode that is, and its ratio to ours."""
    found = [(result[key], how) for (how, p), result in peers.items() if p == precision]
    if not found:
        return "-"
    seconds, how = min(found)
    ratio = seconds / min(ours for p, ours in mine.items() if p in (precision, "float32"))
    return f"{factor * seconds:,.1f} {how}, **{ratio:.2f}x**"


def times_table(measured, precisions):
    heads = [f"{who} {p}" for who in ("ours", "PyTorch") for p in (PRECISIONS if who == "ours" else precisions)]
    lines = ["| | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
    for network, (rounds, peers) in measured.items():
        for title, key, works_of, factor in works(network, rounds):
            mine = {p: statistics.median(work["seconds"] for work in found) for p, found in works_of.items()}
            cells = [f"{factor * mine[p]:,.1f}" if p in mine else "-" for p in PRECISIONS]
            cells += [beside(mine, peers, key, p, factor) for p in precisions]
            lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def products_table(measured):
    """Products in float32; those in bfloat16 have no others to be set beside."""
    lines = ["| products of ours, float32 (GF/s) | in the work | alone | share |", "|---|---|---|---|"]
    for network, (rounds, _) in measured.items():
        for title, _, mine, _ in works(network, rounds):
            mine = mine["float32"]
            inside, alone = (statistics.median(w[k] for w in mine) for k in ("products", "plain_products"))
            share = statistics.median(w["products"] / w["plain_products"] for w in mine)
            lines.append(f"| {title.rsplit(' (', 1)[0]} | {inside:.0f} | {alone:.0f} | {share:.0%} |")
    return "\n".join(lines)


def memory_table(measured):
    """The peak of training beside the goal: one output of each layer for the whole batch, and the weights four times."""
    lines = [
        "| peak memory of training (MB) | ours, float32 | activations + 4 x weights | ratio | PyTorch float32, bfloat16 |",
        "|---|---|---|---|---|",
    ]
    for network, (rounds, peers) in measured.items():
        rounds = rounds["float32"]
        memory = [r["memory"] for r in rounds]
        activations, weights = (memory[0][k] / 1e6 for k in ("activations", "weights"))
        cells = [f"{activations:.0f} + {weights:.0f}"]
        if memory[0]["peak"] is None:
            cells = ["-", *cells, "-"]
        else:
            peak = statistics.median(m["peak"] for m in memory) / 1e6
            cells = [f"{peak:.0f}", *cells, f"{peak / (activations + weights):.2f}"]
        by_precision = ([r["peak"] for (_, p), r in peers.items() if p == precision] for precision in PRECISIONS)
        cells.append(", ".join(f"{min(peaks) / 1e6:.0f}" if peaks else "-" for peaks in by_precision))
        title = f"{network}, {rounds[0]['clouds']} x {rounds[0]['points']:,} points"
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def torch_version():
    """PyTorch's version, or None; asked of another process, as ours is timed in between."""
    command = [sys.executable, "-c", "import torch, safetensors; print(torch.__version__)"]
    run = subprocess.run(command, capture_output=True, text=True)
    return run.stdout.strip() if run.returncode == 0 else None


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--only", choices=NETWORKS, help="measure this network alone")
    parser.add_argument("--patience", type=float, default=PATIENCE, metavar="SECONDS", help=f"for a PyTorch mode [{PATIENCE}]")
    parser.add_argument("--task", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.task:
        print(json.dumps(peer(**json.loads(args.task))))
        return
    # As Ctrl-C does, so that no mode goes on without it.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    version = torch_version()
    if version:
        print(f"PyTorch {version}, {os.cpu_count()} processors", file=sys.stderr)
    else:
        print("PyTorch is skipped: install tests/python/requirements-torch.txt to have it beside ours", file=sys.stderr)
    networks = [args.only] if args.only else NETWORKS
    measured = {network: measure(network, MODES if version else [], args.patience) for network in networks}
    for table in (times_table(measured, PRECISIONS if version else ()), products_table(measured), memory_table(measured)):
        print(f"\n{table}")


if __name__ == "__main__":
    main()
