"""Prints our driver of servos beside the vendor's dynamixel-sdk and the crate rustypot: sync write and read of 15 servos.

All talk to one simulated bus on one pseudo-terminal, one after the other in each round of one run. A round trip is a sync write
of 15 goal positions and a sync read of 15 present currents, velocities and positions (10 bytes of each); beside it stands what
its bytes take on the line, below which no driver comes. The servos answer without delay, the adapter hands bytes on at once.
"""

import json
import pathlib
import signal
import statistics
import subprocess
import sys
import time

import dynamixel_sdk as sdk

ROOT = pathlib.Path(__file__).resolve().parent.parent
TDCR = ROOT / "target/release/tdcr"
# Those of the tests, which share their build.
PACKAGES = ["--locked", "--workspace", "--exclude", "tdcr-mujoco"]
SERVOS = range(1, 16)
RETURN_DELAY = 9
GOAL = (116, 4)
PRESENT = (126, 10)
ROUNDS = int(sys.argv[1]) if len(sys.argv) > 1 else 5
TRIPS = 200
BAUD_RATES = [1_000_000, 4_000_000]


def line_time(baud, joined):
    """Time (us) of a round trip's bytes on the line."""
    count = len(SERVOS)
    write = 14 + count * (1 + GOAL[1])
    read = 14 + count
    answers = 8 + count * (4 + PRESENT[1]) if joined else count * (11 + PRESENT[1])
    return (write + read + answers) * 10e6 / baud


def rust(driver, port, baud, joined):
    """Median time (us) of a round trip through our driver or rustypot."""
    command = ["cargo", "bench", "--quiet", *PACKAGES, "--bench", "bus", "--"]
    answers = "joined" if joined else "each"
    command += [port, str(baud), driver, answers, str(TRIPS)]
    run = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(run.stdout)["median_us"]


def vendor(path, baud, joined):
    """The same through the vendor's SDK."""
    port, packets = sdk.PortHandler(path), sdk.PacketHandler(2.0)
    assert port.setBaudRate(baud)
    read = sdk.GroupSyncRead(port, packets, *PRESENT)
    for servo in SERVOS:
        assert read.addParam(servo)
    ask = read.fastSyncRead if joined else read.txRxPacket
    times = []
    for number in range(TRIPS + 5):
        began = time.perf_counter()
        write = sdk.GroupSyncWrite(port, packets, *GOAL)
        for servo in SERVOS:
            write.addParam(servo, list((2048 + number % 50).to_bytes(4, "little")))
        assert write.txPacket() == sdk.COMM_SUCCESS
        result = ask()
        # A busy machine is now and then slower than the SDK waits; such a trip counts with its time.
        assert result in (sdk.COMM_SUCCESS, sdk.COMM_RX_TIMEOUT, sdk.COMM_RX_CORRUPT), result
        times.append(time.perf_counter() - began)
    port.closePort()
    return 1e6 * statistics.median(times[5:])


def answer_at_once(path, baud):
    """Takes the servos' return delays away."""
    port, packets = sdk.PortHandler(path), sdk.PacketHandler(2.0)
    assert port.setBaudRate(baud)
    for servo in SERVOS:
        for _ in range(8):
            result, _ = packets.write1ByteTxRx(port, servo, RETURN_DELAY, 0)
            if result == sdk.COMM_SUCCESS:
                break
        assert result == sdk.COMM_SUCCESS
    port.closePort()


def measure(baud):
    """Rows of the table at a baud rate."""
    command = [TDCR, "servo-sim", "--robot", "5m", "--baud", str(baud), "--latency", "0", "--quiet"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            path = server.stdout.readline().strip()
            answer_at_once(path, baud)
            for joined in (False, True):
                drivers = {
                    "ours": lambda joined=joined: rust("ours", path, baud, joined),
                    "rustypot": lambda joined=joined: rust("rustypot", path, baud, joined),
                    "dynamixel-sdk": lambda joined=joined: vendor(path, baud, joined),
                }
                rounds = [{name: drive() for name, drive in drivers.items()} for _ in range(ROUNDS)]
                times = {name: statistics.median(r[name] for r in rounds) for name in drivers}
                kind = "fast sync read" if joined else "sync read"
                ours = times["ours"]
                cells = [f"{line_time(baud, joined):,.0f}", f"{ours:,.0f}"]
                for name in ("rustypot", "dynamixel-sdk"):
                    cells.append(f"{times[name]:,.0f}, **{times[name] / ours:.2f}x**")
                print(f"| {kind}, {baud // 1_000_000} Mbaud | " + " | ".join(cells) + " |", flush=True)
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(timeout=10)


if __name__ == "__main__":
    subprocess.run(["cargo", "build", "--quiet", "--release", *PACKAGES, "--examples", "--bins"], cwd=ROOT, check=True)
    print("| sync write and read of 15 servos (us) | bytes on the line | ours | rustypot | dynamixel-sdk |")
    print("|---|---|---|---|---|")
    for rate in BAUD_RATES:
        measure(rate)
