"""The vendor's SDK, unchanged, drives the servos of `tdcr servo-sim`."""

import os
import pathlib
import signal
import subprocess
import time

import dynamixel_sdk as sdk
import pytest

# Addresses of the control table (ROBOTIS e-Manual, XC330-M288).
ID, OPERATING_MODE, CURRENT_LIMIT, TORQUE_ENABLE, LED = 7, 11, 38, 64, 65
REGISTERED, HARDWARE_ERROR, WATCHDOG = 69, 70, 98
GOAL_CURRENT, PROFILE_VELOCITY, GOAL_POSITION = 102, 112, 116
PRESENT_CURRENT, PRESENT_POSITION, PRESENT_VOLTAGE, PRESENT_TEMPERATURE = 126, 132, 144, 146
CURRENT_MODE, EXTENDED_POSITION, CURRENT_BASED_POSITION = 0, 4, 5

# Numbers of the error byte (e-Manual, Protocol 2.0).
RESULT, INSTRUCTION, CRC, RANGE, LENGTH, LIMIT, ACCESS, ALERT = 1, 2, 3, 4, 5, 6, 7, 128

# The servo that has an overload from the start, and all of them.
OVERLOADED = 9
SERVOS = range(1, 10)


@pytest.fixture(autouse=True)
def time_limit():
    """No conversation takes longer than 30 s."""

    def stop(*_):
        raise TimeoutError("the test takes longer than 30 s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(30)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def bus():
    """A port to nine servos at home, and the packet handler of Protocol 2.0."""
    binary = os.environ.get("TDCR") or str(pathlib.Path(__file__).parents[2] / "target/release/tdcr")
    command = [binary, "servo-sim", "--robot", "3m", "--quiet", "--fault", f"overloaded:{OVERLOADED}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            port = sdk.PortHandler(server.stdout.readline().strip())
            assert port.setBaudRate(1_000_000)
            yield Bus(port)
            port.closePort()
        finally:
            server.send_signal(signal.SIGINT)
            assert server.wait(timeout=10) == 0


class Bus:
    """The SDK's calls, told again where a busy machine was slower than the SDK waits (34 ms)."""

    def __init__(self, port):
        self.port = port
        self.packets = sdk.PacketHandler(2.0)

    def told(self, call, *arguments):
        """Calls until it is answered; returns what comes with the result."""
        for _ in range(8):
            *values, result, error = call(self.port, *arguments)
            if result == sdk.COMM_SUCCESS:
                return (*values, error)
            time.sleep(0.1)
        raise AssertionError(self.packets.getTxRxResult(result))

    def write(self, servo, address, value, size=1):
        """The error byte of a write."""
        call = {1: self.packets.write1ByteTxRx, 2: self.packets.write2ByteTxRx, 4: self.packets.write4ByteTxRx}[size]
        (error,) = self.told(call, servo, address, value)
        return error

    def read(self, servo, address, size=1):
        """A signed number, where there is no error."""
        call = {1: self.packets.read1ByteTxRx, 2: self.packets.read2ByteTxRx, 4: self.packets.read4ByteTxRx}[size]
        value, error = self.told(call, servo, address)
        assert error == 0, error
        return value - (1 << 8 * size) if value >> (8 * size - 1) else value

    def drive(self, servo, mode=EXTENDED_POSITION):
        """Switches a servo on where it stands."""
        assert self.write(servo, OPERATING_MODE, mode) == 0
        position = self.read(servo, PRESENT_POSITION, 4)
        assert self.write(servo, GOAL_POSITION, position, 4) == 0
        assert self.write(servo, TORQUE_ENABLE, 1) == 0
        return position


def again(call):
    """Calls until the result is a success."""
    for _ in range(8):
        result = call()
        if result == sdk.COMM_SUCCESS:
            return
        time.sleep(0.1)
    raise AssertionError(sdk.PacketHandler(2.0).getTxRxResult(result))


def test_all_servos_are_found(bus):
    for _ in range(5):
        found, result = bus.packets.broadcastPing(bus.port)
        if result == sdk.COMM_SUCCESS and len(found) == len(SERVOS):
            break
    assert found == {servo: [1240, 52] for servo in SERVOS}
    model, _ = bus.told(bus.packets.ping, 5)
    assert model == 1240
    _, result, _ = bus.packets.ping(bus.port, 40)
    assert result == sdk.COMM_RX_TIMEOUT


def test_items_of_every_size_are_read_and_written(bus):
    for address, size, value in [(LED, 1, 1), (CURRENT_LIMIT, 2, 700), (PROFILE_VELOCITY, 4, 300)]:
        assert bus.write(2, address, value, size) == 0
        assert bus.read(2, address, size) == value
    assert bus.read(2, PRESENT_POSITION, 4) == 2048
    assert bus.read(2, PRESENT_VOLTAGE, 2) == 50
    assert 20 <= bus.read(2, PRESENT_TEMPERATURE) <= 30


def test_registered_writes_wait_for_the_action(bus):
    for servo in (1, 2):
        assert bus.told(bus.packets.regWriteTxRx, servo, LED, 1, [1]) == (0,)
        assert (bus.read(servo, LED), bus.read(servo, REGISTERED)) == (0, 1)
    assert bus.packets.action(bus.port, sdk.BROADCAST_ID) == sdk.COMM_SUCCESS
    for servo in (1, 2):
        assert (bus.read(servo, LED), bus.read(servo, REGISTERED)) == (1, 0)


def test_sync_writes_move_and_sync_reads_see_it(bus):
    servos = [servo for servo in SERVOS if servo != OVERLOADED]
    start = {servo: bus.drive(servo) for servo in servos}
    goals = sdk.GroupSyncWrite(bus.port, bus.packets, GOAL_POSITION, 4)
    for servo in servos:
        assert goals.addParam(servo, list((start[servo] + 400).to_bytes(4, "little")))
    assert goals.txPacket() == sdk.COMM_SUCCESS
    # Motors that wind draw current.
    assert any(bus.read(servo, PRESENT_CURRENT, 2) > 0 for servo in servos)
    time.sleep(1.0)
    for fast in (False, True):
        present = sdk.GroupSyncRead(bus.port, bus.packets, PRESENT_POSITION, 4)
        for servo in servos:
            assert present.addParam(servo)
        again(present.fastSyncRead if fast else present.txRxPacket)
        for servo in servos:
            assert present.isAvailable(servo, PRESENT_POSITION, 4)
            # The default gains leave an error under load.
            assert abs(present.getData(servo, PRESENT_POSITION, 4) - start[servo] - 400) < 60


def test_bulk_reads_and_writes_name_an_address_for_each(bus):
    writes = sdk.GroupBulkWrite(bus.port, bus.packets)
    assert writes.addParam(1, LED, 1, [1])
    assert writes.addParam(2, PROFILE_VELOCITY, 4, [44, 1, 0, 0])
    assert writes.txPacket() == sdk.COMM_SUCCESS
    for fast in (False, True):
        reads = sdk.GroupBulkRead(bus.port, bus.packets)
        assert reads.addParam(2, PROFILE_VELOCITY, 4)
        assert reads.addParam(1, LED, 1)
        again(reads.fastBulkRead if fast else reads.txRxPacket)
        assert reads.getData(1, LED, 1) == 1
        assert reads.getData(2, PROFILE_VELOCITY, 4) == 300


def test_modes_change_while_torque_is_off(bus):
    bus.drive(3)
    assert bus.write(3, OPERATING_MODE, CURRENT_BASED_POSITION) == ACCESS
    assert bus.write(3, TORQUE_ENABLE, 0) == 0
    position = bus.drive(3, CURRENT_BASED_POSITION)
    assert bus.write(3, GOAL_CURRENT, 100, 2) == 0
    assert bus.write(3, GOAL_POSITION, position + 20_000, 4) == 0
    time.sleep(1.5)
    # The goal current holds the tendon back far from the goal.
    assert bus.read(3, PRESENT_POSITION, 4) < position + 12_000
    assert 60 <= bus.read(3, PRESENT_CURRENT, 2) <= 110


def test_every_error_of_the_manual_comes(bus):
    # Read only, and not there.
    assert bus.write(1, PRESENT_POSITION, 0, 4) == ACCESS
    assert bus.write(1, 66, 0) == ACCESS
    assert bus.told(bus.packets.read1ByteTxRx, 1, 600)[-1] == ACCESS
    # EEPROM under torque.
    assert bus.write(1, TORQUE_ENABLE, 1) == 0
    assert bus.write(1, ID, 20) == ACCESS
    assert bus.write(1, LED, 2) == RANGE
    assert bus.write(1, GOAL_POSITION, 100, 2) == LENGTH
    assert bus.write(1, GOAL_POSITION, 5000, 4) == LIMIT
    # Nothing was registered; the SDK does not wait for the answer to an action, so it is asked for by hand.
    action = [0, 0, 0, 0, 1, 3, 0, sdk.INST_ACTION, 0, 0]
    assert by_hand(bus, action) == INSTRUCTION
    unknown = [0, 0, 0, 0, 1, 3, 0, 0x77, 0, 0]
    assert by_hand(bus, unknown) == INSTRUCTION
    assert by_hand(bus, [0, 0, 0, 0, 1, 3, 0, sdk.INST_PING, 0, 0], damage=1) == CRC


def by_hand(bus, packet, damage=0):
    """Sends a packet by the SDK's own framing, with its checksum damaged where asked for; the error byte of the answer."""
    for _ in range(8):
        frame = list(packet)
        frame[:4] = [0xFF, 0xFF, 0xFD, 0x00]
        crc = bus.packets.updateCRC(0, frame, len(frame) - 2) ^ damage
        frame[-2:] = [crc & 0xFF, crc >> 8]
        bus.port.clearPort()
        bus.port.writePort(bytes(frame))
        bus.port.setPacketTimeout(11)
        answer, result = bus.packets.rxPacket(bus.port, False)
        if result == sdk.COMM_SUCCESS:
            assert answer[sdk.protocol2_packet_handler.PKT_ID] == packet[4]
            return answer[sdk.protocol2_packet_handler.PKT_ERROR]
        time.sleep(0.1)
    raise AssertionError("no answer")


def test_a_hardware_error_alerts_until_the_reboot(bus):
    errors, alert = bus.told(bus.packets.read1ByteTxRx, OVERLOADED, HARDWARE_ERROR)
    assert (errors, alert) == (1 << 5, ALERT)
    assert bus.write(OVERLOADED, TORQUE_ENABLE, 1) == ALERT | RESULT
    assert bus.told(bus.packets.reboot, OVERLOADED) == (ALERT,)
    time.sleep(0.5)
    assert bus.read(OVERLOADED, HARDWARE_ERROR) == 0
    assert bus.write(OVERLOADED, TORQUE_ENABLE, 1) == 0


def test_the_watchdog_stops_and_locks_the_goals(bus):
    position = bus.drive(4)
    assert bus.write(4, PROFILE_VELOCITY, 40, 4) == 0
    assert bus.write(4, WATCHDOG, 10) == 0
    assert bus.write(4, GOAL_POSITION, position + 20_000, 4) == 0
    time.sleep(0.6)
    assert bus.read(4, WATCHDOG) == -1
    stopped = bus.read(4, PRESENT_POSITION, 4)
    assert position < stopped < position + 8_000
    assert bus.write(4, GOAL_POSITION, position, 4) == RANGE
    assert bus.write(4, WATCHDOG, 0) == 0
    assert bus.write(4, GOAL_POSITION, position, 4) == 0


def test_turns_are_cleared_and_lost_by_a_reboot(bus):
    position = bus.drive(1)
    assert bus.write(1, GOAL_POSITION, position - 2500, 4) == 0
    time.sleep(1.5)
    assert bus.read(1, PRESENT_POSITION, 4) < 0
    assert bus.told(bus.packets.clearMultiTurn, 1) == (0,)
    assert 0 <= bus.read(1, PRESENT_POSITION, 4) < 4096
