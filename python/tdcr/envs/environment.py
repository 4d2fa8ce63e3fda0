"""The environments, one robot at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tdcr.envs.episodes import Episodes, Observation, first, first_info
from tdcr.envs.tasks import ReachGoal, Task
from tdcr.envs.window import Window
from tdcr.errors import InputError

PICTURES = ("rgb_array", "depth_array")
RENDER_MODES = (*PICTURES, "human")


class TendonRobotEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A tendon-driven continuum robot with a task.

    **Action**, shape (tendons,), -1 to 1: by how much the command of each tendon changes, in ``rate`` of its range; of the task
    Insert one more entry, how far the base is inserted. Commands stay within their ranges, so that no action is unsafe.

    **Observation**, float32: see ``env.unwrapped.layout``. Places are relative to the base and in lengths of the robot.

    **Episodes** never terminate. They are truncated after ``episode_length`` steps, and where the simulation cannot go on:
    the robot does not settle, or its motion diverges; ``info["simulation_failed"]`` tells which. It then stands where it
    last was.

    **Copies**, deep ones and pickled ones, go on where the environment was, to the last bit; among objects that move, from
    the same state, but not to the last bit.

    Args:
        task: Name of a task in :data:`tdcr.envs.TASKS`, or a subclass of :class:`tdcr.envs.Task`.
        robot: Anything that :class:`tdcr.Robot` takes.
        dynamics: Whether the robot moves in time; else each step leads to the equilibrium of its command. Of the task Push alone
            it is true without being given.
        randomise: Ranges ``(low, high)`` that parameters are drawn from at each reset: names of
            :meth:`tdcr.Robot.with_values`, in SI units; ``"payload"`` (kg); ``"disturbance"``, size of a force on the tip whose
            direction is drawn anew every 10 steps (N); ``"noise"``, standard deviation of what is added to all that is measured,
            in its unit; ``"delay"``, steps by which actions arrive late; and names of the task. :meth:`randomise` changes them.
        observation: ``"state"``: commands, places and quaternions of the discs, and in motion rates of the joints;
            ``"tip"``: commands, place and axis of the tip, and in motion its velocity; ``"cloud"``: commands, and the points
            that the robot's cameras see.
        frame_skip: Time steps of one step in motion.
        timestep: Time step in motion (s).
        episode_length: Steps of an episode.
        rate: Largest change of a command in one step, as a share of its range.
        tolerance: Distance that counts as success (m); without, 5 % of the robot's length.
        points: Points of a cloud.
        rig: A :class:`tdcr.Rig`, or its file, in place of a simulated robot, for tasks of reaching: actions move its servos,
            and its cameras measure the tip. Episodes start in the home pose. An action under which the simulator finds a
            tendon slack or overloaded moves nothing. Pictures are those of the rig's cameras, in their own size.
        scene: Obstacles around a simulated robot. Pictures show them; clouds are of the robot alone, behind them. ``info`` has
            ``contacts`` (their number), ``contact_force`` and ``contact_max`` (sum and largest of their forces, N) and
            ``disc_forces`` (force on each disc, world frame, shape (discs, 3), N): in motion those of the last time step. Robots
            that do not move in time slide along obstacles without friction.
        contact_cost: What the reward loses for each newton of ``contact_force``; not of goal-based tasks.
        action: ``"increment"``, or ``"absolute"``: the command itself, -1 to 1 over its range, approached by ``rate`` a step.
        tension_range: Drives all tendons by tensions (N) of this range ``(low, high)``, in place of what the robot's file says;
            the robot needs an elastic backbone to stand so.
        observe_tensions: Whether the tendons' tensions (N) are observed, too.
        weights: Factors of the reward's terms, by name: ``info`` has each as it counts, ``reward_distance`` and its like. Besides
            the terms of the task, ``"change"`` is minus the mean square of the commands' changes, in units of the largest ones;
            by default it is left out. Not of goal-based tasks.
        render_mode: ``"rgb_array"``, ``"depth_array"``, or ``"human"``: each reset and step is shown on a page of
            :func:`tdcr.view` in a browser, at ``metadata["render_fps"]`` steps a second, until the environment is closed. Where
            there is no browser a warning has the page's address; ``env.unwrapped.window.viewer`` is the page.
        camera, width, height: Which of the robot's cameras pictures are of, and their size.
        target: Of the task Shape: ``"poses"`` or ``"cloud"``.
        preview: Of the task Track: points of the path that are observed.

    Raises:
        InputError: For arguments that make no sense; RobotError and ParameterError for robots and their parameters.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 25}

    def __init__(self, task: str | Callable[..., Task] = "reach", render_mode: str | None = None, **arguments: Any) -> None:
        if render_mode not in (None, *RENDER_MODES):
            raise InputError(f"render_mode is {render_mode!r}; expected one of {', '.join(RENDER_MODES)}, or None")
        self.render_mode = render_mode
        self.episodes = Episodes(1, task, **arguments)
        self.window = Window()
        self.metadata = {**self.metadata, "render_fps": self.episodes.world.settings.render_fps}
        self.layout = self.episodes.layout
        self.action_space = self.episodes.action_space
        self.observation_space = self.episodes.observation_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Starts a new episode, which depends on ``np_random`` and ``options`` alone.

        Args:
            seed: Of ``np_random``; without, it goes on.
            options: ``"start"``: the command that the episode starts under, shape (entries,) (m or N); ``"payload"``: what hangs
                from the tip (kg), in place of what is drawn; of tasks of reaching ``"goal"``: the point that is asked for, world
                frame, shape (3,) (m). On a rig the last alone.

        Raises:
            InputError: For options that the task does not take.
            NotSettledError: For a start at which the robot does not settle.
            ContactError: In a scene, for a straight robot inside an obstacle.
            DynamicsError: In motion, if the time step is too long for the robot.
        """
        asked = self.episodes.check_options(options)
        super().reset(seed=seed)
        self.episodes.reset([0], [self.np_random], asked)
        observation, _, _, infos = self.episodes.look()
        self._show()
        return first(observation), first_info(infos)

    def _show(self) -> None:
        """Shows the robot on the page of ``"human"``."""
        if self.render_mode == "human":
            self.window.show(self.episodes, self.metadata["render_fps"])

    def randomise(self, ranges: Mapping[str, tuple[float, float]]) -> None:
        """Other ranges of ``randomise``, from the next reset on, as a curriculum has them; ranges of other names stay.

        Raises:
            InputError: For ends that make no range, on a rig, and for values that the task cannot have.
            ParameterError: For names that the robot does not have.
        """
        self.episodes.randomise(ranges)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Takes a step."""
        episodes = self.episodes
        episodes.drive(np.asarray(action)[np.newaxis])
        observation, rewards, truncated, infos = episodes.look()
        self._show()
        return first(observation), rewards.item(0), False, truncated.item(0), first_info(infos)

    def render(self) -> Any:
        """The picture of ``render_mode``: colours, shape (height, width, 3), or depth (m), shape (height, width). ``None`` for
        ``"human"``, whose page shows each step by itself."""
        return self.episodes.picture(0, self.render_mode) if self.render_mode in PICTURES else None

    def close(self) -> None:
        """Lets go of the robot: on a rig, the tension is released. Ends the page of ``"human"``."""
        self.episodes.world.close()
        self.window.close()


class TendonRobotGoalEnv(TendonRobotEnv):
    """The same for goal-based tasks, as hindsight experience replay (HER) takes them: observations are dictionaries of
    ``observation``, ``achieved_goal`` and ``desired_goal``, and the reward of any goal can be computed.
    """

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any = None) -> Any:
        """Reward for having achieved a goal; any number of leading axes, as HER asks for."""
        return _of_goals(self.episodes).compute_reward(achieved_goal, desired_goal)

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any = None) -> bool:
        """Whether having achieved a goal ends an episode: never."""
        return False

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any = None) -> bool:
        """Whether an episode is cut off for a goal: never."""
        return False


def _of_goals(episodes: Episodes) -> ReachGoal:
    if not isinstance(episodes.task, ReachGoal):
        raise InputError(f"{type(episodes.task).__name__} is not a goal-based task; expected ReachGoal")
    return episodes.task
