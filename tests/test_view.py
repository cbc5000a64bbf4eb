"""`nacs view`, with a window that only notes what it is shown."""

from __future__ import annotations

import sys
import types
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.motion import motion
from sim.plant.batch import Plant
from sim.plant.kinds import compile_plant
from sim.scenario import files

ONE = ("--set", "run.ticks=4", "--set", "faults=[]")


class Window:
    """What `mujoco.viewer.launch_passive` gives."""

    def __init__(self, model, data, **_: object) -> None:
        self.model, self.data, self.cam, self.shown, self.open = model, data, mujoco.MjvCamera(), [], 10_000

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def is_running(self) -> bool:
        return len(self.shown) < self.open

    def sync(self) -> None:
        self.shown.append((self.data.time, self.data.qpos.copy()))


@pytest.fixture
def windows(monkeypatch):
    """Windows that were opened; nobody waits for them."""
    opened: list[Window] = []

    def launch(*arguments, **named):
        opened.append(Window(*arguments, **named))
        return opened[-1]

    passive = types.ModuleType("mujoco.viewer")
    passive.launch_passive = launch
    monkeypatch.setitem(sys.modules, "mujoco.viewer", passive)
    monkeypatch.setattr(mujoco, "viewer", passive, raising=False)
    monkeypatch.delitem(sys.modules, "sim.cli.commands.viewer", raising=False)
    from sim.cli.commands import viewer  # noqa: PLC0415  # with that window

    monkeypatch.setattr(viewer, "time", SimpleNamespace(perf_counter=lambda: 0.0, sleep=lambda _: None))
    monkeypatch.setenv("DISPLAY", ":0")
    return opened


def test_one_body_flies_its_first_trial(nacs, windows) -> None:
    result = nacs("view", "nacs/disturbance", *ONE)
    assert (result.code, result.out, len(windows)) == (0, "", 1), result.err
    assert len(windows[0].shown) == 4 * 6
    assert windows[0].shown[-1][0] == pytest.approx(0.3)


def test_of_several_loops_the_first_is_flown_and_named(nacs, windows) -> None:
    result = nacs("view", "wmap/compare", *ONE)
    assert result.code == 0, result.err
    assert result.out.startswith("loop pd-ukf of wmap/compare; --loop shows another: pd-imm, ")


def test_another_loop_moves_another_way(nacs, windows) -> None:
    changes = ("--set", "run.ticks=20", "--set", "faults=[]")
    assert nacs("view", "wmap/compare", *changes).code == 0
    result = nacs("view", "wmap/compare", *changes, "--loop", "smc-ukf")
    assert result.out.startswith("loop smc-ukf of wmap/compare")
    assert not np.array_equal(windows[0].shown[-1][1], windows[1].shown[-1][1])


@pytest.mark.parametrize(
    ("name", "loop", "dt", "settings"),
    [
        ("formation/nacs", "truth", 0.01, ("phases={}",)),
        ("formation/fault-free", "aukf", 0.01, ("phases={}",)),
        ("consensus/fault-free", "adtl", 0.01, ()),
    ],
)
def test_agents_are_simulated_then_shown(nacs, windows, name: str, loop: str, dt: float, settings: tuple[str, ...]) -> None:
    more = [part for setting in settings for part in ("--set", setting)]
    result = nacs("view", name, "--set", "run.ticks=41", *more, "--loop", loop)
    assert result.code == 0, result.err
    assert f"loop {loop} of {name}" in result.out
    shown = windows[0].shown
    np.testing.assert_allclose([time for time, _ in shown], 2 * dt * np.arange(21))  # 50 of 100 ticks a second
    assert windows[0].model.ngeom > 6  # with what a person looks at
    assert not np.array_equal(shown[0][1], shown[-1][1])
    changes = {"run.ticks": 41, "run.trials": 1} | ({"phases": {}} if settings else {})
    np.testing.assert_array_equal(shown[-1][1], motion(files.load(name, changes), loop).qpos[40])


def test_free_agents_are_where_and_as_their_plant_has_them() -> None:
    scenario = files.load("formation/fault-free", {"run.ticks": 3, "phases": {}})
    moved = motion(scenario, "truth")
    flown = run(build(scenario, np.arange(1), loop="truth"))
    data = mujoco.MjData(moved.scene)
    data.qpos[:] = moved.qpos[2]
    mujoco.mj_forward(moved.scene, data)
    bodies = [int(moved.scene.joint(name).bodyid[0]) for name in compile_plant(scenario.plant).attitude_joints]
    np.testing.assert_allclose(data.xpos[bodies], scenario.plant.places, atol=1e-12)
    turned = data.xquat[bodies][:, [1, 2, 3, 0]]
    np.testing.assert_allclose(np.abs(np.sum(turned * flown.channels["truth/q_BN"][2, 0], axis=-1)), 1.0, atol=1e-12)


def test_closing_the_window_ends_it(nacs, windows, monkeypatch) -> None:
    monkeypatch.setattr(Window, "is_running", lambda self: len(self.shown) < 3)
    assert nacs("view", "nacs/disturbance", *ONE).code == 130
    assert nacs("view", "consensus/fault-free", "--set", "run.ticks=10").code == 130
    assert [len(window.shown) for window in windows] == [3, 3]


def test_a_failed_simulation_is_one_line(nacs, windows, monkeypatch) -> None:
    advance = Plant.advance

    def sabotage(self, wheel_torque, torque_B, steps):
        advance(self, wheel_torque * np.nan, torque_B, steps)

    monkeypatch.setattr(Plant, "advance", sabotage)
    result = nacs("view", "nacs/disturbance", *ONE)
    assert result.code == 3
    assert result.err.startswith("error: trial 0 failed")


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["formation/nacs", "--loop", "ekf"], ["--loop ekf", "formation/nacs flies truth, aukf, pf"]),
        (["nacs/disturbance", "--loop", "ekf"], ["--loop ekf", "one loop"]),
        (["formation/nacs", "--set", "plant.agent=3"], ["plant.agent", "unknown key"]),
        (["formation/nac"], ["no scenario", "did you mean formation/nacs?"]),
    ],
)
def test_what_cannot_be_shown_is_one_line(nacs, windows, arguments: list[str], parts: list[str]) -> None:
    result = nacs("view", *arguments)
    assert (result.code, result.out, windows) == (2, "", [])
    assert result.err.count("\n") == 1
    assert all(part in result.err for part in parts)


def test_without_a_display_it_says_so(nacs, monkeypatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    result = nacs("view", "formation/nacs")
    assert result.code == 2
    assert "needs a display" in result.err
