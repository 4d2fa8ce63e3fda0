"""Parameters of robots by name: the list of them, and those that stand for the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError, ParameterError

ROBOT = tdcr.Robot("2m")
COMMAND = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
OVERLAPS = (
    ["hole_radius[0]", "hole_radius[3]"],
    ["hole[5][0].x", "hole[7][0].x"],
    ["hole_radius[base]", "hole[base][1].y"],
    ["gain[2]", "gain[2]"],
)


def test_the_parameters_of_a_robot_are_listed_with_what_they_act_on() -> None:
    listed = tdcr.parameters(ROBOT)
    assert len(listed) == len(listed.names) == len(set(listed.names)) == len(listed.values) == 35
    for parameter in listed:
        assert parameter.value == ROBOT.value(parameter.name) and parameter.unit
        # Each acts, and on what it says it does: no other tendon's tension law or module's discs.
        moved = ROBOT.with_values({parameter.name: parameter.value + 1e-4 * max(1.0, abs(parameter.value))})
        changed = [other.name for other in listed if moved.value(other.name) != other.value]
        assert parameter.name in changed and set(changed) <= {parameter.name, *parameter.overlaps}
    radius = listed["hole_radius[5]"]
    assert (radius.unit, radius.module, radius.discs) == ("m", 1, (5, 6, 7, 8, 9))
    assert radius.value == pytest.approx(0.0125, rel=1e-4)
    assert radius.acts_on == "module 1 (discs 5 to 9)" and "hole[5][2].y" in radius.overlaps
    assert listed["gain[4]"].tendons == (4,) and listed["gain[4]"].acts_on == "tendon 4"
    assert listed["hole_radius[base]"].acts_on == "base"
    assert radius.bounds == (0.0, np.inf) and listed["hole[5][2].y"].bounds == (-np.inf, np.inf)
    assert all(low <= parameter.value <= high for parameter in listed for low, high in [parameter.bounds])
    assert "damping[1]" in listed and "youngs[0]" not in listed and listed[:3].names == listed.names[:3]
    assert len(repr(tdcr.parameters(tdcr.Robot("5m"))).splitlines()) <= 20
    with pytest.raises(ParameterError, match="no parameter 'gain' here; expected one of gain\\[0\\], "):
        listed["gain"]


@pytest.mark.parametrize("names", OVERLAPS, ids="-".join)
def test_parameters_that_overlap_are_refused_wherever_they_are_named(names: list[str]) -> None:
    says = rf"^parameters `{names[0]}` and `{names[1]}` of robot `2m` overlap".replace("[", r"\[").replace("]", r"\]")

    def refused() -> pytest.RaisesExc[ParameterError]:
        return pytest.raises(ParameterError, match=says)

    batch = np.stack([COMMAND, COMMAND])
    with refused():
        ROBOT.check_parameters(names)
    with refused():
        tdcr.jacobian(ROBOT, COMMAND, names)
    with refused():
        tdcr.jvp(ROBOT, batch, names, [1.0, 1.0])
    with refused():
        tdcr.vjp(ROBOT, batch, names, np.ones((2, 10, 3)))
    with refused():
        tdcr.rollout_vjp(ROBOT, batch[:, None], np.ones((2, 1, 10, 3)), parameters=names)
    with refused():
        rates = tdcr.RolloutRates(parameters=np.ones((2, 2)))
        tdcr.rollout_jvp(ROBOT, batch[:, None], rates, parameters=names)
    if names[0] != names[1]:
        with refused():
            ROBOT.with_values({name: 0.0125 for name in names})
    # Alone and in other company they are right.
    tdcr.jacobian(ROBOT, COMMAND, [names[0], "pitch[1]"])


def test_other_doors_refuse_them_too() -> None:
    tips = tdcr.settle_batch(ROBOT, ROBOT.random_commands(4)).positions
    commands = ROBOT.random_commands(4)
    with pytest.raises(InputError, match=r"`hole_radius\[0\]` and `hole_radius\[3\]` set the same thing"):
        tdcr.calibrate(ROBOT, ["hole_radius[0]", "hole_radius[3]"], commands, tips)
    with pytest.raises(ParameterError, match="overlap"):
        tdcr.calibrate(ROBOT, {"radius": ["hole_radius[0]", "hole_radius[3]"]}, commands, tips)
    with pytest.raises(InputError, match="set the same numbers"):
        vary = [{"what": f"hole_radius[{disc}]", "values": [0.0125, 0.013]} for disc in (0, 3)]
        tdcr.study({"want": ["tip"], "vary": vary}, "never")
    envs = pytest.importorskip("tdcr.envs")
    with pytest.raises(ParameterError, match=r"`hole_radius\[0\]` and `hole_radius\[3\]` of robot `2m` overlap"):
        envs.TendonRobotEnv("reach", randomise={f"hole_radius[{disc}]": (0.012, 0.013) for disc in (0, 3)})


@pytest.mark.parametrize("module", ["torch", "jax"])
def test_frameworks_refuse_them_too(module: str) -> None:
    library = pytest.importorskip(module)
    framework = pytest.importorskip(f"tdcr.{module}")
    as_array = library.tensor if module == "torch" else np.asarray
    names, values = ["hole_radius[0]", "hole_radius[3]"], np.array([0.0125, 0.0125])
    at_rest = np.tile([1.0, 0.0, 0.0, 0.0], (10, 1))
    with pytest.raises(ParameterError, match="overlap"):
        framework.settle(ROBOT, as_array(COMMAND), parameters=names, values=as_array(values))
    with pytest.raises(ParameterError, match="overlap"):
        framework.rollout(ROBOT, as_array(COMMAND[None]), as_array(at_rest), parameters=names, values=as_array(values))


def test_the_payload_may_be_a_parameter_of_a_motion() -> None:
    """Beside the derivative by the payload that there is anyway."""
    commands, by = np.tile(COMMAND, (1, 3, 1)), np.ones((1, 3, 10, 3))
    found = tdcr.rollout_vjp(ROBOT, commands, by, payload=0.01, parameters=["gain[0]", "payload", "pitch[0]"])
    assert found.parameters[0, 1] == found.payload[0] != 0.0
    without = tdcr.rollout_vjp(ROBOT, commands, by, payload=0.01, parameters=["gain[0]", "pitch[0]"])
    assert np.array_equal(found.parameters[:, [0, 2]], without.parameters) and without.payload == found.payload
