"""The paper's simulated robots as MuJoCo models, written from the paper's numbers alone."""

import mujoco

HOLES = [(0.0125, 0.0), (-0.00625, 0.010825), (-0.00625, -0.010825)]

# Modules, disc half height (m), pitch (m), actuator gain (N/m).
ROBOTS = {
    "2m": (2, 0.0085, 0.017, 500.0),
    "3m": (3, 0.0080, 0.016, 500.0),
    "5m": (5, 0.0080, 0.016, 700.0),
}


def density(robot, disc):
    """Disc density (kg/m3)."""
    return 25.0 - disc * 25.0 / 30.0 if robot == "5m" else 25.0


def mjcf(robot):
    """MJCF text of a robot: discs on ball joints, spatial tendons, position actuators."""
    modules, half_height, pitch, gain = ROBOTS[robot]
    discs = 5 * modules
    bodies = ""
    for disc in range(discs):
        offset = 0.00895 if disc == 0 else pitch
        sites = "".join(f'<site name="s{disc}_{k}" pos="{x} {y} 0"/>' for k, (x, y) in enumerate(HOLES))
        bodies += (
            f'<body name="disc{disc}" pos="0 0 {offset}">'
            '<joint type="ball" damping="0.1" armature="0.01"/>'
            f'<geom type="cylinder" size="0.02 {half_height}" density="{density(robot, disc)!r}"'
            ' contype="0" conaffinity="0"/>' + sites
        )
    bodies += "</body>" * discs
    base_sites = "".join(f'<site name="b_{k}" pos="{x} {y} -0.0085"/>' for k, (x, y) in enumerate(HOLES))
    tendons = actuators = ""
    for module in range(modules):
        for k in range(3):
            start = f"b_{k}" if module == 0 else f"s{5 * module - 1}_{k}"
            path = [start] + [f"s{5 * module + j}_{k}" for j in range(5)]
            name = f"t{module}_{k}"
            tendons += f'<spatial name="{name}">' + "".join(f'<site site="{s}"/>' for s in path) + "</spatial>"
            actuators += f'<position tendon="{name}" kp="{gain}" ctrlrange="0 0.04"/>'
    return (
        '<mujoco><option timestep="0.002" gravity="0 0 -9.81"/><worldbody>'
        f'<body name="base" pos="0 0 0.174">{base_sites}{bodies}</body></worldbody>'
        f"<tendon>{tendons}</tendon><actuator>{actuators}</actuator></mujoco>"
    )


def model(robot):
    """Compiled MuJoCo model of a robot."""
    return mujoco.MjModel.from_xml_string(mjcf(robot))
