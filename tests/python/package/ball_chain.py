"""A chain of four balls in contact with a ball and a wall, and its energy written out."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

import tdcr
from tdcr import Obstacle, Scene

PITCH, RADIUS, GAIN, COMPLIANCE = 0.03, 0.008, 400.0, 1e-6
BENDING = [0.15, 0.2, 0.25]
HOLES = [[0.006, 0.0], [-0.003, 0.0052], [-0.003, -0.0052]]
BALLS = tdcr.Robot(
    {
        "name": "balls",
        "gravity": [0.0, 0.0, -9.81],
        "routing": "base",
        "base": {"position": [0.0, 0.0, 0.05], "holes": HOLES, "hole_height": 0.0},
        "modules": [
            {
                "discs": 4,
                "pitch": PITCH,
                "radius": RADIUS,
                "half_height": RADIUS,  # As tall as wide: its collision geometry is one ball.
                "mass": {"density": 1000.0},
                "holes": HOLES,
                "damping": 0.01,
                "armature": 1e-4,
                "backbone": {"bending": BENDING[:2], "torsion": BENDING[2]},
                "tendons": {"drive": {"gain": GAIN}, "range": [0.0, 0.2]},
            }
        ],
    }
)
COMMAND = np.array([0.08, 0.116, 0.12])
PAYLOAD = 0.02
BALL = Obstacle.sphere("ball", 0.03, position=(0.044, 0.012, 0.125), compliance=COMPLIANCE)
WALL = Obstacle.half_space("wall", position=(0.05, 0.0, 0.0), orientation=(0.7, 0.0, -0.75, 0.05), compliance=COMPLIANCE)
SCENE = Scene([BALL, WALL])


def turn(vector: Any) -> Any:
    """Rotation matrix of a rotation vector, which may be complex."""
    x, y, z = vector
    square = x * x + y * y + z * z
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if abs(square) < 1e-12:
        return np.eye(3) + cross + cross @ cross / 2
    angle = np.sqrt(square)
    return np.eye(3) + np.sin(angle) / angle * cross + (1 - np.cos(angle)) / square * cross @ cross


def place(turns: Any) -> tuple[list[Any], list[Any]]:
    """Origins and rotations of the base and the discs."""
    origins, rotations = [np.array([0, 0, 0.05])], [np.eye(3)]
    for vector in turns.reshape(4, 3):
        origins.append(origins[-1] + rotations[-1] @ [0, 0, PITCH])
        rotations.append(rotations[-1] @ turn(vector))
    return origins, rotations


def energy(turns: Any) -> Any:
    """Of joints, tendons, weights and payload (J)."""
    origins, rotations = place(turns)
    mass = 1000.0 * np.pi * RADIUS**2 * 2 * RADIUS
    found = sum(mass * 9.81 * origin[2] for origin in origins[1:]) + PAYLOAD * 9.81 * origins[-1][2]
    found = found + (np.array(BENDING) * turns.reshape(4, 3) ** 2).sum() / 2
    for hole, command in zip(HOLES, COMMAND, strict=True):
        points = [origin + rotation @ [*hole, 0] for origin, rotation in zip(origins, rotations, strict=True)]
        pieces = [np.sqrt(((b - a) ** 2).sum()) for a, b in itertools.pairwise(points)]
        found = found + GAIN / 2 * (sum(pieces) - command) ** 2
    return found


def gaps(turns: Any) -> Any:
    """Of each disc from the ball and the wall (m)."""
    w, x, y, z = np.array(WALL.orientation) / np.linalg.norm(WALL.orientation)
    normal = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    found = []
    for origin in place(turns)[0][1:]:
        away = origin - BALL.position
        found += [np.sqrt((away**2).sum()) - 0.03 - RADIUS, normal @ (origin - WALL.position) - RADIUS]
    return np.array(found)


def derivative(function: Any, turns: Any) -> Any:
    """By steps along the imaginary axis, exact to rounding."""
    return np.array([np.imag(function(turns + 1e-30j * unit)) / 1e-30 for unit in np.eye(12)]).T
