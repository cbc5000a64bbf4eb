"""Environments of Gymnasium: a reference is followed by a learner's actions. Importing this module registers them.

>>> import gymnasium
>>> import nacs.environments
>>> one = gymnasium.make("nacs/Tracking-v0", scenario="nacs/disturbance")
>>> many = gymnasium.make_vec("nacs/Tracking-v0", num_envs=64, scenario="nacs/wheel-failure")

Observation, action, reward and end of an episode: docs/gymnasium.md. The extra `rl` has what this needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationError

from nacs.arguments import real, table, whole, whole_if_given
from nacs.errors import extra, in_one_line
from nacs.nacs_error import NacsError
from nacs.scenarios import Source, load
from sim.bad_input import BadInput
from sim.campaign import cost, draws
from sim.campaign.settings import Campaign
from sim.loop import tracking_task
from sim.loop.open_loop import OpenLoop
from sim.scenario.validation import first_error
from sim.user_code.real_numbers import real_numbers

with extra("gymnasium", "rl"):
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]
SEEDS = 2**31


class _Task:
    """What both environments have: a scenario, what is dispersed, and spaces.

    Args:
      scenario: of one body, as for `nacs.run`; its filters and law do not fly, its faults do.
      trials: how many at once.
      set: dotted keys to values, taken instead of what the scenario says.
      loop: which of several closed loops, since one may be spared the faults; default: the first.
      dispersion: dotted keys of plant, sensors, faults and start to distributions, as in a campaign; drawn anew in every episode.
      torque_nm: N m of an action of one; default: the limit of a drive.
    """

    def __init__(
        self,
        scenario: Source,
        trials: int,
        set: Mapping[str, Any] | None,  # as the command calls it
        loop: str | None,
        dispersion: Mapping[str, Any] | None,
        torque_nm: float | None,
    ) -> None:
        trials, torque_nm = whole("num_envs", trials, 1), None if torque_nm is None else real("torque_nm", torque_nm)
        self._scenario, self._trials, self._loop = load(scenario, set=set, trials=trials), trials, loop
        self._dispersion = table("dispersion", dispersion)
        with in_one_line():
            cost.check(self._scenario, trials, kept=False)
            if self._dispersion:
                draws.check(self._campaign(0), self._scenario, Path("environment"))
            first = self.begin(self._scenario.run.seed)
            self.torque_nm = tracking_task.full_torque(first, torque_nm)
            greatest = tracking_task.greatest(first)
        self.observation_space = Box(-greatest, greatest, dtype=np.float64)
        self.action_space = Box(-1.0, 1.0, (3,), np.float64)

    def begin(self, seed: int) -> OpenLoop:
        """The first tick of an episode."""
        base = self._scenario.model_copy(update={"run": self._scenario.run.model_copy(update={"seed": seed})})  # type: ignore[attr-defined]
        numbers, variants = np.arange(self._trials), None
        with in_one_line():
            if self._dispersion:
                campaign = self._campaign(seed)
                if foreign := [key for key in self._dispersion if key not in draws.together(campaign, base)]:
                    raise BadInput(f"dispersion.{foreign[0]}: keys of {', '.join(draws.ROOTS)} can be dispersed")
                variants = draws.draw(campaign, base, numbers).variants
            return OpenLoop(base, numbers, self._loop, variants)

    def _campaign(self, seed: int) -> Campaign:
        said = {"title": "episodes", "scenario": "-", "seed": seed, "trials": self._trials, "dispersion": self._dispersion}
        try:
            return Campaign.model_validate(said)
        except ValidationError as invalid:
            raise BadInput(f"environment: {first_error(invalid, said, Campaign)}") from None

    def torque(self, action: ArrayLike) -> tuple[Array, Array]:
        """The action within its bounds, (trials, 3), and its torque on the bodies, N m."""
        try:
            asked = real_numbers(action).reshape(self._trials, 3)
        except (TypeError, ValueError):
            raise NacsError(
                f"action of shape {np.shape(np.asarray(action, dtype=object))}: must have {3 * self._trials} numbers, three for each body"
            ) from None
        if not np.isfinite(asked).all():
            raise NacsError(f"action is not finite: {asked[~np.isfinite(asked).all(axis=-1)][0].tolist()}")
        within = np.clip(asked, -1.0, 1.0)
        return within, self.torque_nm * within


class TrackingEnv(gymnasium.Env[Array, Array]):
    """One body follows the reference of its scenario."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  # as Gymnasium has it

    def __init__(
        self,
        scenario: Source = "nacs/fault-free",
        *,
        set: Mapping[str, Any] | None = None,  # as the command calls it
        loop: str | None = None,
        dispersion: Mapping[str, Any] | None = None,
        torque_nm: float | None = None,
    ) -> None:
        self.task = _Task(scenario, 1, set, loop, dispersion, torque_nm)
        self.observation_space, self.action_space = self.task.observation_space, self.task.action_space
        self._ended = True

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; the same `seed` begins the same series of episodes."""
        super().reset(seed=whole_if_given("seed", seed), options=table("options", options))
        self.loop, self._ended = self.task.begin(int(self.np_random.integers(SEEDS))), False
        return tracking_task.observation(self.loop)[0], self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Act for one control period."""
        if self._ended:
            raise NacsError("the episode is over; reset() begins another")
        within, torque = self.task.torque(action)
        self.loop.act(torque)
        terminated = bool(tracking_task.failed(self.loop)[0])
        truncated = self.loop.over and not terminated
        self._ended = terminated or truncated
        reward = float(tracking_task.reward(self.loop, within)[0])
        return tracking_task.observation(self.loop)[0], reward, terminated, truncated, self._info()

    def _info(self) -> dict[str, Any]:
        return {"error_deg": float(tracking_task.error_deg(self.loop)[0])}


class TrackingVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """Many bodies in one batch, on one clock.

    All begin at the scenario's start and are truncated at its last tick; the step after that begins the next episodes. A body that has
    failed is put back to its start by the step after, at the clock's time: noise, faults and reference go on.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 64,
        scenario: Source = "nacs/fault-free",
        *,
        set: Mapping[str, Any] | None = None,  # as the command calls it
        loop: str | None = None,
        dispersion: Mapping[str, Any] | None = None,
        torque_nm: float | None = None,
    ) -> None:
        self.num_envs = num_envs = whole("num_envs", num_envs, 1)
        self.task = _Task(scenario, num_envs, set, loop, dispersion, torque_nm)
        self.single_observation_space, self.single_action_space = self.task.observation_space, self.task.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended: Flags = np.zeros(num_envs, dtype=bool)
        self._begun = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin all episodes; the same `seed`, one number, begins the same series of episodes."""
        if table("options", options).get("reset_mask") is not None:
            raise NacsError("options['reset_mask']: the bodies share a clock and begin together")
        super().reset(seed=whole_if_given("seed", seed), options=options)
        self.loop, self._begun = self.task.begin(int(self.np_random.integers(SEEDS))), True
        self._ended = np.zeros(self.num_envs, dtype=bool)
        return tracking_task.observation(self.loop), self._info()

    def step(self, actions: Array) -> tuple[Array, Array, Flags, Flags, dict[str, Any]]:
        """Act for one control period."""
        if not self._begun:
            raise NacsError("no episode has begun; reset() begins them")
        within, torque = self.task.torque(actions)
        if self.loop.over:
            first, info = self.reset()
            none = np.zeros(self.num_envs, dtype=bool)
            return first, np.zeros(self.num_envs), none, none.copy(), info
        again = self._ended
        self.loop.act(np.where(again[:, None], 0.0, torque))
        if again.any():
            self.loop.restart(again)
        terminated = tracking_task.failed(self.loop) & ~again
        truncated = np.full(self.num_envs, self.loop.over) & ~terminated
        self._ended = terminated
        reward = np.where(again, 0.0, tracking_task.reward(self.loop, within))
        return tracking_task.observation(self.loop), reward, terminated, truncated, self._info()

    def _info(self) -> dict[str, Any]:
        return {"error_deg": tracking_task.error_deg(self.loop), "_error_deg": np.ones(self.num_envs, dtype=bool)}


gymnasium.register(
    "nacs/Tracking-v0", entry_point="nacs.environments:TrackingEnv", vector_entry_point="nacs.environments:TrackingVectorEnv"
)
