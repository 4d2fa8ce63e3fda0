"""Statics by MuJoCo's own forces."""

import mujoco
import numpy as np


def place(m, orientations, command, payload):
    """MuJoCo data with the discs turned to world `orientations` (w, x, y, z), and the tip loaded."""
    d = mujoco.MjData(m)
    below = np.array([1.0, 0.0, 0.0, 0.0])
    for disc, orientation in enumerate(np.array(orientations)):
        inverse, relative = np.zeros(4), np.zeros(4)
        mujoco.mju_negQuat(inverse, below)
        mujoco.mju_mulQuat(relative, inverse, orientation)
        d.qpos[4 * disc : 4 * disc + 4] = relative / np.linalg.norm(relative)
        below = orientation
    d.ctrl[:] = command
    d.xfrc_applied[-1, 2] = -9.81 * payload
    mujoco.mj_forward(m, d)
    return d


def force(m, d):
    """Generalised force that would set the robot at rest in motion (N m)."""
    mujoco.mj_forward(m, d)
    applied = np.zeros(m.nv)
    for body in np.flatnonzero(d.xfrc_applied.any(axis=1)):
        wrench = d.xfrc_applied[body]
        mujoco.mj_applyFT(m, d, wrench[:3], wrench[3:], d.xipos[body], body, applied)
    return d.qfrc_actuator + d.qfrc_passive - d.qfrc_bias + applied


def refine(m, d, tolerance=1e-10):
    """Newton's method on MuJoCo's own forces, their Jacobian by central differences."""
    d.qvel[:] = 0
    start = d.qpos.copy()
    for _ in range(60):
        f = force(m, d)
        if np.abs(f).max() <= tolerance:
            return
        start[:] = d.qpos
        jacobian = np.zeros((m.nv, m.nv))
        for i in range(m.nv):
            for sign in (1, -1):
                turn = np.zeros(m.nv)
                turn[i] = sign * 1e-6
                d.qpos[:] = start
                mujoco.mj_integratePos(m, d.qpos, turn, 1.0)
                jacobian[:, i] += sign * force(m, d) / 2e-6
        step = np.linalg.solve(jacobian, -f)
        step *= min(1.0, 0.3 / np.abs(step).max())
        d.qpos[:] = start
        mujoco.mj_integratePos(m, d.qpos, step, 1.0)
    raise AssertionError("MuJoCo's forces were not brought to zero")
